"""Makes range points in the left image of a pair: samples of its true depth, or a scan by ``icymoon lidar``."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...physics.random_numbers.seeds import make_generator
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..export.lidar import read_facts, read_points

#: Fewest points from which a surface is interpolated.
FEWEST_POINTS = 3
#: Median relative difference of depth above which a scan shows another ground than the pair.
_OTHER_GROUND = 0.05
#: Distance, px, below which two points count as one; the nearer to the camera stays.
_SAME_PX = 1e-3
#: Most points of a scan that are read.
_MAX_POINTS = 20_000_000


class SeenPair(Protocol):
    """The facts of a pair that its range points need."""

    @property
    def name(self) -> str:
        """The pair's name, which seeds the pattern of its points."""

    @property
    def camera(self) -> StereoCamera:
        """The parallel rig of the pair."""

    def rectified_pose(self, eye: str) -> Array | None:
        """Return the matrix (4, 4) from an eye, in OpenCV's axes, to the world; None if it is unknown."""


@dataclass(frozen=True)
class PointErrors:
    """Errors of range points.

    ``noise_m`` is the standard deviation of each range, ``shift_px`` a shift of all points in the image. The seed
    determines its direction.
    """

    noise_m: float
    shift_px: float


@dataclass(frozen=True)
class RangePoints:
    """Points in the left image.

    Their columns and rows (n,) are in px from the centre of the first pixel, their disparities (n,) in px. ``noise_px``
    (n,) is the standard deviation of the disparities by the noise of ranges.
    """

    column: Array
    row: Array
    disparity: Array
    noise_px: Array


def sample_depth(truth: Array, camera: StereoCamera, count: int, random: np.random.Generator) -> Array:
    """Sample points (count, 3) of a true depth (H, W), in m in the axes of the left eye, x right, y down.

    They lie at the centres of pixels; each pixel with a depth has the same probability. The first points of a larger
    ``count`` are the points of a smaller one. Raises IcyMoonError if fewer pixels have a depth.
    """
    known = np.isfinite(truth)
    if known.sum() < count:
        raise IcyMoonError(
            f"{count} range points were asked for, and only {int(known.sum())} pixels have a true depth; give fewer."
        )
    rank = random.permutation(truth.size)
    chosen = rank[known.ravel()[rank]][:count]
    row, column = np.divmod(chosen, truth.shape[1])
    depth = truth[row, column]
    x, y = ((at + 0.5 - centre) / camera.focal_px for at, centre in ((column, camera.cx_px), (row, camera.cy_px)))
    return np.stack([x * depth, y * depth, depth], axis=1)


def read_scan(folder: Path, pair: SeenPair, truth: Array) -> Array:
    """Read the scan of a pair, ``folder/NAME/lidar.npz``, as points (n, 3) in m in the axes of the left eye.

    Raises IcyMoonError if there is no such scan, if the pair states no pose, if no point lies in the left image, or if
    the points' depths differ from the true ones.
    """
    path = folder / pair.name / "lidar.npz"
    if not path.is_file():
        raise IcyMoonError(
            f"{folder} has no scan of the pair {pair.name}; give the folder that icymoon lidar wrote for its settings."
        )
    pose = pair.rectified_pose("left")
    if pose is None:
        raise IcyMoonError(f"The pair {pair.name} states no pose of its camera, so a scan cannot be placed in it.")
    measured, true = ((each - pose[:3, 3]) @ pose[:3, :3] for each in _read_places(path.parent))
    aimed, column, row = _find_pixels(true, pair.camera, truth.shape)
    if not aimed.any():
        raise IcyMoonError(
            f"{path}: none of {len(true)} points lies in the left image of {pair.name}; its axes are not those of the "
            "pair, or the scanner looked elsewhere, so scan again without --position."
        )
    seen = truth[np.rint(row[aimed]).astype(int), np.rint(column[aimed]).astype(int)]
    off = np.abs(seen / true[aimed, 2] - 1)
    if not np.isfinite(off).any() or np.nanmedian(off) > _OTHER_GROUND:
        raise IcyMoonError(
            f"{path} shows another ground than the pair {pair.name}: half of its points in the image differ by more "
            f"than {100 * _OTHER_GROUND:g} % of the depth; scan the settings that the pair was rendered from."
        )
    return np.asarray(measured[_find_pixels(measured, pair.camera, truth.shape)[0]])


def _read_places(folder: Path) -> tuple[Array, Array]:
    """Read the measured points (n, 3) of a scan, and the points of the surface along the same beams, NaN for a false
    alarm.

    Both are in m in the axes of the site.
    """
    facts = read_facts(folder)
    position = np.array(facts["position_m"])
    measured, shares, count = [], [], 0
    for part in read_points(folder, facts):
        if part.point_m.ndim != 2 or (count := count + len(part)) > _MAX_POINTS:
            raise IcyMoonError(
                f"{folder / 'lidar.npz'} has more than {_MAX_POINTS} points, or points without three coordinates; "
                "scan again with fewer beams."
            )
        measured.append(part.point_m)
        shares.append(1.0 - part.error_m / part.range_m)
    if not count:
        raise IcyMoonError(f"{folder / 'lidar.npz'} has no points; scan again with the ground in the scanner's range.")
    points = np.concatenate(measured)
    return points, position + (points - position) * np.concatenate(shares)[:, None]


