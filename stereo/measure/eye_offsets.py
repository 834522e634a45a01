"""By how much the two eyes of a pair are off each other, and how far that can be trusted.

Two independent witnesses. The **truth** of both eyes is free of noise: a point's disparity read in the right eye is
that read in the left one, to rounding, so a wrong f·B, a shift or a shifted row show wherever there is relief,
whatever the light. The **light** tells whether the images belong to that truth. It has noise, glints that each eye
sees elsewhere, shadows without light; so it is compared by limited local contrast, in which no glint outweighs the
ground, and every number has a standard error from the jackknife over tiles. What cannot be told is NaN.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...render.pairs.pair_folder import StereoCamera
from ..images.disparity_and_occlusion import matching_column, warped
from .jackknife import jackknife, tile_sums

#: Shifts of the right image, px, that its light is tried at, and rows.
SHIFTS_PX = np.arange(-3.0, 3.01, 0.5)
ROWS_PX = np.arange(-2.0, 2.1)
#: Pixels below which an image cannot tell.
FEWEST = 100
#: Blur, px, before light is compared, against the noise of single pixels, and the width over which its contrast is
#: taken. Shading that changes with the direction of view is wider, and drops out.
_BLUR_PX, _CONTRAST_PX = 0.8, 3.5
#: Contrast below which light is not told from noise: of the brightness around, and of the whole image's.
_FLOOR, _DARK = 0.02, 1e-3
#: Tiles that a number must rest on.
FEWEST_TILES = 8
#: Columns, about, of the small images in which places are found again, the shifts, px, at which they are sought, and
#: how large a place is, px. From this correlation on it is found: of noise, whose grains are some 3 px, a place has
#: about a hundred, so correlations of noise have a standard deviation of 0.1. And by how much it must fit better
#: there than where the truth has it.
_SMALL_PX, _PLACE_PX, _FOUND, _BETTER = 160, 6.0, 0.65, 0.15
#: Mean square of the contrast from which a place has texture all over, and not a few bright dots in the dark, which fit
#: any others.
_TEXTURED = 0.2
_SEARCH_PX = np.array([*range(-16, -1, 2), -1, 0, 1, *range(2, 17, 2)], float)
#: Disparity, px, by which a point read in the other eye may differ and still be the same point.
_SAME_POINT_PX = 1.0
#: Change of disparity over a column beyond which two columns are of two surfaces.
_STEP = 0.7
#: Deviation, px, that single precision and the mesh's edges between two columns make.
_ROUNDING_PX = 1e-4
#: Part of a disparity that single precision may be off between the eyes, whatever the image: four roundings.
_ROUNDING = 4 * 2.0 ** -24


@dataclass(frozen=True)
class Estimate:
    """A number and its standard error, both NaN where it cannot be told."""

    value: float = float("nan")
    error: float = float("nan")

    def exceeds(self, limit: float, errors: float) -> bool:
        """Whether it is farther than ``limit`` and so many standard errors from 0."""
        return abs(self.value) > max(limit, errors * self.error)  # False for NaN

    @property
    def number(self) -> float | None:
        """The value, or None."""
        return self.value if np.isfinite(self.value) and np.isfinite(self.error) else None


@dataclass(frozen=True)
class TruthOffsets:
    """What makes the truth of both eyes agree: each as if it were the only thing that is wrong."""

    shift_px: Estimate = Estimate()  # of the right eye along the rows
    scale: Estimate = Estimate()  # by how much f·B is too large, as a part of what is stated
    rows_px: Estimate = Estimate()  # of the right eye along the columns
    likeliest: str = "shift_px"  # the one that leaves the least


@dataclass(frozen=True)
class LightOffsets:
    """Where the right image's light fits the left one's, fetched by the true disparity."""

    shift_px: Estimate = Estimate()  # along the rows
    rows_px: Estimate = Estimate()
    correlation: float = float("nan")  # at the best shift, 1 for images that agree
    gain: Estimate = Estimate()  # of the correlation by that shift
    rows_gain: Estimate = Estimate()
    tiles: float = 0.0  # how many tiles of the image it rests on


def truth_offsets(left_depth: np.ndarray, right_depth: np.ndarray, camera: StereoCamera) -> TruthOffsets:
    """Compare the planar depths (H, W) of both eyes, in m, NaN for sky."""
    disparity, other = camera.disparity(left_depth), camera.disparity(right_depth)
    column = matching_column(disparity)
    along, down = (warped(_slope(other, axis), column) for axis in (1, 0))
    difference = warped(other, column) - disparity
    with np.errstate(invalid="ignore"):
        known = ((column >= 1) & (column <= column.shape[1] - 2) & (np.abs(difference) < _SAME_POINT_PX)
                 & (np.abs(along) < _STEP) & (np.abs(down) < 3 * _STEP))
    if known.sum() < FEWEST:
        return TruthOffsets()
    rounding_px = _ROUNDING * _rms(disparity[known])
    # A shift of the right eye by s changes what is fetched by -s times its slope.
    fits = {name: _robust_fit(np.where(known, slope, 0.0), np.where(known, difference, 0.0), known, rounding_px)
            for name, slope in (("shift_px", -along), ("scale", -along * disparity), ("rows_px", -down))}
    likeliest = min(fits, key=lambda name: fits[name][1])
    return TruthOffsets(**{name: estimate for name, (estimate, _) in fits.items()}, likeliest=likeliest)


def _slope(image: np.ndarray, axis: int) -> np.ndarray:
    """Central differences, NaN at the border and beside what is unknown."""
    slope = np.full(image.shape, np.nan)
    inner = [slice(None)] * 2
    inner[axis] = slice(1, -1)
    slope[tuple(inner)] = (np.take(image, range(2, image.shape[axis]), axis)
                           - np.take(image, range(image.shape[axis] - 2), axis)) / 2
    return slope


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values ** 2)))


def _robust_fit(slope: np.ndarray, difference: np.ndarray, known: np.ndarray, rounding_px: float,
                ) -> tuple[Estimate, float]:
    """What ``difference`` is, times ``slope``, by Tukey's weights, and the mean deviation that is left.

    Where an edge falls between two columns the truth of both eyes differs; the weights leave that out. What counts
    as left out is judged by the pixels that can tell, those of at least half the RMS slope or of the steepest
    hundredth: of a view to the horizon most pixels are far, have neither slope nor difference, and would make
    outliers of all that is near.
    """
    steepness = _rms(slope[known])
    least = min(steepness / 2, float(np.quantile(np.abs(slope[known]), 0.99)))
    telling = known & (np.abs(slope) >= least) & (slope != 0)
    if telling.sum() < FEWEST:
        return Estimate(), float("inf")
    value, error = float(np.median(difference[telling] / slope[telling])), float("nan")
    for _ in range(12):
        rest = difference - value * slope
        reach = rest / (4.5 * max(float(np.median(np.abs(rest[telling]))), _ROUNDING_PX))
        weight = np.where(known & (np.abs(reach) < 1), (1 - reach ** 2) ** 2, 0.0)
        sums = tile_sums(weight * slope * difference, weight * slope ** 2)
        (new,), (error,) = jackknife(lambda total: total[..., :1] / total[..., 1:], sums)
        done = not abs(new - value) > 1e-6
        value = float(new)
        if done:
            break
    left = float(np.mean(np.abs(difference - value * slope)[known]))
    return Estimate(value, float(np.hypot(error, rounding_px / steepness))), left


def light_offsets(left: np.ndarray, right: np.ndarray, column: np.ndarray, visible: np.ndarray) -> LightOffsets:
    """Compare radiance (H, W) of both eyes: the left one's where ``visible``, with the right one's at ``column``."""
    width = column.shape[1]
    with np.errstate(invalid="ignore"):
        where = visible & (column >= 1) & (column <= width - 2)
    if where.sum() < FEWEST:
        return LightOffsets()
    left, right = _blurred(left), _blurred(right)
    contrast = _contrast(left, where)
    along = np.stack([_products(contrast, warped(right, column + shift), where) for shift in SHIFTS_PX], axis=1)
    down = np.stack([_products(contrast, warped(_moved_up(right, int(rows)), column), where) for rows in ROWS_PX],
                    axis=1)
    shift, gain, correlation = _best(along, SHIFTS_PX)
    rows, rows_gain, _ = _best(down, ROWS_PX)
    energy = along[:, _zero(SHIFTS_PX), 1]
    held = float(energy.sum() ** 2 / max((energy ** 2).sum(), 1e-300))
    return LightOffsets(shift, rows, correlation.value, gain, rows_gain, held)


def light_correlation(image: np.ndarray, other: np.ndarray, column: np.ndarray, visible: np.ndarray) -> Estimate:
    """How well the light of one eye is that of the ``other`` one at ``column``: 1 if they agree, 0 if not at all."""
    with np.errstate(invalid="ignore"):
        where = visible & (column >= 1) & (column <= column.shape[1] - 2)
    if where.sum() < FEWEST:
        return Estimate()
    image, other = _blurred(image), _blurred(other)
    sums = _products(_contrast(image, where), warped(other, column), where)
    (value,), (error,) = jackknife(lambda total: _correlation(total)[..., None], sums)
    return Estimate(float(value), float(error))


def _finite(image: np.ndarray) -> np.ndarray:
    """In double precision, black where a path of light ended in no number."""
    return np.nan_to_num(image.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)


def _blurred(image: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(_finite(image), (0, 0), _BLUR_PX))


def _contrast(image: np.ndarray, where: np.ndarray) -> np.ndarray:
    """How much brighter a pixel is than those around it, in standard deviations of these, limited to 1; 0 where not
    asked for."""
    level = max(float(image[where].mean()), 1e-300)
    share = np.maximum(_smoothed(where.astype(np.float64), _CONTRAST_PX), 1e-9)
    light = np.where(where, image / level, 0.0)
    mean = _smoothed(light, _CONTRAST_PX) / share
    above = np.where(where, light - mean, 0.0)
    spread = np.sqrt(_smoothed(above ** 2, _CONTRAST_PX) / share)
    return np.asarray(np.tanh(above / (spread + _FLOOR * mean + _DARK)))


def _smoothed(image: np.ndarray, width_px: float) -> np.ndarray:
    """Weighted sums around each pixel; nothing is beyond the border. A Gaussian, as running sums of a box leave
    rounding behind where it is dark."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), width_px, borderType=cv2.BORDER_CONSTANT))


