"""The surface that a matcher measured: each point is a small square in the colour of its error.

It consists of squares because every Blender shows the colours of a mesh in every shading of the viewport, but not
the colours of a point cloud. The squares are drawn in front of everything. Otherwise the true ground would hide all
points that are too far.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path

import bpy
import numpy as np

from ..formats import ply
from ..stereo.images.colours import ERROR_SCALE, colour_signed_errors
from ..support.arrays import Array
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from ..support.srgb import from_srgb
from ..support.steps import Steps
from .datablocks.fingerprint import TAG
from .datablocks.mesh_arrays import read_property
from .shown_objects import link_shown, list_shown, remove_shown
from .tree.builder import Tree

NAME = "Icy Moon Measured Surface"
ROLE = "measured surface"  # value of the custom property ``TAG`` of objects, collection and material
_COLOUR_ATTRIBUTE, _ERROR_ATTRIBUTE = "error", "error_m"  # attributes: the colour of a vertex, the error of a square
_COUNTS_PROPERTY = "icymoon_points"  # custom property, see ``_count_kinds``
_TITLE_PROPERTY = "icymoon_matcher"  # custom property: the matcher in words
#: Maximum depth error in metres that counts as right, and the text and icon of each kind of pixel.
RIGHT_M = ERROR_SCALE.low
KINDS = {
    "far": ("Too far, red", "COLORSET_01_VEC"),
    "near": ("Too near, blue", "COLORSET_04_VEC"),
    "right": (f"Within {100 * RIGHT_M:g} cm, white", "BLANK1"),
}
_SQUARE_CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])


def read_points(path: Path) -> tuple[Array, Array, Array, Array]:
    """Read a file of points that the evaluator wrote. Raises IcyMoonError if it is missing or damaged.

    Returns positions (n, 3) in metres, unit vectors to the camera (n, 3), widths (n,) in metres, and depth errors (n,)
    in metres, which are NaN without a true depth.
    """
    try:
        table = ply.read_properties(path, "x", "y", "z", "nx", "ny", "nz", "size_m", "error_m")
    except (OSError, ValueError):
        table = None
    if table is None or not np.isfinite(table[:, :7]).all():
        raise IcyMoonError(f"{path} is missing or damaged; press Evaluate again.")
    return table[:, :3], table[:, 3:6], table[:, 6], table[:, 7]


def make_squares(position: Array, toward: Array, width: Array) -> Array:
    """Make squares of ``width`` (n,) that face the camera: corners (n, 4, 3), counter-clockwise as seen from it."""
    # Two axes across the line of sight. For a nearly vertical line, they start from y in place of z.
    up = np.where(np.abs(toward[:, 2:]) < 0.99, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
    right = np.cross(up, toward)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axes = np.stack([right, np.cross(toward, right)], axis=1)
    return np.asarray(position[:, None] + np.einsum("ck,nkx->ncx", _SQUARE_CORNERS, axes) * width[:, None, None])


def build_points(
    scene: bpy.types.Scene, paths: Iterable[Path], title: str, full_m: float = ERROR_SCALE.high
) -> bpy.types.Object:
    """Show the points of the files as one object in a separate collection, which replaces an earlier object.

    Errors of ``full_m`` metres and more have the full colour. The object is drawn in front of others and never
    rendered. It is no part of the built scene. Raises IcyMoonError before any change if a file cannot be used or all
    files are empty.
    """
    paths = list(paths)
    position, toward, width, error = (np.concatenate(parts) for parts in zip(*map(read_points, paths), strict=True))
    if not len(position):
        raise IcyMoonError(f"{title} measured nothing here; choose another matcher.")
    clear_points(scene)
    mesh = _build_mesh(make_squares(position, toward, width), error)
    mesh.materials.append(build_material(_COLOUR_ATTRIBUTE))
    fill_colours(mesh.attributes[_COLOUR_ATTRIBUTE], _colour_corners(error.astype(np.float32), full_m))
    item = bpy.data.objects.new(f"{NAME}: {title}", mesh)
    item[_TITLE_PROPERTY] = title
    item[_COUNTS_PROPERTY] = _count_kinds(error, [ply.read_comment_number(path, "missing") for path in paths])
    link_shown(scene, item, NAME, ROLE)
    return item


def _count_kinds(error_m: Array, missing: list[int | None]) -> dict[str, int]:
    """Count the points by the kind of their error. Files of older versions do not contain the number of ``missing``."""
    counts = {
        "far": int((error_m > RIGHT_M).sum()),
        "near": int((error_m < -RIGHT_M).sum()),
        "right": int((np.abs(error_m) <= RIGHT_M).sum()),
        "unknown": int(np.isnan(error_m).sum()),
    }
    return counts if None in missing else counts | {"missing": sum(count or 0 for count in missing)}


def find_title(scene: bpy.types.Scene) -> str:
    """The matcher whose surface is shown, in words; empty without a surface, or for one of an older version."""
    item = find_points(scene)
    return str(item.get(_TITLE_PROPERTY, "")) if item is not None else ""


def make_legend(scene: bpy.types.Scene) -> tuple[tuple[str, str], ...]:
    """Make the lines (text, icon) of the legend of the shown surface: the meaning of each colour, and its share of the
    points."""
    item = find_points(scene)
    stored: object = item.get(_COUNTS_PROPERTY) if item else None
    counts = (
        {key: number for key, number in stored.items() if isinstance(number, int)} if hasattr(stored, "items") else {}
    )
    true = sum(counts.get(key, 0) for key in ("far", "near", "right", "missing"))
    if not true:
        return ()
    lines = make_share_lines(
        "Depth error of the surface shown", counts, {**KINDS, "missing": ("Missing, no point", "BLANK1")}, true
    )
    if counts.get("unknown"):
        lines.append((f"No true depth, grey: {format_count(counts['unknown'], 'point')}", "BLANK1"))
    return tuple(lines)


def make_share_lines(
    title: str, counts: Mapping[str, int], kinds: Mapping[str, tuple[str, str]], total: int
) -> list[tuple[str, str]]:
    """Make the lines (text, icon) of a legend: its title, then the share of each of the ``kinds`` in ``total``."""
    return [
        (title, "NONE"),
        *((f"{text}: {100 * counts[key] / total:.1f} %", icon) for key, (text, icon) in kinds.items() if key in counts),
    ]


def build_squares(name: str, corners: Array) -> bpy.types.Mesh:
    """Build a mesh of squares with corners (n, 4, 3)."""
    count = len(corners)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(4 * count)
    mesh.vertices.foreach_set("co", corners.astype(np.float32).ravel())
    mesh.loops.add(4 * count)
    mesh.loops.foreach_set("vertex_index", np.arange(4 * count, dtype=np.int32))
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 4 * count, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    return mesh


def _build_mesh(corners: Array, error_m: Array) -> bpy.types.Mesh:
    mesh = build_squares(NAME, corners)
    mesh.attributes.new(_ERROR_ATTRIBUTE, "FLOAT", "FACE").data.foreach_set("value", error_m.astype(np.float32))
    mesh.color_attributes.active_color = mesh.color_attributes.new(_COLOUR_ATTRIBUTE, "FLOAT_COLOR", "POINT")
    mesh.update(calc_edges=True)
    mesh.validate()
    return mesh


def _colour_corners(error_m: Array, full_m: float) -> Array:
    """Return the linear colours (4 n, 4) of the corners of squares with errors (n,) in metres; any thread may call
    this."""
    return to_linear_colours(np.repeat(colour_signed_errors(error_m, full_m), 4, axis=0))


def set_colours(attribute: bpy.types.Attribute, rgb: Array) -> None:
    """Fill a colour attribute of bytes or floats with sRGB uint8 (n, 3)."""
    if attribute.data_type == "FLOAT_COLOR":
        fill_colours(attribute, to_linear_colours(rgb))
        return
    rgba = np.ones((len(rgb), 4), np.float32)
    rgba[:, :3] = rgb / np.float32(255)
    attribute.data.foreach_set("color_srgb", rgba.ravel())


def to_linear_colours(rgb: Array) -> Array:
    """Convert sRGB uint8 (n, 3) to opaque linear colours (n, 4), float32; any thread may call this."""
    rgba = np.ones((len(rgb), 4), np.float32)
    rgba[:, :3] = from_srgb(np.arange(256) / 255).astype(np.float32)[rgb]
    return rgba


def fill_colours(attribute: bpy.types.Attribute, rgba: Array) -> None:
    """Fill a colour attribute of floats with linear colours (n, 4), float32. Blender copies them; it would convert
    colours of bytes one by one, in 50 ms for a million."""
    attribute.data.foreach_set("color", rgba.ravel())


def recolour_points(find_scene: Callable[[], bpy.types.Scene], full_m: float) -> Steps[None]:
    """Colour the shown surface again in steps, if there is one: errors of ``full_m`` metres and more get the full
    colour. ``find_scene`` finds the scene anew after a pause."""
    mesh = _find_mesh_with_errors(find_scene())
    if mesh is None:
        return
    error_m = read_property(mesh.attributes[_ERROR_ATTRIBUTE].data, "value")
    colours = yield partial(_colour_corners, error_m, full_m)
    mesh = _find_mesh_with_errors(find_scene())
    if mesh is not None and len(mesh.vertices) == len(colours):
        fill_colours(mesh.attributes[_COLOUR_ATTRIBUTE], colours)
        mesh.update_tag()
        yield None


def _find_mesh_with_errors(scene: bpy.types.Scene) -> bpy.types.Mesh | None:
    """Find the mesh of the measured surface; None without one, or if an older file has no errors of it."""
    item = find_points(scene)
    if item is None or not {_ERROR_ATTRIBUTE, _COLOUR_ATTRIBUTE} <= set(item.data.attributes.keys()):
        return None
    mesh: bpy.types.Mesh = item.data
    return mesh


def build_material(colour_attribute: str) -> bpy.types.Material:
    """Build a material that shows a colour attribute independent of the light."""
    material = bpy.data.materials.new(NAME)
    material[TAG] = ROLE
    tree = Tree(compat.ensure_nodes(material))
    colour = tree.node("ShaderNodeVertexColor", "Error", layer_name=colour_attribute)
    tree.surface(tree.emission("Unlit", colour.outputs["Color"], 1.0), "Output")
    tree.arrange()
    return material


def find_points(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Find the measured surface that is shown in this scene; None without one."""
    return next(iter(list_shown(scene, ROLE)), None)


def clear_points(scene: bpy.types.Scene) -> bool:
    """Remove everything that ``build_points`` made in this scene, and return whether there was anything."""
    return remove_shown(scene, ROLE)
