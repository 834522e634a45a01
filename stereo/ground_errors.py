"""The depth errors of a matcher on the vertices of the ground that was rendered, for the window.

Each vertex is projected into the rectified left image. It is seen if its depth lies among the true depths of the four
pixel centres around it, and it takes the error of the pixel whose true depth is nearest to its own. Needs only numpy,
which Blender has.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..physics.camera.stereo_camera import StereoCamera
from ..render.pairs.pair_folder import read_unchanged_pair
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .images.colours import ERROR, SKY_GREY, colour_signed_errors
from .images.disparity_and_occlusion import find_scene_depth
from .images.disparity_files import read_disparity, read_focal_baseline
from .images.exr import read_depth
from .images.lens import make_lens
from .measure.metrics import is_usable

#: Kinds of vertices, the best known first.
MEASURED, MISSING, COARSE, UNSEEN = range(4)
#: Edges longer than this in the image, px, are too coarse: many pixels between their ends would not show their errors.
#: It is twice the longest edge that a ground has by default where it is level.
COARSE_PX = 16.0
#: Disparity, px, and share of the depth by which a vertex may lie beyond the true depths around it and still be seen:
#: ground is not flat between pixel centres. Matchers measure no better, and the true depth is exact to 1e-4.
_SEEN_PX, _SEEN_SHARE = 0.05, 1e-3
_AROUND = ((0, 0), (0, 1), (1, 0), (1, 1))  # rows and columns of the pixel centres around a place


@dataclass(frozen=True)
class DepthErrors:
    """The depth errors of a matcher on a pair: images (H, W) of the parallel rig's left eye."""

    camera: StereoCamera
    pose: Array  # (4, 4), from the left eye in OpenCV's axes to the world
    truth: Array  # planar metres, NaN where nothing is compared
    error_m: Array  # measured minus true depth, NaN where nothing was measured or is compared


@dataclass(frozen=True)
class VertexErrors:
    """The depth errors at n vertices: arrays (n,)."""

    error_m: Array  # float32, NaN unless MEASURED
    kind: Array  # uint8: MEASURED, MISSING, COARSE or UNSEEN
    depth_m: Array  # float64, planar, from the eye that saw them; infinite if UNSEEN


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
    return DepthErrors(pair.camera.rectified, pose, truth, depth - truth)


def project_points(errors: DepthErrors, position_m: Array) -> tuple[Array, Array]:
    """Pixel-corner coordinates (n, 2), column first, and planar depths (n,) of points (n, 3) of the world.

    Points that are not before the camera have NaN coordinates.
    """
    camera, local = errors.camera, (position_m - errors.pose[:3, 3]) @ errors.pose[:3, :3]
    depth = local[:, 2]
    ahead = np.where(depth > 1e-6, depth, np.nan)
    place = camera.focal_px * local[:, :2] / ahead[:, None] + (camera.cx_px, camera.cy_px)
    return place, depth


def sample_vertex_errors(errors: DepthErrors, position_m: Array, edges: Array) -> VertexErrors:
    """What vertices at ``position_m`` (n, 3) show, with ``edges`` (m, 2) between them."""
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
        long = ((place[edges[:, 0]] - place[edges[:, 1]]) ** 2).sum(axis=1) > COARSE_PX**2
    coarse[edges[long].ravel()] = True
    coarse &= kind != UNSEEN
    kind[coarse], error[coarse] = COARSE, np.nan
    return VertexErrors(error, kind, np.where(kind == UNSEEN, np.inf, depth))


def _sample_at(errors: DepthErrors, place: Array, depth: Array) -> tuple[Array, Array]:
    """For vertices at places in the image, with their depths: the error there, and whether the camera sees them."""
    height, width = errors.truth.shape
    corner = np.floor(place - 0.5).astype(np.intp)
    rows, columns = (
        np.stack([np.clip(corner[:, axis] + step[1 - axis], 0, size - 1) for step in _AROUND], axis=1)
        for axis, size in ((1, height), (0, width))
    )
    true = errors.truth[rows, columns]
    known = np.isfinite(true)
    nearest = np.where(known, np.abs(true - depth[:, None]), np.inf).argmin(axis=1)
    at = np.arange(len(place)), nearest
    low, high = np.where(known, true, np.inf).min(axis=1), np.where(known, true, 0.0).max(axis=1)
    reach = np.maximum(_SEEN_PX * depth**2 / errors.camera.focal_baseline_px_m, _SEEN_SHARE * depth)
    seen = known.any(axis=1) & (depth >= low - reach) & (depth <= high + reach)
    return errors.error_m[rows[at], columns[at]], seen


def choose_better_known(one: VertexErrors, other: VertexErrors) -> VertexErrors:
    """The better known of two for each vertex; of equals, that which was seen from nearer."""
    take = (other.kind < one.kind) | ((other.kind == one.kind) & (other.depth_m < one.depth_m))
    return VertexErrors(
        *(
            np.where(take, b, a)
            for a, b in ((one.error_m, other.error_m), (one.kind, other.kind), (one.depth_m, other.depth_m))
        )
    )


def count_pixels(errors: DepthErrors, places: Array) -> dict[str, int]:
    """Numbers of pixels with a true depth: ``far``, ``near``, ``right`` and ``missing``; and of all these, those that
    are ``coarse``: in a square of COARSE_PX without any of the ``places`` (n, 2) of vertices that show an error."""
    known = np.isfinite(errors.truth)
    error = errors.error_m[known]
    size = int(COARSE_PX)
    cells = np.zeros([-(-n // size) for n in errors.truth.shape], bool)
    column, row = (places // size).astype(np.intp).T
    cells[row, column] = True
    shown = cells.repeat(size, axis=0).repeat(size, axis=1)[: known.shape[0], : known.shape[1]]
    with np.errstate(invalid="ignore"):
        return {
            "far": int((error > ERROR.low).sum()),
            "near": int((error < -ERROR.low).sum()),
            "right": int((np.abs(error) <= ERROR.low).sum()),
            "missing": int(np.isnan(error).sum()),
            "coarse": int((known & ~shown).sum()),
        }


def colour_errors(error_m: Array, kind: Array, full_m: float) -> Array:
    """RGB uint8 (n, 3): ``signed_colours``, and SKY_GREY for UNSEEN and too COARSE vertices."""
    return np.where((kind >= COARSE)[:, None], np.uint8(SKY_GREY), colour_signed_errors(error_m, full_m))
