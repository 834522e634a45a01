"""The depth errors of a matcher, painted on the ground itself, as colours of its vertices.

The ground's mesh gets attributes that no render reads and that are no part of its marks. Rocks are instances of a few
shapes, so the rocks that the left eye sees are shown as slightly larger copies, in a separate collection that is not
rendered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ..physics.camera.blur import describe_blur_identity
from ..physics.mesh.halve_edges import halve_edges
from ..render.pairs.pair_folder import Pair
from ..render.plans.planned_pair import expand_headings
from ..settings import rebuilt_parts
from ..settings.description import merged
from ..settings.pair_ids import make_pair_id
from ..stereo.ground_errors import (
    COARSE,
    MAX_EDGE_PX,
    UNSEEN,
    DepthErrors,
    VertexErrors,
    choose_better_result,
    colour_errors,
    count_pixels,
    project_points,
    sample_vertex_errors,
)
from ..stereo.images.colours import SKY_GREY
from ..support.arrays import Array
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from ..support.steps import Steps
from .built_scene import Built
from .datablocks.array_marks import PAINTED
from .datablocks.fingerprint import TAG, find_added_objects, find_instanced_objects
from .datablocks.mesh_arrays import get_memory, read_property
from .ground.terrain_mesh import build_mesh_from_arrays
from .measured_surface import (
    KINDS,
    build_material,
    fill_colours,
    make_share_lines,
    set_colours,
    to_linear_colours,
)
from .shown_objects import begin_collection, find_collections, remove_shown

NAME = "Icy Moon Depth Errors"
_COPIES_NAME = f"{NAME} on Rocks"
ROLE = "painted errors"  # value of the custom property ``TAG`` of collection, object and material
#: Attributes of vertices: the signed error in metres (NaN if unknown), the kind of the error by ``ground_errors``, and
#: the colour.
ERROR_M, KIND, COLOUR = f"{PAINTED}_m", f"{PAINTED}_kind", f"{PAINTED}_colour"
_COUNTS_PROPERTY, _COLOURS_BEFORE_PROPERTY = (
    "icymoon_pixels",
    "icymoon_colours_before",
)  # custom properties of the collection
#: Scale of the copies of rocks, and the share of the distance by which they are nearer to the eye. So they hide the
#: rocks at any precision of the view's depths.
_COPY_SCALE, _COPY_SHIFT_SHARE = 1.01, 0.005
_AT_ONCE = 1_000_000  # vertices of rocks
#: Vertices of an object of copies, unless a single rock has more. Blender makes such a mesh in about 30 ms.
_MAX_COPIED = 150_000
_MAX_DIVISIONS = 4  # of triangles of rocks
_GROUND_AND_CAMERA = ("terrain object", "terrain data", "rock object", "rock data", "camera")
_KINDS = {
    **KINDS,
    "missing": ("Not measured, grey", "COLORSET_13_VEC"),
    "coarse": ("Triangles too wide to paint", "ERROR"),
}


def why_not_shown(built: Built, headings: int, pair: Pair) -> Steps[str]:
    """Find, in steps, a sentence on why a pair shows the built scene from none of the ``headings`` directions; empty if
    it shows the scene.

    Only the ground and the camera matter: light, surfaces and sampling may differ. Raises IcyMoonError if edits by hand
    cannot be detected.
    """
    now, then = built.settings, pair.settings
    if names := _list_differing(rebuilt_parts.select_geometry(now), rebuilt_parts.select_geometry(then)):
        return (
            f"The evaluated pair {pair.id} has another ground than the one that is built: {_describe_differing(names)}."
        )
    if then.source.kind != "PROCEDURAL" and built.content != pair.data.get("own_files_sha256", ""):
        return f"The file of the ground has changed since the evaluated pair {pair.id} was rendered."
    views = (planned.settings for planned in expand_headings(merged(now, {"dataset": {"headings": headings}})))
    cameras = [_list_differing(rebuilt_parts.select_camera(view), rebuilt_parts.select_camera(then)) for view in views]
    if all(cameras):
        differing = _describe_differing(cameras[0])
        return f"The evaluated pair {pair.id} has another camera than the one that is built: {differing}."
    if not (yield from _has_same_edits(built, pair)):
        return f"The ground or the camera has other edits by hand than those of the evaluated pair {pair.id}."
    return ""


def _list_differing(one: Mapping[str, Mapping[str, Any]], other: Mapping[str, Mapping[str, Any]]) -> list[str]:
    return [f"{topic}.{key}" for topic in one for key in one[topic] if one[topic][key] != other.get(topic, {}).get(key)]


def _describe_differing(names: Sequence[str]) -> str:
    more = f" and {format_count(len(names) - 1, 'more setting')} differ" if len(names) > 1 else " differs"
    return f"{names[0]}{more}"


def _has_same_edits(built: Built, pair: Pair) -> Steps[bool]:
    """Whether ground and camera have the same edits by hand as when a pair was rendered."""
    if pair.data.get("edited_by_hand"):  # the id identifies all edits
        extra = yield from built.find_extra()
        return make_pair_id(pair.settings, extra + describe_blur_identity(pair.settings)) == pair.id
    if find_added_objects(built.collection):
        return False
    return not (yield from built.find_edited_parts(*_GROUND_AND_CAMERA))


@dataclass(frozen=True)
class MeshesToPaint:
    """Mesh arrays of the ground and rocks of a built scene. They hold no Blender data, so any thread can find their
    errors."""

    to_world: Array  # (4, 4), from the ground's coordinates to the world's
    position: Array  # (n, 3) float32, of the ground's vertices in its coordinates, m
    edges: Array  # (k, 2)
    rocks: list[tuple[Array, Array, Array]]  # of each shape: matrices (m, 4, 4), vertices and triangles


@dataclass(frozen=True)
class Copies:
    """Copies of rocks for an object: positions (n, 3), triangles (m, 3), and errors and colours of the vertices."""

    position: Array
    triangles: Array
    errors: VertexErrors
    colours: Array


@dataclass(frozen=True)
class FoundErrors:
    """The errors of pairs on the ground of a scene and on ``copies`` of its rocks, and the number of pixels with each
    kind of error. ``colours`` are from ``to_linear_colours``; errors of ``full_m`` metres and more have the full
    colour.
    """

    ground: VertexErrors
    colours: Array
    copies: list[Copies]
    counts: dict[str, int]
    full_m: float


def read_meshes(built: Built) -> Steps[MeshesToPaint]:
    """Read the meshes of a built scene in steps."""
    mesh, matrix = built.terrain.data, np.array(built.terrain.matrix_world, np.float64)
    memory = yield from get_memory(3 * len(mesh.vertices), np.float32)
    position = read_vertex_positions(mesh, memory)
    yield None
    memory = yield from get_memory(2 * len(mesh.edges), np.int32)
    edges = read_property(mesh.attributes[".edge_verts"].data, "value", np.int32, 2, memory).reshape(-1, 2)
    yield None
    rocks, instances = [], _find_rock_instances(built)
    for shape, matrices in instances.items():
        yield None
        shape.data.calc_loop_triangles()
        triangles = read_property(shape.data.loop_triangles, "vertices", np.int32, 3).reshape(-1, 3)
        rocks.append((matrices, read_vertex_positions(shape.data).astype(np.float64), triangles))
    return MeshesToPaint(matrix, position, edges, rocks)


def find_errors(
    meshes: MeshesToPaint,
    found: Sequence[DepthErrors],
    full_m: float,
    report: Callable[[float, str], object] = lambda fraction, text: None,
) -> FoundErrors:
    """The errors of pairs on the meshes of their scene; any thread may call this. A vertex that several pairs see shows
    the error of the nearest pair. Errors of ``full_m`` metres and more get the full colour. ``report`` gets the
    finished share of the vertices, 0 to 1, and a text on the present work. Raises IcyMoonError if no vertex shows an
    error."""
    places = [np.empty((0, 2))] * len(found)
    counts = [len(meshes.position), *(len(matrices) * len(corners) for matrices, corners, _ in meshes.rocks)]
    shares = np.cumsum([1, *counts]) / (1 + sum(counts))  # above 0 from the first one on
    report(float(shares[0]), "Errors of the ground")
    ground = _find_vertex_errors(found, to_world(meshes.to_world, meshes.position), meshes.edges, places)
    seen: list[tuple[Array, Array, VertexErrors]] = []
    for shape, share in zip(meshes.rocks, shares[1:], strict=False):
        report(float(share), "Errors of the rocks")
        seen += _find_seen_rocks([shape], found, places)
    report(float(shares[-1]), "Colouring")
    if not sum(map(len, places)):
        raise IcyMoonError(
            "No vertex of the ground shows an error: its triangles are too wide, or it is not the "
            "ground of the pair; press Build Scene, or raise terrain.resolution."
        )
    pixels = [count_pixels(errors, at) for errors, at in zip(found, places, strict=True)]
    total = {key: sum(count[key] for count in pixels) for key in pixels[0]}
    return _colour_all(FoundErrors(ground, np.empty((0, 4)), _join_copies(seen), total, full_m), full_m)


def _colour_all(errors: FoundErrors, full_m: float) -> FoundErrors:
    """The same errors with colours for another range; any thread may call this."""
    copies = [replace(each, colours=_colour(each.errors, full_m)) for each in errors.copies]
    return replace(errors, full_m=full_m, colours=_colour(errors.ground, full_m), copies=copies)


def _colour(shown: VertexErrors, full_m: float) -> Array:
    return _colour_values(np.asarray(shown.error_m, np.float32), shown.kind.astype(np.int8), full_m)


def _colour_values(error_m: Array, kind: Array, full_m: float) -> Array:
    """Linear colours (n, 4) of errors in metres and their kinds, float32 and int8; any thread may call this."""
    return to_linear_colours(colour_errors(error_m, kind, full_m))


def show_errors(
    find_build: Callable[[], Built], errors: FoundErrors, title: str, find_full_m: Callable[[], float]
) -> Steps[bpy.types.Collection]:
    """Paint errors in steps on the ground and rocks of a built scene, in place of anything painted before. Errors of
    ``find_full_m`` metres and more have the full colour.

    The last step alone changes the scene, which it finds by ``find_build``. Raises IcyMoonError, before any change, if
    the errors were found on another ground.
    """
    while (full_m := find_full_m()) != errors.full_m:  # the user has changed it meanwhile
        errors = yield partial(_colour_all, errors, full_m)
    copies = list[bpy.types.Object]()
    try:
        for each in errors.copies:
            copies.append(_build_copies(each))
            yield None
            refuse_other_ground(find_build(), errors.ground.error_m, *copies)
            _fill_attributes(copies[-1].data, each.errors, each.colours)
            yield None
        built = find_build()
        refuse_other_ground(built, errors.ground.error_m, *copies)
    except BaseException:
        remove_unlinked(*copies)
        raise
    return _show_in_scene(built, errors, title, copies)


def _show_in_scene(
    built: Built, errors: FoundErrors, title: str, copies: Iterable[bpy.types.Object]
) -> bpy.types.Collection:
    """Give the meshes of a built scene the colours of errors, and link the copies of rocks."""
    mesh = built.terrain.data
    collection = begin_painting(built.scene, mesh, NAME)
    collection[_COUNTS_PROPERTY] = errors.counts | {"title": title}
    _fill_attributes(mesh, errors.ground, errors.colours)
    for shape in find_rock_meshes(built):  # dark, as if unseen; the copies hide them where an eye sees them
        n = len(shape.vertices)
        unseen = VertexErrors(np.full(n, np.nan, np.float32), np.full(n, UNSEEN, np.uint8), np.full(n, np.inf))
        _fill_attributes(shape, unseen, _colour(unseen, errors.full_m))
    for item in copies:
        item.name, item.data.name = _COPIES_NAME, NAME  # which earlier ones had until now
        collection.objects.link(item)
    darken_meshes(find_other_meshes(built))
    return collection


def find_other_meshes(built: Built) -> set[bpy.types.Mesh]:
    """The meshes of a built scene that are neither ground nor rocks, such as the lander."""
    return {
        item.data
        for item in built.collection.all_objects
        if item.type == "MESH" and item.data != built.terrain.data and item.get(TAG) != "rock" and not item.data.library
    }


def darken_meshes(meshes: Iterable[bpy.types.Mesh]) -> None:
    """Show meshes dark. Meshes without vertex colours are white in Blender 5.2 and grey in earlier ones, and legends
    give both colours a meaning."""
    for mesh in meshes:
        set_colours(add_colours(mesh), np.full((len(mesh.vertices), 3), SKY_GREY, np.uint8))


def begin_painting(scene: bpy.types.Scene, mesh: bpy.types.Mesh, name: str) -> bpy.types.Collection:
    """A new collection that is not rendered, for colours painted on a mesh. It replaces anything painted before."""
    clear_painted(scene)
    collection = begin_collection(scene, name, ROLE)
    collection[_COLOURS_BEFORE_PROPERTY] = [
        mesh.attributes.active_color_name or "",
        mesh.attributes.default_color_name or "",
    ]
    return collection


def recolour_errors(find_scene: Callable[[], bpy.types.Scene], full_m: float) -> Steps[None]:
    """Colour the errors that a scene shows again, in steps: errors of ``full_m`` metres and more get the full colour.

    ``find_scene`` finds the scene anew after each pause, for undo moves it in memory and the user may remove the
    errors.
    """
    for uid in [mesh.session_uid for mesh in _find_meshes_with_errors(find_scene())]:
        mesh = _find_mesh_with_errors(find_scene(), uid)
        if mesh is None:
            continue
        error_m = read_property(mesh.attributes[ERROR_M].data, "value")
        kind = read_property(mesh.attributes[KIND].data, "value", np.int8)
        colours = yield partial(_colour_values, error_m, kind, full_m)
        mesh = _find_mesh_with_errors(find_scene(), uid)
        if mesh is not None and len(mesh.vertices) == len(colours):
            fill_colours(mesh.attributes[COLOUR], colours)
            mesh.update_tag()
            yield None


def _find_meshes_with_errors(scene: bpy.types.Scene) -> list[bpy.types.Mesh]:
    """The meshes of a scene that show errors; decisions have colours of their own."""
    return [mesh for mesh in _find_painted_meshes(scene) if ERROR_M in mesh.attributes]


def _find_mesh_with_errors(scene: bpy.types.Scene, uid: int) -> bpy.types.Mesh | None:
    """The mesh with this ``session_uid`` among them; None if it is gone."""
    return next((mesh for mesh in _find_meshes_with_errors(scene) if mesh.session_uid == uid), None)


def find_painted(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection of painted errors or decisions in a scene; None if nothing is painted."""
    return next(iter(find_collections(scene, ROLE)), None)


