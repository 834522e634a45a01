"""Lines of the sidebar that are derived from the settings, computed once for each change."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import blf
import bpy

from ..formats.map_site import read_site_place
from ..physics.camera.blur import advise_on_blur, circle_of_confusion_px, find_blur, motion_blur_px
from ..physics.camera.depth_accuracy import GroundRow, depth_error_m, measure_ground_row, shared_width_px
from ..physics.camera.lens_distortion import find_overscan, read_coefficients
from ..physics.light.scene_sun import sun_from_facts
from ..physics.light.sky import compute_sky, describe_sky
from ..physics.light.sky_over_map import find_sky_place, uses_sky_of_site
from ..physics.rig.focal_length import focal_px
from ..physics.scene_requirements import find_left_out
from ..render.cost.blender_abilities import Abilities
from ..render.cost.estimate import ASSUMED_TRIANGLES
from ..render.cost.machine_speed import Speed, recall_speed, remember_speed
from ..render.cost.quality_presets import QualityPreset, list_qualities
from ..settings.table import TOPICS
from ..settings.topics.camera import RigSettings, SensorSettings
from ..settings.topics.declaration import Setting
from ..settings.topics.ground import SourceSettings, TerrainSettings
from ..settings.topics.light import LightSettings
from ..settings.topics.scene import Settings
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.files import absolute_path
from ..support.number_text import show_rounded
from ..support.printer import show_controls

#: Disparity error, px, of good matchers on textured ground, for which the depth error is given.
DISPARITY_ERROR_PX = 0.25
Found = TypeVar("Found")
_MAX_KEPT = 4
_MAX_NAMED = 3  # maximum number of settings that a sentence names
LINE = 36  # characters that fit the sidebar as Blender opens it
_ICON_CHARACTERS = 6  # characters that an icon takes; a narrow sidebar has wide characters
#: Width of the sidebar as Blender opens it, and characters of a line of the narrowest sidebar.
_WIDTH_PX, _SHORTEST_LINE = 280, 18
#: Pixels of the sidebar beside a text, at scale 1: tabs, margins and the inner edge of a box; and those of an icon.
_BESIDE_TEXT_PX, _ICON_PX = 62, 25
#: Characters by which the widest fitting lines may be longer than a line of mean letters.
_MORE_CHARACTERS = 6
_FEWEST_CHARACTERS = 8
#: 'quality.truth', 'quality.truth is DEPTH', 'quality.truth to DEPTH', 'quality.truth = DEPTH', 'quality.truth DEPTH'
_SETTING_NAME = re.compile(r"\b([a-z_]+)[.]([a-z]\w*)(?:( (?:(?:is|to|=) )?)([A-Z]\w*))?")
_UNIT_SUFFIX = re.compile(r" [(][^)]*[)]$")
#: Name of the panel that shows a setting, if it differs from the topic's name.
_OTHER_PANELS = {("dataset", "methods"): "Evaluation"}
#: Spaces at which a line must not break, and their temporary replacement. They are between a number and its unit,
#: before ▸, and after 'is'.
_FIXED_SPACE, _HELD_SPACE = (
    re.compile(r"(?<=\d) (?=(?:%|px|[kcmµ]?m|[mµ]?s|min|h|[kMG]B|W/m²)(?![\w/]))| (?=▸)|(?<=\bis) "),
    "\u00a0",
)


def remember_answers(function: Callable[..., Found]) -> Callable[..., Found]:
    """Cache the last few answers of a function of settings, because the window calls it at every redraw."""
    kept: list[tuple[tuple[Any, ...], Found]] = []

    def answer(*asked: object) -> Found:
        for known, found in kept:
            if known == asked:
                return found
        found = function(*asked)
        kept.insert(0, (asked, found))
        del kept[_MAX_KEPT:]
        return found

    return answer


def replace_keys_by_labels(sentence: str) -> str:
    """Replace the keys in a sentence by labels.

    'quality.truth is DEPTH' becomes 'Quality and Speed ▸ Truth is Depth Only', 'to DEPTH' likewise, and a topic at the
    beginning, such as 'rock_surface: ', becomes 'Rock Surface: '.
    """
    topic, colon, rest = sentence.partition(": ")
    if colon and topic in TOPICS:
        return f"{TOPICS[topic].label}: {_SETTING_NAME.sub(_find_label, rest)}"
    text = _SETTING_NAME.sub(_find_label, sentence)
    return text[:1].upper() + text[1:]


def _find_label(found: re.Match[str]) -> str:
    topic, key, verb, chosen = found.groups()
    for setting in TOPICS[topic].settings if topic in TOPICS else ():
        if setting.key == key:
            value = setting.choice_labels.get(chosen, chosen)
            return f"{describe_place(topic, setting)}{verb or ''}{value or ''}"
    return found[0]


def describe_place(topic: str, setting: Setting) -> str:
    """Describe where a setting is in the sidebar: its panel and its label, without the unit."""
    return f"{_OTHER_PANELS.get((topic, setting.key), TOPICS[topic].label)} ▸ {_UNIT_SUFFIX.sub('', setting.label)}"


def name_settings(found: Sequence[tuple[str, Setting]]) -> str:
    """Name the places of the first few of the settings (topic, setting), and the number of the others."""
    names = ", ".join(describe_place(topic, setting) for topic, setting in found[:_MAX_NAMED])
    return f"{names} and {len(found) - _MAX_NAMED} more" if len(found) > _MAX_NAMED else names


def describe_value(name: str, settings: Settings, panel: str = "") -> str:
    """Describe the value of a setting ``topic.key`` in words: 'Light ▸ Planet is off', or 'Planet is off' within the
    ``panel`` of its topic."""
    topic, _, key = name.partition(".")
    setting, value = TOPICS[topic][key], settings[topic][key]
    plain = "off" if value is False else "on" if value is True else f"{value or 'empty'}"
    text = setting.choice_labels.get(value, plain) if setting.choices else plain
    place = _UNIT_SUFFIX.sub("", setting.label) if topic == panel else describe_place(topic, setting)
    return f"{place} is {'0' if value == 0 and value is not False else text}"


def format_for_window(message: object) -> str:
    """Format a message for an operator's report: in the window with the labels of settings, without a window with their
    keys."""
    return show_controls(str(message) if bpy.app.background else replace_keys_by_labels(str(message)))


def measure_line_length() -> int:
    """Return the number of characters that fit into a line of the drawn sidebar; ``LINE`` if no sidebar is drawn."""
    region = bpy.context.region
    if region is None or region.type != "UI":
        return LINE
    return max(_SHORTEST_LINE, int(LINE * region.width / (_WIDTH_PX * bpy.context.preferences.system.ui_scale)))


def wrap_lines(text: str, hang: str = "", icon: bool = False) -> tuple[str, ...]:
    """Wrap a text into lines that fit the sidebar, shorter beside an icon.

    Later lines begin with ``hang``. If the first line is indented, the later lines are indented a little more.
    """
    indent = len(text) - len(text.lstrip())
    hang = hang or " " * (indent and indent + 2)
    if room := _measure_room(icon):
        return _fit_lines(text, hang, *room)
    width = measure_line_length()
    width -= (_ICON_CHARACTERS + (width < LINE)) * icon
    return (text,) if len(text) <= width else _wrap_held(text, width, hang)


def _measure_room(icon: bool) -> tuple[int, float] | None:
    """Return the pixels that a text of the drawn sidebar has, and the size of its letters; None if none is drawn."""
    region = bpy.context.region
    if bpy.app.background or region is None or region.type != "UI":
        return None
    preferences = bpy.context.preferences
    scale = preferences.system.ui_scale
    beside = (_BESIDE_TEXT_PX + _ICON_PX * icon) * scale
    return int(region.width - beside), preferences.ui_styles[0].widget.points * scale


@lru_cache(maxsize=256)
def _fit_lines(text: str, hang: str, room_px: int, letter_px: float) -> tuple[str, ...]:
    """Wrap a text into lines of at most ``room_px`` in the font of the window, or of ``_FEWEST_CHARACTERS``."""
    blf.size(0, letter_px)
    text_px = blf.dimensions(0, text)[0]
    if text_px <= room_px:
        return (text,)
    for width in range(int(len(text) * room_px / text_px) + _MORE_CHARACTERS, _FEWEST_CHARACTERS, -1):
        lines = _wrap_held(text, width, hang)
        if all(blf.dimensions(0, line)[0] <= room_px for line in lines):
            return lines
    return _wrap_held(text, _FEWEST_CHARACTERS, hang)


@lru_cache(maxsize=256)
def _wrap_held(text: str, width: int, hang: str) -> tuple[str, ...]:
    held = _FIXED_SPACE.sub(_HELD_SPACE, text)
    return tuple(line.replace(_HELD_SPACE, " ") for line in textwrap.wrap(held, width, subsequent_indent=hang))


#: Custom property of a scene: the file of a ground that was made from an object, and the object's name.
GROUND_OBJECT = "icymoon_ground_object"


def describe_ground_file(scene: bpy.types.Scene) -> str:
    """Name the object or the file of a scene's ground; empty for other ground.

    An object's file is named after its content, so the object's name is kept with the scene.
    """
    source = scene.icymoon.source
    if source.kind not in ("MESH", "HEIGHT_MAP") or not source.file:
        return ""
    stored: Any = scene.get(GROUND_OBJECT)
    kept = dict(stored.items()) if hasattr(stored, "items") else {}
    name = f"copy of {kept.get('name')}" if kept.get("file") == source.file else Path(source.file).name
    return show_controls(f"Ground: {name}")


def list_omission_lines(settings: Settings) -> tuple[str, ...]:
    """List sentences on the details that a render would omit, as in ``pair.json``; none on the planet if the sky cannot
    be computed."""
    try:
        lights = _compute_sky_facts(_list_sky_items(find_light(settings)), bpy.data.filepath)
    except IcyMoonError:
        lights = {"planet": None}
    return tuple(find_left_out(settings, lights))


def find_light(settings: Settings) -> LightSettings:
    """Return the light settings. For the sky over the site of a readable map, their place is the site's, and azimuths
    are from true north."""
    if not uses_sky_of_site(settings):
        return settings.light
    found = _find_sky_place(tuple(settings.source.items()), settings.terrain.body_radius_m, bpy.data.filepath)
    return settings.light | found if found else settings.light


def _list_sky_items(light: LightSettings) -> tuple[tuple[str, Any], ...]:
    """Return the settings on which the sky depends, as the key of a cache: all except the list of lamps."""
    return tuple((key, value) for key, value in light.items() if key != "lamps")


@lru_cache(maxsize=8)
def _find_sky_place(source: tuple[tuple[str, Any], ...], radius_m: float, blend: str) -> dict[str, float]:
    stated = Settings(
        source=SourceSettings.from_values(source),
        terrain=TerrainSettings.from_values((("size_m", 1.0), ("body_radius_m", radius_m))),
        light=LightSettings.from_values((("directions_from", "DATE"), ("place", "SITE"))),
    )
    try:
        path = absolute_path(stated.source.file, "source.file", str(Path(blend).parent) if blend else None)
        place = read_site_place(path, stated)
    except IcyMoonError:
        return {}
    at = find_sky_place(stated, place.to_json() if place else None)
    return {"latitude_deg": at.latitude_deg, "longitude_deg": at.longitude_deg} if at else {}


def list_sky_lines(light: LightSettings) -> tuple[str, ...]:
    """List elevation, azimuth, apparent size and irradiance of Sun and planet; empty if the sky cannot be computed."""
    return _make_sky_lines(_list_sky_items(light), bpy.data.filepath)


def find_sky_fault(light: LightSettings) -> str:
    """Explain in a sentence why the sky cannot be computed; empty if it can."""
    try:
        _compute_sky_facts(_list_sky_items(light), bpy.data.filepath)
    except IcyMoonError as error:
        return str(error)
    return ""


def list_rig_lines(rig: RigSettings) -> tuple[str, ...]:
    """List the field of view, then distance, sampling and depth error at the near edge, the middle and the far edge."""
    return _make_rig_lines(tuple(rig.items()))


def list_camera_notes(settings: Settings) -> tuple[str, ...]:
    """List the blur of the images and its effect on the truth, and the overscan that the distortion needs."""
    return _make_camera_notes(tuple(settings.rig.items()), tuple(settings.sensor.items()))


@lru_cache(maxsize=8)
def _make_camera_notes(*parts: tuple[tuple[str, Any], ...]) -> tuple[str, ...]:
    rig, sensor = RigSettings.from_values(parts[0]), SensorSettings.from_values(parts[1])
    settings = Settings(rig=rig, sensor=sensor)
    lines = [replace_keys_by_labels(sentence) for sentence in advise_on_blur(settings)]
    try:
        found = find_blur(settings)
    except IcyMoonError:
        found = None
    for name, row in (("Near edge", float(rig.height_px)), ("Middle", rig.height_px / 2), ("Far edge", 0.0)):
        depth = measure_ground_row(rig, row).depth_m
        if found is not None and math.isfinite(depth):
            below = row - rig.height_px / 2 - float(rig.principal_y_px)
            lines.append(
                f"{name} focus {circle_of_confusion_px(depth, rig, found):.3g} px, motion "
                f"{motion_blur_px(0.0, below, depth, rig, found):.3g} px"
            )
    if any(read_coefficients(rig)):
        lines.append(_describe_overscan(find_overscan(rig), float(rig.overscan)))
    return tuple(lines)


def _describe_overscan(needed: float | None, given: float) -> str:
    if needed is None:
        return "No overscan is enough for this lens"
    if needed == 0:
        return "The lens needs no overscan"
    share = math.ceil(1000 * needed) / 1000
    return f"Overscan {share:.3f} needed" + (", and set" if given >= needed else "")


def compute_brightness_wm2(light: LightSettings, slope_deg: float = 0.0) -> float:
    """Compute the irradiance, W/m², from Sun and planet on ground that is tilted toward the Sun by ``slope_deg``. It is
    0 in the dark, or if the sky cannot be computed."""
    try:
        found = _compute_sky_facts(_list_sky_items(light), bpy.data.filepath)
    except IcyMoonError:
        return 0.0
    sun, planet = found["sun"], found["planet"] or {}
    height_deg = min(90.0, max(sun["elevation_deg"], 0.0) + slope_deg)
    slope = max(0.02, math.sin(math.radians(height_deg))) * sun["irradiance_wm2"]
    return float(max(slope, sun["ground_irradiance_wm2"]) + planet.get("ground_irradiance_wm2", 0.0))


def find_sun(light: LightSettings) -> dict[str, Any] | None:
    """Return the facts of the Sun as it lights the scene; None if the sky cannot be computed."""
    try:
        found: dict[str, Any] = _compute_sky_facts(_list_sky_items(light), bpy.data.filepath)["sun"]
    except IcyMoonError:
        return None
    return found


def compute_planetshine_wm2(light: LightSettings) -> float:
    """Compute the irradiance, W/m², from the planet on ground that faces it. It is 0 without a planet, or if the sky
    cannot be computed."""
    try:
        planet = _compute_sky_facts(_list_sky_items(light), bpy.data.filepath)["planet"]
    except IcyMoonError:
        return 0.0
    return float(planet["irradiance_wm2"]) if planet else 0.0


@lru_cache(maxsize=8)
def _compute_sky_facts(light: tuple[tuple[str, Any], ...], blend: str) -> dict[str, Any]:
    """Compute the facts of the sky, with the Sun as it lights the scene."""
    described = LightSettings.from_values(light)
    found = describe_sky(compute_sky(described, str(Path(blend).parent) if blend else None))
    return {**found, "sun": sun_from_facts(found["sun"], described.directions_from).to_json()}


def _make_sky_lines(light: tuple[tuple[str, Any], ...], blend: str) -> tuple[str, ...]:
    try:
        found = _compute_sky_facts(light, blend)
    except IcyMoonError:
        return ()
    lines = []
    for name, body in (("Sun", found["sun"]), ("Planet", found["planet"])):
        if body is not None:
            phase = f", phase {body['phase_deg']:.1f}°" if "phase_deg" in body else ""
            lines += [
                f"{name} {body['elevation_deg']:.2f}° high, azimuth {body['azimuth_deg']:.2f}°",
                f"    {body['angular_diameter_deg']:.3g}° wide{phase}",
                f"    {body['irradiance_wm2']:.3g} W/m², {body['ground_irradiance_wm2']:.3g} on flat ground",
            ]
    if found["sun"]["eclipse"] > 0:
        lines.append(f"Eclipse: planet hides {100 * found['sun']['eclipse']:.0f} % of Sun")
    above = (found["planet"] or {}).get("above_ring_plane_deg")
    if above is not None:
        lines.append(
            f"Rings {abs(above):.2g}° from edge-on, seen from {'north' if above > 0 else 'south'}"
            if abs(above) > 1e-4
            else "Rings exactly edge-on: not seen"
        )
    return tuple(lines)


@lru_cache(maxsize=8)
def _make_rig_lines(rig: tuple[tuple[str, Any], ...]) -> tuple[str, ...]:
    described = RigSettings.from_values(rig)
    width, height = int(described.width_px), int(described.height_px)
    focal = focal_px(described)
    fields = [2 * math.degrees(math.atan(n / 2 / focal)) for n in (width, height)]
    lines = [
        f"Field of view {fields[0]:.1f}° x {fields[1]:.1f}°",
        f"Focal length {focal:.1f} px",
        f"Depth × disparity {focal * described.baseline_m:.2f} px·m",
        f"Level ground, disparity ± {DISPARITY_ERROR_PX:g} px:",
    ]
    for name, row in (("Near edge", float(height)), ("Middle", height / 2), ("Far edge", 0.0)):
        lines += _make_row_lines(name, measure_ground_row(described, row), described)
    return tuple(lines)


def _make_row_lines(name: str, row: GroundRow, rig: RigSettings) -> list[str]:
    if math.isinf(row.depth_m):
        return [f"{name} above the horizon"]
    shared = 100 * shared_width_px(rig, row.depth_m) / int(rig.width_px)
    error_m = depth_error_m(row.depth_m, rig, DISPARITY_ERROR_PX)
    return [
        f"{name} {row.depth_m:.2f} m ± {show_rounded(100 * error_m)} cm",
        f"    {row.width_m:.3g} m wide, {shared:.0f} % in both eyes",
        f"    {show_rounded(1000 * row.across_m)} x {show_rounded(1000 * row.along_m)} mm per pixel",
    ]


def list_quality_presets(settings: Settings) -> list[QualityPreset]:
    """List the qualities for the described scene, each with its seconds per pair on this machine; see
    ``list_qualities``."""
    return _list_qualities(
        settings,
        ASSUMED_TRIANGLES,
        recall_known_speed(str(settings.quality.device)),
        Abilities(compat.has_osl(), compat.has_oidn()),
    )


_list_qualities = remember_answers(list_qualities)


def describe_speed(settings: Settings) -> str:
    """Name the machine for which the seconds are estimated."""
    speed = recall_known_speed(str(settings.quality.device))
    return f"Timed on {speed.basis}" if speed else "Timed on another machine"


@lru_cache(maxsize=2)
def recall_known_speed(device: str) -> Speed | None:
    """Return the measured speed of this machine with this Blender, read once; None if it was not measured."""
    return recall_speed(device, bpy.app.version_string)


def keep_speed(speed: Speed) -> None:
    """Store a speed, on which all later estimates rest. Raises IcyMoonError if it cannot be stored."""
    remember_speed(speed)
    recall_known_speed.cache_clear()
