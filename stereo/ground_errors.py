"""The depth errors of a matcher on the vertices of the rendered ground, for the window.

Each vertex is projected into the rectified left image. The eye sees the vertex if its depth is among the true depths of
the four pixel centres around it. The vertex gets the error of the pixel with the nearest true depth. Needs only NumPy,
which Blender has.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..physics.camera import rolling_shutter
from ..physics.camera.rolling_shutter import RollingShutter
from ..physics.camera.stereo_camera import StereoCamera
from ..render.pairs.pair_folder import read_unchanged_pair
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .images.colours import ERROR_SCALE, SKY_GREY, colour_signed_errors
from .images.disparity_and_occlusion import find_scene_depth
from .images.disparity_files import read_disparity, read_focal_baseline
from .images.exr import read_depth
from .images.lens import make_lens
from .measure.metrics import is_usable

#: Kinds of vertices, the best known kind first.
MEASURED, MISSING, COARSE, UNSEEN = range(4)
#: Longest edge in the image, px. The ends of longer edges would not show the errors of the many pixels between them.
#: This is twice the longest edge of level ground by default.
MAX_EDGE_PX = 16.0
#: Distance by which a visible vertex may lie beyond the true depths around it: disparity, px, and share of the depth.
#: Ground is curved between pixel centres. Matchers are less precise than this tolerance, and the true depth is exact to
#: 1e-4.
_DEPTH_TOLERANCE_PX, _DEPTH_TOLERANCE_SHARE = 0.05, 1e-3
_PIXEL_OFFSETS = ((0, 0), (0, 1), (1, 0), (1, 1))  # rows and columns of the pixel centres around a place


@dataclass(frozen=True)
class DepthErrors:
    """The depth errors of a matcher on a pair, as images (H, W) of the parallel rig's left eye."""

    camera: StereoCamera
    pose: Array  # (4, 4), from the left eye in OpenCV's axes to the world
    truth: Array  # planar depth, m, NaN for pixels that do not count
    error_m: Array  # measured minus true depth, m, NaN where one of them is missing
    shutter: RollingShutter | None = None  # ``pose`` is for the middle of the exposure


@dataclass(frozen=True)
class VertexErrors:
    """The depth errors at n vertices: arrays (n,)."""

    error_m: Array  # float32, NaN unless MEASURED
    kind: Array  # uint8: MEASURED, MISSING, COARSE or UNSEEN
    depth_m: Array  # float64, planar, from the eye that saw the vertex; infinite if UNSEEN


def read_depth_errors(pair_folder: Path, disparity_file: Path) -> DepthErrors:
    """Read the depth errors of a stored disparity. Raises IcyMoonError if a file is missing, damaged or changed."""
    pair = read_unchanged_pair(pair_folder)
    pose = pair.rectified_pose("left")
    if pose is None:
        raise IcyMoonError(
            f"{pair_folder / 'pair.json'} does not contain the position of the camera; render the pair again."
        )
    truth = pair.camera.cropped(find_scene_depth(read_depth(pair.truth("left"), "left")))
    lens = make_lens(pair.camera, pair.settings.rig, "left") if pair.camera.looks_elsewhere else None
    truth = truth if lens is None else np.where(lens.sees, truth, np.nan)
    disparity = read_disparity(disparity_file, truth.shape)
    if disparity is None:
        raise IcyMoonError(f"{disparity_file} is missing or damaged; press Evaluate again.")
    valid = is_usable(disparity)
    focal_baseline = read_focal_baseline(disparity_file) or pair.camera.focal_baseline_px_m
    with np.errstate(over="ignore"):
        depth = focal_baseline / np.where(valid, disparity, np.nan).astype(np.float64)
    return DepthErrors(pair.camera.rectified, pose, truth, depth - truth, pair.rolling_shutter)


def project_points(errors: DepthErrors, position_m: Array) -> tuple[Array, Array]:
    """Project points (n, 3) of the world; return their pixel-corner coordinates (n, 2), column first, and planar depths
    (n,), m.

    Points that are not in front of the camera have NaN coordinates; see ``rolling_shutter.project_points``.
    """
    local = (position_m - errors.pose[:3, 3]) @ errors.pose[:3, :3]
    return rolling_shutter.project_points(local, errors.camera, errors.shutter)


