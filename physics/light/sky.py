"""The lights in the sky of the site: the Sun and, if the scene has them, the planet and its other moons.

``light`` is the ``light`` topic of the settings. The local frame is x east, y north, z up, along the normal of the
body's ellipsoid.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...settings.topics.light import LightSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import absolute_path
from . import ephemeris, spice
from .bodies import BODIES
from .directions import direction_toward
from .eclipse import compute_hidden_share
from .ephemeris import Positions
from .moons import SkyMoon, make_sky_moons
from .planetshine import Planet, Ring, irradiance_wm2
from .saturn_rings import RINGS
from .sunlight import apparent_diameter_deg, sun_diameter_deg, sun_irradiance_wm2


@dataclass(frozen=True)
class SkyPlace:
    """The site on a map whose sky is computed: planetocentric degrees, and the angle in degrees, clockwise, from the
    map's up to north.
    """

    latitude_deg: float
    longitude_deg: float
    north_deg: float = 0.0


@dataclass(frozen=True)
class Sky:
    """The lights of a scene."""

    sun: Array  # unit vector (3,) toward it
    sun_irradiance_wm2: float  # on a facing surface
    sun_diameter_deg: float
    planet: Planet | None
    eclipse: float  # share of the Sun's disc that the planet hides, shown or not
    from_j2000: Array  # (3, 3) from the J2000 equatorial to the local frame
    sun_distance_m: float = 0.0  # from the site's origin to a lamp in the Sun's place; 0 for the real Sun
    place: SkyPlace | None = None  # the site of a map that has this sky; None for the place of the ``light`` settings
    moons: tuple[SkyMoon, ...] = ()  # the nearest first, below the horizon too

    @property
    def sun_elevation_deg(self) -> float:
        """Elevation in degrees of the Sun's centre above the horizon."""
        return elevation_deg(self.sun)

    @property
    def sun_is_up(self) -> bool:
        """Whether any part of the Sun's disc is above the horizon; the body itself hides the part below."""
        return self.sun_elevation_deg + self.sun_diameter_deg / 2 > 0

    @property
    def planet_is_up(self) -> bool:
        """Whether any part of the planet is above the horizon."""
        return (
            self.planet is not None
            and self.planet.angular_diameter_deg > 0
            and elevation_deg(self.planet.direction) + self.planet.angular_diameter_deg / 2 > 0
        )

    @property
    def above_ring_plane_deg(self) -> float | None:
        """Angle in degrees of the site north of the plane of Saturn's rings, seen from the planet; None without
        rings.
        """
        if self.planet is None or not self.planet.rings:
            return None
        return _angle_above_plane_deg(self.planet.pole, -self.planet.direction)

    @property
    def ground_irradiance_wm2(self) -> tuple[float, float]:
        """Irradiance of level ground in W/m² from the Sun and from the planet, without shadows."""
        sun = self.sun_irradiance_wm2 * max(float(self.sun[2]), 0.0) * (1.0 - self.eclipse)
        planet = irradiance_wm2(self.planet, np.array([0.0, 0.0, 1.0])) if self.planet and self.planet_is_up else 0.0
        return sun, planet

    @property
    def planet_over_sun(self) -> float:
        """Ratio of the planet's light to the Sun's, on level ground or on ground that faces them, whichever ratio is
        larger. Infinite by night, 0 without a lit planet above the horizon.
        """
        planet = irradiance_wm2(self.planet) if self.planet and self.planet_is_up else 0.0
        sun_level, planet_level = self.ground_irradiance_wm2
        return planet_to_sun_ratio(planet, planet_level, self.sun_irradiance_wm2 * (1.0 - self.eclipse), sun_level)


def planet_to_sun_ratio(planet: float, planet_level: float, sun: float, sun_level: float) -> float:
    """Compute ``Sky.planet_over_sun``, from irradiances in W/m² of planet and Sun on a facing surface and on level
    ground.
    """
    if planet <= 0:
        return 0.0
    return max(planet_level / sun_level, planet / sun) if sun_level > 0 else math.inf


