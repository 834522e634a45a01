"""Blur in the rendered light: depth of field, and motion of the rig during the exposure and the readout.

Both depend on settings of the camera response (aperture, exposure time). Other changes of these settings need no new
render. A pair therefore stores the response for which it was rendered, and developing it with another exposure time
gives a warning.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..rig.focal_length import focal_px

#: Relative difference of exposure or aperture above which a warning is given.
_MIN_RELATIVE_CHANGE = 0.01
#: Largest rotation in degrees during an exposure and a readout. Beyond it, ends and middle do not determine the path.
_MAX_TURN_DEG = 90.0
_SPEEDS = ("speed_right_m_s", "speed_down_m_s", "speed_forward_m_s")
_TURNS = ("turn_right_deg_s", "turn_down_deg_s", "roll_deg_s")

#: Settings by which the rows of two identical eyes differ from the rows of the parallel pair.
_BENDING = (
    "rig.toe_in_deg",
    *(f"rig.distortion_{term}" for term in ("k1", "k2", "p1", "p2", "k3")),
)

#: The ``rig`` settings that blur the image by motion if they are not 0.
MOTION = (*_SPEEDS, *_TURNS)
#: Advice on blurred pairs; the placeholder takes the time of the truth.
TRUTH_IS_SHARP = "The images are blurred, truth is sharp: that of a pinhole{}."


@dataclass(frozen=True)
class Blur:
    """The causes of an image's blur. ``focus_m`` is None without depth of field, ``exposure_s`` without motion.

    Axes are the left eye's: x right, y down, z forward. ``turn_deg_s`` is a rotation vector. ``readout_s`` is 0 for a
    global shutter, see ``rolling_shutter``.
    """

    focus_m: float | None
    f_number: float
    exposure_s: float | None
    velocity_m_s: Array  # (3,)
    turn_deg_s: Array  # (3,)
    readout_s: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the ``blur`` table of ``pair.json``: the blur of the rendered images."""
        found: dict[str, Any] = {"truth": self.warning}
        if self.focus_m is not None:
            found |= {"focus_distance_m": self.focus_m, "f_number": self.f_number}
        if self.exposure_s is not None:
            found |= {
                "exposure_s": self.exposure_s,
                "velocity_m_s": self.velocity_m_s.tolist(),
                "turn_deg_s": self.turn_deg_s.tolist(),
            }
        if self.readout_s:
            found["readout_s"] = self.readout_s
        return found

    @property
    def warning(self) -> str:
        """A sentence on the camera to which the truth belongs."""
        whose = "each row's" if self.readout_s else "the"
        return TRUTH_IS_SHARP.format("" if self.exposure_s is None else f" in the middle of {whose} exposure")


def find_blur(settings: Settings) -> Blur | None:
    """Find the blur that complete settings describe; None without blur. Raises IcyMoonError for a focus nearer than the
    focal length, for motion with unknown exposure time, and for a rotation of more than a quarter turn during exposure
    and readout. For a rolling shutter, raises as ``check_rows_of_lens`` does.
    """
    rig, sensor = settings.rig, settings.sensor
    focus, (velocity, turn) = float(rig.focus_distance_m), read_motion(rig)
    moves = bool(velocity.any() or turn.any())
    readout = float(rig.readout_s) if moves else 0.0
    if not is_blurred(rig):
        return None
    if 0 < focus <= 1e-3 * float(rig.focal_length_mm):
        raise IcyMoonError(
            f"rig.focus_distance_m is {focus:g} m, but a lens of {rig.focal_length_mm:g} mm focuses only beyond its "
            "focal length; raise it, or set it to 0 for everything sharp."
        )
    seconds = float(rig.motion_exposure_s) or float(sensor.exposure_s)
    if moves and rig.motion_exposure_s == 0 and sensor.auto_exposure:
        raise IcyMoonError(
            "The camera moves, but its exposure time is not known before the render; set "
            "rig.motion_exposure_s, or switch sensor.auto_exposure off."
        )
    if moves and np.linalg.norm(turn) * (seconds + readout) > _MAX_TURN_DEG:
        raise IcyMoonError(
            f"The rig turns by {np.linalg.norm(turn) * (seconds + readout):.4g}° during an exposure of {seconds:g} s"
            f"{f' and a readout of {readout:g} s' if readout else ''}; motion blur is made for {_MAX_TURN_DEG:g}° at "
            "most."
        )
    check_rows_of_lens(rig)
    return Blur(focus or None, float(sensor.f_number), seconds if moves else None, velocity, turn, readout)


def check_truth_of_rows(settings: Settings) -> None:
    """Raise IcyMoonError if complete settings ask Cycles for the truth of a rolling shutter."""
    rig = settings.rig
    if has_rolling_shutter(rig) and rig.images == "PAIR" and settings.quality.truth_by == "CYCLES":
        raise IcyMoonError(
            f"rig.readout_s is {rig.readout_s:g} s, and Cycles renders truth for one pose of all rows; set "
            "quality.truth_by to RAYS, or rig.readout_s to 0."
        )


def has_rolling_shutter(rig: RigSettings) -> bool:
    """Return whether the rows of a rig's images have different poses."""
    return bool(rig.readout_s) and any(rig[key] for key in MOTION)


def read_motion(rig: RigSettings) -> tuple[Array, Array]:
    """Read the velocity (3,) in m/s and the rotation vector (3,) in deg/s of a rig, in the left eye's axes x right, y
    down, z forward.
    """
    right, down, roll = _read_vector(rig, _TURNS)
    return _read_vector(rig, _SPEEDS), np.array([-down, right, roll])


