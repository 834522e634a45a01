"""What a scene requires of the renderer, and what is left out because it would not be seen.

``settings`` are complete.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..typed_settings import QualitySettings, RigSettings, Settings, SurfaceSettings
from .camera.stereo_geometry import focal_px
from .light.sky import Sky

#: Topics that describe a surface.
SURFACES = ("surface", "rock_surface")


def surface_topics(settings: Settings) -> tuple[str, ...]:
    """The topics of the surfaces that the scene shows: rocks may have one of their own."""
    return SURFACES if settings.rocks.coverage > 0 and settings.rocks.own_surface else SURFACES[:1]


def nearest_m(rig: RigSettings) -> float:
    """Distance in metres of the nearest level ground that the images show; the camera's height if they look up."""
    half = (0.5 + float(rig.overscan)) * int(rig.height_px) + abs(float(rig.principal_y_px))
    down = math.radians(rig.pitch_deg) + math.atan(half / focal_px(rig))
    return float(rig.height_m) / math.sin(down) if 0 < down < math.pi / 2 else float(rig.height_m)


def walk_px(settings: Settings, topic: str) -> float:
    """Mean free path of the light under a surface, in pixels where the ground is nearest; 0 if no light enters it."""
    surface = settings[topic]
    if surface["model"] != "PRINCIPLED" or surface["subsurface_weight"] <= 0:
        return 0.0
    return float(surface["subsurface_radius_m"]) * focal_px(settings.rig) / nearest_m(settings.rig)


def follows_walk(settings: Settings, topic: str) -> bool:
    """Whether the way of light under a surface is to be followed, see ``quality.walk_px``."""
    length = walk_px(settings, topic)
    return length > 0 and length >= settings.quality.walk_px


def rendered_surface(settings: Settings, topic: str) -> SurfaceSettings:
    """The settings of a surface as it is rendered: without a walk light leaves where it entered, as much of it."""
    surface: SurfaceSettings = settings[topic]
    return surface if follows_walk(settings, topic) else surface | {"subsurface_weight": 0.0}


def only_camera_meets_relief(surface: SurfaceSettings, quality: QualitySettings) -> bool:
    """Whether light that comes by way of a surface finds it as smooth as its mesh, see ``quality.fine_relief``;
    ``surface`` as it is shown. A walk ends where the light leaves the surface anew, which the camera sees too."""
    law = surface.model
    return quality.fine_relief == "CAMERA" and (
        law == "LAMBERT" or (law == "PRINCIPLED" and surface.subsurface_weight == 0))


def relief_of_camera_alone(settings: Settings, topic: str) -> bool:
    """Whether a surface shades fine relief, of its own or of images on it, that only the camera meets."""
    surface = rendered_surface(settings, topic)
    shaded = (surface.relief == "BUMP" and surface.grain_amplitude_m > 0) or (
        settings.textures.set != "NONE")
    return shaded and only_camera_meets_relief(surface, settings.quality)


def planet_gives_light(settings: Settings, sky: Sky) -> bool:
    """Whether the planet is to light the ground, see ``light.planet_least``."""
    return sky.planet_over_sun > 0 and sky.planet_over_sun >= settings.light.planet_least


def find_left_out(settings: Settings, lights: Mapping[str, Any]) -> list[str]:
    """What the settings describe but is not rendered, since it would not be seen: sentences, for the user and
    ``pair.json``.

    ``lights`` are the ``sky.sky_facts`` of what was built.
    """
    said = []
    for topic in surface_topics(settings):
        length = walk_px(settings, topic)
        if length > 0 and not follows_walk(settings, topic):
            said.append(f"{topic}: light is not followed under the surface, since its mean free path of "
                        f"{1e3 * settings[topic]['subsurface_radius_m']:.3g} mm is {length:.2g} of the nearest pixel, "
                        f"under quality.walk_px.")
        if relief_of_camera_alone(settings, topic):
            said.append(f"{topic}: only the camera meets its fine relief, since quality.fine_relief is CAMERA.")
    share = lights["planet"].get("over_sun") if lights["planet"] else None  # None by night too
    if share is not None and (share == 0 or share < settings.light.planet_least):
        said.append("light: the planet gives no light, since "
                    + (f"it would be {share:.2g} of the Sun's, under light.planet_least." if share > 0 else
                       "it is below the horizon or unlit."))
    if settings.quality.truth == "DEPTH":
        said.append("truth: no normals and no labels, since quality.truth is DEPTH.")
    return said
