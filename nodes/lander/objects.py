"""The lander's objects, one with a separate label for each link, and their poses from the settings."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ...physics.arm.kinematics import forward_kinematics, make_rigid_transform
from ...physics.arm.lander_arm import joint_values, make_arm, make_solids
from ...physics.arm.lander_solids import BODY, HEAD, LEGS, MAST, find_pad_centres, make_head
from ...physics.arm.parametric_arm import JOINTS, lander_pose
from ...physics.arm.solids import Solid
from ...physics.arm.urdf import MAX_LINKS
from ...physics.light.directions import camera_axes
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.labels import FIRST_LINK_INSTANCE
from ..datablocks.fingerprint import NAME, TAG
from ..ground.heights_under import probe_heights
from ..ground.terrain_mesh import build_mesh_from_arrays
from .materials import build_materials

#: Property of the body: heights in metres of the ground under the pads, relative to the ground under the left camera.
PADS = "icymoon_pads_m"
#: Colour of links in a view of vertex colours. Links have none, so they are grey, which stands for no value of the
#: ground.
_VIEW_COLOUR = (0.2, 0.2, 0.2, 1.0)
_LANDER_LINKS = (BODY, *JOINTS.values(), HEAD, MAST, *LEGS)
#: Links of the user's own arm have roles by number.
_OWN_LINKS = tuple(f"own {k:02d}" for k in range(MAX_LINKS))
#: Role of the object of each link, and label of its instance.
ROLES = {link: f"lander {link}" for link in (*_LANDER_LINKS, *_OWN_LINKS)}
INSTANCES = {link: FIRST_LINK_INSTANCE + k for k, link in enumerate(ROLES)}


def list_link_keys(settings: Settings) -> dict[str, str]:
    """Return the key in ``ROLES`` and ``INSTANCES`` of each link of these settings, by the link's name."""
    moving = [link for link in make_arm(settings).links if link not in _LANDER_LINKS]
    return {**{link: link for link in _LANDER_LINKS}, **dict(zip(moving, _OWN_LINKS, strict=False))}


def _find_pads_m(settings: Settings, site_m: float, terrain: bpy.types.Object) -> list[float]:
    """Find the heights in metres above ``site_m`` of the ground's mesh under the left and the right pad; 0 outside the
    ground."""
    place = lander_pose(settings, 0.0)
    spots = np.array([place @ [x, y, 0.0, 1.0] for x, y in find_pad_centres(settings.lander)])
    with probe_heights(terrain) as height_at:
        found = np.asarray(height_at(spots[:, 0], spots[:, 1]), float) - site_m
    return [float(each) for each in np.nan_to_num(found, nan=0.0)]


def build_lander(settings: Settings, site_m: float, terrain: bpy.types.Object) -> list[bpy.types.Object]:
    """Build the lander's objects at the poses of the settings, with its pads on the ground. The caller links them."""
    pads_m = _find_pads_m(settings, site_m, terrain)
    materials = build_materials(settings.lander.frost_share)
    solids = {**make_solids(settings, pads_m), HEAD: make_head(settings)}
    keys = list_link_keys(settings)
    made = [_build_link(link, keys[link], solid, materials) for link, solid in solids.items()]
    bpy.data.batch_remove([each for each in materials.values() if each.users == 0])
    made[0][PADS] = pads_m
    place_lander({item[TAG]: item for item in made}, settings, site_m)
    return made


def _build_link(link: str, key: str, solid: Solid, materials: dict[str, bpy.types.Material]) -> bpy.types.Object:
    title = f"{NAME} Lander {link.replace('_', ' ').title()}"
    mesh = build_mesh_from_arrays(title, solid.vertices.astype(np.float32), solid.triangles.astype(np.int32))
    used = list(dict.fromkeys(solid.materials))
    for name in used:
        mesh.materials.append(materials[name])
    mesh.polygons.foreach_set("material_index", np.array([used.index(name) for name in solid.materials], np.int32))
    mesh.polygons.foreach_set("use_smooth", solid.smooth)
    item = bpy.data.objects.new(title, mesh)
    item[TAG], item.pass_index, item.color = ROLES[key], INSTANCES[key], _VIEW_COLOUR
    return item


def find_link_poses(settings: Settings, site_m: float) -> dict[str, Array]:
    """Find the pose (4, 4) in the world of each link's frame, in double precision."""
    arm, rig = make_arm(settings, site_m), settings.rig
    axes = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)
    head = make_rigid_transform(axes, (rig.x_m, rig.y_m, site_m + rig.height_m))
    still = lander_pose(settings, site_m)
    return {
        **dict.fromkeys((BODY, MAST, *LEGS), still),
        **dict(zip(arm.links, forward_kinematics(arm, joint_values(settings)), strict=True)),
        HEAD: head,
    }


def place_lander(objects: dict[str, bpy.types.Object], settings: Settings, site_m: float) -> None:
    """Move the objects, by role, to the poses of the settings."""
    keys = list_link_keys(settings)
    for link, place in find_link_poses(settings, site_m).items():
        if (role := ROLES[keys[link]]) in objects:  # a link of the user's arm may have no geometry
            objects[role].matrix_world = Matrix(place.tolist())


def read_pad_heights_m(body: bpy.types.Object) -> list[float]:
    """Read the heights in metres of the ground under the pads, for which the legs were made.

    They are relative to the ground under the left camera.
    """
    return [float(each) for each in body[PADS]]
