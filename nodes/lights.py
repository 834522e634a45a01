"""The lights of a scene: the Sun and, if it is up, the planet with its light, each in a light group."""

from __future__ import annotations

import json
from pathlib import Path

import bpy

from ..physics.light import sun_colour
from ..physics.sky import Sky, facts
from ..physics.sky import sky as sky_of
from ..settings import Settings
from .fingerprint import NAME, TAG
from .light import build_sun, place_sun
from .planet import build_planet, build_planet_light

SKY = "icymoon_sky"  # of the Sun: where the lights stand and how bright they are


def described_sky(settings: Settings) -> Sky:
    """The sky that settings describe. Raises IcyMoonError if a date or kernels cannot give it."""
    return sky_of(settings["light"], str(Path(bpy.data.filepath).parent) if bpy.data.filepath else None)


def build_lights(settings: Settings, sky: Sky) -> list[bpy.types.Object]:
    """The Sun, and what else shines."""
    sun = build_sun(f"{NAME} Sun")
    sun[TAG], sun.lightgroup = "sun", "Sun"
    _place(sun, settings, sky)
    return [sun, *_planet(settings, sky)]


def advice(sky: Sky) -> list[str]:
    """What a person should know of a dark sky."""
    if sum(sky.ground_irradiance_wm2) > 0 or (sky.sun_irradiance_wm2 > 0 and sky.sun_is_up and not sky.eclipse):
        return []
    return ["Neither Sun nor planet gives light; raise light.sun_elevation_deg or light.sun_irradiance_wm2."]


def change_lights(sun: bpy.types.Object, collection: bpy.types.Collection, settings: Settings,
                  sky: Sky) -> list[bpy.types.Object]:
    """Give an existing Sun and the rest of the lights what settings say.

    Returns the objects in ``collection`` that are to be removed; what replaces them is in it.
    """
    _place(sun, settings, sky)
    old = [item for item in collection.all_objects if item.get(TAG) in ("planet", "planetshine")]
    for item in _planet(settings, sky):
        collection.objects.link(item)
    return old


def _place(sun: bpy.types.Object, settings: Settings, sky: Sky) -> None:
    place_sun(sun, sky, sun_colour(settings["light"]["sun_temperature_k"]))
    sun[SKY] = json.dumps(facts(sky))


def _planet(settings: Settings, sky: Sky) -> list[bpy.types.Object]:
    if sky.planet is None or not sky.planet_is_up:
        return []
    colour = sun_colour(settings["light"]["sun_temperature_k"])
    planet = build_planet(f"{NAME} Planet", sky.planet, colour)
    planet[TAG], planet.data.materials[0][TAG] = "planet", "material"
    shine = build_planet_light(f"{NAME} Planetshine", sky.planet, colour)
    shine[TAG] = "planetshine"
    planet.lightgroup = shine.lightgroup = "Planet"
    return [planet, shine]
