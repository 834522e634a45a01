"""The exports ``fits`` and ``tiff``: the radiance factor I/F of both eyes, and incidence, emission and phase.

I/F = π L / E, with the radiance L of a pixel and the Sun's irradiance E on a surface that faces it, in the same band;
it is Hapke's RADF. Lambert ground of albedo A that faces the Sun has I/F = A. L contains the light of the planet, if
there is any.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.fits import Image, encode_fits
from ...formats.tiff_write import encode_tiff
from ...physics.camera.rolling_shutter import turn_to_world
from ...physics.light.lamps import switch_lamps_off
from ...physics.light.sunlight import sun_colour
from ...render.pairs.pair_folder import EYES
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import write_bytes
from ...support.labels import LIGHT_GROUPS
from ..images.develop import scale_radiance
from ..measure.prepare_pair import LoadedPair
from . import Export
from .cameras import make_pixel_rays

HEADINGS = {"fits": "Radiance"}
TITLES = {
    "fits": "FITS: the radiance factor I/F, and incidence, emission and phase",
    "tiff": "TIFF: the radiance factor I/F, and incidence, emission and phase",
}
#: Names of the bands of a pair, see ``physics.light.bands``.
BAND_NAMES = ("R 620 nm", "G 550 nm", "B 460 nm")
#: Texts in the files that describe the angles.
_FACET_ANGLE_TEXT = "from the facet's normal to the {}"
_GEOMETRY_TEXT = "incidence and emission from the facet's normal, phase, deg"


@dataclass(frozen=True)
class Photometry:
    """The photometry of an eye, arrays (H, W), NaN where there is no ground.

    ``radiance_factor`` (H, W, 3) is of each band. The angles, deg, are between the normal of the facet, the Sun and the
    camera; incidence and emission are NaN without normals. ``irradiance_wm2`` is E, the mean of the bands.
    """

    irradiance_wm2: float
    radiance_factor: Array
    incidence_deg: Array
    emission_deg: Array
    phase_deg: Array


def measure_photometry(pair: LoadedPair, eye: str) -> Photometry:
    """Measure the photometry of an eye.

    Raises IcyMoonError if the pair lacks the Sun or the camera's pose, if no sunlight falls on it, or if its light is a
    lamp nearby.
    """
    sun, pose = pair.pair.sun, pair.pair.row_poses(eye)
    if sun is None or pose is None:
        raise IcyMoonError(
            f"{pair.pair.folder / 'pair.json'} does not contain the Sun and the camera's pose; render the pair again."
        )
    irradiance = sun.irradiance_wm2 * float(pair.settings.light[LIGHT_GROUPS["Sun"]])
    if not irradiance > 0:
        raise IcyMoonError(
            f"{pair.pair.folder}: no sunlight falls on this scene, so I/F is not defined; raise "
            "light.sun_irradiance_wm2 or light.sun_scale."
        )
    if sun.distance_m:
        raise IcyMoonError(
            f"{pair.pair.folder}: light falls off from a lamp at light.sun_distance_m, so there is no "
            "one irradiance, and I/F is not defined; render with the Sun (light.sun_distance_m 0)."
        )
    by_band = irradiance * sun_colour(float(pair.pair.settings.light.sun_temperature_k))
    view, camera, depth = pair.views[eye], pair.pair.camera, pair.depth[eye]
    rays = make_pixel_rays(camera)
    ahead = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).reshape(-1, 3)
    back = -turn_to_world(ahead, pose, np.arange(len(ahead)) // camera.width_px).reshape(rays.shape)
    known = np.isfinite(depth)

    def where_known(angle: Array) -> Array:
        return np.where(known, angle, np.nan)

    none = np.full(depth.shape, np.nan)
    normal, toward = view.normal, np.asarray(sun.direction)
    radiance = np.asarray(scale_radiance(view, pair.pair, switch_lamps_off(pair.settings)), np.float64)
    return Photometry(
        irradiance,
        np.where(known[..., None], math.pi * radiance / by_band, np.nan),
        none if normal is None else where_known(measure_angle_deg(normal, toward)),
        none if normal is None else where_known(measure_angle_deg(normal, back)),
        where_known(measure_angle_deg(back, toward)),
    )


def measure_angle_deg(one: Array, other: Array) -> Array:
    """Measure the angle, deg, between vectors (..., 3) of any length.

    The arc tangent is used, because cosines near 1 of rounded normals tell no angle.
    """
    first = one.astype(np.float64)
    return np.asarray(
        np.degrees(np.arctan2(np.linalg.norm(np.cross(first, other), axis=-1), (first * other).sum(axis=-1)))
    )


def _write_fits(pair: LoadedPair, folder: Path) -> None:
    """Write ``left.fits`` and ``right.fits``: a cube of the radiance factor in three bands, then four images.

    The images are INCIDENCE, EMISSION, PHASE (deg) and DEPTH (m).
    """
    camera = pair.pair.camera
    for eye in EYES:
        found = measure_photometry(pair, eye)
        cards: dict[str, tuple[Any, str]] = {
            "OBJECT": (str(pair.settings.light.body), "body"),
            "PAIR": (pair.pair.id, "id of the pair"),
            "EYE": (eye, "camera"),
            "FOCALPX": (camera.focal_px, "[px] focal length"),
            "CXPX": (camera.cx_px, "[px] principal point from the left edge"),
            "CYPX": (camera.height_px - camera.cy_px, "[px] principal point from the bottom edge"),
            "BASELINE": (camera.baseline_m, "[m] distance of the eyes"),
            "SUNIRRAD": (found.irradiance_wm2, "[W/m2] E of pi L / E"),
            **{f"BAND{k}": (name, "plane") for k, name in enumerate(BAND_NAMES, 1)},
        }
        images = [
            Image("RADIANCE FACTOR", found.radiance_factor, "", cards),
            Image("INCIDENCE", found.incidence_deg, "deg", comment=_FACET_ANGLE_TEXT.format("Sun")),
            Image("EMISSION", found.emission_deg, "deg", comment=_FACET_ANGLE_TEXT.format("camera")),
            Image("PHASE", found.phase_deg, "deg", comment="from the Sun to the camera"),
            Image("DEPTH", pair.depth[eye], "m", comment="along the optical axis"),
        ]
        write_bytes(folder / f"{eye}.fits", encode_fits(images))


def _write_tiff(pair: LoadedPair, folder: Path) -> None:
    """Write ``left_radiance_factor.tif``, ``left_geometry.tif`` and the same of the right eye.

    The bands are R, G, B, and incidence, emission, phase in degrees: 32-bit floats, NaN where there is no ground.
    """
    for eye in EYES:
        found = measure_photometry(pair, eye)
        angles = np.stack([found.incidence_deg, found.emission_deg, found.phase_deg], axis=-1)
        write_bytes(
            folder / f"{eye}_radiance_factor.tif",
            encode_tiff(found.radiance_factor.astype(np.float32), description="I/F: " + ", ".join(BAND_NAMES)),
        )
        write_bytes(folder / f"{eye}_geometry.tif", encode_tiff(angles.astype(np.float32), description=_GEOMETRY_TEXT))


FITS = Export(write_pair=_write_fits)
TIFF = Export(write_pair=_write_tiff)
