"""The calibrated eyes of a rig, each with its own images, lens and direction, from ``left_eye`` and ``right_eye``.

The table ``rig`` describes the parallel pair, to which truth and rectified images belong. The eyes stand at the two
centres of that pair. As in calibrations, the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ...settings.topics.camera import EyeSettings, RigSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from .calibrated_camera import CalibratedCamera
from .lens_distortion import COEFFICIENTS, read_coefficients
from .lens_models import Brown, Cahvore, Fisheye, LensModel, lens_json
from .panorama import Panorama, make_panorama
from .rotations import from_vector, to_vector
from .stereo_camera import StereoCamera

#: Keys of ``EyeSettings`` in the order of the coefficients: of Brown and Conrady's lens,
_BROWN_KEYS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
#: of the fisheye lens,
_FISHEYE_KEYS = ("k1", "k2", "k3", "k4")
#: and of the rotation vector.
_TURN_KEYS = ("turn_x_deg", "turn_y_deg", "turn_z_deg")
#: Keys of the image size and of K.
_PINHOLE_KEYS = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "skew_px")
#: Keys of R of CAHVORE.
_RADIAL_KEYS = ("r0", "r1", "r2")
#: Keys of E of CAHVORE.
_PUPIL_KEYS = ("e0", "e1", "e2")
_KEYS_OF_LENS = {
    "BROWN": _BROWN_KEYS,
    "FISHEYE": _FISHEYE_KEYS,
    "CAHVORE": ("axis_x", "axis_y", *_RADIAL_KEYS, *_PUPIL_KEYS, "linearity"),
}
#: The topics of the eyes, left first.
EYE_TOPICS = ("left_eye", "right_eye")
#: Largest overscan up to which the eyes' images are taken from a pinhole's image. This image then has nine times the
#: pixels of the rectified images.
MAX_OVERSCAN = 1.0
#: Columns and rows of the grid of pixels from which shares of an image are found.
_GRID_PX = 65, 49


def is_calibrated(rig: RigSettings) -> bool:
    """Return whether each eye has a separate calibration."""
    return bool(rig.eyes == "CALIBRATED")


def make_camera_with_eyes(settings: Settings) -> StereoCamera:
    """Make the rig, with calibrated eyes if the settings have them. Raises ValueError for impossible lens
    parameters.
    """
    return add_calibrated_eyes(StereoCamera.from_settings(settings.rig), settings)


def add_calibrated_eyes(camera: StereoCamera, settings: Settings) -> StereoCamera:
    """Add the calibrated eyes of the settings, if any, to a rig, and the panorama that they need. Raises ValueError for
    impossible lens parameters."""
    found = replace(camera, eyes=make_calibrated_eyes(settings))
    return replace(found, panorama=_find_panorama(found)) if found.eyes else found


def find_light_px(settings: Settings) -> tuple[int, int]:
    """Return the columns and rows of the rendered light of a rig; of the parallel rig if the calibrated eyes are
    invalid.
    """
    try:
        return make_camera_with_eyes(settings).light_px
    except ValueError:
        return StereoCamera.from_settings(settings.rig).rendered_px


def make_calibrated_eyes(settings: Settings) -> tuple[CalibratedCamera, CalibratedCamera] | None:
    """Make the calibrated eyes, left first, in the axes of the left eye of the parallel rig; None for a rig of two
    equal eyes. Raises ValueError for impossible lens parameters.
    """
    if not is_calibrated(settings.rig):
        return None
    left, right = (_make_eye(*_make_eye_key(settings[topic])) for topic in EYE_TOPICS)
    return left, _move_aside(right, float(settings.rig.baseline_m))


def _make_eye_key(eye: EyeSettings) -> tuple[tuple[int | float, ...], tuple[float, ...], str, tuple[float, ...]]:
    """Make the hashable arguments of ``_make_eye``: sizes, rotation vector in degrees, lens and coefficients."""
    return (
        tuple(eye[key] for key in _PINHOLE_KEYS),
        tuple(float(eye[key]) for key in _TURN_KEYS),
        eye.lens,
        tuple(float(eye[key]) for key in _KEYS_OF_LENS[eye.lens]),
    )


@lru_cache(maxsize=16)
def _make_eye(
    sizes: tuple[int | float, ...], turn_deg: tuple[float, ...], lens: str, numbers: tuple[float, ...]
) -> CalibratedCamera:
    """Make the eye with these values. Equal values give the same object, by which rectifying maps are cached."""
    width, height, fx, fy, cx, cy, skew = sizes
    rotation = from_vector(np.radians(turn_deg))
    return CalibratedCamera(
        int(width), int(height), fx, fy, cx, cy, _make_lens(lens, numbers), skew, rotation, np.zeros(3)
    )


@lru_cache(maxsize=16)
def _move_aside(eye: CalibratedCamera, baseline_m: float) -> CalibratedCamera:
    """Move an eye by the baseline to the right, in the parallel rig's axes."""
    return eye.placed(eye.rotation, -baseline_m * eye.rotation[:, 0])


