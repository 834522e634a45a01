"""Finds the exact passes of a pair by tracing rays, and writes them to files like Cycles' files."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from ..formats.exr_parts import assemble
from ..formats.exr_pixels import encode_part
from ..physics.camera.stereo_camera import StereoCamera
from ..rays.camera_truth import CameraTruth
from ..rays.stereo_truth import AnyEye, CalibratedEye, Eye, EyeTruth, Stage, trace_eyes
from ..support.arrays import Array
from ..support.files import explain_disk_errors
from ..support.labels import (
    DISTANCE,
    FIRST_ROCK_INSTANCE,
    HIDDEN,
    INSTANCE_AOV,
    LOOSE,
    NORMAL_AOV,
    SKY_DEPTH_M,
    TRUTH,
)
from .pairs.pair_folder import EYES

#: A file of truth: its stem, and its pixels: of the parallel eyes, of the eyes turned in, or of the sensors of
#: calibrated eyes.
TruthRequest = tuple[Path, Literal["PARALLEL", "TOED", "SENSORS"]]


def trace_truth(
    stage: Stage,
    asked: TruthRequest,
    camera: StereoCamera,
    poses: Mapping[str, Array],
    clip_m: tuple[float, float],
    wanted: str,
    rounded: Collection[str],
) -> dict[str, Path]:
    """Trace the passes that ``wanted`` names, as in ``quality.truth``, write them to the files ``asked``, and return
    the files by eye. The passes ``rounded`` are stored as 16-bit floats. Blender is not called, so it may render
    meanwhile.

    ``poses`` are the camera-to-world matrices of the parallel eyes: (4, 4), or, with a rolling shutter, (rows, 4, 4)
    for each rendered row. Surfaces outside the depths ``clip_m`` have no truth.
    """
    stem, kind = asked
    make = _make_calibrated_eye if kind == "SENSORS" else partial(make_rendered_eye, kind == "TOED")
    eyes = {eye: make(camera, eye, poses[eye]) for eye in EYES}
    files = {eye: stem.with_name(f"{stem.name}-{eye}.exr") for eye in EYES}
    for eye, truth in trace_eyes(stage, eyes, camera.baseline_m, *clip_m).items():
        with explain_disk_errors("write", files[eye]):
            files[eye].write_bytes(encode_truth(truth, wanted, rounded))
    return files


def make_rendered_eye(toed: bool, camera: StereoCamera, eye: str, pose: Array) -> Eye:
    """Make the eye whose pixels are rendered for an eye of a rig, margins included; ``pose`` is as in
    ``trace_truth``."""
    columns, rows = camera.rendered_px
    return Eye(
        columns,
        rows,
        camera.focal_px,
        camera.cx_px + camera.margin_x_px,
        camera.cy_px + camera.margin_y_px,
        pose[..., :3, :3] @ (camera.eye_rotation(eye).T if toed else np.eye(3)),
        pose[..., :3, 3],
    )


def _make_calibrated_eye(camera: StereoCamera, eye: str, pose: Array) -> AnyEye:
    own = camera.own_eye(eye)
    assert own is not None
    return CalibratedEye(own, camera.focal_px, pose[:3, :3], pose[:3, 3])


@contextmanager
def trace_in_background(
    stage: Stage | None,
    asked: Mapping[int, TruthRequest],
    camera: StereoCamera,
    poses: Mapping[str, Array],
    clip_m: tuple[float, float],
    wanted: str,
    rounded: Collection[str],
) -> Iterator[dict[int, Future[dict[str, Path]]]]:
    """Trace the requested truths ``asked``, by number, in another thread; none without a ``stage``. For the other
    arguments see ``trace_truth``.

    Cycles lets other threads run while it renders, and often leaves processors idle.
    """
    with ThreadPoolExecutor(1) as beside:
        yield (
            {}
            if stage is None
            else {
                number: beside.submit(trace_truth, stage, each, camera, poses, clip_m, wanted, rounded)
                for number, each in asked.items()
            }
        )


#: Passes by ``quality.truth``; all passes for another value.
_PASSES_BY_TRUTH = {"DEPTH": ("Depth", DISTANCE), "SEMANTIC": ("Depth", DISTANCE, "Material Index")}


def encode_truth(truth: EyeTruth, wanted: str = "FULL", rounded: Collection[str] = ()) -> bytes:
    """Encode the truth of an eye as an EXR file, with the passes of ``wanted``; the passes ``rounded`` are 16-bit
    floats."""
    passes = {**_list_passes("Depth", truth.depth_m, truth), HIDDEN: {"X": truth.hidden}}
    loose = {} if truth.loose_m is None else {LOOSE: {"X": truth.loose_m}}
    return _encode_passes(passes | loose, wanted, rounded)


def encode_camera_truth(truth: CameraTruth, wanted: str, rounded: Collection[str]) -> bytes:
    """Encode the truth of a camera beside the pair as ``encode_truth`` does, with the distance along its rays in place
    of depth."""
    return _encode_passes(_list_passes(DISTANCE, truth.distance_m, truth), wanted, rounded)


def _list_passes(name: str, far_m: Array, truth: EyeTruth | CameraTruth) -> dict[str, dict[str, Array]]:
    """List the passes that every camera has, with ``far_m`` as the pass ``name``."""
    rocks = truth.number >= FIRST_ROCK_INSTANCE
    return {
        name: {"Z": np.where(np.isinf(far_m), SKY_DEPTH_M, far_m)},
        "Object Index": {"X": np.where(rocks, 0, truth.number)},
        "Material Index": {"X": truth.label},
        NORMAL_AOV: dict(zip("RGB", np.moveaxis(truth.normal, -1, 0), strict=True)),
        INSTANCE_AOV: {"X": np.where(rocks, truth.number, 0)},
    }


def _encode_passes(passes: dict[str, dict[str, Array]], wanted: str, rounded: Collection[str]) -> bytes:
    return assemble(
        [
            encode_part(f"{TRUTH}.{name}", channels, f"{TRUTH}.{name}" in rounded)
            for name, channels in passes.items()
            if name in _PASSES_BY_TRUTH.get(wanted, passes)
        ]
    )
