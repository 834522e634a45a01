"""Descriptions at the limits of what settings accept, and what has to be so of all that is made from them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.nodes.light.sun_lamp import read_lamp_diameter_rad, read_lamp_irradiance_wm2
from icymoon.nodes.surface.patches_and_grain import ELEVATION
from icymoon.physics.camera.depth_accuracy import coordinate_rounding_m
from icymoon.render.pairs.pair_folder import EYES, Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings import description, toml_text
from icymoon.settings.rebuilt_parts import describe_mesh_relief
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.declaration import Parts, Setting
from icymoon.settings.topics.scene import Settings
from icymoon.settings.topics.surfaces import HapkeSettings, SurfaceSettings
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.images.exr import Light, View
from icymoon.stereo.images.views import read_eye
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.arrays import Array
from icymoon.support.labels import ROCK, SKY_TAGS, TERRAIN
from mathutils import Vector
from rendering import empty_scene

#: What only costs time, kept small; tests of their own have these at their limits.
CHEAP: Parts = {
    "terrain": {"resolution": 33},
    "mesh": {"most": 2000},
    "rocks": {"most": 40},
    "craters": {"most": 500},
    "light": {"stars_faintest_mag": 3.0},
    "rig": {"width_px": 16, "height_px": 16, "overscan": 0.1},
    "sensor": {"brackets": 2},
    "quality": {"samples": 1, "threads": 2, "device": "CPU"},
}
#: Topics that are no numbers about a scene: files, and where results go.
LEFT_OUT = ("source", "textures", "dataset")
#: The setting without which a topic makes nothing, and a value of it.
SWITCHED_ON_BY = {
    "rocks": ("coverage", 0.02),
    "craters": ("coverage", 0.02),
    "ridges": ("height_m", 1.0),
    "cracks": ("depth_m", 0.3),
    "chaos": ("relief_m", 1.0),
    "hollows": ("depth_m", 0.2),
    "penitentes": ("height_m", 1.0),
    "pits": ("depth_m", 0.3),
    "mantle": ("thickness_m", 0.2),
}
#: The shorter of two lengths may not pass the longer.
SHORT_AND_LONG = (
    ("rocks", "smallest_m", "largest_m"),
    ("craters", "smallest_m", "largest_m"),
    ("terrain", "inner_scale_m", "outer_scale_m"),
)
NEAREST_M = 1.0e-4  # planar depth that the lens clips at
_MAX_RAYS = 1000  # of an image
_SPEEDS = (
    "speed_right_m_s",
    "speed_down_m_s",
    "speed_forward_m_s",
    "turn_right_deg_s",
    "turn_down_deg_s",
    "roll_deg_s",
)


def complete(*parts: Parts) -> Settings:
    """The defaults, made cheap, with changes."""
    return description.merged(description.defaults(), CHEAP, *(description.check(part, "test") for part in parts))


def numbers() -> list[tuple[str, Setting]]:
    """Every (topic, setting) that is a number about a scene, but for what is kept cheap."""
    return [
        (key, s)
        for key, topic in TOPICS.items()
        if key not in LEFT_OUT
        for s in topic.settings
        if s.kind in ("int", "float") and s.key not in CHEAP.get(key, {})
    ]


def drawn(seed: int) -> dict[str, dict[str, Any]]:
    """A random description: few settings or all of them, at a limit or somewhere on their sliders."""
    random = np.random.default_rng(seed)
    settings = [
        (key, s)
        for key, topic in TOPICS.items()
        if key not in LEFT_OUT
        for s in topic.settings
        if s.kind in ("int", "float", "bool", "choice")
        and s.key not in CHEAP.get(key, {})
        and s.key != "directions_from"
    ]
    count = random.choice([2, 5, 10, 40, len(settings)], p=[0.25, 0.25, 0.25, 0.15, 0.1])
    found: dict[str, dict[str, Any]] = {}
    for topic, setting in (settings[k] for k in random.choice(len(settings), count, replace=False)):
        found.setdefault(topic, {})[setting.key] = _value(setting, random)
    for topic, (key, value) in SWITCHED_ON_BY.items():
        if random.random() < 0.25:
            found.setdefault(topic, {}).setdefault(key, value)
    rig = found.setdefault("rig", {})
    if random.random() < 0.3:  # wide enough for a matcher
        rig |= {"width_px": 40, "height_px": 24}
    if random.random() < 0.8:  # a lens that folds the image over is refused, as nearly all such are
        for key in [key for key in rig if key.startswith("distortion")]:
            rig[key] = round(random.uniform(-0.02, 0.02), 5)
    if random.random() < 0.8:  # more craters than allowed are refused, as nearly all small ones are
        for key in ("smallest_m", "largest_m"):
            found.get("craters", {}).pop(key, None)
    turn = math.hypot(*(rig.get(key, 0.0) for key in _SPEEDS))
    if turn and random.random() < 0.9:
        rig["motion_exposure_s"] = min(rig.get("motion_exposure_s") or 0.01, 80.0 / turn)
        if "readout_s" in rig:
            rig["readout_s"] = min(rig["readout_s"], 9.0 / turn)
    return _consistent(found)


def _value(setting: Setting, random: np.random.Generator) -> Any:
    if setting.kind == "choice":
        return str(random.choice([choice[0] for choice in setting.choices]))
    if setting.kind == "bool":
        return bool(random.integers(2))
    low, high = setting.soft or (setting.minimum, setting.maximum)
    value = random.choice([setting.minimum, setting.maximum, random.uniform(low, high)], p=[0.4, 0.4, 0.2])
    return int(value) if setting.kind == "int" else float(value)


def _consistent(found: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """With the shorter of two lengths first."""
    whole = complete(found)
    for topic, short, long in SHORT_AND_LONG:
        if whole[topic][short] > whole[topic][long]:
            found.setdefault(topic, {}).update({short: whole[topic][long], long: whole[topic][short]})
    return found


def story(settings: Settings) -> str:
    """What of a description is not the default, as TOML, for messages."""
    default = description.defaults()
    changed = {
        topic: {key: value for key, value in values.items() if value != default[topic][key]}
        for topic, values in settings.items()
    }
    return toml_text.to_toml({topic: values for topic, values in changed.items() if values})


def shot(settings: Settings, folder: Path) -> tuple[Pair, Built]:
    """Build and render. Raises IcyMoonError where a description is refused."""
    built = build_scene(empty_scene(), settings)
    (made,) = render_pairs(built, expand_headings(settings), folder, 1, 0.0, lambda *a, **k: None)
    return read_pair(made), built


def faults(pair: Pair, built: Built, out: Path) -> list[str]:
    """Everything that is wrong with a rendered pair and the scene that is built, and its evaluation; sentences."""
    found = [f"not finite: {item.name}" for item in built.collection.all_objects if not is_finite(item)]
    found += unused(built)
    for eye in EYES:
        light, view = read_eye(pair, eye)
        found += [f"{eye}: {fault}" for fault in _of_light(light)]
        if np.nanmin(view.depth, initial=math.inf) < 16 * coordinate_rounding_m(*built.camera.matrix_world.translation):
            continue  # a wall so near that coordinates are rounded past it, far from the origin
        found += [f"{eye}: {fault}" for fault in (*_of_truth(view), *_against_rays(pair, view, eye))]
        if not light.radiance.any() and not why_black(built, pair, view, eye):
            found.append(f"{eye}: black without a reason")
    return found + _of_report(pair, out)


def is_finite(item: Any) -> bool:
    if not np.isfinite(np.array(item.matrix_basis)).all():
        return False
    if item.type != "MESH":
        return True
    return not len(item.data.vertices) or bool(np.isfinite(vertices(item.data)).all())


def vertices(mesh: Any) -> Array:
    flat = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", flat)
    return flat.reshape(-1, 3)


def unused(built: Built) -> list[str]:
    """Settings that Blender's data do not have as they are stated."""
    rig, lens = built.settings.rig, built.camera.data
    pairs = {
        "rig.focal_length_mm": (lens.lens, rig.focal_length_mm),
        "rig.sensor_width_mm": (lens.sensor_width, rig.sensor_width_mm),
        "rig.baseline_m": (lens.stereo.interocular_distance, rig.baseline_m),
        "rig.principal_x_px": (-lens.shift_x * rig.width_px, rig.principal_x_px),
        "rig.principal_y_px": (lens.shift_y * rig.width_px, rig.principal_y_px),
        "rig.x_m": (built.camera.location.x, rig.x_m),
        "rig.y_m": (built.camera.location.y, rig.y_m),
        "rig.height_m": (built.camera.location.z, built.site_m + rig.height_m),
    }
    if built.settings.light.directions_from == "ANGLES":
        light = built.settings.light
        disc = light.sun_angular_diameter_deg
        pairs["light.sun_angular_diameter_deg"] = math.degrees(read_lamp_diameter_rad(built.sun)), disc
        if light.sun_elevation_deg + disc / 2 > 0 and not built.sky["sun"]["eclipse"]:
            pairs["light.sun_irradiance_wm2"] = (read_lamp_irradiance_wm2(built.sun), light.sun_irradiance_wm2)
    return [
        f"{name} is {there:g} in the scene, not {stated:g}"
        for name, (there, stated) in pairs.items()
        if abs(there - stated) > 1e-6 * abs(stated) + 1e-12
    ]


