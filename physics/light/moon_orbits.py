"""Places of the large moons of Saturn and Jupiter about their planet at a date, without kernels.

Saturn's moons: the theory of Dourneau 1987 (thesis, Bordeaux; also Meeus, Astronomical Algorithms, ch. 46). Jupiter's:
the largest terms of Lieske's E2 (Meeus, ch. 44). Both count longitudes from the equinox of B1950.

From 2000 to 2060 the moons of Jupiter, seen from Jupiter, are within 0.13° of Lainey's L1.2. From 1999 to 2039, 95 % of
the places of Saturn's moons are within 0.2°, Mimas' within 0.5°, of polynomials of the Bureau des Longitudes, seen from
Saturn along the line of sight from the Earth; later places were not compared. Hyperion, Iapetus and small moons are
left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .sunlight import AU_KM

#: Julian date of J2000, from which days are counted.
_J2000_JD = 2451545.0
#: Semi-major axes of Saturn's moons in units of 0.0001" at 9.538937 au.
_SATURN_UNIT_KM = math.radians(1e-4 / 3600) * 9.538937 * AU_KM
#: Unit of the distances in Lieske's theory. With it, distances agree with Lainey's L1.2 within 0.1 %.
_JUPITER_UNIT_KM = 71418.0
#: Inclination and node of Saturn's equator on the ecliptic of B1950.
_SATURN_TILT_DEG, _SATURN_NODE_DEG = 28.0817, 168.8112
#: Sine of the tilt of the planes about which the orbits of Rhea and Titan turn.
_TILT_SINE = 0.470730
#: Longitude of Jupiter's perihelion.
_PERIHELION_DEG = 13.469942


def _turn_about_x(angle_deg: float) -> Array:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _turn_about_z(angle_deg: float) -> Array:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _turn_about_y(angle_deg: float) -> Array:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


#: From the ecliptic of B1950 to the J2000 equatorial frame: obliquity 23.445792°, and the precession of Lieske et al.
#: 1977 (Astronomy and Astrophysics 58, 1).
_FROM_B1950 = _turn_about_z(0.320289) @ _turn_about_y(-0.278406) @ _turn_about_z(0.320234) @ _turn_about_x(23.445792)


@dataclass(frozen=True)
class _Ellipse:
    """A precessing orbit. Angles are in degrees; longitudes are counted along the reference plane, then along the
    orbit.
    """

    axis_km: float
    eccentricity: float
    longitude_deg: float
    pericentre_deg: float
    inclination_deg: float
    node_deg: float

    def place_km(self) -> Array:
        """Compute the moon's position (3,), in km, in the frame of the reference plane."""
        e, mean = self.eccentricity, math.radians((self.longitude_deg - self.pericentre_deg) % 360)
        eccentric = mean
        for _ in range(6):  # Newton; e is at most 0.03
            eccentric -= (eccentric - e * math.sin(eccentric) - mean) / (1 - e * math.cos(eccentric))
        plane = np.array([math.cos(eccentric) - e, math.sqrt(1 - e**2) * math.sin(eccentric), 0.0])
        turned = _turn_about_z(self.node_deg) @ _turn_about_x(self.inclination_deg)
        return np.asarray(turned @ _turn_about_z(self.pericentre_deg - self.node_deg) @ (self.axis_km * plane))


def _sin(angle_deg: float) -> float:
    return math.sin(math.radians(angle_deg % 360))


def _cos(angle_deg: float) -> float:
    return math.cos(math.radians(angle_deg % 360))


def _list_inner_orbits(days: float) -> dict[str, _Ellipse]:
    """List the orbits of Mimas to Dione about Saturn's equator. Mimas and Tethys librate about each other's motion in
    71 years, Enceladus and Dione in 11 and 4.
    """
    d = days + _J2000_JD - 2411093
    t = d / 365.25
    phase = 5.095 * (days / 365.25 + 2000 - 1866.39)
    swing = 43.57 * _sin(phase) + 0.7209 * _sin(3 * phase) + 0.0205 * _sin(5 * phase)
    pull = 0.25667 * _sin(74.4 + 32.39 * t) + 0.20983 * _sin(134.3 + 92.62 * t)
    orbits = {
        "MIMAS": (268180, 0.01905, 127.64 + 381.994497 * d - swing, 106.1 + 365.549 * t, 1.563, 54.5 - 365.072 * t),
        "ENCELADUS": (
            344301,
            0.00485,
            200.317 + 262.7319002 * d + pull,
            309.107 + 123.44121 * t,
            0.0262,
            348 - 151.95 * t,
        ),
        "TETHYS": (426393, 0.0, 285.306 + 190.69791226 * d + swing / 21.12, 0.0, 1.0976, 111.33 - 72.2441 * t),
        "DIONE": (545876, 0.002157, 254.712 + 131.53493193 * d - pull / 12, 174.8 + 30.82 * t, 0.0139, 232 - 30.27 * t),
    }
    return {name: _Ellipse(axis * _SATURN_UNIT_KM, *rest) for name, (axis, *rest) in orbits.items()}


