"""Makes the entry "lander" of ``pair.json``: poses of its links in both eyes, joints, contact, keypoints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..nodes.built_scene import Built
from ..nodes.datablocks.fingerprint import find_built_objects
from ..nodes.lander.contact import find_contact
from ..nodes.lander.objects import INSTANCES, ROLES, find_link_poses, list_link_keys, read_pad_heights_m
from ..physics.arm.keypoints import describe_keypoints
from ..physics.arm.lander_arm import describe_joints
from ..physics.arm.lander_solids import BODY, HEAD
from ..physics.camera.stereo_camera import StereoCamera
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from .cycles_occlusion import read_depth
from .pairs.pair_folder import EYES, TRUTH_FILE

#: Metres, or sines of angles, by which an object may differ from its pose by the settings before it counts as moved by
#: hand. Blender stores single precision.
_POSE_TOLERANCE = 2e-5


def make_lander_json(built: Built, settings: Settings, poses: Mapping[str, Array], folder: Path) -> dict[str, Any]:
    """Make the entry "lander" of ``pair.json``; empty without a lander.

    ``poses`` are the camera-to-world matrices of the rectified eyes in OpenCV's axes. ``folder`` has the pair's images.
    Lengths are in metres.
    """
    objects = {role: item for role, item in find_built_objects(built.collection).items() if role in ROLES.values()}
    if settings.lander.kind == "NONE" or not objects:
        return {}
    links = _find_real_poses(objects, settings, built.site_m)
    keys = list_link_keys(settings)
    links.pop(HEAD, None)  # the cameras are in the head
    camera, contact = StereoCamera.from_settings(settings.rig), find_contact(settings, built.site_m, built.terrain)
    pads_m = read_pad_heights_m(objects[ROLES[BODY]])
    matrix = np.array([[camera.focal_px, 0.0, camera.cx_px], [0.0, camera.focal_px, camera.cy_px], [0.0, 0.0, 1.0]])
    seen = EYES if settings.rig.images == "PAIR" else ()
    depths = {eye: _crop_margins(read_depth(_find_truth_file(folder, eye).read_bytes()), camera) for eye in seen}
    keypoints = describe_keypoints(settings, pads_m, links, poses, matrix, depths) if seen else []
    return {
        "lander": {
            "links": [
                {
                    "name": link,
                    "instance": INSTANCES[keys[link]],
                    **{f"link_to_{eye}": (np.linalg.inv(poses[eye]) @ pose).tolist() for eye in EYES},
                }
                for link, pose in links.items()
            ],
            **describe_joints(settings),
            "pads_m": pads_m,
            "reached_ground": contact.reached_ground,
            "collisions": [list(pair) for pair in contact.collisions],
            "clearance_m": {
                link: (None if np.isnan(height) else height) for link, height in contact.clearances_m.items()
            },
            "keypoints": keypoints,
        }
    }


def _crop_margins(values: Array, camera: StereoCamera) -> Array:
    """Crop an image that was rendered with margins to the size of the final images."""
    x, y = camera.margin_x_px, camera.margin_y_px
    return values[y : y + camera.height_px, x : x + camera.width_px]


def _find_truth_file(folder: Path, eye: str) -> Path:
    apart = folder / TRUTH_FILE.format(eye)
    return apart if apart.exists() else folder / f"{eye}.exr"


def _find_real_poses(objects: Mapping[str, Any], settings: Settings, site_m: float) -> dict[str, Array]:
    """Find the poses of the links: in double precision from the settings, or from Blender where the user has moved the
    object."""
    found, keys = {}, list_link_keys(settings)
    for link, pose in find_link_poses(settings, site_m).items():
        if (role := ROLES[keys[link]]) in objects:
            there = np.array(objects[role].matrix_world)
            found[link] = pose if np.abs(there - pose).max() < _POSE_TOLERANCE else there
    return found
