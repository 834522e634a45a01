"""Contacts of the arm with the meshed ground, with itself and with the lander."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...physics.arm.collisions import Heights, find_self_collisions, ground_clearances_m, place_capsules
from ...physics.arm.lander_arm import joint_values, make_arm
from ...physics.arm.lander_solids import make_body_capsules
from ...physics.mesh.heights_on_mesh import MeshGround
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.number_text import show_rounded

#: Margin in metres around the arm. Only triangles of the ground within it are tested.
_MARGIN_M = 0.05


@dataclass(frozen=True)
class Contact:
    """Minimum height in metres of each link above the ground, negative inside the ground, and pairs of links that
    overlap."""

    clearances_m: dict[str, float]
    collisions: list[tuple[str, str]]

    @property
    def reached_ground(self) -> bool:
        """Whether any link is at or in the ground."""
        return any(height <= 0 for height in self.clearances_m.values())

    def advice(self) -> list[str]:
        """Return sentences on links other than the scoop that are inside the ground, and on links that overlap."""
        deep = {link: -height for link, height in self.clearances_m.items() if height < 0 and link != "scoop"}
        said = [
            f"The arm's {link.replace('_', ' ')} is {show_rounded(depth)} m inside the ground; raise "
            "arm.shoulder_deg or change other joints."
            for link, depth in deep.items()
        ]
        return said + [
            f"The arm's {one.replace('_', ' ')} is in the {other.replace('_', ' ')}; change the joints of "
            "the topic arm."
            for one, other in self.collisions
        ]


def find_contact(settings: Settings, site_m: float, terrain: bpy.types.Object) -> Contact:
    """Find the contacts of the arm of complete settings. On the ground, the arm meets the triangles of the mesh."""
    arm, joints = make_arm(settings, site_m), joint_values(settings)
    ends = np.array([end for line in place_capsules(arm, joints) for end in (line.start, line.end)])
    heights = _make_heights_near(terrain, ends.min(axis=0)[:2] - _MARGIN_M, ends.max(axis=0)[:2] + _MARGIN_M)
    return Contact(
        ground_clearances_m(arm, joints, heights), find_self_collisions(arm, joints, make_body_capsules(settings))
    )


def _make_heights_near(terrain: bpy.types.Object, low: Array, high: Array) -> Heights:
    """Make a function for the heights of the highest triangle of the ground at points between two corners (2,); NaN
    outside the ground."""
    mesh = terrain.data
    mesh.calc_loop_triangles()
    places, corners = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.vertices.foreach_get("co", places)
    mesh.loop_triangles.foreach_get("vertices", corners)
    world = np.array(terrain.matrix_world)
    points = places.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]
    triangles = corners.reshape(-1, 3)
    inside = ((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)
    if not inside.any():  # triangles wider than the arm
        inside[:] = True
    near = points[triangles[inside[triangles].any(axis=1)]]
    return MeshGround(near.reshape(-1, 3), np.arange(3 * len(near)).reshape(-1, 3)).heights