def _make_lens(lens: str, numbers: tuple[float, ...]) -> LensModel:
    if lens == "FISHEYE":
        return Fisheye(numbers)
    if lens == "BROWN":
        return Brown(Brown(numbers).shortened() or (0.0,) * 5)
    (x, y), radial, pupil, linearity = numbers[:2], numbers[2:5], numbers[5:8], numbers[8]
    ahead = 1.0 - x**2 - y**2
    if not ahead > 0:
        raise ValueError("axis_x and axis_y point the optical axis to the side of the camera or behind it")
    is_cahvor = linearity == 1.0 and not any(pupil)
    return Cahvore((x, y, math.sqrt(ahead)), radial, None if is_cahvor else pupil, linearity)


def make_eye_settings(camera: CalibratedCamera, rotation: Array) -> dict[str, Any]:
    """Make the settings table of an eye with the ``rotation`` (3, 3) from the axes of the parallel rig to its axes."""
    lens = camera.lens
    table: dict[str, Any] = dict(zip(_PINHOLE_KEYS, (
        camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, camera.skew_px),
        strict=True))  # fmt: skip
    table |= dict(zip(_TURN_KEYS, np.degrees(to_vector(rotation)).tolist(), strict=True))
    if isinstance(lens, Cahvore):
        pupil = lens.pupil or (0.0, 0.0, 0.0)
        numbers = (*lens.axis[:2], *lens.radial, *pupil, lens.linearity)
        name = "CAHVORE"
    else:
        name = "BROWN" if isinstance(lens, Brown) else "FISHEYE"
        numbers = lens.coefficients
    stated = {key: float(value) for key, value in zip(_KEYS_OF_LENS[name], numbers, strict=False) if value}
    if isinstance(lens, Cahvore):
        stated["linearity"] = float(lens.linearity)
    if not camera.skew_px:
        del table["skew_px"]
    return {**table, "lens": name, **stated}


def eyes_json(camera: StereoCamera, rig: RigSettings) -> dict[str, Any]:
    """Make the table ``eyes`` of ``pair.json``: K, and R and t of x = R X + t from the left eye's rectified axes, in
    metres.

    Equal eyes have the distortion of the rig. Calibrated eyes have their size, their lens and the way of rendering
    them.
    """
    found = camera.eyes_json()
    if camera.eyes is None:
        distortion = dict(zip(COEFFICIENTS, read_coefficients(rig), strict=True))
        return {eye: {**facts, "distortion": distortion} for eye, facts in found.items()}
    return {
        name: {
            **facts,
            "width_px": eye.width_px,
            "height_px": eye.height_px,
            "lens": lens_json(eye.lens),
            **(
                {"rendered_as": "PINHOLE"}
                if camera.panorama is None
                else {"rendered_as": "FISHEYE", "fisheye": camera.panorama.to_json()}
            ),
            "pixel_centre": "(u + 0.5, v + 0.5)",
        }
        for (name, facts), eye in zip(found.items(), camera.eyes, strict=True)
    }


