"""Stars as the cameras see them: the brightest real stars, and fainter ones in realistic numbers.

A star's V magnitude is converted to the irradiance, over all wavelengths, of sunlight with the same light in V. A
camera whose band is a share of sunlight therefore gets the right number of photons at 550 nm. The star's colour is a
black body's, scaled to a mean of 1 over the bands R, G, B.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...support.arrays import Array, Numbers
from ..random_numbers.seeds import make_generator
from .sunlight import SOLAR_CONSTANT_WM2, sun_colour

SUN_V_MAG = -26.76  # at 1 au, Vega's zero point: Willmer 2018, ApJ Supplement 236, 47
#: Irradiance in W/m² of a star of V = 0, over all wavelengths of sunlight with that V.
V0_WM2 = SOLAR_CONSTANT_WM2 * 10 ** (0.4 * SUN_V_MAG)
#: V magnitude to which the catalogue is complete.
COMPLETE_TO_MAG = 2.5
#: Numbers of stars in the whole sky that are at least as bright as the whole magnitudes from 2 on: Tycho-2 (Høg et al.
#: 2000, A&A 355, L27), as counted at hnsky.org/star_count.htm. Star colours spread V and the counts by some percent.
_STARS_TO_MAG = (55, 191, 558, 1744, 5326, 16503, 48559)


@dataclass(frozen=True)
class Stars:
    """The n stars above the horizon."""

    direction: Array  # (n, 3) unit vectors
    irradiance_wm2: Array  # (n, 3) on a facing surface in R, G, B


@dataclass(frozen=True)
class Catalogue:
    """A catalogue of n stars by name, for the equator and epoch J2000."""

    name: tuple[str, ...]
    direction: Array  # (n, 3) unit vectors
    v_mag: Array  # (n,)
    b_v: Array  # (n,)


@lru_cache(maxsize=1)
def read_catalogue() -> Catalogue:
    """Read the stars of ``stars.csv``, brightest first: every star to V = 2.5; a double star has the light of both.

    Positions: Hipparcos (ESA SP-1200, 1997). V and B - V: Astronomical Almanac 2016, section H.
    """
    with (Path(__file__).parent / "stars.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    ascension, declination, v_mag, b_v = (
        np.array([float(row[key]) for row in rows]) for key in ("ra_h", "dec_deg", "v_mag", "b_v")
    )
    ascension, declination = np.radians(15 * ascension), np.radians(declination)
    direction = np.stack(
        [np.cos(declination) * np.cos(ascension), np.cos(declination) * np.sin(ascension), np.sin(declination)], axis=1
    )
    return Catalogue(tuple(row["name"] for row in rows), direction, v_mag, b_v)


def star_irradiance_wm2(v_mag: Array) -> Array:
    """Compute the irradiance (n,) in W/m² on a facing surface of stars with the V magnitudes (n,)."""
    return np.asarray(V0_WM2 * 10 ** (-0.4 * v_mag))


def star_temperature_k(b_v: float) -> float:
    """Compute the temperature in K of the black body that is nearest to a star's B - V: Ballesteros 2012, EPL 97,
    34008, eq. 14.
    """
    return 4600 * (1 / (0.92 * b_v + 1.7) + 1 / (0.92 * b_v + 0.62))


def count_stars_to(v_mag: Numbers) -> Array:
    """Estimate the number of stars in the whole sky that are at least as bright as a V magnitude from 2 to 8."""
    return np.exp(np.interp(v_mag, np.arange(2, 2 + len(_STARS_TO_MAG)), np.log(_STARS_TO_MAG)))


def _draw_faint(faintest_mag: float, seed: int) -> tuple[Array, Array]:
    """Draw directions (n, 3) and V magnitudes (n,) of stars fainter than the catalogue's, evenly over the sky. (Real
    stars crowd toward the Milky Way, about three times as dense there as at its poles.) Stars are drawn to the faintest
    magnitude that settings allow, so that a fainter limit moves no star.
    """
    random = make_generator(seed, "stars")
    first, last = count_stars_to(COMPLETE_TO_MAG), count_stars_to(2 + len(_STARS_TO_MAG) - 1)
    rank = np.arange(float(first), float(last))  # the brightest first
    grid = np.linspace(COMPLETE_TO_MAG, 2 + len(_STARS_TO_MAG) - 1, 1001)
    v_mag = np.interp(rank + random.random(len(rank)), count_stars_to(grid), grid)
    z, around = random.uniform(-1, 1, len(rank)), random.uniform(0, 2 * np.pi, len(rank))
    keep = v_mag <= faintest_mag
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=1)[keep], v_mag[keep]


def stars_above_horizon(faintest_mag: float, seed: int, from_j2000: Array) -> Stars:
    """Return the stars above the horizon, z > 0 in the frame into which the matrix ``from_j2000`` (3, 3) transforms."""
    known = read_catalogue()
    bright = known.v_mag <= faintest_mag
    direction, v_mag = known.direction[bright], known.v_mag[bright]
    colour = np.array([sun_colour(star_temperature_k(b_v)) for b_v in known.b_v[bright]]).reshape(-1, 3)
    if faintest_mag > COMPLETE_TO_MAG:
        more, their_mag = _draw_faint(faintest_mag, seed)
        direction, v_mag = np.concatenate([direction, more]), np.concatenate([v_mag, their_mag])
        colour = np.concatenate([colour, np.ones_like(more)])
    direction = direction @ from_j2000.T
    up = direction[:, 2] > 0
    return Stars(direction[up], star_irradiance_wm2(v_mag[up])[:, None] * colour[up])
