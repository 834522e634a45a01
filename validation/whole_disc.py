"""Compares a ball of a preset's surface, rendered in Cycles, with the integral of the formula over a sphere."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..physics.surfaces import photometry
from ..settings.description import check, defaults, merged
from ..settings.preset_files import load_preset
from ..settings.topics.scene import Settings
from .ball import BallImage, render_ball
from .comparison import Bench, Comparison, Row
from .moon_albedos import read_preset_photometric_law

PRESETS = ("hapke_enceladus_global", "hapke_europa_global", "hapke_lunar_like")
_PHASES_DEG = (0.0, 1.0, 3.0, 10.0, 30.0, 50.0, 70.0, 90.0, 120.0, 150.0)
#: Phase angles in degrees of a quick run; five still give a quadratic fit.
_QUICK_PHASES_DEG = (0.0, 10.0, 40.0, 80.0, 120.0)
#: Distance of the camera in radii of the ball; the disc then spans phase angles of 0.011 degrees.
_CAMERA_DISTANCE_RADII = 10000.0
_TOLERANCE = 0.005
_SOURCE = "integral of the formula in double precision"


def _fit_equigonal_albedo(factors: list[float], phases_deg: list[float]) -> float:
    return float(np.polyfit(phases_deg, factors, 2)[-1])


def _measure_mirror_point(image: BallImage) -> float:
    """Measure I/F where incidence and emission are half of the phase angle: the mean of the pixels within 2 degrees of
    this point.

    The mean over a small round patch differs from the value at its middle by the curvature of the law there, 1e-3 of
    it.
    """
    half = image.phase / 2
    near = (np.hypot(image.incidence - half, image.emission - half) < np.radians(2.0)) & (
        np.abs(np.pi - image.azimuth) < np.radians(10.0 + np.degrees(0.05 / max(np.sin(half), 0.05)))
    )
    return float(image.radiance_factor[near].mean())


def _make_ball_rows(preset: str, backend: str, images: list[BallImage]) -> list[Row]:
    law, name = (
        read_preset_photometric_law(f"surfaces/{preset}"),
        f"`{preset}`, {'OSL' if backend == 'OSL' else 'nodes'}",
    )
    phases = np.array([image.phase for image in images])
    formula = photometry.disc_brightness(law, phases)
    ratio = np.array([image.brightness for image in images]) / formula
    worst = int(np.argmax(np.abs(ratio - 1)))
    # Between its phase angles, the rendered curve is the formula's curve times the ratio of both.
    alpha = np.linspace(0.0, np.pi, 721)
    curve = photometry.disc_brightness(law, alpha) * np.interp(alpha, phases, ratio)
    bond = float(np.trapz(2 * curve * np.sin(alpha), alpha))
    fitted = [image for image in images if np.radians(9.9) < image.phase < np.radians(120.1)]
    degrees = [float(np.degrees(image.phase)) for image in fitted]
    half = np.radians(degrees) / 2
    of_formula = list(np.pi * law(half, half, np.full_like(half, np.pi)))

    def relative(quantity: str, ours: float, theirs: float) -> Row:
        return Row(f"{name}: {quantity}", ours, theirs, _TOLERANCE * theirs, _SOURCE)

    return [
        relative(
            f"brightness at phase {np.degrees(phases[worst]):g}°, the worst of {len(phases)}",
            float(ratio[worst] * formula[worst]),
            float(formula[worst]),
        ),
        relative("geometric albedo", float(ratio[0] * formula[0]), float(formula[0])),
        relative("Bond albedo", bond, photometry.bond_albedo(law)),
        relative(
            "equigonal albedo",
            _fit_equigonal_albedo([_measure_mirror_point(image) for image in fitted], degrees),
            _fit_equigonal_albedo(of_formula, degrees),
        ),
    ]


def describe_surface(preset: str, backend: str) -> Settings:
    """Return a surface preset's settings, without the rest of its scene."""
    return merged(defaults(), load_preset(f"surfaces/{preset}"), check({"hapke": {"backend": backend}}, "whole disc"))


def _compare_discs(bench: Bench) -> list[Row]:
    cases = list(product(PRESETS[:1] if bench.quick else PRESETS, ("NODES", "OSL")))
    images = render_ball(
        bench,
        [describe_surface(*case) for case in cases],
        _QUICK_PHASES_DEG if bench.quick else _PHASES_DEG,
        _CAMERA_DISTANCE_RADII,
    )
    return [row for case, found in zip(cases, images, strict=True) for row in _make_ball_rows(*case, found)]


COMPARISON = Comparison(
    "disc",
    "Whole discs in Cycles",
    "A ball with the surface of a preset is rendered over phase angles and summed over the image. The sum is "
    "compared with the integral of the formula over a sphere. Between the phase angles, the Bond albedo takes "
    "the shape of the formula's curve. The equigonal albedos are fitted at the same phase angles. The camera is "
    "10 000 radii away. The disc then spans phase angles of 0.011°, which takes 0.3 % from the top of "
    "Enceladus' surge; the numbers contain this.",
    _compare_discs,
)
