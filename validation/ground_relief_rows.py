"""Rows of the terrain presets: slopes as stated, exponents, curvature and shadows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..physics.terrain.roughness.statistics import measure_roughness, power_spectrum
from ..physics.terrain.terrain import Terrain, law_range_m, make_terrain
from ..settings.description import defaults, merged
from ..settings.preset_files import find_preset, load_preset, preset_names
from ..settings.toml_text import read_toml
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from .comparison import Row
from .ground import relief

#: Spacing in metres of the grid on a patch, and its points per side: 20 m.
SPACING_M = 0.04
POINTS = 501
#: Points around the patch that only cast shadows: 12 m, which is longer than any shadow of the presets' relief at 8°.
MARGIN = 300
SUNS_DEG = (60.0, 20.0, 8.0)
#: Shortest wavelength that the grid has.
_SHORTEST_M = 2 * SPACING_M
#: The grid cuts waves off, which changes deviations up to three times as long.
_SHORTEST_LAG_M = 3 * _SHORTEST_M
_FINE_LAG_M = 0.25
#: Longest and shortest wavelength of the spectrum's slope.
_SPECTRUM_M = (3.0, 0.3)
#: Kurtosis of the curvature of a Gaussian surface.
_GAUSSIAN_KURTOSIS = 3.0

# Widths of the rows. Each has its argument in the text of the comparison.
_SLOPE_SHARE = 0.1
_HURST_WIDTH = 0.05
_SPECTRUM_WIDTH = 0.2
_KURTOSIS_WIDTH = 0.5
_SHADOW_WIDTH = 0.06
_SAME_SPECTRUM_WIDTH = 0.03
_FEW_SHADOWS_WIDTH = 0.01

_STATED = "the preset; a patch of 20 m may differ by 10 %"
_LAW = "the preset's law of roughness"
_GAUSS = "Longuet-Higgins 1957 (Phil. Trans. R. Soc. A 249, 321): any derivative of a Gaussian surface is Gaussian"
_FACETS = "between twice a Gaussian surface's kurtosis and that of plates which are flat between their edges"
_SMITH = "Smith 1967, J. Geophys. Res. 72, 4059, for a Gaussian surface of the same RMS slope"
_SAME_SPECTRUM = "a Gaussian surface of the same power spectrum, by Fourier transform"
_WHY_SMITH = (
    "Cause, by a Gaussian surface of the same spectrum, which has the same shadows: the closed form leaves out that "
    "heights along a ray are correlated, and ground with many wavelengths has more shadow"
)
_WHY_SPECTRUM = "Cause unknown: octaves in steps of 1.4, and ground without multifractality, have the same exponent"
_WHY_KURTOSIS = (
    "Cause: multifractality, which alone raises the kurtosis to 3.7 where it is 0.7, and to 3.3 where it is 0.5"
)


@dataclass(frozen=True)
class Preset:
    """A terrain preset: its short name, complete settings, and the RMS slope that it states for its whole ground."""

    name: str
    settings: Settings
    stated_slope_deg: float

    @cached_property
    def is_random_surface(self) -> bool:
        """Whether the ground is the random surface alone, without layers, landforms and snow."""
        ground = make_terrain(self.settings, 0)
        return not (ground.layers or ground.landforms or ground.mantle_thickness_m or ground.talus)

    @property
    def plate_m(self) -> float:
        """Width of the preset's plates in metres; 0 without plates."""
        settings = self.settings
        return max(
            float(settings.chaos.plate_m) if settings.chaos.relief_m > 0 else 0.0,
            float(settings.cracks.plate_m) if settings.cracks.depth_m > 0 else 0.0,
        )


def read_preset(name: str) -> Preset:
    """Read a terrain preset. It states the slope of its whole ground in ``[measured]`` if its landforms change it."""
    settings = merged(defaults(), load_preset(name))
    measured = read_toml(find_preset(name)).get("measured", {})
    stated = measured.get("rms_slope_deg", settings.terrain.rms_slope_deg)
    return Preset(name.split("/")[-1], settings, float(stated))


def sample_square(ground: Terrain, points: int) -> Array:
    """Sample the heights (n, n), m, of a square about the middle of a ground, with landforms at their full height."""
    axis = (np.arange(points) - (points - 1) / 2) * SPACING_M
    # A uniform mesh lowers landforms that are too fine for it; the rendered mesh is graded and does not.
    whole = replace(ground, landforms=tuple(replace(each, finest_m=math.inf) for each in ground.landforms))
    return whole.heights(axis[None, :], axis[:, None], _SHORTEST_M)


def make_relief_rows(seeds: Sequence[int]) -> list[Row]:
    """Make the rows of all terrain presets, on grounds of some seeds."""
    rows = []
    for preset in map(read_preset, preset_names("terrains")):
        grounds = [make_terrain(preset.settings, seed) for seed in seeds]
        rows += make_patch_rows(preset, [sample_square(ground, POINTS) for ground in grounds])
        if preset.is_random_surface:
            rows += make_shadow_rows(preset, grounds, seeds)
    return rows


