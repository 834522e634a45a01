"""Renders the cameras beside a pair, in the scene of the pair."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import bpy

from ..nodes.build_scene import Built
from ..nodes.head_cameras import find_head_poses, read_head_cameras
from ..physics.camera.head_camera import HeadCamera, camera_json, is_plain
from ..rays.camera_truth import trace_camera
from ..rays.stereo_truth import Stage
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors
from ..support.labels import BEAUTY, TRUTH
from .pairs.head_files import image_file, truth_file
from .ray_truth import encode_camera_truth
from .render_camera import set_up_head_camera

#: The files of a head by name in the pair, then by layer, and the entries of its cameras in ``pair.json``.
RenderedHead = tuple[dict[str, dict[str, Path]], list[dict[str, Any]]]


def render_head(
    part: Path,
    built: Built,
    scene: bpy.types.Scene,
    stage: Stage | None,
    settings: Settings,
    rounded: Collection[str],
    render_radiance: Callable[[Path], dict[str, Path]],
) -> RenderedHead:
    """Render the cameras of ``rig.head_file`` at their poses in the ``built`` scene.

    ``render_radiance`` lets Cycles render the view for which ``scene`` is set up, into a file at a stem. ``stage`` is
    for the truth, whose passes ``rounded`` are stored as 16-bit floats; None for settings without a head. Raises
    IcyMoonError if a camera is missing.
    """
    if stage is None:
        return {}, []
    cameras, poses = read_head_cameras(settings), find_head_poses(built.collection, built.camera)
    if len(cameras) != len(poses):
        raise IcyMoonError(
            f"{settings.rig.head_file} has {len(cameras)} cameras, and the scene has {len(poses)} of them; build the "
            "scene again."
        )
    clip_m = built.camera.data.clip_start, built.camera.data.clip_end
    files: dict[str, dict[str, Path]] = {}
    for k, (camera, pose) in enumerate(zip(cameras, poses, strict=True)):
        with set_up_head_camera(scene, camera.rendered, pose):
            (image,) = render_radiance(part / f"{BEAUTY}-head{k}").values()
        truth = part / f"{TRUTH}-head{k}.exr"
        traced = trace_camera(stage, camera.projection, pose, *clip_m)
        with explain_disk_errors("write", truth):
            truth.write_bytes(encode_camera_truth(traced, settings.quality.truth, rounded))
        files.setdefault(image_file(camera.name), {})[BEAUTY] = image
        files.setdefault(_find_truth_file(camera), {})[TRUTH] = truth
    entries = [
        camera_json(camera, pose, image_file(camera.name), _find_truth_file(camera))
        for camera, pose in zip(cameras, poses, strict=True)
    ]
    return files, entries


def _find_truth_file(camera: HeadCamera) -> str:
    """Find the name of the file with the truth: the image's file, or a separate file if the image's projection makes
    Cycles render it on other pixels."""
    return image_file(camera.name) if is_plain(camera.projection) else truth_file(camera.name)