def choose_points(points_m: Array, count: int, random: np.random.Generator) -> Array:
    """Choose ``count`` of points (n, 3), or all if there are fewer, with equal probabilities.

    The first points of a larger count are the points of a smaller one.
    """
    return np.asarray(points_m[random.permutation(len(points_m))[:count]])


def _find_pixels(points_m: Array, camera: StereoCamera, shape: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Return whether points (n, 3) lie in the image (H, W), and their columns and rows."""
    with np.errstate(divide="ignore", invalid="ignore"):
        column = points_m[:, 0] / points_m[:, 2] * camera.focal_px + camera.cx_px - 0.5
        row = points_m[:, 1] / points_m[:, 2] * camera.focal_px + camera.cy_px - 0.5
    return _are_inside(column, row, shape) & (points_m[:, 2] > 0), column, row


def _are_inside(column: Array, row: Array, shape: tuple[int, ...]) -> Array:
    """Return whether positions lie between the centres of the outermost pixels, with a tolerance of 1e-6 px."""
    high, wide = shape[0] - 1, shape[1] - 1
    return np.asarray((np.abs(column - wide / 2) <= wide / 2 + 1e-6) & (np.abs(row - high / 2) <= high / 2 + 1e-6))


def project_points(
    points_m: Array, camera: StereoCamera, shape: tuple[int, ...], errors: PointErrors, random: np.random.Generator
) -> RangePoints:
    """Project points (n, 3), m, in the axes of the left eye, to range points of a stereo camera with ``errors``.

    Points outside the image are left out. Of several points at one image position, only the nearest stays. Raises
    IcyMoonError if fewer than ``FEWEST_POINTS`` are left.
    """
    angle = random.uniform(0, 2 * np.pi)
    range_m = np.linalg.norm(points_m, axis=1)
    noisy = range_m + errors.noise_m * random.standard_normal(len(points_m))
    moved = points_m * (noisy / range_m)[:, None]
    inside, column, row = _find_pixels(moved, camera, shape)
    column, row = column + errors.shift_px * np.cos(angle), row + errors.shift_px * np.sin(angle)
    inside &= _are_inside(column, row, shape)
    disparity = camera.disparity(moved[:, 2])
    kept = np.flatnonzero(inside & (disparity > 0))
    kept = kept[np.argsort(-disparity[kept], kind="stable")]
    place = np.rint(np.stack([column[kept], row[kept]], axis=1) / _SAME_PX)
    kept = np.sort(kept[np.unique(place, axis=0, return_index=True)[1]])
    if len(kept) < FEWEST_POINTS:
        raise IcyMoonError(
            f"Only {len(kept)} of {len(points_m)} range points lie in the left image, and {FEWEST_POINTS} are needed; "
            "give more points, or a scan that looks where the camera looks."
        )
    depth = moved[kept, 2]
    noise_px = camera.focal_baseline_px_m / depth * errors.noise_m / range_m[kept]
    return RangePoints(column[kept], row[kept], disparity[kept], noise_px)


def make_range_points(
    options: Mapping[str, Any], pair: SeenPair, truth: Array, camera: StereoCamera, random: np.random.Generator
) -> RangePoints:
    """Make the range points of a pair by complete options (``matchers.lidar_options``).

    They are samples of the ``truth`` (H, W), planar metres, or the pair's scan.
    """
    if options["returns"]:
        places = choose_points(read_scan(Path(options["returns"]), pair, truth), options["points"], random)
    else:
        places = sample_depth(truth, pair.camera, options["points"], random)
    errors = PointErrors(options["noise_cm"] / 100, options["shift_px"])
    return project_points(places, camera, truth.shape, errors, random)


def mark_pixels(points: RangePoints, shape: tuple[int, ...]) -> Array:
    """Mark points in an image (H, W), float32: their disparities, px, at the nearest pixels, and 0 elsewhere.

    Of several points at a pixel, the nearest to the camera counts.
    """
    marked = np.zeros(shape, np.float32)
    place = np.rint(points.row).astype(int), np.rint(points.column).astype(int)
    np.maximum.at(marked, place, points.disparity.astype(np.float32))
    return marked


def make_point_generator(seed: int, pair: str, *epoch: int) -> np.random.Generator:
    """Make the random generator of the range points of a pair, and of an epoch of training."""
    return make_generator(seed, "range_points", int(hashlib.sha256(pair.encode()).hexdigest()[:8], 16), *epoch)
