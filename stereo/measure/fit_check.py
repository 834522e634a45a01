"""Check whether a map of depths or disparities fits two images, and find another reading of its numbers that fits.

Data sets are read with a wrong unit, channel or orientation more often than they are wrong. So a map is compared with
places that are found in both images without it. If it misses them, its numbers are read in other ways: as distances
along the ray, as depths instead of disparities, upside down, mirrored, with exchanged eyes, or with another factor. A
reading is named only if it explains places that the stated one misses; if the images have too few common places,
nothing is stated. A prediction is compared with the true disparity, which covers more places. ``python benchmarks
fit_check`` measures false alarms on sound pairs and the share of faults that are found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from ...physics.camera.occlusion import find_matching_column
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array

#: Columns to which images are reduced before places are searched; a pixel of these is precise enough for disparities.
_REDUCED_COLUMNS = 400
#: Limits of the searched disparities: the greatest as a share of the width, large for eyes very near to the ground, and
#: the least in px below 0.
_MAX_SEARCHED_SHARE, _SEARCHED_BELOW_0_PX = 0.75, 2
#: Block size (px), uniqueness (%) and least region (px) of places that count; noise makes smaller regions.
_BLOCK_PX, _UNIQUENESS_PERCENT, _MIN_REGION_PX = 7, 12, 60
#: Tolerances within which a place agrees with a disparity: px of the reduced images, and share of the disparity.
_AGREEMENT_PX, _AGREEMENT_SHARE = 1.0, 0.03
#: Least contrast of a place with its surroundings, grey levels of 255.
_MIN_CONTRAST_DN = 1.5
#: Requirements for a statement: fewest places, tiles per side, fewest tiles with places, and fewest rows and columns of
#: such tiles. Along a horizon there are many places and no ground.
_FEWEST_PLACES, _TILES_PER_SIDE, _FEWEST_TILES, _FEWEST_BANDS = 150, 8, 8, 3
#: Fewest places as a share of the image: in images of noise alone one place in a hundred is found by chance.
_MIN_PLACES_SHARE = 0.05
#: Least share of the places that a right map explains, and largest share that a wrong map explains. A right map misses
#: occluded and repeated places too.
_MIN_RIGHT_SHARE, _MAX_WRONG_SHARE = 0.5, 0.25
#: Two readings differ where their disparities differ by _DIFFERENT_PX. The other reading is named if the two differ in
#: at least _DIFFERENT_SHARE of the places, if it is nearer to most of them in at least _NEARER_TILES_SHARE of the
#: tiles, and if its median error is at most _MAX_ERROR_RATIO times the stated reading's.
_DIFFERENT_PX, _DIFFERENT_SHARE, _NEARER_TILES_SHARE, _MAX_ERROR_RATIO = 0.5, 0.2, 0.75, 0.5


#: For a small fault of scale: least disparity of the reduced images, px; the least fault, as a logarithm and in px; and
#: the largest fault, as a logarithm. On steep ground even sound pairs are off by 0.04.
_MIN_SCALED_PX, _MIN_SCALE_FAULT, _MIN_SCALE_FAULT_PX, _MAX_SCALE_FAULT = 5.0, 0.04, 0.25, 0.5
#: Share of the tiles that show a wrong scale, and the share of the fault that they show at least.
_SHOWING_TILES_SHARE, _SHOWN_FAULT_SHARE = 0.8, 0.3
#: Focal lengths to try, as shares of the stated one: steps of 3 %, without those within a tenth.
_ZOOMS = tuple(math.exp(0.03 * k) for k in range(-26, 27) if abs(k) > 3)


@dataclass(frozen=True)
class FitFault:
    """A reading of a map that fits better than the stated one, or the fact that no reading fits.

    ``kind`` is a key of ``READINGS``, or "nothing" if no reading fits. The numbers are ``factor`` times too large.
    """

    kind: str
    factor: float = 1.0
    stated_share: float = float("nan")  # share of the places that the stated reading explains
    share: float = float("nan")  # share of the places that the other reading explains


#: The readings to try, in words that follow "it fits".
READINGS = {
    "factor": "with another factor",
    "ray": "as distances along the ray",
    "depth": "as depths in metres",
    "disparity": "as disparities in px",
    "inverse": "as 1 / depth in 1/m",
    "upside_down": "upside down",
    "mirrored": "mirrored from left to right",
    "turned": "turned by 180°",
    "right_eye": "as the map of the right eye",
    "swapped": "with the images exchanged",
}


#: Functions that turn a map, by the kind of reading.
TURN_BY_READING: dict[str, Callable[[Array], Array]] = {
    "upside_down": lambda a: a[::-1],
    "mirrored": lambda a: a[:, ::-1],
    "turned": lambda a: a[::-1, ::-1],
}


@dataclass(frozen=True)
class MatchedPlaces:
    """Disparities in px (H, W) at which pixels of the left image are found in the right one, NaN elsewhere, and
    ``swapped``, the same with the images exchanged. The images are ``step`` times smaller than the originals.
    """

    left: Array
    swapped: Array
    step: int

    def are_enough(self) -> bool:
        """Return whether there are enough matched points for a verdict, in either order of the images."""
        return any(
            _is_spread(np.isfinite(each)) and np.isfinite(each).mean() >= _MIN_PLACES_SHARE
            for each in (self.left, self.swapped)
        )


def find_common_places(left: Array, right: Array) -> MatchedPlaces:
    """Find the places that two grey images (H, W) of any range have in common, by block matching in both directions."""
    step = max(1, math.ceil(left.shape[1] / _REDUCED_COLUMNS))
    small = [_to_8_bit(_reduce(image, step)) for image in (left, right)]
    return MatchedPlaces(_match_both_ways(small[0], small[1]), _match_both_ways(small[1], small[0]), step)


def make_true_places(disparity: Array) -> MatchedPlaces:
    """Make matched places from the true disparity (H, W) of a pair, px, NaN where unknown."""
    step = max(1, math.ceil(disparity.shape[1] / _REDUCED_COLUMNS))
    thinned = disparity[step // 2 :: step, step // 2 :: step] / step
    return MatchedPlaces(thinned, np.full_like(thinned, np.nan), step)


def find_fault(values: Array, kind: str, camera: StereoCamera, places: MatchedPlaces) -> FitFault | None:
    """Find the fault of a map ``values`` (H, W) of "depth" (m) or "disparity" (px), NaN where unknown. None if the map
    fits, or if the images do not decide.
    """
    if not places.are_enough():
        return None
    stated = read_as_disparity(values, kind, camera)
    here = _measure_agreeing_share(stated, places.left, places.step)
    best: FitFault | None = None
    for name, disparity, found in _list_other_readings(values, kind, camera, places):
        if not _is_spread(np.isfinite(found) & np.isfinite(_thin(disparity, places.step))):
            continue
        share = _measure_agreeing_share(disparity, found, places.step)
        if (
            share >= _MIN_RIGHT_SHARE
            and _explains_more(disparity, stated, found, places)
            and (best is None or share > best.share)
        ):
            best = FitFault(name, 1.0, here, share)
    if best is None:
        best = _find_factor(stated, places, here, kind)
    if (
        best is None
        and here < _MAX_WRONG_SHARE
        and _is_spread(np.isfinite(places.left) & np.isfinite(_thin(stated, places.step)))
    ):
        return FitFault("nothing", 1.0, here)
    return best


def find_misfit(values: Array, kind: str, camera: StereoCamera, places: MatchedPlaces) -> FitFault | None:
    """Find a small fault of a map that ``find_fault`` does not find; None without one.

    A "scale" is off by 4 % or more, so that the numbers are ``factor`` times too large. A "zoom" is the map of a camera
    with another focal length at the same position; its ``factor`` is that focal length over the stated one.
    """
    if not places.are_enough():
        return None
    thinned = _thin(read_as_disparity(values, kind, camera), places.step) / places.step
    scale = _find_scale(thinned, places.left)
    if scale is not None:
        return FitFault("scale", scale if kind == "depth" else 1 / scale)
    zoom = _find_zoom(thinned, camera, places)
    return None if zoom is None else FitFault("zoom", zoom)


def _find_scale(stated: Array, found: Array) -> float | None:
    """Find the ratio of the found disparities to the stated ones, if it clearly differs from 1 in most parts of the
    image; else None.

    Each part gives the ratio at which its places gather, because wrongly found places hardly move it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(found / stated)
        known = np.isfinite(ratio) & (np.abs(ratio) < _MAX_SCALE_FAULT)
    if not _is_spread(known):
        return None
    gathered = np.array([_find_half_sample_mode(ratio[tile][known[tile]]) for tile in _find_filled_tiles(known)])
    off, disparity = float(np.median(gathered)), float(np.median(found[known]))
    if disparity < _MIN_SCALED_PX or abs(off) < _MIN_SCALE_FAULT or abs(off) * disparity < _MIN_SCALE_FAULT_PX:
        return None
    shown = np.mean(gathered * np.sign(off) > _SHOWN_FAULT_SHARE * abs(off))
    return math.exp(off) if shown >= _SHOWING_TILES_SHARE else None


