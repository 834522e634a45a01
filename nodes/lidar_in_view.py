"""Shows a LiDAR in the 3D View: its beams before a scan, and its points after one.

Points are small squares, like the squares of the measured surface, with a node group that shows only the first of them.
Beams are thin rods to the built surfaces, because bare lines are hidden with the overlays of a camera view. Both are in
a collection that is not rendered and not part of the built scene.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..formats.lidar_file import LidarFile
from ..physics.lidar.instrument import SensorPose, mount_on_rig
from ..stereo.lidar_view import (
    ICE_DELAY,
    INTENSITY,
    RANGE_ERROR,
    RETURN_NUMBER,
    ShownPoints,
    colour_points,
    describe_colours,
    list_values,
)
from ..support.arrays import Array
from ..support.number_text import format_count
from . import measured_surface, painted_errors
from .built_scene import Built
from .datablocks.fingerprint import TAG
from .datablocks.mesh_arrays import read_property
from .ground.terrain_mesh import build_mesh_from_arrays
from .measured_surface import build_material, make_squares, set_colours
from .rig import find_eye_poses
from .shown_objects import link_shown, list_shown, remove_shown
from .tree.builder import Tree

NAME = "Icy Moon LiDAR"
ROLE = "lidar"  # value of the custom property ``TAG`` of collection, objects, material and node group
POINTS, BEAMS = "LiDAR Points", "LiDAR Beams"
#: Attributes of the squares, by the value that they hold, and the attribute of the colour of their corners.
ATTRIBUTES = {
    INTENSITY: ("intensity", "FLOAT"),
    RANGE_ERROR: ("range_error_m", "FLOAT"),
    ICE_DELAY: ("ice_delay_m", "FLOAT"),
    RETURN_NUMBER: ("return_number", "INT"),
}
_COLOUR = "lidar_colour"
_TITLE_PROPERTY, _TOTAL_PROPERTY = "icymoon_scanner", "icymoon_points"
#: Lines of the legend on beams and ranges, of points and of beams.
_LINES_PROPERTY = "icymoon_lidar_lines"
#: Width of a square as seen from the sensor, in radians, and radius of a rod at its end divided by its length.
_WIDTH_RAD, _ROD_RADIUS = 0.006, 0.003
#: Maximum number of rows and columns of beams that are drawn, and the length of beams in metres if all miss.
_MAX_ROWS, _MAX_COLUMNS, _MISSED_M = 9, 25, 10.0
#: Colours (sRGB) of beams that hit and that miss.
_HIT, _MISSED = (90, 255, 120), (110, 110, 110)
_LIMIT = "Points Shown"
#: Objects that are shown over the ground and stop no beam.
_SHOWN_ROLES = (ROLE, measured_surface.ROLE, painted_errors.ROLE)
_MAX_SKIPS, _SKIP_M = 16, 1e-4


def show_points(scene: bpy.types.Scene, points: ShownPoints, kind: str, count: int) -> bpy.types.Object:
    """Show the first ``count`` points of a scan, and remove earlier points. ``kind``, one of ``ATTRIBUTES``, sets their
    colour."""
    clear_scan(scene)
    toward = points.position_m - points.point_m
    distance = np.linalg.norm(toward, axis=1)
    toward = np.where(distance[:, None] > 0, toward / np.maximum(distance, 1e-12)[:, None], [[0.0, 0.0, 1.0]])
    mesh = measured_surface.build_squares(NAME, make_squares(points.point_m, toward, _WIDTH_RAD * distance))
    for value, array in list_values(points).items():
        name, data_type = ATTRIBUTES[value]
        dtype = np.int32 if data_type == "INT" else np.float32
        mesh.attributes.new(name, data_type, "FACE").data.foreach_set("value", array.astype(dtype))
    mesh.color_attributes.active_color = mesh.color_attributes.new(_COLOUR, "BYTE_COLOR", "POINT")
    item = bpy.data.objects.new(POINTS, mesh)
    item[_TITLE_PROPERTY], item[_TOTAL_PROPERTY] = points.title, points.total
    item[_LINES_PROPERTY] = "\n".join(
        (f"{points.returned} of {format_count(points.beams, 'beam')} returned", describe_ranges(points.range_m))
    )
    item.modifiers.new(_LIMIT, "NODES").node_group = _build_limit()
    _link(scene, item)
    recolour(scene, kind)
    limit_points(scene, count)
    return item


def _build_limit() -> bpy.types.NodeTree:
    """Build a node group that removes all faces from a given number on."""
    group = bpy.data.node_groups.new(_LIMIT, "GeometryNodeTree")
    group[TAG] = ROLE
    _, result = (
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry").identifier
        for direction in ("INPUT", "OUTPUT")
    )
    tree = Tree(group)
    squares = tree.node("NodeGroupInput", "Squares")
    index = tree.node("GeometryNodeInputIndex", "Index")
    # Blender 5.2 has renamed the inputs of Compare; Math has the same names everywhere.
    beyond = tree.math("GREATER_THAN", _LIMIT, index.outputs[0], 0.0)
    kept = tree.node(
        "GeometryNodeDeleteGeometry",
        "Remove Others",
        {"Geometry": squares.outputs[0], "Selection": beyond},
        domain="FACE",
        mode="ALL",
    )
    tree.node("NodeGroupOutput", "Geometry", {result: kept.outputs[0], "__extend__": None})
    tree.arrange()
    return group


def limit_points(scene: bpy.types.Scene, count: int) -> None:
    """Show only the first ``count`` points, if any are shown."""
    item = find_points(scene)
    modifier = item.modifiers.get(_LIMIT) if item is not None else None
    node = modifier.node_group.nodes.get(_LIMIT) if modifier is not None and modifier.node_group else None
    if node is not None:
        next(socket for socket in node.inputs if socket.identifier == "Value_001").default_value = count - 0.5


def recolour(scene: bpy.types.Scene, kind: str) -> None:
    """Colour the points that are shown, if any, by a ``kind`` of ``ATTRIBUTES``."""
    item = find_points(scene)
    if item is not None and (values := _read_values(item.data)) and _COLOUR in item.data.color_attributes:
        set_colours(item.data.color_attributes[_COLOUR], np.repeat(colour_points(kind, values), 4, axis=0))
        item.data.update_tag()


def _read_values(mesh: bpy.types.Mesh) -> dict[str, Array]:
    """Read the values (k,) of points; empty if the user has removed some of the attributes."""
    if not all(name in mesh.attributes for name, _ in ATTRIBUTES.values()):
        return {}
    return {
        value: read_property(mesh.attributes[name].data, "value", np.int32 if kind == "INT" else np.float32)
        for value, (name, kind) in ATTRIBUTES.items()
    }


def make_legend(scene: bpy.types.Scene, kind: str) -> tuple[tuple[str, str], ...]:
    """Make the lines (text, icon) of the legend: the scanner, its beams and ranges, then the meaning of the colours,
    for points by their ``kind``."""
    item = find_shown(scene)
    if item is None:
        return ()
    told = (str(item.get(_TITLE_PROPERTY, "")), *str(item.get(_LINES_PROPERTY, "")).splitlines())
    lines = tuple((text, "NONE") for text in told if text)
    if item != find_points(scene):
        return *lines, ("Green: meets the ground", "COLORSET_03_VEC"), ("Grey: meets nothing", "COLORSET_13_VEC")
    if not (values := _read_values(item.data)):
        return ()
    kept, total = len(values[INTENSITY]), item.get(_TOTAL_PROPERTY)
    drawn = f"{kept} of {total} points can be shown" if isinstance(total, int) and total > kept else f"{kept} points"
    return (*lines, (drawn, "NONE"), *describe_colours(kind, values))


def describe_ranges(range_m: Array) -> str:
    """Describe the nearest and the farthest of some ranges (k,) in metres."""
    found = range_m[np.isfinite(range_m)]
    return f"Range: {found.min():.3g} to {found.max():.3g} m" if len(found) else "No range was measured"


def show_beams(scene: bpy.types.Scene, built: Built, lidar: LidarFile) -> bpy.types.Object:
    """Draw some of the beams of a scanner at the left eye of a built scene, in place of earlier points and beams. A
    beam that hits nothing is grey and twice as long as the median of the beams that hit."""
    clear_scan(scene)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    pose = find_sensor_pose(built, lidar)
    pattern = lidar.instrument.pattern
    beams = pattern.make_chosen(pattern.choose_spread(_MAX_ROWS, _MAX_COLUMNS))
    direction = beams.direction @ pose.rotation.T
    farthest = min(lidar.instrument.farthest_m, 1e5)
    length = np.array([_find_hit(scene, depsgraph, pose.position_m, each, farthest) for each in direction])
    hit = np.isfinite(length)
    told = f"{hit.sum()} of {format_count(len(hit), 'beam')} meet the ground", describe_ranges(length)
    typical = float(np.median(length[hit])) if hit.any() else _MISSED_M
    length = np.where(hit, length, min(2 * typical, farthest))
    corners, faces = make_rods(pose.position_m, direction, length, _ROD_RADIUS * typical / 3, _ROD_RADIUS * length)
    mesh = build_mesh_from_arrays(NAME, corners, faces)
    mesh.color_attributes.active_color = mesh.color_attributes.new(_COLOUR, "BYTE_COLOR", "POINT")
    colours = np.where(hit[:, None], np.array(_HIT, np.uint8), np.array(_MISSED, np.uint8))
    set_colours(mesh.color_attributes[_COLOUR], np.repeat(colours, len(corners) // len(hit), axis=0))
    item = bpy.data.objects.new(BEAMS, mesh)
    item[_TITLE_PROPERTY], item[_LINES_PROPERTY] = lidar.title, "\n".join(told)
    _link(scene, item)
    return item


def find_sensor_pose(built: Built, lidar: LidarFile) -> SensorPose:
    """Find the pose that a scan gives the sensor: at the left eye, see ``mount_on_rig``."""
    eyes = find_eye_poses(built.camera.matrix_world, built.camera.data.stereo.interocular_distance)
    return mount_on_rig(eyes["left"], lidar.aim)


def _find_hit(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, start: Array, direction: Array, farthest_m: float
) -> float:
    """Find the distance in metres at which a beam hits something; infinite if it hits nothing."""
    passed = 0.0
    for _ in range(_MAX_SKIPS):
        found, place, _, _, item, _ = scene.ray_cast(
            depsgraph, (start + direction * passed).tolist(), direction.tolist(), distance=farthest_m - passed
        )
        if not found:
            return np.inf
        along = float(np.dot(np.array(place) - start, direction))
        if item.get(TAG) not in _SHOWN_ROLES:
            return along
        passed = along + _SKIP_M
    return np.inf


def make_rods(start: Array, direction: Array, length: Array, near_m: float, far_m: Array) -> tuple[Array, Array]:
    """Make three-sided rods from a common ``start`` (3,) along unit vectors (n, 3), closed at their ends. Returns
    corners (6 n, 3) and triangles (7 n, 3). The rods' radii in metres are ``near_m`` at the start and ``far_m`` (n,) at
    the ends. Seen from the start, far beams then look as wide as near beams.
    """
    up = np.where(np.abs(direction[:, 2:]) < 0.99, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
    right = np.cross(direction, up)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    other = np.cross(right, direction)
    end = start + direction * length[:, None]
    angle = 2 * np.pi * np.arange(3) / 3
    ring = np.cos(angle)[:, None] * right[:, None] + np.sin(angle)[:, None] * other[:, None]
    corners = np.concatenate([start + near_m * ring, end[:, None] + far_m[:, None, None] * ring], axis=1)
    sides = [(a, b, b + 3) for a, b in ((0, 1), (1, 2), (2, 0))] + [
        (a, b + 3, a + 3) for a, b in ((0, 1), (1, 2), (2, 0))
    ]
    faces = 6 * np.arange(len(end))[:, None, None] + np.array([*sides, (3, 4, 5)])
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


def _link(scene: bpy.types.Scene, item: bpy.types.Object) -> None:
    """Put an object into a collection that is not rendered."""
    material = build_material(_COLOUR)
    material.name, material[TAG] = NAME, ROLE
    item.data.materials.append(material)
    link_shown(scene, item, NAME, ROLE)


def find_points(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Find the points that are shown in a scene; None if none are shown."""
    return next((item for item in list_shown(scene, ROLE) if item.modifiers.get(_LIMIT) is not None), None)


def find_shown(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Find the points or beams that are shown in a scene; None if none are shown."""
    return next(iter(list_shown(scene, ROLE)), None)


def clear_scan(scene: bpy.types.Scene) -> bool:
    """Remove points and beams of a scene, and return whether there were any. The user's own objects stay."""
    return remove_shown(scene, ROLE)
