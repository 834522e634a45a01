"""Bakes indirect light to the vertices of the ground, once for all images of a ground under one sky.

Light that Lambert ground gets from other ground is the same from all directions of view. Cycles bakes this light to
texels within the facets, and the vertices get the mean of their texels (``baked_texels``). Images then need direct
light only: fewer samples, and no denoiser. During the bake, ground is smooth between its vertices, since a sample would
meet one point of the relief. Light of the Sun and light of the planet are baked separately, since each has its own
light group. With ``quality.bake_area`` VIEW only the facets that the cameras may see, and the facets around them, get
texels.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ..nodes.build_scene import Built
from ..nodes.datablocks.fingerprint import find_added_objects
from ..nodes.rig import turn_about_eye
from ..physics.light import baked_texels
from ..physics.light.baked_noise import count_samples_needed, find_largest_share, measure_bake_noise
from ..physics.light.baked_rocks import TERM_COUNT, fit_terms
from ..physics.random_numbers.seeds import make_generator, seed_stream
from ..physics.rig.seen_points import find_seen_facets, find_sides_passed
from ..physics.scene_requirements import find_why_not_baked
from ..settings import rebuilt_parts
from ..settings.topics.rendering import QualitySettings
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.labels import BAKED_ATTRIBUTES, BAKED_ERROR_ATTRIBUTES, NOT_BAKED
from ..support.number_text import show_rounded
from . import baked_rocks, cycles_settings, texel_bakes
from .mesh_arrays import read_corners, read_triangles, read_vertices
from .pairs.baked_file import BakedLight
from .plans.planned_pair import PlannedPair
from .workers.shared_light import SharedLight, StoredLight

#: Version of the bake. Raise this number when the same settings are baked in another way, or when files of baked light
#: contain more.
_BAKE_VERSION = 5
#: Samples of each half of the first two bakes. The difference of the halves shows how many samples the noise limit
#: takes.
_FIRST_HALF_SAMPLES = 8
#: Height above the ground, m, of the eye for which the share of indirect light is measured: the height of a mast.
_EYE_HEIGHT_M = 1.5
#: Factor by which the bake stays below quality.bake_noise, over all light in the direction with most indirect light.
#: Images show other parts of the ground, and an image above the limit must be traced in the end, which costs more than
#: additional samples.
_NOISE_MARGIN = 1.1
#: Samples of the direct light. A few are enough, because only the mean over the ground is needed.
_DIRECT_LIGHT_SAMPLES = 2
#: Samples that show whether a texel is within a rock.
_OPEN_SKY_SAMPLES = 8
#: Most samples of each of the three texels of a rock's point.
_MAX_ROCK_SAMPLES = 16
_LIGHT_OF_NO_ROCKS = np.zeros((0, TERM_COUNT, 3), np.float32)
#: By light group: parts of names and seeds that distinguish its bakes from the Sun's bakes.
_KEY_PARTS_BY_GROUP: dict[str, tuple[int, ...]] = {"Sun": (), "Planet": (1,)}


@dataclass(frozen=True)
class IndirectLight:
    """The method for the indirect light of a pair: baked ``lights`` by light group, or tracing if ``lights`` is empty.

    ``why_traced`` is the reason for tracing if the settings ask for baked light. ``tried`` is baked light that proved
    unfit for an image, so the image is traced. ``spent_s`` are the processor seconds of bakes in this call.
    """

    lights: Mapping[str, StoredLight] = field(default_factory=dict)
    why_traced: str = ""
    tried: Mapping[str, StoredLight] = field(default_factory=dict)
    spent_s: float = 0.0

    def to_json(self, shares: Mapping[str, Mapping[str, float]], noise_of_image: float | None) -> dict[str, Any] | None:
        """Return the entry of ``pair.json``. It has the shares of baked light in the images by eye and light group, and
        the noise of baked light over all light in the left image. None if the settings ask for traced light."""
        if not self.lights:
            tried = {group: {"file": kept.file, "sha256": kept.sha256} for group, kept in self.tried.items()}
            stated = {"method": "TRACED", "why": self.why_traced, **({"tried": tried} if tried else {})}
            return stated if self.why_traced else None
        share = {group: sum(of[group] for of in shares.values()) / max(len(shares), 1) for group in self.lights}
        noise = math.hypot(*(share[group] * kept.light.noise for group, kept in self.lights.items()))
        of_image = {} if noise_of_image is None else {"noise_of_image": round(noise_of_image, 5)}
        return {
            "method": "BAKED",
            "share": round(sum(share.values()), 5),
            "noise": round(noise, 5),
            **of_image,
            "lights": {group: kept.to_json(share[group]) for group, kept in self.lights.items()},
        }

    def find_why_traced(self, stated: dict[str, Any] | None, limit: float) -> str:
        """Find the reason, as a clause, why an image must be ray traced, from the ``stated`` entry of ``to_json``;
        empty if baked light is good enough.

        The noise of baked light is fixed to the ground, so it looks like texture. Where much light is indirect, it
        would make matching easier than it is. A ``limit`` of 0 means no limit.
        """
        if not self.lights or stated is None:
            return ""
        if math.isnan(stated["share"]):
            return (
                "the image shows ground without baked light, as of an eye that moves far during the exposure; set "
                "quality.bake_area to GROUND"
            )
        if not 0 < limit < stated["noise"]:
            return ""
        return (
            f"baked light would have noise of {show_rounded(100 * stated['noise'])} % of the light, because "
            f"{show_rounded(100 * stated['share'])} % of it is indirect, which is above quality.bake_noise; raise "
            "quality.bake_samples"
        )


def provide_baked_light(
    built: Built, scene: bpy.types.Scene, planned: PlannedPair, shared: SharedLight
) -> IndirectLight:
    """Put the baked light of a planned pair on the built ground; the data set may have it already.

    Otherwise one process bakes it while others wait. Raises IcyMoonError if it cannot be baked or written.
    """
    settings = planned.settings
    if settings.quality.indirect != "BAKED":
        return IndirectLight()
    if why := find_why_not_baked(settings) or _find_why_unsuitable(built):
        return IndirectLight(why_traced=why)
    lights: dict[str, StoredLight] = {}
    spent, mesh = 0.0, built.terrain.data
    shining = _find_light_groups(built)
    seen = find_visible_facets(built, planned) if settings.quality.bake_area == "VIEW" else None
    unlit = np.zeros(len(mesh.vertices), bool) if seen is None else ~_find_facet_vertices(mesh, seen)
    for group in BAKED_ATTRIBUTES.keys() - shining.keys():
        _write_attribute(mesh, BAKED_ATTRIBUTES[group], np.zeros((len(mesh.vertices), 3), np.float32))
        _write_attribute(mesh, BAKED_ERROR_ATTRIBUTES[group], np.zeros(len(mesh.vertices), np.float32))
        if built.rocks is not None:
            baked_rocks.write_rock_light(
                built.rocks, group, np.zeros((len(built.rocks.data.vertices), TERM_COUNT, 3), np.float32)
            )
    for group, dark in shining.items():
        lights[group], seconds = _find_or_bake(built, scene, settings, shared, group, dark, seen)
        found = lights[group].light
        _write_attribute(mesh, BAKED_ATTRIBUTES[group], np.where(unlit[:, None], np.float32(NOT_BAKED), found.values))
        _write_attribute(mesh, BAKED_ERROR_ATTRIBUTES[group], found.error)
        if built.rocks is not None:
            baked_rocks.write_rock_light(built.rocks, group, found.rocks)
        spent += seconds
    return IndirectLight(lights, spent_s=spent)


def _find_light_groups(built: Built) -> dict[str, list[bpy.types.Object]]:
    """Find the light groups that light the ground, each with the lamps of the other groups."""
    shine = built.planetshine
    if shine is None:
        return {"Sun": []}
    by_day = {"Sun": [shine]} if built.sun.data.energy > 0 else {}
    return {**by_day, "Planet": [built.sun]}


def _find_or_bake(
    built: Built,
    scene: bpy.types.Scene,
    settings: Settings,
    shared: SharedLight,
    group: str,
    dark: list[bpy.types.Object],
    seen: Array | None,
) -> tuple[StoredLight, float]:
    """Find or bake the light of a light group. Return it, and the processor seconds that this call took."""
    rocks = built.rocks
    return shared.get(
        make_bake_key(built, settings, group, seen),
        len(built.terrain.data.vertices),
        len(rocks.data.vertices) if rocks is not None else 0,
        lambda: bake_indirect_light(built.terrain, scene, settings, group, dark, rocks, seen),
    )


def _find_why_unsuitable(built: Built) -> str:
    """Find the reason, as a clause, why the built scene cannot use baked light; empty if it can."""
    if find_added_objects(built.collection):
        return "objects without baked light were added to the scene"
    if built.edited_parts("terrain object", "terrain materials"):
        return "the ground was edited by hand"
    if built.edited_parts("rock object", "rock data", "rock materials"):
        return "rocks were edited by hand"
    polygons = built.terrain.data.polygons
    totals = np.empty(len(polygons), np.int32)
    polygons.foreach_get("loop_total", totals)
    most = baked_texels.MAX_CORNERS
    return f"facets of the ground have more than {most} corners" if totals.max(initial=0) > most else ""


def find_visible_facets(built: Built, planned: PlannedPair) -> Array:
    """Find the facets of the ground that the cameras of a pair may see, as bool (facets,)."""
    mesh, camera = built.terrain.data, built.camera
    with turn_about_eye(camera, planned.turn_deg):
        to_camera = np.array(camera.matrix_world.inverted() @ built.terrain.matrix_world)
    right, up, back = (read_vertices(mesh) @ to_camera[:3, :3].T + to_camera[:3, 3]).T
    starts, _, corners, _ = texel_bakes.read_facets(mesh)
    return find_seen_facets(find_sides_passed(planned.settings.rig, right, -up, -back), starts, corners)


def _find_facet_vertices(mesh: bpy.types.Mesh, facets: Array) -> Array:
    """Find the vertices that are corners of some facets, as bool (vertices,)."""
    _, counts, corners, _ = texel_bakes.read_facets(mesh)
    found = np.zeros(len(mesh.vertices), bool)
    found[corners[np.repeat(facets, counts)]] = True
    return found


def make_bake_key(built: Built, settings: Settings, group: str = "Sun", seen: Array | None = None) -> str:
    """Make the key of baked light: 12 hexadecimal digits of everything that the light depends on. These are ground,
    surface, lights, bounces, seed and samples, the light group, and the facets that are ``seen`` if only some are
    baked.

    The mesh of a graded ground is made for the rig, so there the rig counts too; otherwise heading, rig and sensor do
    not.
    """
    quality = settings.quality
    parts = [
        _BAKE_VERSION,
        compat.find_series(),
        rebuilt_parts.select_scene(settings),
        rebuilt_parts.select_appearance(settings),
        rebuilt_parts.select_light(settings),
        quality.diffuse_bounces,
        quality.bake_samples,
        quality.bake_noise,
        built.extra,
        *_KEY_PARTS_BY_GROUP[group],
    ]
    if seen is not None:
        parts.append(hashlib.sha256(np.packbits(seen).tobytes()).hexdigest())
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]


def _bake_halves(
    run: Callable[[str, int, int], Array],
    seeds: Array,
    quality: QualitySettings,
    positions: Array,
    triangles: Array,
    eye: Array,
) -> tuple[Array, list[Array], int]:
    """Bake the direct light, and two halves of the indirect light with different seeds. Return them, and the number of
    samples of each half.

    ``run`` bakes each: a few samples at first, then as many more as the noise limit requires.
    """
    direct = run("DIRECT", _DIRECT_LIGHT_SAMPLES, int(seeds[4]))
    count = min(_FIRST_HALF_SAMPLES, quality.bake_samples // 2)
    halves = [run("INDIRECT", count, int(seed)) for seed in seeds[:2]]
    share = find_largest_share(direct, (halves[0] + halves[1]) / 2, positions, triangles, eye)
    noise, asked = measure_bake_noise(halves, triangles), quality.bake_noise / _NOISE_MARGIN
    more = count_samples_needed(noise, share, count, asked, quality.bake_samples // 2) - count
    if more > 0:
        halves = [
            (count * half + more * run("INDIRECT", more, int(seed))) / (count + more)
            for half, seed in zip(halves, seeds[2:4], strict=True)
        ]
        count += more
    return direct, halves, count


def bake_indirect_light(
    terrain: bpy.types.Object,
    scene: bpy.types.Scene,
    settings: Settings,
    group: str = "Sun",
    dark: Sequence[bpy.types.Object] = (),
    rocks: bpy.types.Object | None = None,
    seen: Array | None = None,
) -> BakedLight:
    """Bake the indirect light of a ground and its ``rocks`` by a light group, while the lamps of other groups are
    ``dark``; see ``BakedLight``.

    Only vertices of facets that are ``seen`` (facets,) get light; other vertices have 0. Light is baked in two halves
    with different seeds, whose difference is the noise. Each half has few samples at first, then as many more as the
    noise limit requires. Half of the difference has the same variance as the error of their mean, between vertices too.
    Raises IcyMoonError if Cycles cannot bake.
    """
    start = time.process_time()
    quality = settings.quality
    kept = scene.render.use_persistent_data, scene.render.use_multiview
    seeds = seed_stream(int(settings.dataset.seed), "bake", *_KEY_PARTS_BY_GROUP[group]).generate_state(5) >> 1
    mesh = terrain.data
    lit = np.ones(len(mesh.vertices), bool) if seen is None else _find_facet_vertices(mesh, seen)
    triangles = (np.cumsum(lit) - 1)[
        _find_rendered_triangles(mesh, seen)
    ]  # in the order of the vertices that get light
    positions = read_vertices(mesh)
    under = np.argmin((positions[:, :2] ** 2).sum(axis=1))
    eye = np.array([0.0, 0.0, positions[under, 2] + _EYE_HEIGHT_M])
    numbers = _LIGHT_OF_NO_ROCKS
    with _hide_lamps(dark), _open_bake(terrain, scene, settings, lit) as (found, bake_texels):
        covered = _find_covered_texels(bake_texels, int(seeds[4])) if rocks is not None else None

        def run(kind: str, samples: int, seed: int) -> Array:
            texels = bake_texels(kind, samples, seed)
            if covered is None:
                return baked_texels.gather_to_vertices(found, texels, len(mesh.vertices))[lit]
            return baked_texels.gather_uncovered(found, texels, covered, len(mesh.vertices))[lit]

        direct, halves, count = _bake_halves(run, seeds, quality, positions[lit], triangles, eye)
    if rocks is not None and len(rocks.data.vertices):
        with _hide_lamps(dark):
            numbers = _bake_rocks(rocks, terrain, scene, settings, group, min(2 * count, _MAX_ROCK_SAMPLES))
    scene.render.use_persistent_data, scene.render.use_multiview = kept
    values, error = np.zeros((len(lit), 3), np.float32), np.zeros(len(lit), np.float32)
    values[lit] = np.maximum((halves[0] + halves[1]) / 2, 0.0)
    error[lit] = (halves[0] - halves[1]).mean(axis=1) / 2
    mean, straight = (float(each.mean(dtype=np.float64)) if lit.any() else 0.0 for each in (values[lit], direct))
    share = mean / (mean + straight) if mean + straight > 0 else 0.0
    return BakedLight(
        values, error, numbers, measure_bake_noise(halves, triangles), share, 2 * count, time.process_time() - start
    )


@contextmanager
def _hide_lamps(lamps: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Switch lamps off, until the end of the ``with`` block."""
    before = [lamp.hide_render for lamp in lamps]
    for lamp in lamps:
        lamp.hide_render = True
    try:
        yield
    finally:
        for lamp, hidden in zip(lamps, before, strict=True):
            lamp.hide_render = hidden