def check_rows_of_lens(rig: RigSettings) -> None:
    """Raise IcyMoonError for a rolling shutter in eyes that are calibrated or toed in, or whose lens distorts. The rows
    of their sensors are not the rows of the parallel pair, to which the truth and the rectified images belong.
    """
    if not has_rolling_shutter(rig):
        return
    alike = rig.eyes == "ALIKE"
    wrong = ["rig.eyes"] if not alike else [key for key in _BENDING if rig[key.removeprefix("rig.")]]
    if wrong:
        raise IcyMoonError(
            f"rig.readout_s is {rig.readout_s:g} s, and with {wrong[0]} a row of the sensor is not a row of the "
            f"parallel pair; set {wrong[0]} to {0 if alike else 'ALIKE'}, or rig.readout_s to 0."
        )


def is_blurred(rig: RigSettings) -> bool:
    """Return whether a rig's images are blurred by depth of field or motion."""
    return rig.focus_distance_m != 0 or any(rig[key] for key in MOTION)


def _read_vector(rig: RigSettings, keys: tuple[str, ...]) -> Array:
    return np.array([float(rig[key]) for key in keys])


def advise_on_blur(settings: Settings) -> list[str]:
    """List sentences to show before a render: that the truth is sharp, or the reason why the blur cannot be
    rendered.
    """
    try:
        blur = find_blur(settings)
    except IcyMoonError as error:
        return [str(error)]
    return [blur.warning] if blur else []


def describe_blur_identity(settings: Settings) -> str:
    """Describe the camera response on which the rendered light depends, for the name of the pair; empty without
    blur.
    """
    blur = find_blur(settings)
    check_truth_of_rows(settings)
    if blur is None:
        return ""
    return f"f/{blur.f_number if blur.focus_m is not None else None} {blur.exposure_s} s"


def warn_on_blur_mismatch(settings: Settings, rendered: Settings, exposures_s: list[float]) -> list[str]:
    """List sentences on differences between the blur of a ``rendered`` pair and the ``settings`` that develop it."""
    blur = find_blur(rendered)
    if blur is None:
        return []
    said = [blur.warning]
    f_number = float(settings.sensor.f_number)
    if blur.focus_m is not None and abs(f_number / blur.f_number - 1) > _MIN_RELATIVE_CHANGE:
        said.append(
            f"Depth of field is that of f/{blur.f_number:g}, at which the pair was rendered, but its light belongs to "
            f"f/{f_number:g}; render it again."
        )
    far = [t for t in exposures_s if blur.exposure_s and abs(t / blur.exposure_s - 1) > _MIN_RELATIVE_CHANGE]
    if far:
        said.append(
            f"Motion blur is that of {blur.exposure_s:.4g} s, for which the pair was rendered, but its exposure is "
            f"{', '.join(f'{t:.4g} s' for t in far)}; make the two times equal and render it again."
        )
    return said


def circle_of_confusion_px(depth_m: float, rig: RigSettings, blur: Blur) -> float:
    """Compute the diameter in px of the disc that images a point at a planar depth; 0 without depth of field.

    With a thin lens it is f (F/N) |1 / focus - 1 / depth|, where f is the focal length in px and F/N the width of the
    aperture.
    """
    if blur.focus_m is None:
        return 0.0
    aperture_m = 1e-3 * float(rig.focal_length_mm) / blur.f_number
    return focal_px(rig) * aperture_m * abs(1 / blur.focus_m - 1 / depth_m)


def motion_blur_px(column_px: float, row_px: float, depth_m: float, rig: RigSettings, blur: Blur) -> float:
    """Compute the distance in px between the images of a point when the left eye's exposure begins and when it ends.

    In the middle of the exposure the point is ``column_px`` right of and ``row_px`` below the principal point. The
    distance is infinite if the camera passes the point, and 0 without motion.
    """
    if blur.exposure_s is None:
        return 0.0
    focal = focal_px(rig)
    point = depth_m * np.array([column_px / focal, row_px / focal, 1.0])
    ends = [find_pose_after(blur, side * blur.exposure_s / 2) for side in (-1, 1)]
    seen = [pose[:3, :3].T @ (point - pose[:3, 3]) for pose in ends]
    if min(p[2] for p in seen) <= 0:
        return math.inf
    return float(np.linalg.norm(np.subtract(*(focal * p[:2] / p[2] for p in seen))))


class SteadyMotion(Protocol):
    """A motion with constant velocity and rotation, in the axes of the left eye at time 0."""

    @property
    def velocity_m_s(self) -> Array:
        """Velocity (3,) in m/s."""

    @property
    def turn_deg_s(self) -> Array:
        """Rotation vector (3,) in degrees per second."""


def find_pose_after(motion: SteadyMotion, seconds: float) -> Array:
    """Find the pose (4, 4) of the left eye ``seconds`` after the middle of the exposure, in the eye's axes at that
    middle (x right, y down, z forward).
    """
    pose = np.eye(4)
    angle = math.radians(float(np.linalg.norm(motion.turn_deg_s))) * seconds
    if angle:
        x, y, z = motion.turn_deg_s / np.linalg.norm(motion.turn_deg_s)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        pose[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross  # Rodrigues
    pose[:3, 3] = motion.velocity_m_s * seconds
    return pose
