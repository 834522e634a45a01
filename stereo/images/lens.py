"""Lens distortion and toe-in, and the rectification that removes both.

There are three images. The rendered image comes from a pinhole with margins, toed in as the eye is, or from a panorama
for calibrated eyes whose field no pinhole shows. The image of the sensor is distorted by the lens; a calibrated eye's
image has its own size, and looks where the eye does. The rectified image belongs to the parallel rig, as the truth
does; it is made from the numbers of the sensor, and matchers get it. With an erroneous calibration, the rectified image
fits that rig only approximately.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ...physics.camera.calibrated_camera import CalibratedCamera
from ...physics.camera.calibration_error import make_rectifying_map, moves_pixels
from ...physics.camera.eyes import find_rays_in_rig, project_to_light
from ...physics.camera.lens_distortion import distort_points, read_coefficients, refuse_folds, undistort_points
from ...physics.camera.stereo_camera import StereoCamera
from ...settings.topics.camera import CalibrationErrorSettings, RigSettings
from ...support.arrays import Array, Numbers
from .spline import sample


@dataclass(frozen=True)
class Lens:
    """Maps from the pixels of one image to positions in another: (H, W, 2), float32, column and row, NaN outside the
    other image.
    """

    sensor_in_rendered: Array
    rectified_in_sensor: Array
    rectified_in_rendered: Array
    rendered_px: tuple[int, int]  # columns and rows of the rendered image
    is_calibrated: bool = False

    def distort(self, radiance: Array) -> Array:
        """Distort rendered radiance to radiance (H, W, bands) on the sensor; 0 beyond the edges of the render."""
        seen = (
            sample(radiance, self.sensor_in_rendered).astype(np.float32)
            if self.is_calibrated
            else _remap(radiance, self.sensor_in_rendered, cubic=True)  # kept, so that old pairs keep their images
        )
        return np.maximum(np.nan_to_num(seen), 0.0)

    def rectify_radiance(self, radiance: Array) -> Array:
        """Resample rendered radiance, of any number of bands, at the pixels of the rectified image; 0 where unknown."""
        return np.nan_to_num(_remap(radiance, self.rectified_in_rendered))

    def depth_of_sensor(self, depth: Array) -> Array:
        """Return the planar depth at the sensor's pixels, from a rendered ``depth`` (H, W); NaN outside the render and
        for NaN.

        Within a surface 1 / depth is interpolated linearly, which is exact on planes. Between surfaces the nearest
        rendered pixel counts, never a mean.
        """
        height, width = depth.shape
        inside = _find_inside(self.sensor_in_rendered, (width, height), 0.5)
        place = np.where(inside[..., None], self.sensor_in_rendered, 0).astype(np.float64)
        column, row = np.clip(np.rint(place).astype(np.intp), 0, [width - 1, height - 1]).transpose(2, 0, 1)
        nearest = np.where(inside, depth[row, column], np.nan)
        if width < 2 or height < 2:
            return nearest
        left, top = np.clip(np.floor(place).astype(np.intp), 0, [width - 2, height - 2]).transpose(2, 0, 1)
        right_share, bottom_share = place[..., 0] - left, place[..., 1] - top
        inverse = 1 / depth.astype(np.float64)
        upper, lower = (
            (1 - right_share) * inverse[line, left] + right_share * inverse[line, left + 1] for line in (top, top + 1)
        )
        between = (1 - bottom_share) * upper + bottom_share * lower
        usable = inside & _find_unbroken_cells(inverse)[top, left] & (between > 0)
        return np.where(usable, 1 / np.where(usable, between, 1.0), nearest)

    @property
    def sees(self) -> Array:
        """Pixels (H, W), bool, of the rectified image that are inside the sensor's field of view."""
        height, width = self.sensor_in_rendered.shape[:2]
        return _find_inside(self.rectified_in_sensor, (width, height), 0.0) & _find_inside(
            self.rectified_in_rendered, self.rendered_px, 0.0
        )


def make_lens(camera: StereoCamera, rig: RigSettings, eye: str) -> Lens | None:
    """Make the lens of an eye with the distortion in the ``rig`` settings. None if all three images are the same,
    except for margins. A calibrated eye of the ``camera`` has its own lens.

    Raises IcyMoonError if the coefficients fold the image.
    """
    own = camera.own_eye(eye)
    if own is not None:
        return _make_calibrated_lens(replace(camera, toe_in_deg=0.0, eyes=None), own)
    k = read_coefficients(rig)
    return _make_lens(camera, k, eye) if any(k) or camera.toe_in_deg else None


def make_rectification(
    camera: StereoCamera, rig: RigSettings, errors: CalibrationErrorSettings, eye: str
) -> Array | None:
    """Make the map from an eye's rectified image to the sensor's image (see ``Lens``) that a calibration with these
    ``errors`` assumes. None if both images are assumed equal.

    Raises IcyMoonError if the coefficients fold the image, or if the errors leave nothing of it.
    """
    if moves_pixels(camera, rig, errors, eye):
        return make_rectifying_map(camera, rig, errors, eye).astype(np.float32)
    lens = make_lens(camera, rig, eye)
    return None if lens is None else lens.rectified_in_sensor


def rectify(numbers: Array, rectified_in_sensor: Array) -> Array:
    """Rectify the sensor's numbers (H, W), and keep their type; 0 outside the sensor."""
    seen = _remap(numbers.astype(np.float32), rectified_in_sensor)
    return np.rint(np.nan_to_num(seen)).astype(numbers.dtype)


