"""The other moons in the sky of a site: spheres, lit by the Sun at their places, in the planet's shadow or out of it.

A moon's light is its geometric albedo times its phase function times the Sun's irradiance times (R/d)², as for any
distant body; a moon is never nearer than 90 of its radii. The light is spread over the disc by the law of Lommel and
Seeliger, which fits the Earth's Moon, or by Lambert's law for Titan's haze, and scaled to that amount.

Left out are dark and bright regions, the planet's light on a moon's night side, shadows of moons on each other, and the
moons' light on the ground, less than 1e-4 of the Sun's. A moon in the planet's shadow is dimmed evenly, by the share of
the Sun's disc that the planet hides from its centre.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...support.arrays import Array
from .eclipse import compute_hidden_share
from .planetshine import Planet, lambert_phase
from .sunlight import BANDS_M, apparent_diameter_deg

#: The Sun's B - V: Ramirez et al. 2012, Astrophysical Journal 752, 5.
_SUN_B_V = 0.653
#: Wavelengths in metres of B and V.
_B_M, _V_M = 440e-9, 550e-9
#: Constants A and B of both functions exp(-A tan(α/2)^B) of the phase law of magnitude and slope: Bowell et al. 1989
#: (in Asteroids II, p. 524).
_SLOPE_LAW = ((3.33, 0.63), (1.87, 1.22))
#: Largest phase angle of this law in degrees; beyond it, the ratio to a Lambert sphere is constant.
_SLOPE_LAW_END_DEG = 120.0


@dataclass(frozen=True)
class Moon:
    """A moon's size and brightness. A ``phase_integral`` of 1.5 is a Lambert sphere's."""

    planet: str
    number: int  # of NAIF
    radius_km: float
    geometric_albedo: float  # in V
    b_v: float
    phase_integral: float

    @property
    def is_hazy(self) -> bool:
        """Whether haze, not ground, scatters the light, so that Lambert's law spreads it."""
        return self.phase_integral >= 1.5

    def band_albedos(self) -> Array:
        """Compute the geometric albedos (3,) in R, G, B, on the line through the albedos in B and V."""
        blue = 10 ** (-0.4 * (self.b_v - _SUN_B_V))
        return self.geometric_albedo * (1 + (1 - blue) * (np.array(BANDS_M) - _V_M) / (_V_M - _B_M))

    def phase_function(self, phase_deg: float) -> float:
        """Compute the brightness at a phase angle relative to full phase. The slope G of an icy moon's law follows from
        its phase integral q = 0.290 + 0.684 G (Bowell et al. 1989).
        """
        if self.is_hazy:
            return lambert_phase(phase_deg)
        if phase_deg > _SLOPE_LAW_END_DEG:
            end = self.phase_function(_SLOPE_LAW_END_DEG)
            return end * lambert_phase(phase_deg) / lambert_phase(_SLOPE_LAW_END_DEG)
        slope = (self.phase_integral - 0.290) / 0.684
        half = math.tan(math.radians(phase_deg) / 2)
        steep, flat = (math.exp(-a * half**b) for a, b in _SLOPE_LAW)
        return (1 - slope) * steep + slope * flat


#: Radii: IAU working group (Archinal et al. 2018). Albedos of Saturn's icy moons at 0.55 µm, without the narrow
#: brightening at opposition: Filacchione et al. 2022, Icarus 375, 114803. Titan: Karkoschka 1998. Jupiter's moons: JPL,
#: "Planetary Satellite Physical Parameters". B - V: Explanatory Supplement to the Astronomical Almanac. Phase
#: integrals: 0.8 and 0.6 of Ganymede and Callisto by Squyres and Veverka 1981; 0.7 of Rhea to 0.9 of Enceladus by
#: Buratti and Veverka 1984, Icarus 58, 254. Values between these for other icy moons are our choice, good to 0.1.
MOONS: Mapping[str, Moon] = {
    "MIMAS": Moon("SATURN", 601, 198.2, 0.63, 0.66, 0.8),
    "ENCELADUS": Moon("SATURN", 602, 252.1, 0.89, 0.70, 0.9),
    "TETHYS": Moon("SATURN", 603, 531.0, 0.74, 0.73, 0.8),
    "DIONE": Moon("SATURN", 604, 561.4, 0.65, 0.71, 0.8),
    "RHEA": Moon("SATURN", 605, 763.5, 0.60, 0.78, 0.7),
    "TITAN": Moon("SATURN", 606, 2575.0, 0.22, 1.28, 1.5),
    "IO": Moon("JUPITER", 501, 1821.5, 0.63, 1.17, 0.8),
    "EUROPA": Moon("JUPITER", 502, 1560.8, 0.67, 0.87, 0.9),
    "GANYMEDE": Moon("JUPITER", 503, 2631.2, 0.43, 0.83, 0.8),
    "CALLISTO": Moon("JUPITER", 504, 2410.3, 0.17, 0.86, 0.6),
}


_UP = np.array([0.0, 0.0, 1.0])
#: A globe whose place, size and Sun are still to be set; a sphere's pole has no effect.
_LAMBERT_GLOBE = Planet(_UP, 0.0, 0.0, _UP, _UP, 1.0, 1.0, "LAMBERT")


@dataclass(frozen=True)
class SkyMoon:
    """A moon as seen from the site."""

    name: str  # in capitals
    globe: Planet  # its size and place, with the Sun
    distance: float  # over the planet's
    irradiance_wm2: Array  # (3,) on a facing surface in R, G, B of sunlight
    eclipse: float  # share of the Sun's disc that the planet hides from the moon's centre

    @property
    def is_hazy(self) -> bool:
        """Whether Lambert's law spreads its light."""
        return MOONS[self.name].is_hazy


def list_moons(planet: str) -> list[str]:
    """List the names of the large moons of a planet."""
    return [name for name, moon in MOONS.items() if moon.planet == planet]


def make_sky_moons(
    places_km: Mapping[str, Array], planet: Planet, planet_km: float, sun_diameter_deg: float
) -> tuple[SkyMoon, ...]:
    """Make the moons at ``places_km`` (3,) from the site, in the local frame, the nearest first. ``planet`` is the
    planet at a distance of ``planet_km`` in the sky of the site.
    """
    found = []
    for name, place in places_km.items():
        moon, distance = MOONS[name], float(np.linalg.norm(place))
        size = apparent_diameter_deg(moon.radius_km, distance)
        globe = replace(_LAMBERT_GLOBE, direction=place / distance, angular_diameter_deg=size, sun=planet.sun)
        eclipse = compute_hidden_share(_see_planet_from(place, planet, planet_km), sun_diameter_deg)
        facing = planet.sun_irradiance_wm2 * math.sin(math.radians(size / 2)) ** 2
        light = (1 - eclipse) * facing * moon.phase_function(globe.phase_deg) * moon.band_albedos()
        found.append(SkyMoon(name, globe, distance / planet_km, light, eclipse))
    return tuple(sorted(found, key=lambda moon: moon.distance))


def _see_planet_from(place_km: Array, planet: Planet, planet_km: float) -> Planet:
    """Return the planet as seen from a moon at a place relative to the site."""
    toward = planet_km * planet.direction - place_km
    distance = float(np.linalg.norm(toward))
    radius_km = planet_km * math.sin(math.radians(planet.angular_diameter_deg / 2))
    return replace(planet, direction=toward / distance, angular_diameter_deg=apparent_diameter_deg(radius_km, distance))
