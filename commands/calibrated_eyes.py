"""Settings of a rig whose eyes are two different calibrated cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.calibrations.options import Reading, Stated, convert_to_brown
from ..formats.calibrations.ros import make_ros_pair
from ..formats.ros_camera import read_ros_camera
from ..physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ..physics.camera.eyes import (
    EYE_TOPICS,
    describe_panorama,
    find_calibrated_reasons,
    find_overscan_of_eyes,
    make_camera_with_eyes,
    make_eye_settings,
    measure_dark_shares,
)
from ..physics.camera.lens_models import Brown
from ..physics.camera.rotations import nearest_rotation, to_vector
from ..settings.description import check, defaults, merged
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.foreign_bytes import explain_errors
from .calibration_advice import check_baseline, check_focal_length, describe_exchanged, selects_by_name

#: Largest angle between two eyes that count as parallel, rad, and largest offset from side by side, as a share of the
#: baseline.
MAX_TURN_RAD, MAX_OFFSET_SHARE = 1e-4, 1e-3
#: Largest difference of two alike eyes in focal length, principal point and distortion, px over the image.
ALIKE_PX = 0.5
#: Largest relative difference of the focal lengths along x and y that counts as square pixels.
SQUARE_PIXEL_TOLERANCE = 1e-3


def make_rig_of_calibration(reading: Reading, where: str) -> CalibratedRig:
    """Return the rig of a calibration. Raises IcyMoonError unless it has two cameras."""
    count = len(reading.rig.cameras)
    if count != 2:
        raise IcyMoonError(
            f"{where}: there {'is 1 camera' if count == 1 else f'are {count} cameras'}, but a rig needs two; "
            + ("name two of them by --cameras." if count > 2 else "give the calibration of both.")
        )
    return reading.rig


def find_why_calibrated(rig: CalibratedRig) -> str:
    """Find why one camera cannot represent both eyes of a pair. Returns a clause, empty if it can."""
    left, right = rig.cameras
    if left.size_px != right.size_px:
        return f"images have {left.width_px} x {left.height_px} and {right.width_px} x {right.height_px} px"
    alike = [convert_to_brown(camera) for camera in rig.cameras]
    for camera, same in zip(rig.cameras, alike, strict=True):
        if abs(camera.fx_px / camera.fy_px - 1) >= SQUARE_PIXEL_TOLERANCE or camera.skew_px:
            return f"pixels are not square (fx {camera.fx_px:g}, fy {camera.fy_px:g}, skew {camera.skew_px:g} px)"
        if same is None or not isinstance(same.lens, Brown) or len(same.lens.shortened()) > 5:
            return f"the lens is {camera.lens.name}"
    first, second = (_list_shared_parameters(camera) for camera in alike if camera is not None)
    off = float(np.abs(first - second).max())
    if off > ALIKE_PX:
        return f"the eyes differ by up to {off:.3g} px in focal length, principal point and distortion"
    rotation, translation = rig.relative_pose()
    turned = float(np.linalg.norm(to_vector(rotation)))
    if turned > MAX_TURN_RAD:
        return f"the eyes are rotated relative to each other by {math.degrees(turned):.3g} degrees"
    x, y, z = (-rotation.T @ translation).tolist()
    if max(abs(y), abs(z)) > MAX_OFFSET_SHARE * abs(x):
        return f"the right eye is {x:.4g} m to the right of the left one, {y:.4g} m below and {z:.4g} m before it"
    return ""


def _list_shared_parameters(camera: CalibratedCamera) -> Array:
    """Return the parameters that two identical eyes share, each in px; distortion is taken at a focal length from the
    axis."""
    lens = camera.lens
    k = lens.coefficients[:5] if isinstance(lens, Brown) else ()
    return np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *(np.array(k) * camera.fx_px)])


def make_calibrated_settings(
    rig: CalibratedRig,
    why: str,
    paths: Sequence[Path],
    kind: str,
    stated: Stated = Stated(),  # noqa: B008
    names: str | None = None,
) -> tuple[Settings, list[str]]:
    """Make the settings ``rig``, ``left_eye`` and ``right_eye`` of two cameras, and sentences about them for the user.

    ``rig`` is their rectified pair. Its overscan shows everything that both eyes see, if that is not too much. Raises
    IcyMoonError for eyes that are swapped, one above the other or at one position, and for a lens that folds the image.
    """
    where = " and ".join(map(str, paths))
    for camera in rig.cameras:
        check_focal_length(camera.fx_px, camera.size_px, where)
    with explain_errors(where, "a calibration of two eyes side by side", "calibrate two eyes side by side"):
        pair = _rectify(rig, paths, kind)
    if pair.along_m > 0:
        left, right = (camera.name if selects_by_name(kind, names) else "" for camera in rig.cameras)
        second = f"{where}: {right}" if right else str(paths[-1])
        raise IcyMoonError(describe_exchanged(second, left or str(paths[0]), pair.along_m, (left, right)))
    doubts = check_baseline(-pair.along_m, where, "the translation is", kind, stated)
    centre_px = pair.cx_px, pair.cy_px
    table = {**make_rig_table(pair.size_px, pair.focal_px, centre_px, -pair.along_m), "eyes": "CALIBRATED"}
    eyes = {
        topic: make_eye_settings(camera, turn.T)
        for topic, camera, turn in zip(EYE_TOPICS, rig.cameras, pair.turns, strict=True)
    }
    whole = merged(defaults(), check({"rig": table, **eyes}, where))
    for reason, _ in find_calibrated_reasons(whole):
        raise IcyMoonError(f"{where}: {reason}")
    panorama = make_camera_with_eyes(whole).panorama
    if panorama is None:
        table["overscan"] = math.ceil(find_overscan_of_eyes(make_camera_with_eyes(whole)) * 1000) / 1000
    found = check({"rig": table, **eyes}, where)
    notes = [
        f"Each eye is rendered as it is: {why}. The table rig is their rectified pair, to which truth and rectified "
        "images belong.",
        *([describe_panorama(panorama)] if panorama else []),
        *doubts,
    ]
    shares = zip(("left", "right"), measure_dark_shares(make_camera_with_eyes(merged(defaults(), found))), strict=True)
    notes += [f"{share:.1%} of the {eye} eye's pixels stay dark." for eye, share in shares if share > 0]
    return found, notes


def make_rig_table(
    size_px: tuple[int, int], focal_px: float, centre_px: tuple[float, float], baseline_m: float
) -> dict[str, Any]:
    """Make the table ``rig`` of the settings of two parallel eyes. The principal point ``centre_px`` is counted from
    the centre of the first pixel."""
    (width, height), (cx_px, cy_px) = size_px, centre_px
    width_mm = defaults().rig.sensor_width_mm
    return {
        "width_px": width,
        "height_px": height,
        "sensor_width_mm": width_mm,
        "focal_length_mm": focal_px / width * width_mm,
        # Rounding of the model's vectors leaves 1e-14 px at the middle of the image; adding 0 turns -0 into 0.
        "principal_x_px": round(cx_px + 0.5 - width / 2, 9) + 0.0,
        "principal_y_px": round(cy_px + 0.5 - height / 2, 9) + 0.0,
        "baseline_m": baseline_m,
    }


def complete_eyes(found: Settings) -> Settings:
    """Complete the settings of a calibration by the defaults of a rig and its eyes, so that they replace earlier
    settings of distortion, toe-in, overscan and lens."""
    unsaid = defaults()
    keys = [key for key in unsaid.rig if key in _OF_THE_LENS or key.startswith("distortion_")]
    rig = {**{key: unsaid.rig[key] for key in keys}, **found.rig}
    eyes = {topic: {**unsaid[topic], **found[topic]} for topic in EYE_TOPICS if topic in found}
    return check({"rig": rig, **eyes}, "a calibration")


#: Settings of a rig, besides distortion, that return to their defaults if a calibration leaves them out.
_OF_THE_LENS = ("eyes", "toe_in_deg", "overscan")


@dataclass(frozen=True)
class _Rectified:
    """The rectified pair of two cameras: the rotation (3, 3) of each camera into the pair, the common camera of the
    pair, and the x component, m, of the right eye's t."""

    turns: tuple[Array, Array]
    size_px: tuple[int, int]
    focal_px: float
    cx_px: float
    cy_px: float
    along_m: float