@lru_cache(maxsize=2)  # both eyes: maps are large
def _make_lens(camera: StereoCamera, k: tuple[float, ...], eye: str) -> Lens:
    pixels = make_pixel_grid(camera.width_px, camera.height_px) + 0.5
    principal, margin = np.array([camera.cx_px, camera.cy_px]), np.array([camera.margin_x_px, camera.margin_y_px])
    points = (pixels - principal) / camera.focal_px
    refuse_folds(points, k)

    def columns_and_rows(normalised: Array, beside: Numbers = 0.0) -> Array:
        return (normalised * camera.focal_px + principal - 0.5 + beside).astype(np.float32)

    rectified = _turn_and_distort(points, camera.eye_rotation(eye), k) if camera.toe_in_deg else points
    return Lens(
        columns_and_rows(undistort_points(points, k), margin),
        columns_and_rows(distort_points(rectified, k)),
        columns_and_rows(rectified, margin),
        camera.rendered_px,
    )


@lru_cache(maxsize=2)
def _make_calibrated_lens(camera: StereoCamera, own: CalibratedCamera) -> Lens:
    """Make the lens of a calibrated eye that was rendered by the parallel rig, or as a panorama."""
    rays = _make_rectified_rays(camera)
    return Lens(
        project_to_light(find_rays_in_rig(own, make_pixel_grid(*own.size_px)), camera).astype(np.float32),
        own.show(rays @ own.rotation.T).astype(np.float32),
        project_to_light(rays, camera).astype(np.float32),
        camera.light_px,
        is_calibrated=True,
    )


def _make_rectified_rays(camera: StereoCamera) -> Array:
    """Return the directions (H, W, 3) of the pixels of the rectified image, with length 1 along the optical axis."""
    pixels = make_pixel_grid(camera.width_px, camera.height_px)
    points = (pixels + 0.5 - np.array([camera.cx_px, camera.cy_px])) / camera.focal_px
    return np.concatenate([points, np.ones_like(pixels[..., :1])], axis=-1)


def make_pixel_grid(width: int, height: int) -> Array:
    """Make the columns and rows (H, W, 2) of the centres of pixels, counted from the centre of the first pixel."""
    return np.stack(np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)), axis=-1)


def _turn_and_distort(points: Array, rotation: Array, k: tuple[float, ...]) -> Array:
    """Turn normalised points (H, W, 2) of the parallel rig to the pinhole image of the toed-in eye; NaN for points
    behind the eye and beyond the fold of its lens.
    """
    rays = np.concatenate([points, np.ones_like(points[..., :1])], axis=-1) @ rotation.T
    ahead = rays[..., 2:] > 1e-6
    seen = np.where(ahead, rays[..., :2] / np.where(ahead, rays[..., 2:], 1.0), np.nan)
    back = undistort_points(distort_points(seen, k), k)
    return np.where(np.abs(back - seen) < 1e-6 * (1 + np.abs(seen)), seen, np.nan)


#: Two neighbours are on one surface if their inverse depths differ by at most _SLOPE_FACTOR times the smaller of the
#: steps beside them, plus _ROUGHNESS_SHARE times the smaller inverse depth.
_SLOPE_FACTOR, _ROUGHNESS_SHARE = 2.0, 0.01


def _find_unbroken_cells(inverse: Array) -> Array:
    """Find cells (H - 1, W - 1), bool, whose four pixels are on one surface, by inverse depths (H, W), NaN where
    unknown.
    """
    across, down = _find_continued_steps(inverse), _find_continued_steps(inverse.T).T
    return across[:-1] & across[1:] & down[:, :-1] & down[:, 1:]


def _find_continued_steps(inverse: Array) -> Array:
    """Find the steps (H, W - 1), bool, to the next pixel of a row that are similar to the smaller of the steps before
    and after, as on a plane; false for NaN.
    """
    step = np.abs(np.diff(inverse, axis=1))
    padded = np.pad(np.nan_to_num(step, nan=np.inf), ((0, 0), (1, 1)), constant_values=np.inf)
    beside = np.minimum(padded[:, :-2], padded[:, 2:])
    return step <= _SLOPE_FACTOR * beside + _ROUGHNESS_SHARE * np.fmin(inverse[:, 1:], inverse[:, :-1])


def _find_inside(where: Array, size: tuple[int, int], reach: float) -> Array:
    """Find which positions ``where`` (..., 2) are inside an image of ``size`` (columns, rows), or at most ``reach`` px
    beyond its outermost pixel centres; bool (...).
    """
    return np.asarray(((where >= -reach) & (where <= np.array(size) - 1 + reach)).all(axis=-1))


def _remap(image: Array, where: Array, cubic: bool = False) -> Array:
    """Sample ``image`` (H, W) or (H, W, bands) at positions ``where`` (h, w, 2), column and row, linearly or with
    cubics; NaN beyond its outermost pixel centres.
    """
    import cv2  # imported here, because Blender has no OpenCV and develops only pairs without distortion and toe-in

    height, width = image.shape[:2]
    at = np.nan_to_num(where, nan=-1.0)
    found = cv2.remap(
        image.astype(np.float32),
        at[..., 0],
        at[..., 1],
        cv2.INTER_CUBIC if cubic else cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    found[~_find_inside(where, (width, height), 0.0)] = np.nan
    return np.asarray(found)
