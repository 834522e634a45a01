"""Directions of Sun and planet from a site at a date, without kernels: elements and rotation of ``bodies``.

From 2000 to 2060 the Sun's direction is within 0.25° (Enceladus) and 0.15° (Europa) of full theories, its distance
within 0.2 %. The planet swings about its mean place above the moon by twice the eccentricity of the orbit, 0.56° and
1.06°; above Enceladus it swings by as much again over years. With these terms it is within 0.05° and 0.15° of full
theories. Other moons are placed relative to the planet, see ``moon_orbits``. ``spice`` gives exact directions from
kernels.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import shorten
from .bodies import BODIES, Orbit
from .moon_orbits import find_moon_places

#: Seconds by which TDB, the time of ephemerides, is ahead of UTC; right from 2017 on, 5 s too large in 2000.
_TDB_UTC_S = 69.184
#: First and last year for which the directions were compared with full theories.
_KNOWN_YEARS = (2000, 2060)
_OBLIQUITY = math.radians(23.43928)  # of the ecliptic, J2000


@dataclass(frozen=True)
class Positions:
    """Sun and planet in the sky of a site; directions are unit vectors (3,): east, north, up."""

    sun: Array
    sun_distance_au: float
    planet_name: str  # in capitals
    planet: Array
    planet_distance_km: float
    planet_equator_km: float
    planet_pole_km: float
    planet_axis: Array
    from_j2000: Array  # (3, 3) from the J2000 equatorial frame
    moons_km: Mapping[str, Array] = field(default_factory=dict)  # (3,) of other moons from the site, by name

    def turned(self, north_deg: float) -> Positions:
        """Return the same positions in axes whose y is turned so that north is at this angle, clockwise, from y."""
        turn = _rotation_about_z(math.radians(north_deg))
        return replace(
            self,
            sun=turn @ self.sun,
            planet=turn @ self.planet,
            planet_axis=turn @ self.planet_axis,
            from_j2000=turn @ self.from_j2000,
            moons_km={name: turn @ place for name, place in self.moons_km.items()},
        )


#: Pattern of a date, with optional month and day.
_DAY_PATTERN = r"\s*([0-9]{4})(?:-([0-9]{2})(?:-([0-9]{2})"
#: Pattern of the time of day.
_TIME_PATTERN = r"(?:[T ]([0-9]{2})(?::([0-9]{2})(?::([0-9]{2})(\.[0-9]+)?)?)?"
#: Pattern of the time zone: the lead of its clock over UTC.
_ZONE_PATTERN = r"(?:\s*(?:[Zz]|([+-])([01][0-9])(?::?([0-5][0-9]))?))?"
_DATE = re.compile(rf"{_DAY_PATTERN}{_TIME_PATTERN}{_ZONE_PATTERN})?)?)?\s*")


def parse_date(date_utc: str) -> np.datetime64:
    """Parse a date such as 2035-03-01T12:00:00, to the millisecond; UTC may be stated as Z or +00:00. Raises
    IcyMoonError if the text is not a date, if the calendar lacks the date, or if it states another time zone.
    """
    shown = f"light.date_utc is {shorten(date_utc)!r}"
    match = _DATE.fullmatch(date_utc)
    if match is None:
        raise IcyMoonError(f"{shown}; write it as 2035-03-01T12:00:00.")
    year, month, day = (int(part or 1) for part in match.groups()[:3])
    hour, minute, second = (int(part or 0) for part in match.groups()[3:6])
    fraction, sign, zone_hours, zone_minutes = match.groups()[6:]
    if lack := _describe_missing_date(year, month, day, hour, minute, second + float(fraction or 0)):
        raise IcyMoonError(f"{shown}, but {lack}.")
    date = np.datetime64(f"{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}", "ms") + np.timedelta64(
        int(f"{fraction or '.'}000"[1:4]), "ms"
    )
    ahead = np.timedelta64(60 * int(zone_hours or 0) + int(zone_minutes or 0), "m")
    if ahead:
        raise IcyMoonError(
            f"{shown}, which is not in UTC; write the same moment as "
            f"{format_date(date - ahead if sign == '+' else date + ahead)}."
        )
    return date


def format_date(date: np.datetime64) -> str:
    """Format a date as ``light.date_utc`` states it, without milliseconds that are 0."""
    return str(date.astype("datetime64[ms]")).removesuffix(".000")


def _describe_missing_date(year: int, month: int, day: int, hour: int, minute: int, second: float) -> str:
    """Return the reason, as a clause with the fix, why a day or time of day does not exist; empty if the date
    exists.
    """
    if not 1 <= month <= 12:
        return "a year has 12 months; write a month from 01 to 12"
    first = np.datetime64(f"{year:04}-{month:02}", "M")
    days = int(((first + np.timedelta64(1, "M")).astype("datetime64[D]") - first.astype("datetime64[D]")).astype(int))
    if not 1 <= day <= days:
        return f"{first} has {days} days; write a day from 01 to {days}"
    if hour > 23:
        next_day = first.astype("datetime64[D]") + np.timedelta64(day, "D")
        return "the hours of a day are 00 to 23; " + (
            "write an hour from 00 to 23" if hour > 24 or minute or second else f"write its end as {next_day}T00:00:00"
        )
    if minute > 59:
        return "an hour has 60 minutes; write a minute from 00 to 59"
    return "" if second < 60 else "a minute has 60 seconds here; write a second from 00 to 59"


def days_since_j2000(date_utc: str) -> float:
    """Compute the days (TDB) since 2000-01-01 12:00 of a UTC date such as 2035-03-01T12:00:00.

    Raises IcyMoonError if the text is not a date in UTC.
    """
    date = parse_date(date_utc)
    return (
        float((date - np.datetime64("2000-01-01T12:00", "ms")) / np.timedelta64(1, "ms") + 1000 * _TDB_UTC_S) / 86.4e6
    )


def refuse_unknown_years(date_utc: str) -> None:
    """Raise IcyMoonError for a date outside the validity of the elements, or for a text that is not a date."""
    days = days_since_j2000(date_utc)
    if not days_since_j2000(f"{_KNOWN_YEARS[0]}-01-01") <= days < days_since_j2000(f"{_KNOWN_YEARS[1] + 1}-01-01"):
        raise IcyMoonError(
            f"light.date_utc is {date_utc}, but without kernels Sun and planet are known only from "
            f"{_KNOWN_YEARS[0]} to {_KNOWN_YEARS[1]}; choose a date of these years, or set light.directions_from to "
            "KERNELS."
        )


def heliocentric_position_au(orbit: Orbit, days: float) -> Array:
    """Compute the position (3,) from the Sun in the J2000 equatorial frame, in au, some ``days`` after J2000."""
    century = days / 36525
    a, e, inclination, longitude, perihelion, node = (
        at + rate * century
        for at, rate in (
            orbit.semi_major_axis_au,
            orbit.eccentricity,
            orbit.inclination_deg,
            orbit.mean_longitude_deg,
            orbit.perihelion_deg,
            orbit.node_deg,
        )
    )
    mean = math.radians((longitude - perihelion) % 360)
    eccentric = mean + e * math.sin(mean)
    for _ in range(8):  # Newton; e is 0.05
        eccentric -= (eccentric - e * math.sin(eccentric) - mean) / (1 - e * math.cos(eccentric))
    plane = np.array([a * (math.cos(eccentric) - e), a * math.sqrt(1 - e**2) * math.sin(eccentric), 0.0])
    to_ecliptic = (
        _rotation_about_z(-math.radians(node))
        @ _rotation_about_x(-math.radians(inclination))
        @ _rotation_about_z(-math.radians(perihelion - node))
    )
    return np.asarray(_rotation_about_x(-_OBLIQUITY) @ to_ecliptic @ plane)


def body_frame(orientation: tuple[float, float, float]) -> Array:
    """Compute the matrix (3, 3) from the J2000 equatorial to the body-fixed frame, from right ascension and declination
    of the pole and W, in degrees.
    """
    ascension, declination, turned = (math.radians(angle % 360) for angle in orientation)
    return (
        _rotation_about_z(turned)
        @ _rotation_about_x(math.pi / 2 - declination)
        @ _rotation_about_z(math.pi / 2 + ascension)
    )


def site_frame(radii_km: tuple[float, float, float], latitude_deg: float, longitude_deg: float) -> tuple[Array, Array]:
    """Compute the position (3,) in km and the rows east, north, up (3, 3) of planetocentric coordinates, in the
    body-fixed frame. Up is the normal of the ellipsoid; on Enceladus it leans up to 1.9° from the radius.
    """
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    radial = np.array(
        [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
    )
    radii = np.array(radii_km)
    position = radial / np.linalg.norm(radial / radii)
    return position, local_axes(position / radii**2, longitude, radii_km)


def local_axes(normal: Array, longitude: float, radii_km: Sequence[float]) -> Array:
    """Compute the rows east, north, up (3, 3) of the normal of an ellipsoid at a longitude in radians. At a pole, north
    is the limit along the meridian of the longitude.
    """
    up = normal / np.linalg.norm(normal)
    east = np.array([-math.sin(longitude) / radii_km[1] ** 2, math.cos(longitude) / radii_km[0] ** 2, 0.0])
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(up, east), up])


def find_positions(body: str, date_utc: str, latitude_deg: float, longitude_deg: float) -> Positions:
    """Find the Sun, the planet and its other large moons over a site of a body in ``bodies.BODIES``. Raises
    IcyMoonError for any other body.
    """
    name = body.strip().upper()
    try:
        moon = BODIES[name]
    except KeyError:
        raise IcyMoonError(
            f"light.body is {body!r}; without kernels only {' and '.join(BODIES)} are known; give light.kernels or "
            "set light.directions_from to ANGLES."
        ) from None
    days = days_since_j2000(date_utc)
    place, axes = site_frame(moon.radii_km, latitude_deg, longitude_deg)
    toward_sun = -heliocentric_position_au(moon.orbit, days)
    distance = float(np.linalg.norm(toward_sun))
    longitude, ratio = moon.under_planet(days)
    over = math.radians(longitude)
    to_planet = moon.distance_km * ratio * np.array([math.cos(over), math.sin(over), 0.0]) - place
    planet_distance = float(np.linalg.norm(to_planet))
    from_j2000 = axes @ body_frame(moon.orientation(days))
    places = find_moon_places(moon.parent, days)
    return Positions(
        from_j2000 @ toward_sun / distance,
        distance,
        moon.parent,
        axes @ to_planet / planet_distance,
        planet_distance,
        moon.planet_equator_km,
        moon.planet_pole_km,
        axes @ np.array([0.0, 0.0, 1.0]),
        from_j2000,
        {other: axes @ to_planet + from_j2000 @ place for other, place in places.items() if other != name},
    )


def _rotation_about_x(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


def _rotation_about_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
