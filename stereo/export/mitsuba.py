"""The export ``mitsuba``: the scene of a pair for the renderer Mitsuba 3.

``<out>/<pair>/`` gets ``scene_left.xml`` and ``scene_right.xml``, which Mitsuba loads unchanged, PLY files of the
evaluated ground and rocks, ``planet.pfm`` if a planet gives light, ``mitsuba_hapke.py`` for Hapke's law,
``mitsuba_hapke.py`` and ``mitsuba_snow.py`` for the law of snow, and ``export.json``, which lists the omissions.

Blender builds the scene again from the settings of the pair to get its meshes. The scene has the camera of each eye,
the Sun's disc as a far disk, the planet's light as a map of the sky, and Lambert's law, Hapke's or the law of snow. The
film has a Gaussian filter of the same width as Cycles' filter here. Radiance has the unit of the pair, W/(m² sr).
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ...formats.geotiff import describe_map_place
from ...physics.light.planetshine import VisibleCap, irradiance_wm2
from ...physics.light.sky import Sky
from ...physics.surfaces.hapke import porosity_factor
from ...render.pairs.pair_folder import EYES, Pair, read_pair, refuse_rolling_shutter
from ...render.pairs.pair_sky import compute_pair_sky
from ...render.plans.planned_pair import PlannedPair
from ...render.workers.process import Message
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import write_json, write_text
from ...support.version import ROOT
from ..measure.prepare_pair import list_distinct_pairs
from .encodings import write_pfm
from .ground import build_geometry, refuse_edited
from .plug_in import FoldersContext

NEEDS = "Blender"
HEADINGS = {"mitsuba": "Ground and Meshes"}
TITLES = {"mitsuba": "Mitsuba 3: the scene for this renderer, with meshes, cameras and light"}
#: Distance of the Sun's disk, m, so large that its direction is the same from all points of a ground.
_SUN_DISTANCE_M = 1e9
#: Rows of the map of the sky. A row is 0.1 degrees, a three-hundredth of Saturn's disc.
_SKY_ROWS = 1800
#: Standard deviation of the filter in pixels, as of a Blackman-Harris window that is 3 pixels wide in all.
#: ``cycles.filter_width`` is 1.5, half of this width, because Cycles doubles it for this window.
_FILTER_PX = 0.4155
#: Depth without Russian roulette, which would only add noise.
_ROULETTE_DEPTH = 1000

#: Settings of a surface that the export lacks if they are not 0: of every surface, and of Principled ice alone.
_UNEXPORTED_VARIATIONS = ("albedo_variation", "salt_share", "trough_dirt", "slope_dirt", "emitted_w_m2_sr")
_UNEXPORTED_LAYERS = ("glint_share", "crust_share", "frost_share", "fracture_share")

#: The files with the BSDF of each reflectance law.
_BSDF_FILES = {"HAPKE": ("mitsuba_hapke.py",), "SNOW": ("mitsuba_hapke.py", "mitsuba_snow.py")}

Plugin = dict[str, Any]


def write_folders(folders: Sequence[Path], out: Path, context: FoldersContext) -> None:
    """Write the scenes of the pairs in folders, and warn of content that is omitted."""
    pairs = [read_pair(folder) for folder in list_distinct_pairs(folders)]
    for pair in pairs:
        for sentence in find_left_out(pair.settings, compute_pair_sky(pair.settings, pair.data.get("ground"))):
            context.warn(f"pair {pair.id}: {sentence}")
    with context.progress("Starting Blender") as show:
        export_mitsuba(pairs, out, context.blender, show)


def export_mitsuba(
    pairs: Sequence[Pair], out: Path, blender: str, hear: Callable[[Message], None] = lambda message: None
) -> list[Path]:
    """Write the scenes of pairs to ``<out>/<pair>/`` and return these folders.

    Raises IcyMoonError if a pair was edited by hand, or if its cameras or lights are not supported.
    """
    for pair in pairs:
        _refuse_unexportable(pair)
    build_geometry([PlannedPair(pair.id, pair.settings, 0.0) for pair in pairs], out, blender, hear)
    return [write_scene(pair, out / pair.id) for pair in pairs]


def _refuse_unexportable(pair: Pair) -> None:
    refuse_edited(pair)
    refuse_rolling_shutter(pair, "this export has one pose for all rows", "render it with rig.readout_s 0")
    if pair.camera.looks_elsewhere or pair.camera.rendered_px != (pair.camera.width_px, pair.camera.height_px):
        raise IcyMoonError(
            f"{pair.folder} has toe-in, calibrated eyes or overscan, which this export does not support; render "
            "it with rig.eyes ALIKE, and without rig.toe_in_deg and rig.overscan."
        )
    if pair.settings.light.sun_distance_m:
        raise IcyMoonError(
            f"{pair.folder} is lit by a lamp near the ground, which this export does not support; render "
            "it without light.sun_distance_m."
        )
    if pair.settings.light.lamps:
        raise IcyMoonError(
            f"{pair.folder} is lit by lamps, which this export does not support; render it without light.lamps."
        )


def write_scene(pair: Pair, folder: Path) -> Path:
    """Write the scene files of a pair beside its meshes, and return the folder."""
    settings, shown = pair.settings, compute_pair_sky(pair.settings, pair.data.get("ground"))
    left_out = find_left_out(settings, shown)
    meshes = [kind for kind in ("terrain", "rock") if (folder / f"{kind}.ply").is_file()]
    models = {_choose_surface(settings, kind).model for kind in meshes}
    for name in dict.fromkeys(name for model, names in _BSDF_FILES.items() if model in models for name in names):
        shutil.copyfile(ROOT / "stereo" / "adapters" / name, folder / name)
    shared: dict[str, Plugin] = {
        "integrator": {
            "type": "path",
            "max_depth": int(settings.quality.diffuse_bounces) + 2,
            "rr_depth": _ROULETTE_DEPTH,
            "hide_emitters": True,
        },
        **{
            kind: {"type": "ply", "filename": f"{kind}.ply", "bsdf": _surface_plugin(settings, kind)} for kind in meshes
        },
        **_light_plugins(pair, shown, folder),
    }
    for eye in EYES:
        write_text(folder / f"scene_{eye}.xml", _to_xml({**shared, "sensor": _camera_plugin(pair, eye)}))
    write_json(
        folder / "export.json",
        {
            "pair": pair.id,
            "meshes": meshes,
            "left_out": left_out,
            "unit": "W/(m² sr)",
            **({"map": place} if (place := describe_map_place(pair.data.get("ground"))) else {}),
        },
    )
    return folder


def find_left_out(settings: Settings, shown: Sky) -> list[str]:
    """List the parts of a pair that the export lacks, one sentence each."""
    found = []
    for topic in ("surface", "rock_surface") if settings.rocks.own_surface else ("surface",):
        surface = settings[topic]
        if surface["model"] not in ("LAMBERT", *_BSDF_FILES):
            found.append(f"{topic}.model {surface['model']} is exported as Lambert's law with the same albedo.")
        if surface["grain_amplitude_m"] and surface["relief"] != "DISPLACEMENT":
            found.append(f"{topic}.grain_amplitude_m: relief that the mesh does not have is left out.")
        if surface.get("ice_colour", "GREY") != "GREY":
            found.append(f"{topic}.ice_colour is left out: the ground is grey.")
        layers = _UNEXPORTED_LAYERS if surface["model"] == "PRINCIPLED" else ()
        found += [f"{topic}.{key} is left out." for key in (*_UNEXPORTED_VARIATIONS, *layers) if surface.get(key)]
        if layers and surface["bubble_share"]:
            found.append(f"{topic}.bubble_share is left out: the albedo is {topic}.albedo, not that of the bubbles.")
    if settings.veil.optical_depth > 0:
        found.append("The veil (veil.optical_depth) is left out.")
    if settings.textures.set != "NONE":
        found.append("Images on the ground (textures.set) are left out.")
    if shown.planet is not None and shown.planet.rings:
        found.append("Saturn's rings are left out, except for their shadow on the planet.")
    if shown.moons:
        found.append("Other moons are left out.")
    if settings.light.stars:
        found.append("Stars are left out.")
    return found


def _choose_surface(settings: Settings, kind: str) -> SurfaceSettings:
    return settings.rock_surface if kind == "rock" and settings.rocks.own_surface else settings.surface


def _surface_plugin(settings: Settings, kind: str) -> Plugin:
    surface = _choose_surface(settings, kind)
    if surface.model == "SNOW":
        return {"type": "icymoon_snow", "albedo": float(surface.albedo)}
    if surface.model != "HAPKE":
        return {"type": "diffuse", "reflectance": [float(surface.albedo)] * 3}
    hapke = settings.hapke
    return {
        "type": "icymoon_hapke",
        **{key: float(hapke[key]) for key in ("w", "b", "c", "b_s0", "h_s", "b_c0", "h_c", "theta_bar_deg")},
        "k": float(porosity_factor(hapke.filling_factor)),
        "h_function": int(hapke.h_function),
    }


def _camera_plugin(pair: Pair, eye: str) -> Plugin:
    """Make the camera of an eye.

    Mitsuba's camera looks along z with x to the left and y up; a pair's camera has x to the right and y down.
    """
    camera = pair.camera
    pose = np.array(pair.data["poses_camera_to_world"][eye]) @ np.diag([-1.0, -1.0, 1.0, 1.0])
    return {
        "type": "perspective",
        "fov_axis": "x",
        "fov": math.degrees(2 * math.atan(camera.width_px / 2 / camera.focal_px)),
        "principal_point_offset_x": camera.cx_px / camera.width_px - 0.5,
        "principal_point_offset_y": camera.cy_px / camera.height_px - 0.5,
        "near_clip": 1e-3,
        "far_clip": 1e7,
        "to_world": pose,
        "sampler": {"type": "independent", "sample_count": int(pair.settings.quality.samples)},
        "film": {
            "type": "hdrfilm",
            "width": camera.width_px,
            "height": camera.height_px,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "gaussian", "stddev": _FILTER_PX},
        },
    }


def _light_plugins(pair: Pair, shown: Sky, folder: Path) -> dict[str, Plugin]:
    found: dict[str, Plugin] = {}
    if pair.sun is not None and pair.sun.irradiance_wm2 > 0:
        found["sun"] = _sun_plugin(pair.sun.direction, pair.sun.irradiance_wm2, pair.sun.angular_diameter_deg)
    if shown.planet is not None and shown.planet_is_up and irradiance_wm2(shown.planet) > 0:
        write_pfm(folder / "planet.pfm", _make_sky_map(VisibleCap(shown.planet)))
        # The map's pole is y, and its middle column looks along z, which is north here.
        found["planet"] = {"type": "envmap", "filename": "planet.pfm", "to_world": _SKY_TO_WORLD}
    return found


def _sun_plugin(direction: Array, energy: float, diameter_deg: float) -> Plugin:
    if diameter_deg == 0:
        return {"type": "directional", "direction": [float(-axis) for axis in direction], "irradiance": [energy] * 3}
    half = math.radians(diameter_deg / 2)
    z = -direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1) @ np.diag([*[_SUN_DISTANCE_M * math.tan(half)] * 2, 1.0])
    matrix[:3, 3] = -_SUN_DISTANCE_M * z
    return {
        "type": "disk",
        "to_world": matrix,
        "emitter": {"type": "area", "radiance": [energy / (math.pi * math.sin(half) ** 2)] * 3},
    }


#: Transform from the axes of Mitsuba's map of the sky, with y up, to ours.
_SKY_TO_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


def _make_sky_map(seen: VisibleCap) -> Array:
    """Make the radiance (rows, 2 rows, 3) of the planet by direction, as Mitsuba's ``envmap`` reads it.

    It is 0 below the horizon.
    """
    rows = _SKY_ROWS
    # Mitsuba: u = atan2(x, -z) / 2π over the columns, v = acos(y) / π from the middle of the first row to the middle of
    # the last.
    polar = np.arange(rows) / (rows - 1) * math.pi
    around = (np.arange(2 * rows) + 0.5) / rows * math.pi
    x, z = np.sin(around) * np.sin(polar)[:, None], -np.cos(around) * np.sin(polar)[:, None]
    y = np.broadcast_to(np.cos(polar)[:, None], x.shape)
    ray = np.stack([x, y, z], axis=-1) @ _SKY_TO_WORLD[:3, :3].T
    planet, shape = seen.planet, seen.shape
    radiance = np.zeros((*x.shape, 3), np.float32)
    near = (ray @ planet.direction > math.cos(math.radians(planet.angular_diameter_deg) * 0.51)) & (ray[..., 2] > 0)
    way = ray[near] @ shape.stretch.T / shape.radius
    a, b = (way * way).sum(-1), way @ shape.observer
    inside = b * b - a * (shape.observer @ shape.observer - 1)
    point = (-(b + np.sqrt(np.maximum(inside, 0.0))) / a)[:, None] * way + shape.observer
    radiance[near] = np.where((inside > 0) & (b < 0), seen.radiance(point), 0.0)[:, None]
    return radiance


_TAG_BY_TYPE = {
    "integrator": "integrator",
    "sensor": "sensor",
    "sampler": "sampler",
    "film": "film",
    "rfilter": "rfilter",
    "bsdf": "bsdf",
    "emitter": "emitter",
    "planet": "emitter",
}


def _to_xml(scene: dict[str, Plugin]) -> str:
    lines = ['<scene version="3.0.0">']
    for name, plugin in scene.items():
        kind = "shape" if plugin["type"] in ("ply", "disk") else _TAG_BY_TYPE.get(name, "emitter")
        lines += _plugin_xml(kind, plugin, name, 1)
    return "\n".join([*lines, "</scene>", ""])


def _plugin_xml(kind: str, plugin: Plugin, name: str, depth: int) -> list[str]:
    space = "  " * depth
    identity = f" id={quoteattr(name)}" if depth == 1 else ""
    lines = [f"{space}<{kind} type={quoteattr(plugin['type'])}{identity}>"]
    for key, value in plugin.items():
        if key != "type":
            lines += _value_xml(key, value, depth + 1)
    return [*lines, f"{space}</{kind}>"]


def _value_xml(key: str, value: object, depth: int) -> list[str]:
    space, name = "  " * depth, f"name={quoteattr(key)}"
    if isinstance(value, dict):
        return _plugin_xml(_TAG_BY_TYPE[key], value, key, depth)
    if isinstance(value, np.ndarray):
        numbers = " ".join(f"{number:.17g}" for number in value.ravel())
        return [f'{space}<transform {name}><matrix value="{numbers}"/></transform>']
    if isinstance(value, bool):
        return [f'{space}<boolean {name} value="{str(value).lower()}"/>']
    if isinstance(value, list):
        kind = "vector" if key == "direction" else "rgb"
        return [f'{space}<{kind} {name} value="{" ".join(f"{number:.17g}" for number in value)}"/>']
    kind = {str: "string", int: "integer", float: "float"}[type(value)]
    shown = f"{value:.17g}" if kind == "float" else str(value)
    return [f"{space}<{kind} {name} value={quoteattr(shown)}/>"]
