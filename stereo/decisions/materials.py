"""Albedo and share of salt of a workspace's cells: from the truth, and as a lander measures them in its left image.

A lander knows the light of the Sun, its camera's response and the slopes of the elevation model that it made. The
measured albedo assumes Lambert ground: A = π L / (E cos i). Shares of salt come from colours: the light of a mixture by
area is the sum of the light of its parts, so R, G and B give the amounts of ice and of salt by least squares. The
colours of both are known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.sensor import black_dn
from ...physics.light.ground_colours import Bands, ice_and_salt_bands
from ...physics.light.lamps import radiant_power_w, read_factors
from ...physics.light.photons import pixel_pitch_m
from ...physics.light.sunlight import sun_colour
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.labels import LIGHT_GROUPS
from ..images.develop import Channels, DevelopedImages
from .dem import Grid, mean_by_cell
from .footprints import Planes

#: Least angle between the colours of ice and salt for a share of salt, rad. At this angle noise of 1 % changes the
#: share by a half.
_MIN_COLOUR_ANGLE_RAD = 0.02
#: Least cosine of incidence for an albedo; below it an error of the slope would decide the albedo.
_MIN_INCIDENCE_COSINE = 0.1


@dataclass(frozen=True)
class Materials:
    """Materials of cells (rows, columns), NaN where unknown.

    ``albedo`` is the mean of the bands, ``salt`` the share of the area.
    """

    albedo: Array
    salt: Array


def make_true_materials(maps: Array) -> Materials:
    """Convert the maps (4, rows, columns) of the file ``workspace_cells.MATERIALS_FILE`` to materials."""
    return Materials(maps[:3].mean(axis=0), maps[3])


def compute_white_radiance(images: DevelopedImages, settings: Settings) -> Array:
    """Return the radiance, W/(m² sr), of white ground that gives the values of the left image.

    (H, W), or (H, W, 3) of a colour sensor; NaN where the image is saturated.
    """
    seen = images.seen("left").astype(np.float64)
    black = black_dn(settings.sensor) if len(images.frames) == 1 else 0.0
    top = 2.0**images.bits - 1
    return np.where(seen < top, (seen - black) / (top - black) * images.saturation_radiance, np.nan)


def measure_materials(
    white: Array,
    position_m: Array,
    index: Array,
    grid: Grid,
    planes: Planes,
    toward_sun: Array,
    irradiance: float,
    settings: Settings,
) -> Materials:
    """Measure the materials of cells as a lander does from ``white``, the result of ``compute_white_radiance``.

    ``white`` is NaN outside sunlit pixels. ``index`` (n,) are the flat indices of the pixels whose points are
    ``position_m`` (n, 3). ``planes`` lie under each cell. ``irradiance`` is the Sun's on ground that faces it, W/m².
    """
    channels = [_mean(one.ravel()[index], position_m, grid) for one in np.atleast_3d(white).transpose(2, 0, 1)]
    east, north, up = (float(each) for each in toward_sun)
    facing = up - planes.east_slope * east - planes.north_slope * north
    cosine = facing / np.hypot(1.0, np.hypot(planes.east_slope, planes.north_slope))
    lit = np.where(cosine > _MIN_INCIDENCE_COSINE, cosine, np.nan)
    of_white = _compute_channel_signals((1.0, 1.0, 1.0), settings)[:, None, None]
    albedo = math.pi * np.mean(channels / of_white, axis=0) / (irradiance * lit)
    return Materials(albedo, _find_salt_share(np.array(channels), settings))


def _mean(values: Array, position_m: Array, grid: Grid) -> Array:
    known = np.isfinite(values)
    return mean_by_cell(position_m[known], values[known], grid)


def _find_salt_share(channels: Array, settings: Settings) -> Array:
    """Find the share of salt (rows, columns) from the signals (channels, rows, columns).

    NaN where the signals leave it undetermined.
    """
    ice, salt = (
        _compute_channel_signals(bands, settings) for bands in ice_and_salt_bands(settings.surface, settings.hapke)
    )
    angle = math.atan2(float(np.linalg.norm(np.cross(ice, salt))), float(ice @ salt)) if len(ice) == 3 else 0.0
    if len(channels) != 3 or angle < _MIN_COLOUR_ANGLE_RAD:
        return np.full(channels.shape[1:], np.nan)
    parts = np.tensordot(np.linalg.pinv(np.stack([ice, salt], axis=1)), channels, axes=1)
    of_ice, of_salt = np.maximum(parts, 0.0)
    total = of_ice + of_salt
    return np.asarray(np.divide(of_salt, total, out=np.full(total.shape, np.nan), where=total > 0))


def _compute_channel_signals(bands: Bands, settings: Settings) -> Array:
    """Compute the signals of a camera's channels for sunlit ground of these reflectances, relative to white ground."""
    channels = Channels(settings.light, settings.sensor, pixel_pitch_m(settings.sensor, settings.rig))
    light: Any = np.array(bands) * sun_colour(settings.light.sun_temperature_k)
    return np.array([plane[0, 0] for plane in channels.planes(light[None, None])]) * channels.gains


def refuse_lamps(folder: Path, settings: Settings) -> None:
    """Raise IcyMoonError if lamps light the images, because an albedo is computed from the Sun's irradiance alone."""
    lamps, factors = settings.light.lamps, read_factors(settings.light)
    if any(radiant_power_w(lamp) * factor > 0 for lamp, factor in zip(lamps, factors, strict=True)):
        raise IcyMoonError(
            f"{folder}: an albedo can be measured in sunlight only, and lamps shine too; set light.lamp_scales to 0 "
            "for each lamp, or leave out the rules of albedo and salts."
        )


def scale_sun_irradiance(irradiance_wm2: float, settings: Settings) -> float:
    """Scale the Sun's irradiance, W/m², on ground that faces it by ``light.sun_scale``."""
    return irradiance_wm2 * float(settings.light[LIGHT_GROUPS["Sun"]])