def _find_covered_texels(bake_texels: Callable[[str, int, int], Array], seed: int) -> Array:
    """Find the texels of the ground inside rocks, where no ray escapes, as bool (n,)."""
    return bake_texels("AO", _OPEN_SKY_SAMPLES, seed)[:, :3].max(axis=1) <= 0


def _bake_rocks(
    rocks: bpy.types.Object,
    terrain: bpy.types.Object,
    scene: bpy.types.Scene,
    settings: Settings,
    group: str,
    samples: int,
) -> Array:
    """Bake the terms (rocks, terms, 3) of the indirect light on rocks, see ``physics.light.baked_rocks``."""
    random = make_generator(int(settings.dataset.seed), "bake", 2, *_KEY_PARTS_BY_GROUP[group])
    points = baked_rocks.draw_points(rocks, random)
    used = baked_rocks.are_above_ground(points, terrain)
    seeds = random.integers(0, 2**31 - 1, 2)
    every = np.ones(3 * len(points.rock), bool)
    with (
        baked_rocks.add_point_object(points, scene) as item,
        _open_bake(item, scene, settings, every) as (found, bake_texels),
    ):
        used &= ~_find_covered_texels(bake_texels, int(seeds[0]))[found.texels[0]].all(axis=1)
        light = bake_texels("INDIRECT", samples, int(seeds[1]))[found.texels[0], :3].mean(axis=1)
    return fit_terms(points, light, used, len(rocks.data.vertices)).astype(np.float32)