def _moved_up(image: np.ndarray, rows: int) -> np.ndarray:
    return image[np.clip(np.arange(image.shape[0]) + rows, 0, image.shape[0] - 1)]


def _products(contrast: np.ndarray, fetched: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Sums (tiles, 3) that ``_correlation`` is made of."""
    other = _contrast(fetched, where)
    return tile_sums(contrast * other, contrast ** 2, other ** 2)


def _correlation(sums: np.ndarray) -> np.ndarray:
    """Of sums (..., 3); 0 where there is no contrast but rounding's."""
    return np.asarray(sums[..., 0] / (np.sqrt(sums[..., 1] * sums[..., 2]) + 1e-6))


def _zero(steps: np.ndarray) -> int:
    return int(np.argmin(np.abs(steps)))


def _best(sums: np.ndarray, steps: np.ndarray) -> tuple[Estimate, Estimate, Estimate]:
    """The step at which sums (tiles, steps, 3) correlate best, what that gains over no step, and the correlation."""
    def value(totals: np.ndarray) -> np.ndarray:
        curve = _correlation(totals.reshape(*totals.shape[:-1], len(steps), 3))
        best = curve.max(axis=-1)
        return np.stack([_peak(curve, steps), best - curve[..., _zero(steps)], best], axis=-1)

    numbers, errors = jackknife(value, sums.reshape(len(sums), -1))
    shift, gain, best = (Estimate(float(a), float(b)) for a, b in zip(numbers, errors, strict=True))
    return shift, gain, best


def _peak(curve: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Where curves (..., steps) have their peak, by the parabola through the three points around it."""
    middle = np.clip(curve.argmax(axis=-1), 1, len(steps) - 2)
    before, at, after = (np.take_along_axis(curve, (middle + k)[..., None], -1)[..., 0] for k in (-1, 0, 1))
    left, right = steps[middle] - steps[middle - 1], steps[middle + 1] - steps[middle]
    rise, fall = (at - before) / left, (after - at) / right
    bend = (rise - fall) / (left + right)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = (rise - bend * left) / (2 * bend)
    return steps[middle] + np.where(bend > 0, np.clip(np.nan_to_num(step), -left, right), 0.0)


def foreign_share(left: np.ndarray, right: np.ndarray, disparity: np.ndarray, visible: np.ndarray) -> Estimate:
    """Of the places of the left image (H, W) that are found in the right one beyond doubt, the share that is not
    where the true ``disparity`` has them.

    On images made small, which takes noise out. NaN where too few places are found.
    """
    step = max(1, round(left.shape[1] / _SMALL_PX))
    left, right, true, seen = (_reduced(image, step) for image in (
        _finite(left), _finite(right), np.where(visible, disparity, 0.0) / step, visible))
    where, column = seen > 0.999, matching_column(true)
    if where.sum() < FEWEST:
        return Estimate()
    left, right = _blurred(left), _blurred(right)
    contrast = _contrast(left, where)
    fits = np.stack([_local_correlation(contrast, _contrast(warped(right, column + shift), where), where
                                        & (column + shift >= 0) & (column + shift <= left.shape[1] - 1))
                     for shift in _SEARCH_PX])
    here = fits[np.abs(_SEARCH_PX) <= 1].max(axis=0)
    found = where & (fits.max(axis=0) > _FOUND)
    sums = tile_sums(found & (fits.max(axis=0) > here + _BETTER), found)
    if np.count_nonzero(sums[:, 1]) < FEWEST_TILES:
        return Estimate()
    (value,), (error,) = jackknife(lambda total: total[..., :1] / total[..., 1:], sums)
    return Estimate(float(value), float(error))


def _local_correlation(contrast: np.ndarray, other: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Correlation around each pixel, of the pixels where both are known; 0 where these are few or without contrast."""
    share, first, second = where.astype(np.float64), contrast * where, other * where
    energy, other_energy, both = (_smoothed(image, _PLACE_PX) for image in (first ** 2, second ** 2, first * second))
    told = (_smoothed(share, _PLACE_PX) > 0.5) & (np.minimum(energy, other_energy) > _TEXTURED)
    return np.where(told, both / np.sqrt(np.where(told, energy * other_energy, 1.0)), 0.0)


def _reduced(image: np.ndarray, step: int) -> np.ndarray:
    """Means of squares of ``step`` pixels."""
    height, width = (size // step for size in image.shape)
    return np.asarray(image[:height * step, :width * step].reshape(height, step, width, step).mean(axis=(1, 3)))