def clear_painted(scene: bpy.types.Scene) -> bool:
    """Remove all paint of a scene, including decisions, and return whether there was any."""
    painted = find_painted(scene)
    before: Sequence[str] | None = painted.get(_COLOURS_BEFORE_PROPERTY) if painted else None
    for mesh in _find_painted_meshes(scene):
        for name in (ERROR_M, KIND, COLOUR):
            if name in mesh.attributes:
                mesh.attributes.remove(mesh.attributes[name])
        for name, key in zip(before or (), ("active_color_name", "default_color_name"), strict=False):
            if name in mesh.color_attributes:
                setattr(mesh.attributes, key, name)
    return remove_shown(scene, ROLE)


def find_title(scene: bpy.types.Scene) -> str:
    """The matcher whose errors are painted, in words; empty without painted errors."""
    collection = find_painted(scene)
    stored: Any = collection.get(_COUNTS_PROPERTY) if collection else None
    return str(stored.get("title", "")) if hasattr(stored, "items") else ""


def make_legend(scene: bpy.types.Scene) -> tuple[tuple[str, str], ...]:
    """The meaning of the colours, with the share of the pixels of each: (text, icon) of each line."""
    collection = find_painted(scene)
    stored: Any = collection.get(_COUNTS_PROPERTY) if collection else None
    counts = (
        {key: number for key, number in stored.items() if isinstance(number, int)} if hasattr(stored, "items") else {}
    )
    true = sum(counts.get(key, 0) for key in ("far", "near", "right", "missing"))
    if not true:
        return ()
    counts = {key: number for key, number in counts.items() if key != "coarse" or number}
    return (
        *make_share_lines(f"Depth error of {stored.get('title')} on the ground", counts, _KINDS, true),
        ("The lander and what the left eye does not see, dark", "BLANK1"),
    )