@contextmanager
def _open_bake(
    item: bpy.types.Object, scene: bpy.types.Scene, settings: Settings, lit: Array
) -> Iterator[tuple[baked_texels.Texels, Callable[[str, int, int], Array]]]:
    """Yield the texels of an object around the vertices that are to be ``lit``, and a function that bakes to them while
    the object has no fine relief. The function takes kind, samples and seed, and returns light over pi (n, 4)."""
    mesh = item.data
    found = texel_bakes.lay_out_mesh_texels(mesh, lit)
    with ExitStack() as undo:
        image = texel_bakes.add_target_image(mesh, found, undo)
        for material in mesh.materials:
            _remove_relief_from_normals(material.node_tree, undo)
            texel_bakes.direct_bake_to_image(material.node_tree, image, undo)

        def run(kind: str, samples: int, seed: int) -> Array:
            quality = settings.quality | {"samples": samples, "denoiser": "NONE", "noise_threshold": 0.0}
            cycles_settings.apply_quality(scene, quality, seed)
            scene.render.use_persistent_data = scene.render.use_multiview = False
            _run_bake(scene, item, kind)
            return texel_bakes.read_texels(image)

        yield found, run


def _find_rendered_triangles(mesh: bpy.types.Mesh, seen: Array | None) -> Array:
    """Find the vertices (n, 3) of the triangles into which Cycles divides a mesh, or its facets that are ``seen``."""
    loops, facets = read_triangles(mesh)
    return read_corners(mesh)[loops if seen is None else loops[seen[facets]]]