def _of_light(light: Light) -> Iterator[str]:
    for name, radiance in {"radiance": light.radiance, **light.groups}.items():
        if not np.isfinite(radiance).all():
            yield f"{name} has {np.count_nonzero(~np.isfinite(radiance))} values that are no number"
        elif radiance.min() < 0:
            yield f"{name} is {radiance.min():g}, negative"


def _surface(view: View) -> Array:
    """Where (H, W) ground or blocks are seen; where there are no labels, where anything is."""
    return np.isfinite(view.depth) if view.semantic is None else np.isin(view.semantic, (TERRAIN, ROCK))


def _of_truth(view: View) -> Iterator[str]:
    if view.semantic is None or view.instance is None or view.normal is None:
        return  # depth is all there is
    surface, depth = _surface(view), np.isfinite(view.depth)
    if (surface & ~depth).any():
        yield f"{np.count_nonzero(surface & ~depth)} pixels of a surface have no depth"
    if (depth & (view.semantic == 0)).any():
        yield f"{np.count_nonzero(depth & (view.semantic == 0))} pixels of sky have a depth"
    if (surface & (view.instance <= 0)).any():
        yield f"{np.count_nonzero(surface & (view.instance <= 0))} pixels of a surface have no instance"
    length = np.linalg.norm(view.normal[surface], axis=-1)
    if len(length) and np.abs(length - 1).max() > 5e-4:  # they are stored as 16-bit floats
        yield f"normals are {length.min():g} to {length.max():g} long"