def _find_painted_meshes(scene: bpy.types.Scene) -> set[bpy.types.Mesh]:
    rocks = [shape for item in scene.objects if item.get(TAG) == "rock" for shape in find_instanced_objects(item)]
    return {item.data for item in (*scene.objects, *rocks) if item.type == "MESH" and COLOUR in item.data.attributes}


def read_vertex_positions(mesh: bpy.types.Mesh, memory: Array | None = None) -> Array:
    """Positions (n, 3) of a mesh's vertices in its coordinates, float32, see ``read_property``."""
    # mesh.vertices has the same, but takes 20 times as long.
    return read_property(mesh.attributes["position"].data, "vector", width=3, memory=memory).reshape(-1, 3)


def to_world(matrix: ArrayLike, position: Array) -> Array:
    """Positions (n, 3) in the world, float64."""
    whole = np.array(matrix, np.float64)
    return np.asarray(position.astype(np.float64) @ whole[:3, :3].T + whole[:3, 3])


def _find_vertex_errors(
    found: Sequence[DepthErrors], position: Array, edges: Array, places: list[Array]
) -> VertexErrors:
    """Find the errors at vertices, over all pairs. Each pair's image positions of vertices are added to ``places``."""
    shown: VertexErrors | None = None
    for k, errors in enumerate(found):
        one = sample_vertex_errors(errors, position, edges)
        places[k] = np.concatenate([places[k], project_points(errors, position[one.kind < COARSE])[0]])
        shown = one if shown is None else choose_better_result(shown, one)
    assert shown is not None
    return shown