def sample_vertex_errors(errors: DepthErrors, position_m: Array, edges: Array) -> VertexErrors:
    """Sample the errors at vertices at ``position_m`` (n, 3), with ``edges`` (m, 2) between them."""
    place, depth = project_points(errors, position_m)
    height, width = errors.truth.shape
    inside = ((place >= 0) & (place < (width, height))).all(axis=1)  # also False for NaN
    kind = np.full(len(place), UNSEEN, np.uint8)
    error = np.full(len(place), np.nan, np.float32)
    found, seen = _sample_at(errors, place[inside], depth[inside])
    error[inside] = np.where(seen, found, np.nan)
    kind[inside] = np.where(seen, np.where(np.isnan(found), MISSING, MEASURED), UNSEEN)
    coarse = np.zeros(len(place), bool)
    with np.errstate(invalid="ignore"):
        long = ((place[edges[:, 0]] - place[edges[:, 1]]) ** 2).sum(axis=1) > MAX_EDGE_PX**2
    coarse[edges[long].ravel()] = True
    coarse &= kind != UNSEEN
    kind[coarse], error[coarse] = COARSE, np.nan
    return VertexErrors(error, kind, np.where(kind == UNSEEN, np.inf, depth))


def _sample_at(errors: DepthErrors, place: Array, depth: Array) -> tuple[Array, Array]:
    """Sample the error at each image position. Also return whether the camera sees the vertex there, judged by its
    depth.
    """
    height, width = errors.truth.shape
    corner = np.floor(place - 0.5).astype(np.intp)
    rows, columns = (
        np.stack([np.clip(corner[:, axis] + step[1 - axis], 0, size - 1) for step in _PIXEL_OFFSETS], axis=1)
        for axis, size in ((1, height), (0, width))
    )
    true = errors.truth[rows, columns]
    known = np.isfinite(true)
    nearest = np.where(known, np.abs(true - depth[:, None]), np.inf).argmin(axis=1)
    at = np.arange(len(place)), nearest
    low, high = np.where(known, true, np.inf).min(axis=1), np.where(known, true, 0.0).max(axis=1)
    reach = np.maximum(
        _DEPTH_TOLERANCE_PX * depth**2 / errors.camera.focal_baseline_px_m, _DEPTH_TOLERANCE_SHARE * depth
    )
    seen = known.any(axis=1) & (depth >= low - reach) & (depth <= high + reach)
    return errors.error_m[rows[at], columns[at]], seen


def choose_better_result(one: VertexErrors, other: VertexErrors) -> VertexErrors:
    """Choose, for each vertex, the better known of two results; of equal kinds, the result that was seen from
    nearer.
    """
    take = (other.kind < one.kind) | ((other.kind == one.kind) & (other.depth_m < one.depth_m))
    return VertexErrors(
        *(
            np.where(take, b, a)
            for a, b in ((one.error_m, other.error_m), (one.kind, other.kind), (one.depth_m, other.depth_m))
        )
    )


def count_pixels(errors: DepthErrors, places: Array) -> dict[str, int]:
    """Count the pixels with a true depth by their error: ``far``, ``near``, ``right`` and ``missing``. ``coarse``
    counts those in squares of MAX_EDGE_PX without a vertex that shows an error; ``places`` (n, 2) are these vertices in
    the image.
    """
    known = np.isfinite(errors.truth)
    error = errors.error_m[known]
    size = int(MAX_EDGE_PX)
    cells = np.zeros([-(-n // size) for n in errors.truth.shape], bool)
    column, row = (places // size).astype(np.intp).T
    cells[row, column] = True
    shown = cells.repeat(size, axis=0).repeat(size, axis=1)[: known.shape[0], : known.shape[1]]
    with np.errstate(invalid="ignore"):
        return {
            "far": int((error > ERROR_SCALE.low).sum()),
            "near": int((error < -ERROR_SCALE.low).sum()),
            "right": int((np.abs(error) <= ERROR_SCALE.low).sum()),
            "missing": int(np.isnan(error).sum()),
            "coarse": int((known & ~shown).sum()),
        }


def colour_errors(error_m: Array, kind: Array, full_m: float) -> Array:
    """Colour errors, RGB uint8 (n, 3), as ``colour_signed_errors`` does; UNSEEN and COARSE vertices are SKY_GREY."""
    return np.where((kind >= COARSE)[:, None], np.uint8(SKY_GREY), colour_signed_errors(error_m, full_m))
