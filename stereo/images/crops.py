"""Images and truth of a window of a pair, decoded only in the part that the window needs."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from ...physics.camera.calibration_error import refuse_calibration_errors
from ...physics.camera.sensor import expose_level_s, meter_level
from ...physics.camera.stereo_camera import StereoCamera
from ...physics.light.lamps import find_light_factors, is_light_scaled
from ...physics.light.photons import pixel_pitch_m
from ...render.pairs.pair_folder import EYES, Pair
from ...settings.topics.camera import SensorSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.labels import GROUP_PASSES
from .develop import Channels, DevelopedImages, average_bands, develop, scale_radiance
from .disparity_and_occlusion import find_scene_depth, find_visible_in_right
from .exr import NORMAL_PASSES, OBJECT_PASSES, Light, Truth, read_light, read_truth, read_view
from .lens import make_rectification
from .views import read_eye

#: Sensor settings that make a pixel depend on other pixels, or on its position on the sensor.
_NONLOCAL_SETTINGS = (
    "psf_sigma_px",
    "veiling_glare",
    "deposit_share",
    "prnu",
    "dsnu_e",
    "blooming",
    "radiation_flux_cm2_s",
)


class Crop(NamedTuple):
    """Rows and columns of a window."""

    rows: slice
    columns: slice


class Crops:
    """Reads windows of pairs. It keeps one number of each whole pair, the level for auto exposure."""

    def __init__(self) -> None:
        self._levels: dict[tuple[str, tuple[float, ...], float], float] = {}

    def read(self, pair: Pair, settings: Settings, crop: Crop) -> dict[str, Array] | None:
        """Read the arrays of ``read_whole`` in a window. None if pixels depend on others, which requires the whole
        image.

        The noise of a pixel differs from its noise in the whole image, but has the same strength.
        """
        refuse_calibration_errors(settings.calibration_error, pair.folder)
        if not _depends_on_single_pixels(pair, settings):
            return None
        rows, groups = range(crop.rows.start, crop.rows.stop), is_light_scaled(settings)
        left = read_view(pair.image("left"), "left", _list_unneeded_passes(groups), rows)
        light = {"left": left, "right": read_light(pair.image("right"), "right", groups, rows)}
        channels = Channels(settings.light, settings.sensor, pixel_pitch_m(settings.sensor, settings.rig))
        seconds = expose_level_s(
            self._meter_level(pair, settings) if settings.sensor.auto_exposure else 0.0, channels.rate, settings.sensor
        )
        fixed = Settings(settings | {"sensor": settings.sensor | {"auto_exposure": False, "exposure_s": seconds}})
        images = develop(
            pair, _crop_columns(light["left"], crop.columns), _crop_columns(light["right"], crop.columns), fixed
        )
        # The right eye's truth is needed only without rays for the hidden points.
        right = (
            left
            if left.hidden is not None
            else read_truth(pair.truth("right"), "right", _list_unneeded_passes(False), rows)
        )
        found = _make_truth_arrays(pair.camera, left, right)
        return _scale_images(images) | {key: value[:, crop.columns] for key, value in found.items()}

    def _meter_level(self, pair: Pair, settings: Settings) -> float:
        """Meter the level for auto exposure on the whole left image."""
        scales = tuple(find_light_factors(settings).values())
        key = (pair.id, scales, float(settings.sensor.auto_percentile))
        if key not in self._levels:
            light = read_light(pair.image("left"), "left", is_light_scaled(settings))
            radiance = average_bands(scale_radiance(light, pair, settings))
            self._levels[key] = meter_level(np.minimum(radiance, 1e30), settings.sensor)
        return self._levels[key]


def read_whole(pair: Pair, settings: Settings) -> dict[str, Array]:
    """Read the developed images ``left`` and ``right``, 0 to 1, (H, W) or (H, W, 3), and the truth of the left image,
    (H, W): ``disparity_px``, 0 where unknown, ``valid`` and ``occluded``.
    """
    refuse_calibration_errors(settings.calibration_error, pair.folder)
    light, views = zip(
        *(read_eye(pair, eye, _list_unneeded_passes(is_light_scaled(settings))) for eye in EYES), strict=True
    )
    return _scale_images(develop(pair, light[0], light[1], settings)) | _make_truth_arrays(pair.camera, *views)


def _scale_images(images: DevelopedImages) -> dict[str, Array]:
    top = 2.0**images.bits - 1
    return {eye: images.seen(eye) / top for eye in EYES}


def _make_truth_arrays(camera: StereoCamera, left: Truth, right: Truth) -> dict[str, Array]:
    depth, other = find_scene_depth(left), find_scene_depth(right)
    disparity = camera.disparity(depth)
    valid = np.isfinite(disparity)
    seen = find_visible_in_right(depth, other, camera, left.hidden)
    return {"disparity_px": np.where(valid, disparity, 0.0), "valid": valid, "occluded": valid & ~seen}


def _depends_on_single_pixels(pair: Pair, settings: Settings) -> bool:
    """Return whether each pixel's value depends only on the light at this pixel and on the exposure."""
    camera, sensor = pair.camera, settings.sensor
    if any(pair.image(eye) != pair.truth(eye) for eye in EYES):
        return False  # blurred: the truth is in separate files
    plain: bool = (
        camera.rendered_px == (camera.width_px, camera.height_px)
        and sensor.colour == "MONO"
        and sensor.band_weights == "EQUAL"
        and not any(_spreads_light(sensor, key) for key in _NONLOCAL_SETTINGS)
    )
    return plain and all(
        make_rectification(camera, settings.rig, settings.calibration_error, eye) is None for eye in EYES
    )


def _spreads_light(sensor: SensorSettings, key: str) -> bool:
    return float(sensor[key]) > 0


def _list_unneeded_passes(groups: bool) -> Collection[str]:
    return (*OBJECT_PASSES, *NORMAL_PASSES, *(() if groups else GROUP_PASSES))


def _crop_columns(light: Light, columns: slice) -> Light:
    return Light(light.radiance[:, columns], {group: each[:, columns] for group, each in light.groups.items()})