def find_rays_in_rig(eye: CalibratedCamera, pixels: Array) -> Array:
    """Find the unit directions (..., 3) of the pixels (..., 2) of an eye, in the axes of the parallel rig; NaN outside
    its field of view.
    """
    return np.asarray(eye.unproject(pixels) @ eye.rotation)


#: Cosine of the largest angle from the axis of a rig at which a ray counts as seen by a pinhole.
_MIN_AHEAD = 1e-3


def _grid_pixels(eye: CalibratedCamera) -> Array:
    """Make a grid of pixels (49, 65, 2) spread over the whole image of an eye, borders included."""
    grid = np.meshgrid(
        *(np.linspace(0.0, size - 1.0, count) for size, count in zip(eye.size_px, _GRID_PX, strict=True))
    )
    return np.stack(grid, axis=-1)


def measure_dark_shares(camera: StereoCamera) -> tuple[float, float]:
    """Estimate the share of the pixels of each calibrated eye that lie outside the images of the light, on a grid."""
    left, right = (_dark_share(eye, camera) for eye in camera.eyes or ())
    return left, right


def _dark_share(eye: CalibratedCamera, camera: StereoCamera) -> float:
    where = project_to_light(find_rays_in_rig(eye, _grid_pixels(eye)), camera)
    size = np.array(camera.light_px)
    return float(1.0 - ((where >= 0) & (where <= size - 1)).all(axis=-1).mean())


def project_to_light(rays: Array, camera: StereoCamera) -> Array:
    """Project rays (..., 3) of any length to columns and rows (..., 2) of the images of the light, counted from the
    centre of the first pixel. NaN for rays that no such image can show.
    """
    if camera.panorama is not None:
        return camera.panorama.show(rays)
    middle = np.array([camera.cx_px + camera.margin_x_px, camera.cy_px + camera.margin_y_px]) - 0.5
    with np.errstate(invalid="ignore"):
        ahead = rays[..., 2:] > _MIN_AHEAD * np.linalg.norm(rays, axis=-1, keepdims=True)
    points = np.where(ahead, rays[..., :2] / np.where(ahead, rays[..., 2:], 1.0), np.nan)
    return np.asarray(points * camera.focal_px + middle)


@lru_cache(maxsize=16)
def _find_panorama(camera: StereoCamera) -> Panorama | None:
    """Find the panorama that calibrated eyes need; None if the overscan of the settings, or a pinhole of acceptable
    size, covers their field of view."""
    set_px = np.array([camera.margin_x_px, camera.margin_y_px])
    shown = max(MAX_OVERSCAN, float((set_px / [camera.width_px, camera.height_px]).min()))
    if find_overscan_of_eyes(camera) <= shown:
        return None
    eyes = camera.eyes or ()
    return make_panorama(max(map(_px_per_rad, eyes)), max(map(_find_widest_rad, eyes)))


def _px_per_rad(eye: CalibratedCamera) -> float:
    """Return the pixels per radian of an eye: on its axis, or the median over its image, whichever is larger."""
    pixels = _grid_pixels(eye)
    beside = np.stack([pixels + np.array(step) / 2 for step in ((-1, 0), (1, 0), (0, -1), (0, 1))])
    rays = eye.unproject(beside)
    turns = np.linalg.norm(rays[[1, 3]] - rays[[0, 2]], axis=-1)  # radians per pixel along rows and columns
    scale = 1.0 / np.sqrt(turns[0] * turns[1])
    lens = eye.lens
    axis = 1 + lens.radial[0] if isinstance(lens, Cahvore) else 1.0
    return max(axis * max(eye.fx_px, eye.fy_px), float(np.nanmedian(scale)))


def _find_widest_rad(eye: CalibratedCamera) -> float:
    """Find the largest angle in rad, off the axis of the rig, at which an eye sees something."""
    rays = find_rays_in_rig(eye, _grid_pixels(eye))
    angles = np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2])
    if isinstance(eye.lens, Fisheye) and np.isnan(angles).any():  # the circle that it shows is between grid points
        return eye.lens.widest_rad + math.acos(min(1.0, eye.rotation[2, 2]))
    behind = eye.show(-eye.rotation[:, 2])
    if ((behind >= 0) & (behind <= np.array(eye.size_px) - 1)).all():
        return math.pi
    return float(np.nanmax(angles))  # at a corner, which the grid has


