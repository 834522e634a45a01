"""The sky at a date or from kernels over the site of a map, and a check that the stated sky belongs to that site."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ...settings.topics.light import LightSettings
from ...settings.topics.scene import Settings
from .ephemeris import site_frame
from .sky import SkyPlace

#: Largest angle, in degrees, between two places on the body that count as one site; their skies differ by as much.
_SAME_SITE_DEG = 0.1
#: Least angle between a map's up and north that is reported. On a map of one zone the convergence of the grid is
#: smaller, and shadows hardly move.
_MIN_TURN_DEG = 1.0


def uses_sky_of_site(settings: Settings) -> bool:
    """Return whether the settings ask for the sky over the site of a map, which its coordinates state."""
    light, source = settings.light, settings.source
    stated = source.kind == "HEIGHT_MAP" and source.site != "OFFSET"
    return bool(stated and light.directions_from != "ANGLES" and light.place == "SITE")


def find_sky_place(settings: Settings, place: Mapping[str, Any] | None) -> SkyPlace | None:
    """Find the place on a map (``MapPlace.to_json``) whose sky the settings ask for. None if they ask for the sky at
    the place of the ``light`` settings, or if the map states no longitude and latitude.
    """
    if not uses_sky_of_site(settings) or place is None or place["latitude_deg"] is None:
        return None
    source = settings.source
    latitude, longitude = float(place["latitude_deg"]), float(place["longitude_deg"])
    if source.site == "DEGREES":  # the map of an ellipsoid has another kind of latitude
        latitude, longitude = float(source.site_latitude_deg), float(source.site_longitude_deg)
    north = float(place["north_deg"])
    if 90.0 - abs(latitude) <= _SAME_SITE_DEG:  # near a pole, the longitude determines the direction of north
        longitude = float(place["longitude_deg"])
    return SkyPlace(latitude, longitude, north)


def warn_sky_of_another_site(light: LightSettings, place: Mapping[str, Any] | None) -> list[str]:
    """Return warnings if directions follow from a date and the ``place`` on a map (``MapPlace.to_json``) is not the
    place of the ``light`` settings, or if the map's up is not north.
    """
    if light.directions_from == "ANGLES" or place is None or place["latitude_deg"] is None:
        return []
    latitude, longitude = float(place["latitude_deg"]), float(place["longitude_deg"])
    north = float(place["north_deg"])
    said = []
    if _angle_between_deg((latitude, longitude), (light.latitude_deg, light.longitude_deg)) > _SAME_SITE_DEG:
        said.append(
            f"The map's site is at latitude {latitude:.4f}°, longitude {longitude:.4f}°, but the sky is computed "
            f"for light.latitude_deg {light.latitude_deg:g} and light.longitude_deg {light.longitude_deg:g}; "
            f"set light.latitude_deg to {latitude:.4f} and light.longitude_deg to {longitude:.4f}."
        )
    elif 90.0 - abs(light.latitude_deg) <= _SAME_SITE_DEG:  # where a longitude is a direction
        over = math.copysign(1.0, latitude)
        found = _wrap_deg(north - over * (light.longitude_deg - longitude))
        if abs(found) > _MIN_TURN_DEG:
            said.append(
                f"At this pole light.longitude_deg {light.longitude_deg:g} sets where north is, {found:.1f}° "
                f"clockwise of the map's up, from which the azimuths of a date are counted; set "
                f"light.longitude_deg to {_wrap_deg(longitude + over * north):.4f}, whose north is up."
            )
        return said
    if abs(north) > _MIN_TURN_DEG:
        said.append(
            f"North is {north:.1f}° clockwise of the map's up, from which the azimuths of a date are counted, "
            f"so the Sun stands {abs(north):.1f}° off; set light.directions_from to ANGLES, with the "
            f"elevation that icymoon sky prints and its azimuth plus {north % 360:.1f}°."
        )
    return said


def _wrap_deg(angle_deg: float) -> float:
    """Wrap an angle to -180 up to 180 degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def _angle_between_deg(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Compute the angle in degrees at the body's centre between two places (latitude, longitude) in degrees."""
    a, b = (site_frame((1.0, 1.0, 1.0), *place)[0] for place in (one, other))
    return math.degrees(2 * math.asin(min(1.0, math.dist(a, b) / 2)))