def _remove_relief_from_normals(tree: bpy.types.NodeTree, undo: ExitStack) -> None:
    """Remove the fine relief from the shading normals of a surface's node tree; ``undo`` restores the tree."""
    for node in tree.nodes:
        for link in list(node.inputs["Normal"].links) if node.bl_idname == "ShaderNodeBsdfDiffuse" else ():
            undo.callback(tree.links.new, link.from_socket, node.inputs["Normal"])
            tree.links.remove(link)


def _run_bake(scene: bpy.types.Scene, item: bpy.types.Object, kind: str) -> None:
    what: dict[str, Any] = {"type": "AO"} if kind == "AO" else {"type": "DIFFUSE", "pass_filter": {kind}}
    if why := texel_bakes.run_bake(scene, item, **what):
        raise IcyMoonError(f"Cycles could not bake the light of the ground{why}; set quality.indirect to TRACED.")


def _write_attribute(mesh: bpy.types.Mesh, name: str, values: Array) -> None:
    """Give the vertices of a mesh an attribute: vectors (n, 3) or numbers (n,). Equal values stay untouched, since a
    change makes Cycles build its tree again.
    """
    there = mesh.attributes.get(name)
    if there is None and not values.any():
        return
    kind, key = ("FLOAT_VECTOR", "vector") if values.ndim > 1 else ("FLOAT", "value")
    if there is None:
        there = mesh.attributes.new(name, kind, "POINT")
    now = np.empty(values.size, np.float32)
    there.data.foreach_get(key, now)
    if not np.array_equal(now.reshape(values.shape), values):
        there.data.foreach_set(key, np.ascontiguousarray(values).reshape(-1))
        mesh.update()