def elevation_deg(direction: Array) -> float:
    """Compute the angle in degrees of a direction above the horizon."""
    return _angle_above_plane_deg(np.array([0.0, 0.0, 1.0]), direction)


def _angle_above_plane_deg(axis: Array, direction: Array) -> float:
    """Compute the angle in degrees of a direction above the plane whose normal is ``axis``."""
    return math.degrees(math.asin(float(np.clip(axis @ direction, -1, 1))))


def azimuth_deg(direction: Array) -> float:
    """Compute the angle in degrees of a direction from north over east, 0 to 360."""
    return math.degrees(math.atan2(direction[0], direction[1])) % 360.0


#: Largest relative difference between the mean radius of the described ground's body and of the body whose sky a date
#: gives. Other round moons differ by more: Miranda is 6 % smaller than Enceladus, the Moon 11 % larger than Europa.
_MAX_RADIUS_DIFFERENCE = 0.05


def check_body(
    settings: Settings, fix: str = "set light.body to what this is, with kernels, or light.directions_from to ANGLES."
) -> None:
    """Raise IcyMoonError if a date would give the ground of one body the sky of another; ``fix`` ends the sentence."""
    light, radius_km = settings.light, settings.terrain.body_radius_m / 1000.0
    body = BODIES.get(light.body.strip().upper())
    if light.directions_from == "ANGLES" or body is None:
        return
    own_km = math.prod(body.radii_km) ** (1 / 3)
    if abs(radius_km / own_km - 1) > _MAX_RADIUS_DIFFERENCE:
        raise IcyMoonError(
            f"light.body is {light.body}, which has a radius of {own_km:.0f} km, but "
            f"terrain.body_radius_m is the radius of a body of {radius_km:.0f} km, which has another "
            f"sky; {fix}"
        )


def compute_sky(light: LightSettings, blend_folder: str | None = None, place: SkyPlace | None = None) -> Sky:
    """Compute the sky that ``light`` settings describe; ``blend_folder`` replaces // in ``kernels``.

    With a ``place``, the sky of a date is computed over that place and turned so that y is the map's up. Raises
    IcyMoonError if the sky cannot be computed from the stated date or kernels.
    """
    if light.directions_from != "ANGLES":
        return _sky_at_date(light, blend_folder, place)
    sun = direction_toward(light.sun_azimuth_deg, light.sun_elevation_deg)
    irradiance = float(light.sun_irradiance_wm2)
    planet = (
        Planet(
            direction_toward(light.planet_azimuth_deg, light.planet_elevation_deg),
            float(light.planet_angular_diameter_deg),
            float(light.planet_flattening),
            # Moon and planet turn about axes within a degree of each other.
            direction_toward(0.0, light.latitude_deg),
            sun,
            irradiance,
            float(light.planet_albedo),
            light.planet_phase_law,
            _choose_rings(light),
            light.planet_face,
            float(light.planet_spot_longitude_deg),
        )
        if light.planet
        else None
    )
    diameter = float(light.sun_angular_diameter_deg)
    return Sky(
        sun,
        irradiance,
        diameter,
        planet,
        compute_hidden_share(planet, diameter) if planet else 0.0,
        _star_frame_by_angles(light),
        float(light.sun_distance_m),
    )


def _choose_rings(light: LightSettings) -> tuple[Ring, ...]:
    return tuple(RINGS.values()) if light.planet_rings else ()


def _star_frame_by_angles(light: LightSettings) -> Array:
    """Compute the matrix (3, 3) from the J2000 equatorial frame at a site without a date. Its pole is the body's pole,
    and right ascension 0 h is on the meridian, in the south if the pole is in the north.
    """
    latitude = math.radians(light.latitude_deg)
    pole = direction_toward(0.0, light.latitude_deg)
    culminates = np.array([0.0, -math.sin(latitude), math.cos(latitude)])
    return np.stack([culminates, np.cross(pole, culminates), pole], axis=1)


