"""Scans of real ground, NASA's FROST, beside the terrain presets: slopes, Hurst exponents, relief and spectra.

The slope of a scan chooses the preset for the comparison. The other numbers test whether ground with that slope also
has the scan's other statistics.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..formats.ply import read_vertices
from ..physics.terrain.roughness.statistics import measure_roughness, power_spectrum
from ..physics.terrain.terrain import make_terrain
from ..physics.triangle_files.obj import parse_triangles
from ..settings.description import defaults, merged
from ..settings.preset_files import load_preset, preset_names
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.foreign_bytes import read
from .comparison import Bench, Comparison, Row

#: Size in metres of a patch and spacing of the grid on which both grounds are measured; a quarter is a quadrant.
SIZE_M, SPACING_M = 5.0, 0.02
#: Least side in metres of a scan; a smaller one is not in metres.
_MIN_SIDE_M = 4.0
#: Largest side in metres of a scan.
_MAX_SIDE_M = 12.0
#: Largest share of cells without a point; these cells get the mean of their neighbours.
_MAX_HOLES_SHARE = 0.05
_MAX_TRIANGLES = 20_000_000
#: Distance in metres of the slope that chooses the preset.
_CHOOSING_LAG_M = 0.5
#: Distance of the slope that is judged.
_JUDGED_LAG_M = 0.1
#: Distances of the Hurst exponent.
_HURST_LAGS_M = (0.06, 0.6)
#: Wavelength of the spectrum.
_SPECTRUM_WAVELENGTH_M = 0.2
_SEED = 1
#: Student's factor of a 95 % interval for two means of four quadrants each (6 degrees of freedom).
_STUDENT_FACTOR = 2.45
_SOURCE = "FROST, Wong et al. 2019, NASA Ames Research Center: {name}"
_DATA_PAGE = "ti.arc.nasa.gov/dataset/frost"
_FIX = f"get the scan again ({_DATA_PAGE})"
_SUFFIXES = (".ply", ".obj")
_CHOOSING_STATISTIC = "slope"


@dataclass(frozen=True)
class Statistic:
    """A number of a patch, and its standard error from the differences between the four quadrants."""

    value: float
    error: float


def read_scan(path: Path) -> Array:
    """Read the heights (n, n), m, of the middle of a scan, ``SPACING_M`` apart, from its points or vertices, z up.

    A cell has the mean height of its points. Raises IcyMoonError if the file is no scan in metres, or has too many
    holes.
    """
    if path.suffix.lower() == ".obj":
        points, _ = read(path, lambda foreign: parse_triangles(foreign, _MAX_TRIANGLES), "a mesh in OBJ", _FIX)
    else:
        found = read_vertices(path)
        if found is None:
            raise IcyMoonError(f"{path}: has no x, y and z of vertices first; save it as a plain PLY file.")
        points = found
    points = points[np.isfinite(points).all(axis=1)]
    sides = np.ptp(points[:, :2], axis=0) if len(points) else np.zeros(2)
    if not (sides.min() >= _MIN_SIDE_M and sides.max() <= _MAX_SIDE_M):
        raise IcyMoonError(
            f"{path}: is {sides[0]:.3g} x {sides[1]:.3g} wide; a scan has sides of "
            f"{_MIN_SIDE_M:g} to {_MAX_SIDE_M:g} m, in "
            "metres with z up."
        )
    return _fill_holes(path, *_sum_into_cells(points, min(SIZE_M, float(sides.min()))))


def _sum_into_cells(points: Array, side_m: float) -> tuple[Array, Array]:
    """Add up the heights in each cell of a square in the middle of the points. Returns the sums and the numbers of
    points, both (n, n)."""
    count = int(side_m / SPACING_M + 1e-6)
    corner = (points[:, :2].min(axis=0) + points[:, :2].max(axis=0) - count * SPACING_M) / 2
    column, row = np.floor((points[:, :2] - corner) / SPACING_M).astype(int).T
    inside = (column >= 0) & (column < count) & (row >= 0) & (row < count)
    cell = row[inside] * count + column[inside]
    sums, counts = (np.bincount(cell, weight, count * count) for weight in (points[inside, 2], None))
    return sums.reshape(count, count), counts.reshape(count, count)


def _fill_holes(path: Path, sums: Array, counts: Array) -> Array:
    """Compute the mean heights of the cells; a cell without a point gets the mean of its neighbours. Raises
    IcyMoonError if there are too many such cells."""
    holes = float(np.mean(counts == 0))
    if holes > _MAX_HOLES_SHARE:
        raise IcyMoonError(
            f"{path}: {holes:.0%} of the cells of {SPACING_M * 100:g} cm have no point, "
            f"{_MAX_HOLES_SHARE:.0%} are allowed; "
            "give the scan at full resolution."
        )
    with np.errstate(invalid="ignore"):
        heights = sums / counts
    while (empty := np.isnan(heights)).any():
        around = np.pad(heights, 1, constant_values=np.nan)
        beside = np.stack([around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1]])
        known = np.isfinite(beside)
        mean = np.where(known, beside, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        heights = np.where(empty & known.any(axis=0), mean, heights)
    return np.asarray(heights)


def measure_statistics(heights_m: Array) -> dict[str, Statistic]:
    """Measure the compared statistics of a patch of heights (n, n)."""
    half = len(heights_m) // 2
    quadrants = [_measure_numbers(heights_m[y : y + half, x : x + half]) for y in (0, half) for x in (0, half)]
    return {
        name: Statistic(value, float(np.std([each[name] for each in quadrants], ddof=1) / np.sqrt(len(quadrants))))
        for name, value in _measure_numbers(heights_m).items()
    }


def _measure_numbers(heights_m: Array) -> dict[str, float]:
    found = measure_roughness(heights_m, SPACING_M, _CHOOSING_LAG_M, _HURST_LAGS_M)
    waves, density = power_spectrum(heights_m, SPACING_M)
    return {
        _CHOOSING_STATISTIC: found.slope_deg,
        f"RMS slope at {_JUDGED_LAG_M:g} m": measure_roughness(
            heights_m, SPACING_M, _JUDGED_LAG_M, _HURST_LAGS_M
        ).slope_deg,
        f"Hurst exponent from {_HURST_LAGS_M[0]:g} to {_HURST_LAGS_M[1]:g} m": found.hurst,
        "RMS height": found.height_m,
        f"logarithm of the power spectrum at {_SPECTRUM_WAVELENGTH_M:g} m": float(
            np.interp(-np.log10(_SPECTRUM_WAVELENGTH_M), np.log10(waves), np.log10(np.maximum(density, 1e-30)))
        ),
    }


@cache
def measure_preset(name: str) -> dict[str, Statistic]:
    """Measure the statistics of the middle of a terrain preset, as ``measure_statistics`` does."""
    ground = make_terrain(merged(defaults(), load_preset(name)), _SEED)
    axis = (np.arange(int(SIZE_M / SPACING_M + 1e-6)) + 0.5) * SPACING_M - SIZE_M / 2
    return measure_statistics(ground.heights(axis[None, :], axis[:, None], 2 * SPACING_M))


def compare_scan(path: Path) -> list[Row]:
    """Compare a scan with the preset whose slope is nearest. Returns the row of that slope, and the rows of the numbers
    that the preset predicts."""
    theirs = measure_statistics(read_scan(path))
    presets = {name: measure_preset(name) for name in preset_names("terrains")}
    name = min(
        presets, key=lambda each: abs(presets[each][_CHOOSING_STATISTIC].value - theirs[_CHOOSING_STATISTIC].value)
    )
    return [
        Row(
            f"{path.stem} and `{name.split('/')[-1]}`: "
            + (f"RMS slope at {_CHOOSING_LAG_M:g} m, which chooses the preset" if key == _CHOOSING_STATISTIC else key),
            ours.value,
            theirs[key].value,
            _STUDENT_FACTOR * float(np.hypot(ours.error, theirs[key].error)),
            _SOURCE.format(name=path.name),
            "°" if "slope" in key else "m" if "height" in key else "",
            fitted=key == _CHOOSING_STATISTIC,
        )
        for key, ours in presets[name].items()
    ]


def _compare_scans(bench: Bench) -> list[Row]:
    folder = bench.frost
    if folder is None:
        raise IcyMoonError(
            f"No folder of the FROST scans is given; get them from {_DATA_PAGE}, and pass --frost FOLDER."
        )
    if not folder.is_dir():
        raise IcyMoonError(f"--frost: {folder} is not a folder; give the folder of scans from {_DATA_PAGE}.")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES)
    if not paths:
        raise IcyMoonError(
            f"--frost: {folder} has no scan ({' or '.join(_SUFFIXES)}); get them from {_DATA_PAGE}, "
            "or give their folder."
        )
    return [row for path in paths for row in compare_scan(path)]


COMPARISON = Comparison(
    "frost",
    "Scans of real ground",
    "NASA Ames scanned salt, soil and rock of Death Valley and the Atacama Desert as examples of the ground of ocean "
    "worlds: eleven patches of 5 x 5 m with points 2.5 mm apart (FROST, Wong et al. 2019, "
    "ti.arc.nasa.gov/dataset/frost). Each scan is held beside the terrain preset whose RMS slope at 0.5 m is nearest. "
    "This row chooses the preset, so agreement in it is not judged; the others test whether that preset has the scan's "
    "slope at 0.1 m, Hurst exponent, RMS height and power spectrum too. Heights are means over cells of 2 cm, and "
    "presets have their waves from 4 cm on. Allowed is the 95 % interval of the difference of two "
    "patches, by how much the quadrants of each differ.\n\n"
    "The data are not shipped, and no one here had them, so no number stands on this page. FOLDER has the scans as PLY "
    "or OBJ files, in metres with z up. A test holds the command to ground of a known Hurst exponent.",
    _compare_scans,
    quick=False,
    needs="frost",
)