def _find_rhea(days: float) -> _Ellipse:
    """Compute Rhea's orbit about the ecliptic; Titan forces a part of its eccentricity."""
    d = days + _J2000_JD - 2411093
    t = d / 365.25
    own, titan = 342.7 + 10.057 * t, 276.59 + 0.5118 * t
    e_sin = 0.000265 * _sin(own) + 0.001 * _sin(titan)
    e_cos = 0.000265 * _cos(own) + 0.001 * _cos(titan)
    node, solar = 345 - 10.057 * t, 42.02 - 0.5118 * t
    return _Ellipse(
        762277 * _SATURN_UNIT_KM,
        math.hypot(e_sin, e_cos),
        359.244 + 79.6900472 * d + 0.0867 * _sin(node),
        math.degrees(math.atan2(e_sin, e_cos)),
        _SATURN_TILT_DEG - 0.0455 + 0.3469 * _cos(node) + 0.0193 * _cos(solar),
        _SATURN_NODE_DEG - 0.0078 + (0.3469 * _sin(node) + 0.0193 * _sin(solar)) / _TILT_SINE,
    )


def _find_titan(days: float) -> _Ellipse:
    """Compute Titan's orbit about the ecliptic, with the Sun's effect on its eccentricity and pericentre."""
    d = days + _J2000_JD - 2411368
    t = d / 365.25
    turn, e = 42 - 0.5118 * t, 0.029092
    node = _SATURN_NODE_DEG - 0.1420 + 0.2960 * _sin(turn) / _TILT_SINE
    pericentre = 276.59 + 0.5118 * t
    twice = 2 * (pericentre - node - 4.6)
    return _Ellipse(
        1766041 * _SATURN_UNIT_KM,
        e * (1 + math.radians(0.3752) * (_cos(twice) - _cos(2 * 103.199))),
        261.1582 + 22.57697855 * d + 0.0740 * _sin(turn),
        pericentre + 0.3752 * (_sin(twice) - _sin(2 * 103.199)),
        _SATURN_TILT_DEG - 0.6303 + 0.2960 * _cos(turn),
        node,
    )


def _find_saturn_moons(days: float) -> dict[str, Array]:
    equator = (
        _FROM_B1950
        @ _turn_about_z(_SATURN_NODE_DEG)
        @ _turn_about_x(_SATURN_TILT_DEG)
        @ _turn_about_z(-_SATURN_NODE_DEG)
    )
    places = {name: equator @ orbit.place_km() for name, orbit in _list_inner_orbits(days).items()}
    outer = {"RHEA": _find_rhea(days), "TITAN": _find_titan(days)}
    return places | {name: _FROM_B1950 @ orbit.place_km() for name, orbit in outer.items()}


class _JupiterAngles:
    """The angles of Lieske's theory in degrees, by moon from Io outwards: mean longitudes ``l``, pericentres ``p``,
    nodes ``o``; the node of Jupiter's equator, Jupiter's mean anomaly, the phase of the libration, and the tilt of the
    equator to the orbit.
    """

    def __init__(self, days: float) -> None:
        t = days + _J2000_JD - 2443000.5
        self.l = [
            106.07719 + 203.488955790 * t,
            175.73161 + 101.374724735 * t,
            120.55883 + 50.317609207 * t,
            84.44459 + 21.571071177 * t,
        ]
        self.p = [
            97.0881 + 0.16138586 * t,
            154.8663 + 0.04726307 * t,
            188.1840 + 0.00712734 * t,
            335.2868 + 0.00184 * t,
        ]
        self.o = [
            312.3346 - 0.13279386 * t,
            100.4411 - 0.03263064 * t,
            119.1942 - 0.00717703 * t,
            322.6168 - 0.00175934 * t,
        ]
        self.equator = 316.5182 - 2.08e-6 * t
        great = 0.33033 * _sin(163.679 + 0.0010512 * t) + 0.03439 * _sin(34.486 - 0.0161731 * t)
        self.anomaly = 30.23756 + 0.0830925701 * t + great
        self.libration = 199.6766 + 0.17379190 * t
        self.tilt = 3.120262 + 0.0006 * (days + _J2000_JD - 2415020) / 36525


def _find_io(a: _JupiterAngles) -> tuple[float, float, float]:
    """Compute Io's longitude in degrees, the tangent of its latitude over Jupiter's equator, and its distance in the
    theory's unit.
    """
    (l1, l2, l3, _), (p1, p2, p3, p4), (o1, o2, o3, _) = a.l, a.p, a.o
    longitude = l1 + (
        0.47259 * _sin(2 * (l1 - l2))
        - 0.03478 * _sin(p3 - p4)
        + 0.01081 * _sin(l2 - 2 * l3 + p3)
        + 0.00738 * _sin(a.libration)
        + 0.00713 * _sin(l2 - 2 * l3 + p2)
        - 0.00674 * _sin(p1 + p3 - 2 * (_PERIHELION_DEG + a.anomaly))
        + 0.00666 * _sin(l2 - 2 * l3 + p4)
    )
    latitude = (
        0.0006393 * _sin(longitude - o1)
        + 0.0001825 * _sin(longitude - o2)
        + 0.0000329 * _sin(longitude - o3)
        + 0.0000311 * _sin(longitude - a.equator)
    )
    return longitude, latitude, 5.90569 * (1 - 0.0041339 * _cos(2 * (l1 - l2)))