def rays(pair: Pair, eye: str) -> tuple[Array, Array]:
    """Position (3,) of an eye of the parallel rig, and the vectors (H, W, 3) of a planar depth of 1 m through its
    pixels' centres, world axes."""
    assert pair.rectified_poses is not None
    pose, camera = np.array(pair.rectified_poses[eye]), pair.camera
    x = (np.arange(camera.width_px) + 0.5 - camera.cx_px) / camera.focal_px
    y = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    plane = np.stack([*np.broadcast_arrays(x[None, :], y[:, None]), np.ones((len(y), len(x)))], axis=-1)
    return pose[:3, 3], plane @ pose[:3, :3].T


def _against_rays(pair: Pair, view: View, eye: str) -> Iterator[str]:
    """True depth against that of Blender's own rays through the same meshes."""
    if "DISPLACEMENT" in (pair.settings.surface.relief, pair.settings.rock_surface.relief) or describe_mesh_relief(
        pair.settings
    ):
        return  # which Cycles alone does
    start, toward = rays(pair, eye)
    scene, graph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    depth, rounded = np.full((2, *view.depth.shape), np.nan)
    places = list(np.ndindex(depth.shape))
    for place in places[:: math.ceil(len(places) / _MAX_RAYS)]:
        way = toward[place]
        hit, at, normal, face, item, matrix = scene.ray_cast(graph, Vector(start), Vector(way).normalized())
        hit = hit and item.get("icymoon") not in SKY_TAGS
        # What the largest coordinate is rounded by, along the ray to the plane that is hit.
        slant = max(abs(np.array(normal) @ way) / np.linalg.norm(way), 1e-3) if hit else 1.0
        vertices = item.data.polygons[face].vertices if hit else ()
        corners = [np.array(matrix @ item.data.vertices[k].co) for k in vertices]
        depth[place] = _met(start, way, np.array(at), corners) if hit else np.nan
        rounded[place] = np.spacing(np.float32(np.abs([*start, *np.ravel(corners)]).max())) / slant
    tried = np.isfinite(rounded) & ~(depth < NEAREST_M)
    shown = np.where(_surface(view), view.depth, np.nan)
    if tried.any() and np.mean((np.isfinite(depth) != np.isfinite(shown))[tried]) > 0.02:
        met, has = (np.isfinite(each[tried]).mean() for each in (depth, shown))
        yield f"rays meet ground at {met:.0%} of the pixels, truth has it at {has:.0%}"
    both = np.isfinite(depth) & np.isfinite(shown) & tried
    # Walls of a kilometre between neighbouring vertices are seen edge-on, where both are rounded many times over.
    off = np.abs(depth - shown)[both] / (5e-4 * shown + 16 * rounded)[both]
    if len(off) and np.quantile(off, 0.95) > 1:
        yield f"depth is {np.quantile(off, 0.95):.2g} tolerances off that of rays at {np.nanmedian(shown):.3g} m"