def _find_rock_instances(built: Built) -> dict[bpy.types.Object, Array]:
    """The matrices (n, 4, 4) of the instances of each shape of rocks."""
    fields = {item for item in built.collection.all_objects if item.get(TAG) == "rock"}
    if not fields:
        return {}
    instances, numbers = bpy.context.evaluated_depsgraph_get().object_instances, dict[bpy.types.Object, list[int]]()
    for k, each in enumerate(instances):
        if each.is_instance and each.parent.original in fields:
            numbers.setdefault(each.object.original, []).append(k)
    # To read the matrix of each instance apart takes three times as long. Blender keeps matrices by columns.
    matrices = read_property(instances, "matrix_world", width=16).reshape(-1, 4, 4).transpose(0, 2, 1)
    return {shape: matrices[found].astype(np.float64) for shape, found in numbers.items() if shape.type == "MESH"}


def find_rock_meshes(built: Built) -> set[bpy.types.Mesh]:
    """The meshes of which the rocks are instances."""
    fields = [item for item in built.collection.all_objects if item.get(TAG) == "rock"]
    return {shape.data for item in fields for shape in find_instanced_objects(item) if shape.type == "MESH"}


def _join_copies(rocks: Iterable[tuple[Array, Array, VertexErrors]]) -> list[Copies]:
    """Join copies, given by their positions, triangles and errors, to a few objects, without colours yet."""
    groups, vertices = list[list[tuple[Array, Array, VertexErrors]]](), 0
    for each in rocks:
        vertices += len(each[0])
        if not groups or vertices > _MAX_COPIED:
            groups.append([])
            vertices = len(each[0])
        groups[-1].append(each)
    return [_join_group(group) for group in groups]