def _find_half_sample_mode(values: Array) -> float:
    """Find the value around which numbers gather: repeatedly keep the narrowest half of them, and take the median of
    the rest.
    """
    ordered = np.sort(values)
    while len(ordered) > 8:
        half = len(ordered) // 2
        first = int(np.argmin(ordered[half:] - ordered[: len(ordered) - half]))
        ordered = ordered[first : first + half]
    return float(np.median(ordered))


def _find_zoom(stated: Array, camera: StereoCamera, places: MatchedPlaces) -> float | None:
    """Find the focal length of the map as a multiple of the camera's, if a map scaled by this factor fits clearly
    better; else None.
    """
    rows, columns = np.mgrid[: stated.shape[0], : stated.shape[1]].astype(np.float32)
    first = places.step // 2 + 0.5
    across, down = (camera.cx_px - first) / places.step, (camera.cy_px - first) / places.step
    best, least = None, math.inf
    for zoom in _ZOOMS:
        x, y = (
            np.asarray(middle + zoom * (each - middle), np.float32)
            for middle, each in ((across, columns), (down, rows))
        )
        other = cv2.remap(
            stated.astype(np.float32), x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=[math.nan]
        )
        with np.errstate(invalid="ignore"):
            both = np.isfinite(other) & np.isfinite(stated) & np.isfinite(places.left)
            differs = both & (np.abs(other - stated) > _DIFFERENT_PX)
        if not _is_spread(both):
            continue
        missed = float(np.median(np.abs(other - places.left)[both]))
        near = np.abs(other - places.left)[both] <= _find_tolerance(places.left)[both]
        if missed < least and near.mean() >= _MIN_RIGHT_SHARE and _is_nearer(other, stated, places.left, differs):
            best, least = zoom, missed
    return best


