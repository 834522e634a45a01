"""Moons and their planets: shape, orientation and mean orbit, as the sky needs them.

Angles are in degrees, T in Julian centuries and d in days since J2000 (TDB). Orientation: IAU working group (Archinal
et al. 2018, Celestial Mechanics 130, 22). Orbits of the planets about the Sun: Standish's elements for 1800 to 2050
(Solar System Dynamics group, JPL, "Approximate Positions of the Planets", table 1). Longitude of the planet above a
moon: terms of the theories of Dourneau 1987 (thesis, Bordeaux; also Meeus, Astronomical Algorithms, ch. 46) and
Lieske's E2 (ibid., ch. 44), reduced to the body-fixed frames above. Distances of the moons: their semi-major axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Orbit:
    """Heliocentric elements at J2000 (mean ecliptic and equinox), each with its change per century."""

    semi_major_axis_au: tuple[float, float]
    eccentricity: tuple[float, float]
    inclination_deg: tuple[float, float]
    mean_longitude_deg: tuple[float, float]
    perihelion_deg: tuple[float, float]
    node_deg: tuple[float, float]


@dataclass(frozen=True)
class Body:
    """A moon and its planet; the moon stays above the planet's equator."""

    parent: str
    radii_km: tuple[float, float, float]  # towards the planet, along the orbit, along the axis
    distance_km: float  # of the planet
    planet_equator_km: float
    planet_pole_km: float
    orientation: Callable[[float], tuple[float, float, float]]  # d -> right ascension, declination, W in degrees
    under_planet: Callable[[float], tuple[float, float]]  # d -> east longitude in degrees, distance over the mean
    orbit: Orbit


def _enceladus_orientation(d: float) -> tuple[float, float, float]:
    t = d / 36525
    return 40.66 - 0.036 * t, 83.52 - 0.004 * t, 6.32 + 262.7318996 * d


def _europa_orientation(d: float) -> tuple[float, float, float]:
    t = d / 36525
    j4, j5, j6, j7 = (
        math.radians(a + b * t) for a, b in ((355.80, 1191.3), (119.90, 262.1), (229.80, 64.3), (352.25, 2382.6))
    )
    return (
        268.08 - 0.009 * t + 1.086 * math.sin(j4) + 0.060 * math.sin(j5) + 0.015 * math.sin(j6) + 0.009 * math.sin(j7),
        64.51 + 0.003 * t + 0.468 * math.cos(j4) + 0.026 * math.cos(j5) + 0.007 * math.cos(j6) + 0.002 * math.cos(j7),
        36.022
        + 101.3747235 * d
        - 0.980 * math.sin(j4)
        - 0.054 * math.sin(j5)
        - 0.014 * math.sin(j6)
        - 0.008 * math.sin(j7),
    )


#: Mean east longitude of Saturn from the meridian that the crater Salih defines, from 2000 to 2060.
_SATURN_LONGITUDE_DEG = -4.09
#: Mean east longitude of Jupiter from the meridian that the crater Cilix defines, from 2000 to 2060.
_JUPITER_LONGITUDE_DEG = -1.53


def _place_under_saturn(d: float) -> tuple[float, float]:
    """Return the east longitude of Saturn in degrees, and its relative distance. Terms: eccentricity 0.00485, and the
    effect of Dione on the mean longitude in 11.1 and 3.9 years.
    """
    days = d + 40452.0  # from JD 2411093
    years = days / 365.25
    anomaly = math.radians((200.317 + 262.7319002 * days - 309.107 - 123.44121 * years) % 360)
    slow = 0.25667 * math.sin(math.radians(74.4 + 32.39 * years)) + 0.20983 * math.sin(
        math.radians(134.3 + 92.62 * years)
    )
    return _SATURN_LONGITUDE_DEG + 0.55577 * math.sin(anomaly) + slow, 1.0 - 0.00485 * math.cos(anomaly)


def _place_under_jupiter(d: float) -> tuple[float, float]:
    """Return the east longitude of Jupiter in degrees, and its relative distance. The eccentricity of 0.0094 is kept up
    by Io and Ganymede; the pericentre is where Europa passes Ganymede.
    """
    days = d + 8544.5  # from JD 2443000.5
    anomaly = math.radians(2 * (175.73161 + 101.374724735 * days - 120.55883 - 50.317609207 * days) % 360)
    return _JUPITER_LONGITUDE_DEG + 1.06476 * math.sin(anomaly), 1.0 - 0.0093848 * math.cos(anomaly)


_JUPITER = Orbit(
    (5.20288700, -0.00011607),
    (0.04838624, -0.00013253),
    (1.30439695, -0.00183714),
    (34.39644051, 3034.74612775),
    (14.72847983, 0.21252668),
    (100.47390909, 0.20469106),
)
_SATURN = Orbit(
    (9.53667594, -0.00125060),
    (0.05386179, -0.00050991),
    (2.48599187, 0.00193609),
    (49.95424423, 1222.49362201),
    (92.59887831, -0.41897216),
    (113.66242448, -0.28867794),
)

BODIES = {
    "ENCELADUS": Body(
        "SATURN",
        (256.6, 251.4, 248.3),
        238040.0,
        60268.0,
        54364.0,
        _enceladus_orientation,
        _place_under_saturn,
        _SATURN,
    ),
    "EUROPA": Body(
        "JUPITER",
        (1562.6, 1560.3, 1559.5),
        671100.0,
        71492.0,
        66854.0,
        _europa_orientation,
        _place_under_jupiter,
        _JUPITER,
    ),
}