def _join_group(rocks: Sequence[tuple[Array, Array, VertexErrors]]) -> Copies:
    starts = np.cumsum([0, *(len(position) for position, _, _ in rocks)])
    names = ("error_m", "kind", "depth_m")
    return Copies(
        np.concatenate([position for position, _, _ in rocks]),
        np.concatenate([faces + start for (_, faces, _), start in zip(rocks, starts, strict=False)]),
        VertexErrors(*(np.concatenate([getattr(shown, name) for _, _, shown in rocks]) for name in names)),
        np.empty((0, 4)),
    )


def _find_seen_rocks(
    shapes: Sequence[tuple[Array, Array, Array]], found: Sequence[DepthErrors], places: list[Array]
) -> Iterator[tuple[Array, Array, VertexErrors]]:
    """Positions, triangles and vertex errors of the rocks with a vertex that an eye sees. Triangles too wide to show an
    error are divided.
    """
    for matrices, *whole in shapes:
        divisions = _count_divisions(found, matrices, *whole)
        for times in np.unique(divisions):
            corners, faces = whole
            for _ in range(times):
                corners, faces = halve_edges(corners, faces)
            yield from _find_seen_copies(found, matrices[divisions == times], corners, faces, places)


def _count_divisions(found: Sequence[DepthErrors], matrices: Array, corners: Array, faces: Array) -> Array:
    """Count how often the triangles of each instance must be divided to be narrow in the images."""
    longest = np.zeros(len(matrices))
    step = max(1, _AT_ONCE // max(1, len(corners)))
    for errors in found:
        for k in range(0, len(matrices), step):
            place = project_points(errors, _place_instances(matrices[k : k + step], corners))[0].reshape(
                -1, len(corners), 2
            )
            sides = np.linalg.norm(place[:, faces] - place[:, np.roll(faces, 1, axis=1)], axis=-1)
            inside = ((place >= 0) & (place < errors.truth.shape[::-1])).all(axis=-1).any(axis=1)
            longest[k : k + step] = np.maximum(
                longest[k : k + step], np.where(inside, np.nan_to_num(sides).max(axis=(1, 2), initial=0.0), 0.0)
            )
    needed = np.ceil(np.log2(np.maximum(longest / MAX_EDGE_PX, 1.0)))
    return np.asarray(np.minimum(needed, _MAX_DIVISIONS).astype(np.intp))


def _find_seen_copies(
    found: Sequence[DepthErrors], matrices: Array, corners: Array, faces: Array, places: list[Array]
) -> Iterator[tuple[Array, Array, VertexErrors]]:
    edges, n = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), len(corners)
    step = max(1, _AT_ONCE // max(1, n))
    for some in (matrices[k : k + step] for k in range(0, len(matrices), step)):
        shown = _find_vertex_errors(
            found, _place_instances(some, corners), _repeat_indices(edges, len(some), n), places
        )
        seen = np.flatnonzero((shown.kind.reshape(-1, n) <= COARSE).any(axis=1))
        most = max(1, _MAX_COPIED // max(1, n))
        for rocks in (seen[k : k + most] for k in range(0, len(seen), most)):
            larger = _place_instances(some[rocks], corners * _COPY_SCALE)
            yield (
                larger + _COPY_SHIFT_SHARE * (found[0].pose[:3, 3] - larger),
                _repeat_indices(faces, len(rocks), n),
                VertexErrors(
                    *(values.reshape(-1, n)[rocks].ravel() for values in (shown.error_m, shown.kind, shown.depth_m))
                ),
            )


def _place_instances(matrices: Array, corners: Array) -> Array:
    moved = np.einsum("mij,nj->mni", matrices[:, :3, :3], corners) + matrices[:, None, :3, 3]
    return moved.reshape(-1, 3)


def _repeat_indices(indices: Array, times: int, vertices: int) -> Array:
    """Edges or faces of a mesh, for ``times`` copies of its vertices."""
    return (indices[None] + (np.arange(times) * vertices)[:, None, None]).reshape(-1, indices.shape[1])


def _build_copies(copies: Copies) -> bpy.types.Object:
    """The object of copies of rocks, in no collection and without colours."""
    mesh = build_mesh_from_arrays(NAME, copies.position, copies.triangles)
    material = build_material(COLOUR)
    mesh.materials.append(material)
    item = bpy.data.objects.new(_COPIES_NAME, mesh)
    material[TAG] = item[TAG] = ROLE
    item.hide_render = True
    # Hide the copies from Cycles in a 3D View, where their unlit colours would be black beside sunlit ice and hide the
    # rocks.
    compat.hide_from_rays(item)
    return item


def refuse_other_ground(built: Built, of_vertices: Array, *items: bpy.types.Object | None) -> None:
    """Raise IcyMoonError if ``of_vertices`` (n, …) has another number of vertices than the built ground, or if some of
    the ``items`` that were made for it are gone."""
    if len(built.terrain.data.vertices) != len(of_vertices):
        raise IcyMoonError("The ground changed while its errors were computed; paint them again.")
    try:
        kept = all(block.name for item in items if item for block in (item, item.data, *item.data.materials))
    except ReferenceError:  # undo, or Purge Unused Data
        kept = False
    if not kept:
        raise IcyMoonError("A part of the painting was removed while it was made; paint it again.")


def remove_unlinked(*items: bpy.types.Object | None) -> None:
    """Remove objects that are in no collection, with their meshes and materials, unless undo has removed them."""
    for item in items:
        with suppress(ReferenceError):
            if item is not None:
                bpy.data.batch_remove([*item.data.materials, item.data, item])


def _fill_attributes(mesh: bpy.types.Mesh, shown: VertexErrors, colours: Array) -> None:
    """Add the attributes to a mesh, and show the colours of ``to_linear_colours``. The attribute that renders use as
    the mesh's colours stays.
    """
    mesh.attributes.new(ERROR_M, "FLOAT", "POINT").data.foreach_set("value", shown.error_m)
    mesh.attributes.new(KIND, "INT8", "POINT").data.foreach_set("value", shown.kind.astype(np.int8))
    fill_colours(add_colours(mesh), colours)
    mesh.update_tag()


def add_colours(mesh: bpy.types.Mesh) -> bpy.types.Attribute:
    """Add the colours of vertices to a mesh, and show them."""
    rendered = mesh.attributes.default_color_name or ""
    mesh.color_attributes.new(COLOUR, "FLOAT_COLOR", "POINT")
    mesh.attributes.active_color_name, mesh.attributes.default_color_name = COLOUR, rendered
    return mesh.attributes[COLOUR]