def _find_europa(a: _JupiterAngles) -> tuple[float, float, float]:
    (l1, l2, l3, _), (_, p2, p3, p4), (_, o2, o3, o4) = a.l, a.p, a.o
    longitude = l2 + (
        1.06476 * _sin(2 * (l2 - l3))
        + 0.04256 * _sin(l1 - 2 * l2 + p3)
        + 0.03581 * _sin(l2 - p3)
        + 0.02395 * _sin(l1 - 2 * l2 + p4)
        + 0.01984 * _sin(l2 - p4)
        - 0.01778 * _sin(a.libration)
        + 0.01654 * _sin(l2 - p2)
        + 0.01334 * _sin(l2 - 2 * l3 + p2)
        + 0.01294 * _sin(p3 - p4)
        - 0.01142 * _sin(l2 - l3)
        - 0.01057 * _sin(a.anomaly)
    )
    latitude = (
        0.0081004 * _sin(longitude - o2)
        + 0.0004512 * _sin(longitude - o3)
        - 0.0003284 * _sin(longitude - a.equator)
        + 0.0001160 * _sin(longitude - o4)
    )
    return longitude, latitude, 9.39657 * (1 + 0.0093848 * _cos(l1 - l2) - 0.0003116 * _cos(l2 - p3))


def _find_ganymede(a: _JupiterAngles) -> tuple[float, float, float]:
    (_, l2, l3, l4), (_, p2, p3, p4), (_, o2, o3, o4) = a.l, a.p, a.o
    longitude = l3 + (
        0.16490 * _sin(l3 - p3)
        + 0.09081 * _sin(l3 - p4)
        - 0.06907 * _sin(l2 - l3)
        + 0.03784 * _sin(p3 - p4)
        + 0.01846 * _sin(2 * (l3 - l4))
        - 0.01340 * _sin(a.anomaly)
        - 0.01014 * _sin(2 * (a.equator - _PERIHELION_DEG))
        + 0.00704 * _sin(l2 - 2 * l3 + p3)
        - 0.00620 * _sin(l2 - 2 * l3 + p2)
    )
    latitude = (
        0.0032402 * _sin(longitude - o3)
        - 0.0016911 * _sin(longitude - a.equator)
        + 0.0006847 * _sin(longitude - o4)
        - 0.0002797 * _sin(longitude - o2)
    )
    swell = 0.0006342 * _cos(l2 - l3) - 0.0014388 * _cos(l3 - p3) - 0.0007919 * _cos(l3 - p4)
    return longitude, latitude, 14.98832 * (1 + swell)


def _find_callisto(a: _JupiterAngles) -> tuple[float, float, float]:
    l4, (_, _, p3, p4), (_, _, o3, o4) = a.l[3], a.p, a.o
    season = 2 * (_PERIHELION_DEG + a.anomaly)
    longitude = l4 + (
        0.84287 * _sin(l4 - p4)
        + 0.03431 * _sin(p4 - p3)
        - 0.03305 * _sin(2 * (a.equator - _PERIHELION_DEG))
        - 0.03211 * _sin(a.anomaly)
        - 0.01862 * _sin(l4 - p3)
        + 0.01186 * _sin(a.equator - o4)
        + 0.00623 * _sin(l4 + p4 - season)
    )
    latitude = (
        -0.0076579 * _sin(longitude - a.equator)
        + 0.0044134 * _sin(longitude - o4)
        - 0.0005112 * _sin(longitude - o3)
        + 0.0000773 * _sin(longitude + a.equator - season)
    )
    return longitude, latitude, 26.36273 * (1 - 0.0073546 * _cos(l4 - p4))


def _find_jupiter_moons(days: float) -> dict[str, Array]:
    angles = _JupiterAngles(days)
    node, inclination = 99.95349, 1.306015  # of Jupiter's orbit in 1950, on the ecliptic of that date
    frame = (
        _FROM_B1950
        @ _turn_about_z(node)
        @ _turn_about_x(inclination)
        @ _turn_about_z(angles.equator - node)
        @ _turn_about_x(angles.tilt)
    )
    places = {}
    theories = {"IO": _find_io, "EUROPA": _find_europa, "GANYMEDE": _find_ganymede, "CALLISTO": _find_callisto}
    for name, find in theories.items():
        longitude, tangent, distance = find(angles)
        along = longitude - angles.equator
        ray = np.array([_cos(along), _sin(along), tangent]) / math.hypot(1.0, tangent)
        places[name] = frame @ (distance * _JUPITER_UNIT_KM * ray)
    return places


def find_moon_places(planet: str, days: float) -> Mapping[str, Array]:
    """Find the positions (3,) in km of a planet's large moons from its centre, by their names in capitals, in the J2000
    equatorial frame, ``days`` (TDB) after J2000. Empty for a planet other than SATURN and JUPITER.
    """
    if planet == "SATURN":
        return _find_saturn_moons(days)
    return _find_jupiter_moons(days) if planet == "JUPITER" else {}
