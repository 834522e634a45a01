"""Expose the view as the camera response exposes a pair, so that the view is as bright as the pair's images.

The images show numbers of the camera that are proportional to the light, as Blender's view transform *Raw* shows it.
The exposure time of auto exposure depends on the image, so it is estimated until a pair was rendered.

Cycles samples one light for each light path, all lights equally often. So a planet, however faint, makes half of the
pixels of its first picture black. Views leave out planetshine that is too faint to see; renders include it.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy

from ..nodes import build_scene as scenes
from ..nodes.datablocks.fingerprint import TAG
from ..physics.camera.sensor import capacity_e
from ..physics.light.lamps import estimate_irradiance_wm2
from ..physics.light.photons import pixel_pitch_m
from ..physics.surfaces import surface_law
from ..render.pairs.pair_folder import read_pair
from ..settings import rebuilt_parts
from ..settings.blender import scene_properties
from ..settings.description import merged
from ..settings.topics.scene import Settings
from ..stereo.images.develop import Channels
from ..support.errors import IcyMoonError
from . import sidebar_text
from .window_events import make_registration

#: View transform that shows light as the images of a camera do.
TRANSFORM = "Raw"
#: Properties of the built collection: the set exposure, and the brightness of a pair as a share of the estimate.
EXPOSED, MEASURED = "icymoon_view_exposure", "icymoon_measured_brightness"
#: Slope toward the Sun of the brightest hundredth of the ground, as a multiple of the mean square slope.
_STEEPEST_FACTOR = 2.0
#: Landforms with walls, some of which face the Sun, by the setting that switches them on.
_WITH_WALLS = (("chaos", "relief_m"), ("cracks", "depth_m"), ("pits", "depth_m"))
#: Distance of the ground that lamps at the cameras make brightest, as a multiple of the height of the cameras.
_GROUND_PER_HEIGHT = 1.5
_MAX_EXPOSURE_STOPS = 10.0  # largest exposure of the view, up or down
#: Light of ground that faces the planet, as a share of white, below which it is invisible: a step of 8 bits.
_MIN_VISIBLE_SHARE = 1 / 255


def estimate_white(settings: Settings, measured: float = 1.0) -> float:
    """Estimate the radiance, W/(m² sr), that is white in the images; 0 if nothing is lit.

    Without auto exposure the value is exact. With it, ``measured`` is the radiance of a pair as a share of the
    estimate.
    """
    sensor = settings.sensor
    if not sensor.auto_exposure:
        rate = Channels(settings.light, sensor, pixel_pitch_m(sensor, settings.rig)).rate
        return capacity_e(sensor) / (rate * sensor.exposure_s) if rate > 0 else 0.0
    return measured * _estimate_brightest(settings) / float(sensor.auto_target)


def _estimate_brightest(settings: Settings) -> float:
    """Estimate the radiance, W/(m² sr), of the ground's brightest hundredth."""
    walls = settings.source.kind == "PROCEDURAL" and any(settings[topic][key] > 0 for topic, key in _WITH_WALLS)
    wm2 = sidebar_text.compute_brightness_wm2(
        sidebar_text.find_light(settings), 90.0 if walls else _STEEPEST_FACTOR * settings.terrain.rms_slope_deg
    )
    wm2 += estimate_irradiance_wm2(settings.light, _GROUND_PER_HEIGHT * settings.rig.height_m)
    return wm2 * _find_albedo(settings) / math.pi


def _find_albedo(settings: Settings) -> float:
    found = surface_law.find_albedos(settings.surface, settings.hapke)
    return max(found.bond if found else settings.surface.albedo, 0.02)


def expose_view(scene: bpy.types.Scene, settings: Settings, anew: bool = False) -> None:
    """Expose the view of a built scene as a pair with these settings and the present camera response.

    An exposure that the user has set stays, unless ``anew``.
    """
    collection = scenes.find_collection(scene)
    if collection is None:
        return
    if not (anew or has_own_exposure(scene)):
        _show_planetshine(collection, True)
        return
    present = rebuilt_parts.select_response(scene_properties.read_unchecked(scene.icymoon))
    stored = collection.get(MEASURED)  # the value is from a file, which anyone may have written
    measured = stored if isinstance(stored, float) and 0 < stored < math.inf else 1.0
    white = estimate_white(merged(settings, present), measured)
    if white > 0:
        scene.view_settings.exposure = max(-_MAX_EXPOSURE_STOPS, min(_MAX_EXPOSURE_STOPS, -math.log2(white)))
        collection[EXPOSED] = scene.view_settings.exposure
    planet_wm2 = sidebar_text.compute_planetshine_wm2(sidebar_text.find_light(settings))
    _show_planetshine(
        collection, white <= 0 or planet_wm2 * _find_albedo(settings) / math.pi > _MIN_VISIBLE_SHARE * white
    )


def _show_planetshine(collection: bpy.types.Collection, shown: bool) -> None:
    """Show or hide planetshine in 3D Views."""
    for lamp in _find_planetshine(collection):
        if lamp.hide_viewport is shown:
            lamp.hide_viewport = not shown


def _find_planetshine(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    return [item for item in collection.all_objects if item.get(TAG) == "planetshine"]


def is_without_planetshine(scene: bpy.types.Scene) -> bool:
    """Return whether 3D Views leave out planetshine because it is too faint to see."""
    collection = scenes.find_collection(scene)
    return collection is not None and any(lamp.hide_viewport for lamp in _find_planetshine(collection))


def has_own_exposure(scene: bpy.types.Scene) -> bool:
    """Return whether the view still has the exposure that Icy Moon set."""
    collection = scenes.find_collection(scene)
    stored = collection.get(EXPOSED) if collection is not None else None
    return isinstance(stored, float) and abs(stored - scene.view_settings.exposure) < 1e-4


def expose_as_rendered(scene: bpy.types.Scene, folder: Path, exposures_s: tuple[float, ...]) -> None:
    """Expose the view as a rendered pair was, also with auto exposure. ``exposures_s`` are the pair's exposure times,
    s."""
    built = scenes.find_built(scene)
    if built is None or len(exposures_s) != 1:
        return
    present = rebuilt_parts.select_response(scene_properties.read_unchecked(scene.icymoon))
    try:
        settings = merged(read_pair(folder).settings, present)
    except IcyMoonError:  # the pair was removed meanwhile
        return
    fixed = merged(settings, {"sensor": {"auto_exposure": False, "exposure_s": exposures_s[0]}})
    estimate = estimate_white(merged(settings, {"sensor": {"auto_exposure": True}}))
    if settings.sensor.auto_exposure and estimate > 0 and estimate_white(fixed) > 0:
        built.collection[MEASURED] = estimate_white(fixed) / estimate
        expose_view(scene, merged(built.settings, built.preview))


def describe_exposure(scene: bpy.types.Scene) -> str:
    """Describe how the exposure of the view differs from a pair's exposure: '' if they are equal, 'automatic' if they
    are equal and follow the light, 'estimated', or 'other'."""
    collection = scenes.find_collection(scene)
    if collection is None or not has_own_exposure(scene) or scene.view_settings.view_transform != TRANSFORM:
        return "other"
    if not scene.icymoon.sensor.auto_exposure:
        return ""
    return "automatic" if MEASURED in collection else "estimated"


def follow_response(scene: bpy.types.Scene, effects: frozenset[str]) -> None:
    """Expose the view again when the camera response changes. Other changes are handled where the scene is shown."""
    if scene is not None and "response" in effects and (built := scenes.find_built(scene)) is not None:
        expose_view(scene, merged(built.settings, built.preview))


register, unregister = make_registration(follow_response)