def find_overscan_of_eyes(camera: StereoCamera) -> float:
    """Find the least ``rig.overscan`` with which the rendered images cover the field of view of the calibrated eyes;
    infinite if no pinhole covers it.
    """
    plain, size = camera.rectified, np.array([camera.width_px, camera.height_px])  # a pinhole without overscan
    needed = 0.0
    for eye in camera.eyes or ():
        pixels = _grid_pixels(eye)
        where = project_to_light(find_rays_in_rig(eye, pixels), plain)
        if (np.isnan(where) & np.isfinite(eye.unproject(pixels)[..., :2])).any():
            return math.inf
        # The grid may miss the outermost point by up to a pixel.
        beyond = 1.0 + np.nan_to_num(np.maximum(-where, where - (size - 1)), nan=-1.0).max(axis=(0, 1))
        needed = max(needed, float((beyond / size).max()))
    return needed


def find_calibrated_reasons(settings: Settings) -> Iterator[tuple[str, str]]:
    """Yield the reasons why calibrated eyes cannot be rendered: sentences, each with the setting at fault."""
    if not is_calibrated(settings.rig):
        return
    for topic in EYE_TOPICS:
        try:
            eye = _make_eye(*_make_eye_key(settings[topic]))
        except ValueError as error:
            yield f"{topic} is not a camera: {error}; correct {topic}.", f"{topic}.lens"
            return
        lost = eye.dark_share()
        if lost and not isinstance(eye.lens, Fisheye):
            keys = "r0, r1 and r2" if isinstance(eye.lens, Cahvore) else "k1 to k6"
            yield (
                (
                    f"{topic}.{keys} fold the image over itself, so {lost:.1%} of the pixels see nothing; correct the "
                    f"coefficients, or narrow the field by {topic}.fx_px and {topic}.fy_px."
                ),
                f"{topic}.lens",
            )
            return
    pinhole = replace(make_camera_with_eyes(settings), panorama=None)
    for topic, share in zip(EYE_TOPICS, measure_dark_shares(pinhole), strict=True):
        if share == 1.0:
            yield (
                (
                    f"{topic} looks beside the parallel rig and sees nothing of it; correct {topic}.turn_x_deg, "
                    f"{topic}.turn_y_deg and {topic}.turn_z_deg, which turn from the rectified axes into the eye's, or "
                    f"{topic}.cx_px and {topic}.cy_px."
                ),
                f"{topic}.turn_y_deg",
            )


def advise_on_calibrated_eyes(settings: Settings) -> Iterator[str]:
    """Yield sentences on the rendering of calibrated eyes if no pinhole renders them, and on their pixels that stay
    dark.
    """
    if not is_calibrated(settings.rig):
        return
    camera = make_camera_with_eyes(settings)
    if camera.panorama:
        yield f"eyes: {describe_panorama(camera.panorama)}"
    for name, share in zip(("left", "right"), measure_dark_shares(camera), strict=True):
        if share > 0:
            yield f"eyes: {share:.1%} of the pixels of the {name} eye stay dark. {_advise_on_unlit(camera)}"


def describe_panorama(panorama: Panorama) -> str:
    """Describe in a sentence the image from which the eyes' images are taken."""
    return (
        "No pinhole shows all that the eyes see, so they are taken from an equidistant fisheye image of "
        f"{panorama.size_px} x {panorama.size_px} px, {math.degrees(panorama.field_rad):.4g} degrees wide, with "
        f"{panorama.px_per_rad:.4g} px per radian."
    )


def _advise_on_unlit(camera: StereoCamera) -> str:
    if camera.panorama:
        return "Their lenses show nothing there."
    needed = find_overscan_of_eyes(camera)
    return f"Set rig.overscan to {math.ceil(needed * 1000) / 1000:g} to light those that the lens lights."