def _find_positions(light: LightSettings, blend_folder: str | None, place: SkyPlace | None) -> Positions:
    if place is not None:
        there = light | {"latitude_deg": place.latitude_deg, "longitude_deg": place.longitude_deg}
        return _find_positions(there, blend_folder, None).turned(place.north_deg)
    site = light.date_utc, float(light.latitude_deg), float(light.longitude_deg)
    if light.directions_from == "DATE":
        ephemeris.refuse_unknown_years(light.date_utc)
        return ephemeris.find_positions(light.body, *site)
    return spice.find_positions(
        absolute_path(light.kernels, "light.kernels", blend_folder), light.body, light.parent, *site, shows_moons(light)
    )


def shows_moons(light: LightSettings) -> bool:
    """Return whether the settings ask for other moons and give their places. Moons need the planet, which hides
    them.
    """
    return bool(light.moons and light.planet and light.directions_from != "ANGLES")


def _sky_at_date(light: LightSettings, blend_folder: str | None, place: SkyPlace | None) -> Sky:
    at = _find_positions(light, blend_folder, place)
    irradiance = sun_irradiance_wm2(at.sun_distance_au)
    planet = Planet(
        at.planet,
        apparent_diameter_deg(at.planet_equator_km, at.planet_distance_km),
        1 - at.planet_pole_km / at.planet_equator_km,
        at.planet_axis,
        at.sun,
        irradiance,
        float(light.planet_albedo),
        light.planet_phase_law,
        _choose_rings(light) if at.planet_name in ("SATURN", "699") else (),
        light.planet_face,
        float(light.planet_spot_longitude_deg),
    )
    diameter = sun_diameter_deg(at.sun_distance_au)
    return Sky(
        at.sun,
        irradiance,
        diameter,
        planet if light.planet else None,
        compute_hidden_share(planet, diameter),
        at.from_j2000,
        place=place,
        moons=make_sky_moons(at.moons_km, planet, at.planet_distance_km, diameter) if shows_moons(light) else (),
    )


def describe_sky(shown: Sky) -> dict[str, Any]:
    """Return the ``light`` table of ``pair.json``."""
    planet, on_ground = shown.planet, shown.ground_irradiance_wm2
    return {
        "sun": {
            "direction_to_world": shown.sun.tolist(),
            "elevation_deg": shown.sun_elevation_deg,
            "azimuth_deg": azimuth_deg(shown.sun),
            "irradiance_wm2": shown.sun_irradiance_wm2,
            "angular_diameter_deg": shown.sun_diameter_deg,
            "ground_irradiance_wm2": on_ground[0],
            "eclipse": shown.eclipse,
            **({"distance_m": shown.sun_distance_m} if shown.sun_distance_m else {}),
        },
        **({"place": {**asdict(shown.place), "from": "source.site"}} if shown.place else {}),
        "j2000_to_world": shown.from_j2000.tolist(),
        "planet": None
        if planet is None
        else {
            "direction_to_world": planet.direction.tolist(),
            "elevation_deg": elevation_deg(planet.direction),
            "azimuth_deg": azimuth_deg(planet.direction),
            "phase_deg": planet.phase_deg,
            "angular_diameter_deg": planet.angular_diameter_deg,
            "irradiance_wm2": irradiance_wm2(planet),
            "ground_irradiance_wm2": on_ground[1],
            "over_sun": None if math.isinf(shown.planet_over_sun) else shown.planet_over_sun,
            "above_ring_plane_deg": shown.above_ring_plane_deg,
        },
        **({"moons": [_describe_moon(moon) for moon in shown.moons]} if shown.moons else {}),
    }


def _describe_moon(moon: SkyMoon) -> dict[str, Any]:
    direction = moon.globe.direction
    return {
        "name": moon.name,
        "direction_to_world": direction.tolist(),
        "elevation_deg": elevation_deg(direction),
        "azimuth_deg": azimuth_deg(direction),
        "phase_deg": moon.globe.phase_deg,
        "angular_diameter_deg": moon.globe.angular_diameter_deg,
        "irradiance_wm2": float(moon.irradiance_wm2.mean()),
        "eclipse": moon.eclipse,
    }
