"""The lights of a scene: the Sun and the planet, each in a light group, the moons and the stars."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import bpy

from ...formats.map_site import read_site_place
from ...physics.light.lamps import gives_light
from ...physics.light.moon_mesh import is_above_horizon, make_moon_mesh
from ...physics.light.planet_face import face_tint
from ...physics.light.saturn_rings import make_ring_mesh
from ...physics.light.sky import Sky, check_body, describe_sky
from ...physics.light.sky import compute_sky as sky_of
from ...physics.light.sky_over_map import find_sky_place, uses_sky_of_site
from ...physics.light.stars import stars_above_horizon
from ...physics.light.sunlight import sun_colour
from ...physics.mesh.horizon import dip_deg
from ...physics.rig.focal_length import focal_px
from ...physics.scene_requirements import planet_gives_light
from ...physics.terrain.skyline import advise_on_skyline
from ...settings.topics.scene import Settings
from ..datablocks.blend_file_paths import find_used_files
from ..datablocks.fingerprint import NAME, TAG
from .celestial_meshes import build_moons, build_planet, build_rings, build_stars
from .lamps import ROLES as LAMP_ROLES
from .lamps import build_lamps
from .planet_lamp import build_planet_light
from .sun_lamp import build_sun, place_sun

SKY = "icymoon_sky"  # property of the Sun: positions and brightness of the lights
#: Roles of the objects that shine, without the Sun.
ROLES = ("planet", "planetshine", "rings", "moons", "stars", *LAMP_ROLES)


def compute_scene_sky(settings: Settings) -> Sky:
    """Compute the sky of the settings. Raises IcyMoonError if the date or kernels give no sky, or the sky of another
    body, or if the sky over the site of a map is wanted and the map cannot be read."""
    check_body(settings)
    folder = str(Path(bpy.data.filepath).parent) if bpy.data.filepath else None
    place = None
    if uses_sky_of_site(settings):
        found = read_site_place(find_used_files(settings)["source.file"], settings)
        place = find_sky_place(settings, found.to_json() if found else None)
    return sky_of(settings.light, folder, place)


def list_light_settings(settings: Settings) -> list[Any]:
    """List the settings on which the lights depend."""
    of_site = [settings.source] if uses_sky_of_site(settings) else []
    of_pixel = [focal_px(settings.rig)] if settings.light.stars or settings.light.planet else []
    of_stars = [settings.dataset.seed] if settings.light.stars else []
    of_planet = [settings.rig.height_m, settings.terrain.body_radius_m] if settings.light.planet else []
    return [settings.light, *of_pixel, *of_stars, *of_planet, *of_site]


def build_lights(settings: Settings, sky: Sky, camera: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """Build the Sun, then the other objects that shine, which follow the ``camera``, one after the other."""
    sun = build_sun(f"{NAME} Sun")
    sun[TAG], sun.lightgroup = "sun", "Sun"
    _place_sun(sun, settings, sky)
    yield sun
    yield from _build_lights_but_sun(settings, sky, camera, {})


def advise_on_sky(sky: Sky, settings: Settings) -> list[str]:
    """Return sentences for the user on a dark sky, hills before the Sun, rings and moons that are not shown, and stars
    of wrong brightness."""
    light, sentences = settings.light, advise_on_skyline(settings, sky.sun, sky.sun_diameter_deg)
    if sky.planet is not None and light.planet_rings and not sky.planet.rings:
        sentences.append("Only Saturn has bright rings; light.planet_rings has no effect for this planet.")
    if light.moons and light.directions_from == "ANGLES":
        sentences.append("light.moons has no effect, because moons need a date; set light.directions_from to DATE.")
    if light.stars and light.irradiance_band == "CAMERA":
        sentences.append(
            "Stars include all wavelengths, but the Sun only those of the camera; set "
            "light.irradiance_band to BOLOMETRIC for stars of the right brightness."
        )
    if (
        gives_light(light)
        or sum(sky.ground_irradiance_wm2) > 0
        or (sky.sun_irradiance_wm2 > 0 and sky.sun_is_up and sky.eclipse < 1)
    ):
        return sentences
    if sky.sun_is_up and sky.eclipse >= 1:
        fix = "move one of them" if light.directions_from == "ANGLES" else "choose another light.date_utc"
        return [*sentences, f"The planet hides the Sun, so there is no light; {fix}."]
    return [
        *sentences,
        "Neither Sun nor planet gives light; raise light.sun_elevation_deg or light.sun_irradiance_wm2."
        if light.directions_from == "ANGLES"
        else "Neither Sun nor planet gives light; choose another light.date_utc or site.",
    ]


def update_lights(
    sun: bpy.types.Object, collection: bpy.types.Collection, settings: Settings, sky: Sky, keeps: bool
) -> list[bpy.types.Object]:
    """Change an existing Sun to the settings, and make the other lights again.

    The new lights are linked to ``collection``. Returns the old ones, which the caller must remove. With ``keeps`` a
    planet of the same disc keeps its mesh, and planet and planetshine keep their nodes if only values differ.
    """
    _place_sun(sun, settings, sky)
    old = [item for item in collection.all_objects if item.get(TAG) in ROLES]
    camera = next(item for item in collection.all_objects if item.get(TAG) == "camera")
    former = {item[TAG]: item for item in old} if keeps else {}
    for item in list(_build_lights_but_sun(settings, sky, camera, former)):
        collection.objects.link(item)
    return old


def _place_sun(sun: bpy.types.Object, settings: Settings, sky: Sky) -> None:
    place_sun(sun, sky, sun_colour(settings.light.sun_temperature_k))
    sun[SKY] = json.dumps(describe_sky(sky))


def _build_lights_but_sun(
    settings: Settings,
    sky: Sky,
    camera: bpy.types.Object,
    former: Mapping[str, bpy.types.Object],
) -> Iterator[bpy.types.Object]:
    light = settings.light
    colour, pixel_rad = sun_colour(light.sun_temperature_k), 1 / focal_px(settings.rig)
    dip = dip_deg(settings.rig.height_m, settings.terrain.body_radius_m)
    if sky.planet is not None and sky.planet_is_up:
        planet = build_planet(f"{NAME} Planet", sky.planet, colour, pixel_rad, dip, former.get("planet"))
        yield _finish_body(planet, "planet", camera, "Planet")
        if planet_gives_light(settings, sky):
            tint = colour * face_tint(sky.planet)
            shine = build_planet_light(f"{NAME} Planetshine", sky.planet, tint, former.get("planetshine"))
            shine[TAG], shine.lightgroup = "planetshine", "Planet"
            yield shine
    rings = make_ring_mesh(sky.planet) if sky.planet is not None else None
    if rings is not None and rings.vertices[:, 2].max() > 0:
        yield _finish_body(build_rings(f"{NAME} Rings", rings, colour, dip), "rings", camera, "Planet")
    moons = [moon for moon in sky.moons if is_above_horizon(moon, pixel_rad, dip)]
    if moons:
        item = build_moons(f"{NAME} Moons", make_moon_mesh(moons, pixel_rad), colour, dip)
        yield _finish_body(item, "moons", camera)
    if light.stars:
        stars = stars_above_horizon(float(light.stars_faintest_mag), int(settings.dataset.seed), sky.from_j2000)
        yield _finish_body(build_stars(f"{NAME} Stars", stars, pixel_rad), "stars", camera)
    yield from build_lamps(light, camera, find_used_files(settings).get("light.ies_file"))


def _finish_body(item: bpy.types.Object, role: str, camera: bpy.types.Object, group: str = "") -> bpy.types.Object:
    """Give a body in the sky its role and its light group, and let it follow the ``camera``: the real body is so far
    away that it looks the same from everywhere on the ground."""
    item[TAG], item.data.materials[0][TAG] = role, "material"
    item.lightgroup = group
    item.constraints.new("COPY_LOCATION").target = camera
    return item