def is_confirmed(values: Array, kind: str, camera: StereoCamera, places: MatchedPlaces) -> bool:
    """Return whether the images have enough places, and most of them confirm a map ``values`` (H, W) of "depth" (m) or
    "disparity" (px), NaN where unknown.
    """
    return (
        places.are_enough()
        and _measure_agreeing_share(read_as_disparity(values, kind, camera), places.left, places.step)
        >= _MIN_RIGHT_SHARE
    )


def are_mostly_at_disparity(where: Array, disparity_px: float, places: MatchedPlaces) -> bool:
    """Return whether the images show most of the pixels ``where`` (H, W) at one disparity, like a wall that
    faces them.
    """
    inside = _thin(where.astype(np.float64), places.step) > 0
    there = _measure_agreeing_share(np.where(where, disparity_px, np.nan), places.left, places.step)
    return bool(
        there >= _MIN_RIGHT_SHARE and (inside & np.isfinite(places.left)).sum() >= _MIN_RIGHT_SHARE * inside.sum()
    )


def compute_ray_lengths(camera: StereoCamera) -> Array:
    """Compute the distance from the eye over the planar depth, (H, W)."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    return np.asarray(
        np.sqrt(1 + ((u - camera.cx_px) / camera.focal_px) ** 2 + ((v - camera.cy_px) / camera.focal_px) ** 2)
    )


def read_as_disparity(values: Array, kind: str, camera: StereoCamera) -> Array:
    """Convert depths in m to disparities in px, or return disparities in px unchanged; NaN where unknown."""
    if kind == "disparity":
        return values
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > 0, camera.disparity(values), np.nan)


def _list_other_readings(
    values: Array, kind: str, camera: StereoCamera, places: MatchedPlaces
) -> Iterator[tuple[str, Array, Array]]:
    """Yield the name of each other reading, its disparities (H, W), and the places with which they are compared."""
    stated = read_as_disparity(values, kind, camera)
    other = "depth" if kind == "disparity" else "disparity"
    yield other, read_as_disparity(values, other, camera), places.left
    yield "inverse", values * camera.focal_baseline_px_m - camera.doffs_px, places.left
    if kind == "depth":
        yield "ray", read_as_disparity(values / compute_ray_lengths(camera), kind, camera), places.left
    for name, turn in TURN_BY_READING.items():
        yield name, turn(stated), places.left
    yield "right_eye", warp_to_other_eye(stated, "right"), places.left
    yield "swapped", stated, places.swapped


def warp_to_other_eye(disparity: Array, eye: str) -> Array:
    """Warp the disparities (H, W), px, of ``eye`` to the other eye. Where two points meet, the nearer one counts; NaN
    where no point falls.
    """
    column = find_matching_column(np.nan_to_num(disparity), eye)
    place = np.rint(column).astype(np.int64)
    known = np.isfinite(disparity) & (place >= 0) & (place < disparity.shape[1])
    found = np.full(disparity.shape, -np.inf)
    np.maximum.at(found, (np.nonzero(known)[0], place[known]), disparity[known])
    return np.where(np.isfinite(found), found, np.nan)


def _find_factor(stated: Array, places: MatchedPlaces, here: float, kind: str) -> FitFault | None:
    """Find the factor on which most matched points agree; None if they are too few."""
    thinned = _thin(stated, places.step) / places.step
    with np.errstate(invalid="ignore", divide="ignore"):
        both = np.isfinite(thinned) & (places.left > 2 * _AGREEMENT_PX) & (thinned > 0)
    if not _is_spread(both):
        return None
    ratio = np.log(places.left[both] / thinned[both])
    bins = np.arange(ratio.min() - _AGREEMENT_SHARE, ratio.max() + 3 * _AGREEMENT_SHARE, _AGREEMENT_SHARE)
    counts, edges = np.histogram(ratio, bins)
    near = np.convolve(counts, np.ones(3), "same")
    middle = (edges[near.argmax()] + edges[near.argmax() + 1]) / 2
    middle = float(np.median(ratio[np.abs(ratio - middle) <= 1.5 * _AGREEMENT_SHARE]))
    scaled = stated * math.exp(middle)
    share = _measure_agreeing_share(scaled, places.left, places.step)
    if share < _MIN_RIGHT_SHARE or not _explains_more(scaled, stated, places.left, places):
        return None
    return FitFault("factor", math.exp(middle if kind == "depth" else -middle), here, share)


def _explains_more(disparity: Array, stated: Array, found: Array, places: MatchedPlaces) -> bool:
    """Return whether another reading explains clearly more of the places at which it differs from the stated one."""
    if found is not places.left:  # the other reading exchanges the images
        here = _measure_agreeing_share(stated, places.left, places.step)
        return not here >= _MAX_WRONG_SHARE
    one, other = (_thin(each, places.step) / places.step for each in (stated, disparity))
    with np.errstate(invalid="ignore"):
        differs = np.isfinite(found) & (np.abs(one - other) > _DIFFERENT_PX)
    return _is_nearer(other, one, found, differs)


def _is_nearer(other: Array, one: Array, found: Array, differs: Array) -> bool:
    """Return whether ``other`` disparities are clearly nearer than ``one`` to the ``found`` ones, where the two differ.
    All arrays (H, W) have the size of the reduced images.
    """
    if not _is_spread(differs):
        return False
    if differs.sum() < _DIFFERENT_SHARE * np.isfinite(found).sum():
        return False
    missed, left = np.abs(one - found), np.abs(other - found)
    nearer = [bool(np.mean((left < missed)[tile][differs[tile]]) > 0.5) for tile in _find_filled_tiles(differs)]
    return bool(
        np.mean(nearer) >= _NEARER_TILES_SHARE
        and np.median(left[differs]) <= _MAX_ERROR_RATIO * np.median(missed[differs])
    )


def _measure_agreeing_share(disparity: Array, found: Array, step: int) -> float:
    """Measure the share of places at which a disparity (H, W) agrees with the ``found`` one; NaN if the places are too
    few.
    """
    thinned = _thin(disparity, step) / step
    with np.errstate(invalid="ignore"):
        both = np.isfinite(found) & ~np.isnan(thinned)
        if both.sum() < _FEWEST_PLACES:
            return float("nan")
        return float(np.mean(np.abs(thinned - found)[both] <= _find_tolerance(found)[both]))


def _find_tolerance(found: Array) -> Array:
    return np.maximum(_AGREEMENT_PX, _AGREEMENT_SHARE * np.abs(found))


def _thin(values: Array, step: int) -> Array:
    """Return the values in the middle of squares of ``step`` pixels."""
    height, width = (size // step * step for size in values.shape)
    return values[step // 2 : height : step, step // 2 : width : step]


Tile = tuple[slice, slice]


def _find_filled_tiles(where: Array) -> list[Tile]:
    """Find the tiles of an image that have enough pixels."""
    height, width = (math.ceil(size / _TILES_PER_SIDE) for size in where.shape)
    tiles = [
        (slice(row, row + height), slice(column, column + width))
        for row in range(0, where.shape[0], height)
        for column in range(0, where.shape[1], width)
    ]
    return [tile for tile in tiles if where[tile].sum() >= _FEWEST_PLACES / _TILES_PER_SIDE]


def _is_spread(where: Array) -> bool:
    """Return whether there are enough pixels in enough parts of an image, across and along it."""
    if where.sum() < _FEWEST_PLACES:
        return False
    tiles = _find_filled_tiles(where)
    return len(tiles) >= _FEWEST_TILES and all(
        len({tile[axis].start for tile in tiles}) >= _FEWEST_BANDS for axis in (0, 1)
    )


def _reduce(image: Array, step: int) -> Array:
    """Average an image over squares of ``step`` pixels."""
    height, width = (size // step for size in image.shape)
    cut = np.nan_to_num(image[: height * step, : width * step].astype(np.float32), posinf=0.0, neginf=0.0)
    return np.asarray(cut.reshape(height, step, width, step).mean(axis=(1, 3)))


def _to_8_bit(image: Array) -> Array:
    """Convert light to 8 bits by its square root, much as eyes see it. The brightest 0.5 % of the pixels saturate."""
    level = image / max(float(np.quantile(image, 0.995)), 1e-9)
    return np.rint(255 * np.sqrt(np.clip(level, 0, 1))).astype(np.uint8)


def _match_both_ways(left: Array, right: Array) -> Array:
    """Find the disparities (H, W) on which block matching of 8-bit images agrees in both directions, NaN elsewhere."""
    width = left.shape[1]
    count = 16 * math.ceil((_MAX_SEARCHED_SHARE * width + _SEARCHED_BELOW_0_PX) / 16)
    there, back = _match_one_way(left, right, count), _match_one_way(right[:, ::-1], left[:, ::-1], count)[:, ::-1]
    column = np.rint(find_matching_column(np.nan_to_num(there))).astype(np.int64)
    inside = (column >= 0) & (column < width)
    other = np.take_along_axis(back, np.clip(column, 0, width - 1), axis=1)
    smooth = cv2.blur(left.astype(np.float32), (_BLOCK_PX, _BLOCK_PX))
    contrast = np.sqrt(cv2.blur((left - smooth) ** 2, (_BLOCK_PX, _BLOCK_PX)))
    with np.errstate(invalid="ignore"):
        sure = inside & (np.abs(there - other) <= 1) & (contrast > _MIN_CONTRAST_DN)
    steps = np.where(sure, np.rint(16 * np.nan_to_num(there)), -32768).astype(np.int16)
    cv2.filterSpeckles(steps, -32768, _MIN_REGION_PX, 16)
    return np.where(steps == -32768, np.nan, there)


def _match_one_way(left: Array, right: Array, count: int) -> Array:
    least, beside = -_SEARCHED_BELOW_0_PX, count - _SEARCHED_BELOW_0_PX  # columns at which OpenCV finds nothing
    padded = [
        cv2.copyMakeBorder(np.ascontiguousarray(image), 0, 0, beside, -least, cv2.BORDER_REPLICATE)
        for image in (left, right)
    ]
    area = _BLOCK_PX**2
    found = cv2.StereoSGBM.create(
        least,
        count,
        _BLOCK_PX,
        4 * area,
        16 * area,
        uniquenessRatio=_UNIQUENESS_PERCENT,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    ).compute(*padded)
    found = found[:, beside : beside + left.shape[1]].astype(np.float64) / 16
    return np.where(found < least, np.nan, found)