def _met(start: Array, way: Array, at: Array, corners: list[Array]) -> float:
    """How many of ``way`` it is to where a ray meets a face. Blender's own answer, ``at``, is off by some hundredths
    of a metre on triangles of 25 m seen from 0.3 m, so it only says which face; the plane of three corners is exact."""
    if len(corners) != 3:
        return float((at - start) @ way / (way @ way))
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return float((corners[0] - start) @ normal / (way @ normal)) if way @ normal else float("nan")


def why_black(built: Built, pair: Pair, view: View, eye: str) -> str:
    """Why an image may be black; empty if it may not."""
    surface = _surface(view)
    if not surface.any():
        return "only sky is seen"
    if view.normal is None:
        return "there are no normals to tell by"
    sun, shine = built.sun.data.energy, built.planetshine
    if sun == 0 and shine is None:
        return "no light is up"
    if built.settings.veil.optical_depth > 1 + built.settings.quality.diffuse_bounces:
        return "the veil scatters light more often than it is followed"
    lights = ([(built.sun, sun)] if sun else []) + ([(shine, shine.data.energy)] if shine is not None else [])
    if all(power == 0 for _, power in lights):
        return "the lights have no power"
    topics = {"surface"} | ({"rock_surface"} if built.settings.rocks.own_surface else set())
    if all(_is_black(built.settings[topic], built.settings.hapke) for topic in topics):
        return "the surface reflects nothing"
    start, toward = rays(pair, eye)
    points = (start + view.depth[..., None] * toward)[surface]
    normals = view.normal[surface]
    if built.settings.surface.trough_dirt and _dirty(built, points).all():
        return "only dirt is seen"
    if not any(_reached(points, normals, item) for item, _ in lights):
        return "what is seen is in shadow"
    return ""


def _is_black(surface: SurfaceSettings, hapke: HapkeSettings) -> bool:
    if surface.model == "HAPKE":
        return hapke.w == 0
    return surface.albedo == 0 or (surface.model == "PRINCIPLED" and surface.transmission == 1)


def _dirty(built: Built, points: Array) -> Array:
    """Whether the ground at points (n, 3) is wholly dark by the dirt of its height."""
    mesh, dirt = built.terrain.data, built.settings.surface.trough_dirt
    elevation = np.empty(len(mesh.vertices), np.float32)
    mesh.attributes[ELEVATION].data.foreach_get("value", elevation)
    places = vertices(mesh)
    nearest = [np.argmin(((places - point) ** 2).sum(axis=1)) for point in points]
    return (-math.copysign(1.0, dirt) * elevation[nearest] >= 1) & (abs(dirt) == 1)


def _reached(points: Array, normals: Array, light: Any) -> bool:
    """Whether any of the points sees any of a light's disc, by Blender's own rays."""
    scene, graph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    axes = np.array(light.matrix_world.to_3x3())
    half = light.data.angle / 2
    for point, normal in zip(points, normals, strict=True):
        for radius, turn in [(0.0, 0.0), *((half * r, math.pi / 4 * k) for r in (0.5, 0.95) for k in range(8))]:
            way = axes @ [math.sin(radius) * math.cos(turn), math.sin(radius) * math.sin(turn), math.cos(radius)]
            if way @ normal <= 0 or way[2] < 0:
                continue
            from_point = Vector(point + 1e-4 * normal * max(1e-3, float(np.abs(point).max())))
            if not scene.ray_cast(graph, from_point, Vector(way))[0]:
                return True
    return False


def _of_report(pair: Pair, out: Path) -> list[str]:
    """Develop and evaluate: whatever the images are, there is a report of numbers, or a sentence why not."""
    report = evaluate([pair.folder], parse_methods("bm:disparities=16:window=5"), out)
    found = [] if len(report["rows"]) == 1 else ["the report has no row"]
    if any(word in (out / "report.json").read_text(encoding="utf-8") for word in ("NaN", "Infinity")):
        found.append("a number of the report is none")
    found += [
        f"evaluation ends with {failed['message']!r}"
        for failed in report["failed"]
        if not is_sentence(failed["message"])
    ]
    return found


def is_sentence(message: str) -> bool:
    """Whether a message is one for people: one line that ends as a sentence does."""
    return "\n" not in message and message.endswith(".") and len(message) > 20
