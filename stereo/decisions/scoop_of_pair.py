"""The scoop of a pair's arm: its pixels, and its true, commanded and measured positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...physics.arm.kinematics import forward_kinematics
from ...physics.arm.lander_solids import make_arm_solids
from ...physics.arm.parametric_arm import JOINTS, find_real_angles_rad, make_parametric_arm, read_commanded_rad
from ...render.pairs.pair_folder import Pair
from ...support.arrays import Array
from ..images.exr import NORMAL_PASSES, read_truth
from .dem import back_project_depth
from .scoop_pose import find_pose, measure_pose_error, sample_surface

SCOOP_LINK = "scoop"
_MODEL_POINT_COUNT = 6000


@dataclass(frozen=True)
class Scoop:
    """The scoop of a pair. The poses ``true`` and ``commanded`` (4, 4) transform from the link to the site."""

    mask: Array  # boolean (H, W) of the left image
    true: Array
    commanded: Array
    model: Array  # points and normals (n, 6) of its surface
    middle: Array  # (3,), in the link's frame


def find_scoop(pair: Pair, pose: Array, random: np.random.Generator) -> Scoop | None:
    """Return the scoop of a pair whose left eye has this ``pose`` (4, 4).

    None without a shipped arm, or without labels of instances.
    """
    links = {link["name"]: link for link in pair.data.get("lander", {}).get("links", ())}
    if SCOOP_LINK not in links or pair.settings.lander.kind != "PARAMETRIC":
        return None
    instance = read_truth(pair.truth("left"), "left", NORMAL_PASSES).instance
    if instance is None:
        return None
    site_m = float(pose[2, 3]) - pair.settings.rig.height_m
    arm, joints = make_parametric_arm(pair.settings, site_m), read_commanded_rad(pair.settings.arm)
    solid = make_arm_solids(pair.settings.arm)[SCOOP_LINK]
    middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
    return Scoop(
        pair.camera.cropped(instance) == links[SCOOP_LINK]["instance"],
        pose @ np.array(links[SCOOP_LINK]["link_to_left"], np.float64),
        forward_kinematics(arm, joints)[-1],
        sample_surface(solid.vertices, solid.triangles, _MODEL_POINT_COUNT, random),
        middle,
    )


def read_stated_joints(pair: Pair) -> dict[str, dict[str, float]] | None:
    """Read the ``commanded`` angles, degrees, of the joints of a pair's arm, and the ``fault`` of each.

    None without a shipped arm.
    """
    if not pair.data.get("lander") or pair.settings.lander.kind != "PARAMETRIC":
        return None
    told = read_commanded_rad(pair.settings.arm)
    return {
        name: dict(zip(JOINTS, np.round(np.degrees(angles), 6).tolist(), strict=True))
        for name, angles in (("commanded", told), ("fault", find_real_angles_rad(pair.settings.arm) - told))
    }


def locate_scoop(scoop: Scoop, depth_m: Array, pair: Pair, pose: Array, random: np.random.Generator) -> dict[str, Any]:
    """Locate the scoop in a planar depth (H, W), m, of a left eye with this ``pose`` (4, 4).

    ``error_mm`` is the distance of its middle from the true middle, ``error_deg`` its angle from the true pose, and
    ``apart_mm`` the distance of the commanded pose from the true one. ``found_mm`` (3,) is the found middle relative to
    the commanded one: east, north, up. ``pixels`` is the scoop's number of pixels, and ``known`` the share of them with
    a depth. Values are None if no pose is found.
    """
    apart, _ = measure_pose_error(scoop.true, scoop.commanded, scoop.middle)
    points, _ = back_project_depth(np.where(scoop.mask, depth_m, np.nan), pair.camera.rectified, pose)
    pixels = int(scoop.mask.sum())
    found = find_pose(scoop.model, points, scoop.commanded, pose[:3, 3], random)
    numbers: dict[str, Any] = {
        "apart_mm": apart,
        "pixels": pixels,
        "known": len(points) / pixels if pixels else None,
        "error_mm": None,
        "error_deg": None,
        "found_mm": None,
    }
    if found is None:
        return numbers
    error_mm, error_deg = measure_pose_error(found, scoop.true, scoop.middle)
    shift = (found - scoop.commanded)[:3] @ np.append(scoop.middle, 1.0)
    return numbers | {"error_mm": error_mm, "error_deg": error_deg, "found_mm": (1000 * shift).tolist()}