def make_patch_rows(preset: Preset, patches: Sequence[Array]) -> list[Row]:
    """Make the rows of a preset's patches of heights (n, n), except for shadows."""
    terrain = preset.settings.terrain
    shortest, longest = law_range_m(terrain)
    law_m = max(shortest, _SHORTEST_LAG_M), longest
    baseline = float(terrain.slope_baseline_m)
    found = [measure_roughness(patch, SPACING_M, baseline, law_m) for patch in patches]
    slope = float(np.mean([each.slope_deg for each in found]))
    stated = preset.stated_slope_deg
    rows = [
        Row(f"`{preset.name}`: RMS slope at {baseline:g} m", slope, stated, _SLOPE_SHARE * stated, _STATED, "°"),
        *_make_curvature_rows(preset, patches),
    ]
    if not preset.is_random_surface:
        return rows
    hurst = float(np.mean([each.hurst for each in found]))
    spectra = [power_spectrum(patch, SPACING_M) for patch in patches]
    fall = float(np.mean([relief.measure_spectral_slope(*each, *_SPECTRUM_M) for each in spectra]))
    asked = float(terrain.hurst)
    return [
        *rows,
        _make_fine_slope_row(preset, patches),
        Row(f"`{preset.name}`: Hurst exponent", hurst, asked, _HURST_WIDTH, _LAW),
        Row(
            f"`{preset.name}`: exponent of the power spectrum, 0.3 to 3 m",
            fall,
            -2.0 * (1.0 + asked),
            _SPECTRUM_WIDTH,
            f"{_LAW}: -2 (1 + H)",
            why=_WHY_SPECTRUM,
        ),
    ]


def _make_fine_slope_row(preset: Preset, patches: Sequence[Array]) -> Row:
    """Make the row of the RMS slope over a distance shorter than the baseline."""
    terrain = preset.settings.terrain
    found = [measure_roughness(patch, SPACING_M, _FINE_LAG_M).slope_deg for patch in patches]
    steeper = (_FINE_LAG_M / float(terrain.slope_baseline_m)) ** (float(terrain.hurst) - 1.0)
    asked = math.degrees(math.atan(math.tan(math.radians(terrain.rms_slope_deg)) * steeper))
    return Row(
        f"`{preset.name}`: RMS slope at {_FINE_LAG_M:g} m",
        float(np.mean(found)),
        asked,
        _SLOPE_SHARE * asked,
        _LAW,
        "°",
    )


def _make_curvature_rows(preset: Preset, patches: Sequence[Array]) -> list[Row]:
    """Make the rows of the kurtosis of curvature: of ground that should be Gaussian, or its logarithm for ground of
    plates."""
    kurtosis = float(np.mean([relief.measure_curvature_kurtosis(patch) for patch in patches]))
    if preset.is_random_surface:
        quantity = f"`{preset.name}`: kurtosis of curvature"
        return [Row(quantity, kurtosis, _GAUSSIAN_KURTOSIS, _KURTOSIS_WIDTH, _GAUSS, why=_WHY_KURTOSIS)]
    if preset.plate_m == 0.0:
        return []
    # Edges two spacings wide, twice per plate along each axis, hold all curvature: a share of 4 spacings per plate.
    logs = np.log10([2 * _GAUSSIAN_KURTOSIS, _GAUSSIAN_KURTOSIS * preset.plate_m / (4 * SPACING_M)])
    quantity = f"`{preset.name}`: logarithm of the kurtosis of curvature"
    return [Row(quantity, math.log10(kurtosis), float(logs.mean()), float(np.ptp(logs)) / 2, _FACETS)]


def make_shadow_rows(preset: Preset, grounds: Sequence[Terrain], seeds: Sequence[int]) -> list[Row]:
    """Make the rows of the share in shadow under three Suns, beside the closed form and a Gaussian surface of the same
    spectrum."""
    ours: list[list[float]] = []
    theirs: list[list[float]] = []
    slopes: list[float] = []
    for ground, seed in zip(grounds, seeds, strict=True):
        made = sample_square(ground, POINTS + 2 * MARGIN)
        slopes.append(relief.measure_point_slope(made[MARGIN:-MARGIN, MARGIN:-MARGIN], SPACING_M))
        other = relief.draw_gaussian_surface(ground.base, len(made), SPACING_M, np.random.default_rng(seed))
        other *= slopes[-1] / relief.measure_point_slope(other, SPACING_M)
        for shares, heights in ((ours, made), (theirs, other)):
            shares.append([relief.measure_shadow_share(heights, SPACING_M, sun, MARGIN) for sun in SUNS_DEG])
    slope = math.sqrt(float(np.mean(np.square(slopes))))
    rows = []
    for sun, share, same in zip(SUNS_DEG, np.mean(ours, axis=0), np.mean(theirs, axis=0), strict=True):
        quantity = f"`{preset.name}`: share in shadow, Sun at {sun:g}°"
        closed = relief.predict_shadow_share(sun, slope)
        widths = [
            width if expected >= width else _FEW_SHADOWS_WIDTH
            for width, expected in ((_SHADOW_WIDTH, closed), (_SAME_SPECTRUM_WIDTH, same))
        ]
        why = _WHY_SMITH if abs(share - same) <= widths[1] else ""
        rows += [
            Row(f"{quantity}, closed form", float(share), closed, widths[0], _SMITH, why=why),
            Row(f"{quantity}, same spectrum", float(share), float(same), widths[1], _SAME_SPECTRUM),
        ]
    return rows
