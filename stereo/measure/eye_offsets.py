"""Offsets between the two eyes of a pair, each with its standard error.

There are two independent tests. The **truth** of both eyes has no noise: a point has the same disparity in both, except
for rounding. So a wrong f·B, a shift or a shifted row is visible wherever there is relief, in any light. The **light**
shows whether the images belong to that truth. It has noise, shadows, and glints that each eye sees in another place. It
is therefore compared by its local contrast, limited so that no glint outweighs the ground, and the jackknife over tiles
gives every number a standard error. Undetermined numbers are NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from ...physics.camera.occlusion import find_matching_column, sample_at_columns
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from .jackknife import jackknife, sum_over_tiles

#: Shifts of the right image, px, to try along the rows and across them.
SHIFTS_PX = np.arange(-3.0, 3.01, 0.5)
ROWS_PX = np.arange(-2.0, 2.1)
#: Fewest pixels for a result.
FEWEST_PIXELS = 100
#: Blur, px, that reduces the noise of single pixels, and the width over which contrast is computed. Shading that
#: depends on the direction of view varies over larger widths, so the contrast does not contain it.
_BLUR_PX, _CONTRAST_PX = 0.8, 3.5
#: Contrast below which light counts as noise: as a share of the local brightness, and of the whole image's brightness.
_MIN_LOCAL_CONTRAST, _MIN_GLOBAL_CONTRAST = 0.02, 1e-3
#: Correlation of the light from which on the images belong to their depth.
FITTING_CORRELATION = 0.6
#: Fewest tiles for a number that is used.
FEWEST_TILES = 8
#: Number of rows of the truth that suffices, because the truth has no noise. In a higher image only every second, third
#: or nth row is compared.
_ENOUGH_ROWS = 240
#: The search for places of the left image in the right one: the approximate number of columns of the reduced images;
#: the size of a place, px; the least correlation of a found place; and the least excess of this correlation over the
#: correlation at the true disparity. A place has about a hundred grains of noise, of 3 px, so correlations of noise
#: have a standard deviation of 0.1.
_REDUCED_COLUMNS, _PLACE_PX, _FOUND_CORRELATION, _MIN_CORRELATION_GAIN = 160, 6.0, 0.65, 0.15
#: Least mean square of the contrast of a place with texture everywhere. A few bright dots in the dark would match any
#: other dots.
_MIN_TEXTURE = 0.2
#: Shifts, px, at which a place is searched for.
_SEARCH_PX = np.array([*range(-16, -1, 2), -1, 0, 1, *range(2, 17, 2)], float)
#: Difference in disparity, px, below which both eyes see the same point.
_SAME_POINT_PX = 1.0
#: Change of disparity from one column to the next above which they show two surfaces, px.
_SURFACE_STEP_PX = 0.7
#: Deviation, px, due to single precision and to edges of the mesh between two columns.
_ROUNDING_PX = 1e-4
#: Largest relative difference of a disparity between the eyes due to single precision: four roundings.
_ROUNDING_SHARE = 4 * 2.0**-24


@dataclass(frozen=True)
class Estimate:
    """A number and its standard error; both are NaN if it cannot be determined."""

    value: float = float("nan")
    error: float = float("nan")

    def exceeds(self, limit: float, errors: float) -> bool:
        """Return whether the number differs from 0 by more than ``limit`` and by more than ``errors`` standard
        errors.
        """
        return abs(self.value) > max(limit, errors * self.error)  # False for NaN

    @property
    def number(self) -> float | None:
        """The value; None if it is unknown."""
        return self.value if np.isfinite(self.value) and np.isfinite(self.error) else None


@dataclass(frozen=True)
class TruthOffsets:
    """The corrections that make the truth of both eyes agree. Each is computed as if it were the only one."""

    shift_px: Estimate = Estimate()  # shift of the right eye along the rows
    scale: Estimate = Estimate()  # share by which the stated f·B is too large
    rows_px: Estimate = Estimate()  # shift of the right eye along the columns
    likeliest: str = "shift_px"  # the correction that leaves the smallest difference


@dataclass(frozen=True)
class LightOffsets:
    """The shifts at which the light of the right image, moved by the true disparity, fits the left image."""

    shift_px: Estimate = Estimate()  # shift along the rows
    rows_px: Estimate = Estimate()  # shift along the columns
    correlation: float = float("nan")  # at the best shift, 1 for images that agree
    gain: Estimate = Estimate()  # gain of the correlation by that shift
    rows_gain: Estimate = Estimate()
    tiles: float = 0.0  # effective number of tiles with contrast


def measure_truth_offsets(left_depth: Array, right_depth: Array, camera: StereoCamera) -> TruthOffsets:
    """Compare the planar depths (H, W) of both eyes, in m, NaN for sky."""
    rows = slice(None, None, max(1, len(left_depth) // _ENOUGH_ROWS))
    disparity, other = camera.disparity(left_depth[rows]), camera.disparity(right_depth)
    column = find_matching_column(disparity)
    with np.errstate(invalid="ignore"):
        inside = (column >= 1) & (column <= column.shape[1] - 2)
    if inside.sum() < FEWEST_PIXELS:
        return TruthOffsets()
    matching = _ColumnSampler(column, inside)
    along, down = (matching.of(slope) for slope in (_find_row_slope(other[rows].T).T, _find_row_slope(other)[rows]))
    difference = matching.of(other[rows]) - disparity
    with np.errstate(invalid="ignore"):
        known = (
            inside
            & (np.abs(difference) < _SAME_POINT_PX)
            & (np.abs(along) < _SURFACE_STEP_PX)
            & (np.abs(down) < 3 * _SURFACE_STEP_PX)
        )
    if known.sum() < FEWEST_PIXELS:
        return TruthOffsets()
    rounding_px = _ROUNDING_SHARE * _compute_rms(disparity[known])
    difference, disparity, along, down = (np.where(known, each, 0.0) for each in (difference, disparity, along, down))
    # A shift of the right eye by s changes the warped disparity by -s times its slope.
    fits = {
        name: _fit_robustly(slope, difference, known, rounding_px)
        for name, slope in (("shift_px", -along), ("scale", -along * disparity), ("rows_px", -down))
    }
    likeliest = min(fits, key=lambda name: fits[name][1])
    return TruthOffsets(**{name: estimate for name, (estimate, _) in fits.items()}, likeliest=likeliest)


class _ColumnSampler:
    """The fractional columns (H, W) at which images are interpolated linearly."""

    def __init__(self, column: Array, inside: Array) -> None:
        """Set the columns (H, W). Only columns that are ``inside`` an image count, except its outermost columns."""
        column = np.where(inside, column, 0.0)
        whole = np.floor(column)
        self._place = np.arange(column.shape[0])[:, None] * column.shape[1] + whole.astype(np.intp)
        self._weight = column - whole

    def of(self, image: Array) -> Array:
        """Return the image (H, W) at the columns."""
        before, after = (image.ravel()[k:].take(self._place) for k in (0, 1))
        return np.asarray(before + self._weight * (after - before))


def _find_row_slope(image: Array) -> Array:
    """Compute central differences from row to row, NaN in the outermost rows and beside unknown values."""
    slope = np.full_like(image, np.nan)
    slope[1:-1] = (image[2:] - image[:-2]) / 2
    return slope


def _compute_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _fit_robustly(
    slope: Array,
    difference: Array,
    known: Array,
    rounding_px: float,
) -> tuple[Estimate, float]:
    """Fit the factor x in ``difference`` = x · ``slope`` with Tukey's weights; return x and the mean deviation that is
    left.

    Both arrays are 0 unless ``known``. Where an edge falls between two columns, the truth of both eyes differs; the
    weights exclude these outliers. Their scale comes from the pixels that determine x: those with at least half the RMS
    slope, or the steepest hundredth. In a view to the horizon most pixels are far away and have neither slope nor
    difference. If they set the scale, all near pixels would be outliers.
    """
    steep = np.abs(slope[known])
    steepness = _compute_rms(steep)
    least = min(steepness / 2, float(np.quantile(steep, 0.99)))
    telling = (np.abs(slope) >= least) & (slope != 0)
    if telling.sum() < FEWEST_PIXELS:
        return Estimate(), float("inf")
    told_slope, told = slope[telling], difference[telling]
    product, square = slope * difference, slope * slope
    value, error = float(np.median(told / told_slope)), float("nan")
    weight = np.empty_like(slope)
    for _ in range(12):
        scale = 4.5 * max(float(np.median(np.abs(told - value * told_slope))), _ROUNDING_PX)
        # (1 - (rest / scale)²)², and 0 for outliers.
        np.subtract(difference, np.multiply(slope, value, out=weight), out=weight)
        weight *= 1 / scale
        np.maximum(np.subtract(1.0, np.multiply(weight, weight, out=weight), out=weight), 0.0, out=weight)
        weight *= weight
        sums = sum_over_tiles(weight * product, weight * square)
        (new,), (error,) = jackknife(lambda total: total[..., :1] / total[..., 1:], sums)
        done = not abs(new - value) > 1e-6
        value = float(new)
        if done:
            break
    left = float(np.abs(difference - value * slope).sum()) / int(known.sum())
    return Estimate(value, float(np.hypot(error, rounding_px / steepness))), left


def measure_light_offsets(left: Array, right: Array, column: Array, visible: Array) -> LightOffsets:
    """Compare the radiance (H, W) of both eyes: the left where ``visible``, with the right at ``column``."""
    width = column.shape[1]
    with np.errstate(invalid="ignore"):
        where = visible & (column >= 1) & (column <= width - 2)
    if where.sum() < FEWEST_PIXELS:
        return LightOffsets()
    own, shifted = (
        _Contrasts(_blur_and_scale(left), where),
        _ShiftedImage(_blur_and_scale(right), np.where(where, column, 0.0)),
    )

    @cache
    def products(shift_px: float, rows: float) -> Array:
        return own.products(shifted.by(shift_px, int(rows)))

    shift, gain, correlation = _find_best_step(lambda step: products(step, 0.0), SHIFTS_PX)
    rows, rows_gain, _ = _find_best_step(lambda step: products(0.0, step), ROWS_PX)
    energy = products(0.0, 0.0)[:, 1]
    held = float(energy.sum() ** 2 / max((energy**2).sum(), 1e-300))
    return LightOffsets(shift, rows, correlation.value, gain, rows_gain, held)


def measure_light_correlation(image: Array, other: Array, column: Array, visible: Array) -> Estimate:
    """Measure the correlation of one eye's image with the ``other`` eye's image at ``column``: 1 if they agree
    fully.
    """
    with np.errstate(invalid="ignore"):
        where = visible & (column >= 1) & (column <= column.shape[1] - 2)
    if where.sum() < FEWEST_PIXELS:
        return Estimate()
    own, shifted = (
        _Contrasts(_blur_and_scale(image), where),
        _ShiftedImage(_blur_and_scale(other), np.where(where, column, 0.0)),
    )
    sums = own.products(shifted.by(0.0, 0))
    (value,), (error,) = jackknife(lambda total: _compute_correlation(total)[..., None], sums)
    return Estimate(float(value), float(error))


def _zero_if_not_finite(image: Array) -> Array:
    """Return the values in double precision, with 0 for render values that are not finite."""
    return np.nan_to_num(image.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)


def _blur(image: Array) -> Array:
    return np.asarray(cv2.GaussianBlur(_zero_if_not_finite(image), (0, 0), _BLUR_PX))


def _blur_and_scale(image: Array) -> Array:
    """Blur an image and scale its maximum to 1, in single precision. A contrast does not depend on the brightness, and
    the rounding errors are far below the noise of a render.
    """
    blurred = _blur(image)
    return np.asarray(blurred / max(float(blurred.max()), 1e-300), np.float32)


class _ShiftedImage:
    """An image at the fractional columns that match the pixels of another image, and beside them."""

    def __init__(self, image: Array, column: Array) -> None:
        """Set the image and its columns ``column`` (H, W), which lie inside it."""
        self._side_columns, self._above = int(np.ceil(SHIFTS_PX.max())) + 1, int(ROWS_PX.max())
        self._padded = np.pad(image, ((self._above,) * 2, (self._side_columns,) * 2), mode="edge")
        self._width = self._padded.shape[1]
        rows = np.arange(image.shape[0])[:, None] * self._width
        self._places = {}
        for part in np.unique(SHIFTS_PX % 1.0):
            whole = np.floor(column + part)
            self._places[part] = rows + whole.astype(np.intp), (column + part - whole).astype(image.dtype)

    def by(self, shift_px: float, rows: int) -> Array:
        """Return the image (H, W), ``shift_px`` (of SHIFTS_PX) to the right of those columns and ``rows`` below;
        constant beyond its edges.
        """
        place, weight = self._places[shift_px % 1.0]
        start = (self._above + rows) * self._width + self._side_columns + int(np.floor(shift_px))
        before, after = (self._padded.ravel()[start + k :].take(place) for k in (0, 1))
        return np.asarray(before + weight * (after - before))


class _Contrasts:
    """The local contrast of a first image, which is compared with other images over the same pixels."""

    def __init__(self, image: Array, where: Array) -> None:
        self._mask, self._count = where.astype(image.dtype), int(where.sum())
        self._share = np.maximum(_smooth(self._mask, _CONTRAST_PX), 1e-9)
        self.own = self.of(image)
        self._energy = sum_over_tiles(self.own**2)[:, 0]

    def of(self, image: Array) -> Array:
        """Return the brightness of each pixel above the mean around it, in standard deviations of the surroundings,
        limited to 1; 0 where no pixel counts.
        """
        light = image * self._mask
        light /= max(float(light.sum(dtype=np.float64)) / self._count, float(np.finfo(light.dtype).tiny))
        mean = _smooth(light, _CONTRAST_PX)
        mean /= self._share
        above = np.multiply(np.subtract(light, mean, out=light), self._mask, out=light)
        spread = _smooth(above * above, _CONTRAST_PX)
        np.sqrt(np.divide(spread, self._share, out=spread), out=spread)
        spread += _MIN_LOCAL_CONTRAST * mean + _MIN_GLOBAL_CONTRAST
        return np.asarray(np.tanh(np.divide(above, spread, out=above), out=above))

    def products(self, image: Array) -> Array:
        """Return the sums (tiles, 3) that ``_compute_correlation`` needs."""
        other = self.of(image)
        both, energy = sum_over_tiles(self.own * other, other * other).T
        return np.stack([both, self._energy, energy], axis=1)


def _smooth(image: Array, width_px: float) -> Array:
    """Return weighted sums around each pixel, with 0 beyond the border. The weights are a Gaussian, because the running
    sums of a box leave rounding errors where it is dark.
    """
    return np.asarray(cv2.GaussianBlur(image, (0, 0), width_px, borderType=cv2.BORDER_CONSTANT))


def _compute_correlation(sums: Array) -> Array:
    """Compute the correlation from sums (..., 3); 0 where the only contrast is rounding."""
    return np.asarray(sums[..., 0] / (np.sqrt(sums[..., 1] * sums[..., 2]) + 1e-6))


def _find_best_step(products: Callable[[float], Array], steps: Array) -> tuple[Estimate, Estimate, Estimate]:
    """Find the step with the best correlation, its gain over step 0, and its correlation.

    ``products`` gives the sums (tiles, 3) at a step. In a sound pair the images fit best at step 0, whichever tile is
    left out. Then only the neighbouring steps are tried, because the peak is found from these alone.
    """
    middle = len(steps) // 2
    for tried in (steps[middle - 1 : middle + 2], steps):
        sums = np.stack([products(step) for step in tried.tolist()], axis=1)
        whole, zero = sums.sum(axis=0), len(tried) // 2
        curves = _compute_correlation(np.concatenate([whole[None], whole - sums]))
        if (curves[:, zero] > FITTING_CORRELATION).all() and (curves.argmax(axis=1) == zero).all():
            break

    def value(totals: Array) -> Array:
        curve = _compute_correlation(totals.reshape(*totals.shape[:-1], len(tried), 3))
        best = curve.max(axis=-1)
        return np.stack([_interpolate_peak(curve, tried), best - curve[..., zero], best], axis=-1)

    numbers, errors = jackknife(value, sums.reshape(len(sums), -1))
    shift, gain, best = (Estimate(float(a), float(b)) for a, b in zip(numbers, errors, strict=True))
    return shift, gain, best


def _interpolate_peak(curve: Array, steps: Array) -> Array:
    """Interpolate the position of the peak of curves (..., steps), by the parabola through the three points
    around it.
    """
    middle = np.clip(curve.argmax(axis=-1), 1, len(steps) - 2)
    before, at, after = (np.take_along_axis(curve, (middle + k)[..., None], -1)[..., 0] for k in (-1, 0, 1))
    left, right = steps[middle] - steps[middle - 1], steps[middle + 1] - steps[middle]
    rise, fall = (at - before) / left, (after - at) / right
    bend = (rise - fall) / (left + right)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = (rise - bend * left) / (2 * bend)
    return steps[middle] + np.where(bend > 0, np.clip(np.nan_to_num(step), -left, right), 0.0)


def measure_foreign_share(left: Array, right: Array, disparity: Array, visible: Array) -> Estimate:
    """Measure the share of reliable matches between the left (H, W) and the right image that contradict the true
    ``disparity``.

    Works on reduced images, which have less noise. NaN if too few places are found.
    """
    step = max(1, round(left.shape[1] / _REDUCED_COLUMNS))
    left, right, true, seen = (
        _reduce(image, step)
        for image in (
            _zero_if_not_finite(left),
            _zero_if_not_finite(right),
            np.where(visible, disparity, 0.0) / step,
            visible,
        )
    )
    where, column = seen > 0.999, find_matching_column(true)
    if where.sum() < FEWEST_PIXELS:
        return Estimate()
    left, right = _blur(left), _blur(right)
    contrasts = _Contrasts(left, where)
    fits = np.stack(
        [
            _compute_local_correlation(
                contrasts.own,
                contrasts.of(sample_at_columns(right, column + shift)),
                where & (column + shift >= 0) & (column + shift <= left.shape[1] - 1),
            )
            for shift in _SEARCH_PX
        ]
    )
    here = fits[np.abs(_SEARCH_PX) <= 1].max(axis=0)
    found = where & (fits.max(axis=0) > _FOUND_CORRELATION)
    sums = sum_over_tiles(found & (fits.max(axis=0) > here + _MIN_CORRELATION_GAIN), found)
    if np.count_nonzero(sums[:, 1]) < FEWEST_TILES:
        return Estimate()
    (value,), (error,) = jackknife(lambda total: total[..., :1] / total[..., 1:], sums)
    return Estimate(float(value), float(error))


def _compute_local_correlation(contrast: Array, other: Array, where: Array) -> Array:
    """Compute the correlation around each pixel over the pixels where both are known; 0 if these are few or have no
    contrast.
    """
    share, first, second = where.astype(np.float64), contrast * where, other * where
    energy, other_energy, both = (_smooth(image, _PLACE_PX) for image in (first**2, second**2, first * second))
    told = (_smooth(share, _PLACE_PX) > 0.5) & (np.minimum(energy, other_energy) > _MIN_TEXTURE)
    return np.where(told, both / np.sqrt(np.where(told, energy * other_energy, 1.0)), 0.0)


def _reduce(image: Array, step: int) -> Array:
    """Average an image over squares of ``step`` pixels."""
    height, width = (size // step for size in image.shape)
    return np.asarray(image[: height * step, : width * step].reshape(height, step, width, step).mean(axis=(1, 3)))