def _rectify(rig: CalibratedRig, paths: Sequence[Path], kind: str) -> _Rectified:
    """Rectify the rig of a calibration. Two ROS files of one pair state how. Otherwise OpenCV's rotations are used,
    with the mean focal length of both eyes and the mean of their principal points as shares of the larger size."""
    stated = [read_ros_camera(path) for path in paths] if kind == "ros" and len(paths) == 2 else []
    first, second = stated or make_ros_pair(rig)
    size = (
        max(rig.cameras[0].width_px, rig.cameras[1].width_px),
        max(rig.cameras[0].height_px, rig.cameras[1].height_px),
    )
    p = second.projection
    if not (stated and p[0, 0] == p[1, 1] and np.array_equal(first.projection[:, :3], p[:, :3])):
        first, second = make_ros_pair(rig)
        p = second.projection.copy()
        shares = [(np.array([camera.cx_px, camera.cy_px]) + 0.5) / camera.size_px for camera in rig.cameras]
        p[:2, 2] = np.mean(shares, axis=0) * size - 0.5
    turns = nearest_rotation(first.rectification), nearest_rotation(second.rectification)
    # The file of either eye may state the baseline, so that exchanged files are reported as exchanged.
    along_m = float(p[0, 3] / p[0, 0] - first.projection[0, 3] / first.projection[0, 0])
    return _Rectified(turns, size, float(p[0, 0]), float(p[0, 2]), float(p[1, 2]), along_m)
