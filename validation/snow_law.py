"""Compares rendered snow with the measured reflectance of snow on Earth."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..physics.surfaces import snow
from ..settings.description import check, defaults, merged
from ..settings.preset_files import load_preset
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from .ball import BallImage, render_ball
from .comparison import Bench, Comparison, Row

#: Phase angles in degrees.
_PHASES_DEG = (10.0, 25.0, 40.0, 55.0, 70.0, 85.0, 100.0, 115.0)
#: Phase angles in degrees of a quick run.
_QUICK_PHASES_DEG = (25.0, 70.0, 100.0)
#: Largest incidence in the range of the formula.
_MAX_INCIDENCE_RAD = math.radians(snow.LARGEST_INCIDENCE_DEG)
#: Largest emission angle in its range.
_MAX_EMISSION_RAD = math.radians(snow.LARGEST_EMISSION_DEG)
#: Least azimuth from the plane of the Sun.
_MIN_OFF_PLANE_RAD = math.radians(20)
_CAMERA_DISTANCE_RADII = 100.0
_SOURCE = "Kokhanovsky and Zege 2004, Applied Optics 43, 1589, itself within about 5 % of measurements"
_CELL_RAD = math.radians(10.0)


def _collect_samples(images: list[BallImage]) -> Iterator[tuple[Array, Array]]:
    """Yield the angles (3, n) and the radiance factors (n,), divided by cos i, of each image's pixels in range. The
    angles are incidence i, emission and azimuth."""
    for image in images:
        side = np.abs(np.sin(image.azimuth))
        with np.errstate(invalid="ignore"):
            inside = (
                (image.incidence <= _MAX_INCIDENCE_RAD)
                & (image.emission <= _MAX_EMISSION_RAD)
                & (side >= math.sin(_MIN_OFF_PLANE_RAD))
            )
        angles = np.stack([image.incidence[inside], image.emission[inside], image.azimuth[inside]])
        yield angles, image.radiance_factor[inside] / np.cos(angles[0])


def _measure_errors(images: list[BallImage], albedo: float) -> tuple[Array, Array]:
    """Measure the relative differences (n,) from the snow law, as means over cells of 10 degrees of each angle. Also
    return the middles (3, n) of the cells."""
    angles, factors = (np.concatenate(parts, axis=-1) for parts in zip(*_collect_samples(images), strict=True))
    law = snow.reflectance_factor(angles[0], angles[1], angles[2], albedo)
    cells, which = np.unique((angles // _CELL_RAD).astype(int), axis=1, return_inverse=True)
    which, count = which.ravel(), np.bincount(which.ravel())
    ratio = np.bincount(which, factors) / np.bincount(which, law)
    whole = count >= 4  # fewer pixels are noise
    return ratio[whole] - 1, (cells[:, whole] + 0.5) * _CELL_RAD


def _make_rows(name: str, error: Array, middles: Array, allowed: float, unjudged: str = "") -> list[Row]:
    worst = int(np.argmax(np.abs(error)))
    i, e, azimuth = np.degrees(middles[:, worst])
    where = f"near i {i:.0f}°, e {e:.0f}°, azimuth {azimuth:.0f}°"
    return [
        Row(f"{name}: RMS difference", float(np.sqrt(np.mean(error**2))), 0.0, allowed, _SOURCE, unjudged=unjudged),
        Row(f"{name}: mean difference", float(np.mean(error)), 0.0, allowed, _SOURCE, unjudged=unjudged),
        Row(f"{name}: largest difference, {where}", float(error[worst]), 0.0, 3 * allowed, _SOURCE, unjudged=unjudged),
    ]


def _describe_surface(model: str, albedo: float, **changes: object) -> Settings:
    return merged(
        defaults(),
        check(
            {
                "surface": {
                    "model": model,
                    "albedo": albedo,
                    "albedo_variation": 0.0,
                    "grain_amplitude_m": 0.0,
                    **changes,
                }
            },
            "snow",
        ),
    )


def compute_lambert_errors() -> tuple[Array, Array]:
    """Compute the relative differences of a white Lambert surface from measured snow, on a grid of 5 degrees in
    incidence and emission and 10 degrees in azimuth. Also return the angles (3, n)."""
    i, e, azimuth = (
        axis.ravel()
        for axis in np.radians(
            np.meshgrid(
                np.arange(0.0, 71.0, 5.0), np.arange(0.0, 61.0, 5.0), np.arange(20.0, 161.0, 10.0), indexing="ij"
            )
        )
    )
    return 1 / snow.reflectance_factor(i, e, azimuth, 1.0) - 1, np.stack([i, e, azimuth])


def _compare_snow(bench: Bench) -> list[Row]:
    fresh = load_preset("surfaces/fresh_snow")
    law = _describe_surface("SNOW", 0.9)
    surfaces = {
        f"the law `SNOW` by {name} in Cycles": merged(law, check({"hapke": {"backend": backend}}, "snow"))
        for backend, name in (("NODES", "nodes"), ("OSL", "OSL"))
    } | {
        "`fresh_snow` without relief and patches": merged(
            defaults(),
            fresh,
            check({"surface": {"albedo_variation": 0.0, "grain_amplitude_m": 0.0, "glint_share": 0.0}}, "snow"),
        ),
        "`fresh_snow` without patches": merged(
            defaults(), fresh, check({"surface": {"albedo_variation": 0.0, "glint_share": 0.0}}, "snow")
        ),
    }
    found = render_ball(
        bench,
        list(surfaces.values()),
        _QUICK_PHASES_DEG if bench.quick else _PHASES_DEG,
        _CAMERA_DISTANCE_RADII,
        pixels=120,
        samples=32,
    )
    rows = _make_rows(
        "Lambert's law, albedo 1, by the formula",
        *compute_lambert_errors(),
        0.05,
        "it is no snow of ours; it shows how far a law without a phase function is off",
    )
    for (name, settings), images in zip(surfaces.items(), found, strict=True):
        error, middles = _measure_errors(images, float(settings.surface.albedo))
        rows += _make_rows(name, error, middles, 0.005 if settings.surface.model == "SNOW" else 0.05)
    return rows


COMPARISON = Comparison(
    "snow",
    "Snow on Earth",
    "Reflectance factors of a ball are compared with the snow law for the same albedo. They are means over "
    "cells of 10° of incidence, emission and azimuth, with incidence up to 70°, emission up to 60° and azimuth "
    "at least 20° from the plane of the Sun. Numbers are relative differences, with the noise of 32 samples. "
    "The ball has a radius of a metre. `fresh_snow` is without its glints, because so few pixels do not resolve "
    "them.",
    _compare_snow,
)
