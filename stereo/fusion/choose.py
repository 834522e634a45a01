"""Chooses between stereo and an interpolation of range points, pixel by pixel.

The points count as the truth. Stereo's error at a point is its difference from the point. The interpolation's error is
the difference of its prediction from the other points, see ``Interpolation.predict_left_out``. Both errors give, in
each place:

* the share of stereo's disparities that are wrong. Where a matcher rejects many disparities, it also accepts many wrong
  ones. So the share begins with the rejected share of the surroundings, and the points correct its level, nearby and as
  a whole;
* the scale of the interpolation's errors, which have Student's law with 3 degrees of freedom.

Where the two differ much, one is wrong. Bayes' rule gives the probability of an error above 1 px for each, and the one
with the smaller probability is taken. Where stereo is taken and the two agree, their mean is better than either.
Finally the same choice is made at each point without that point, with a weaker or stronger preference for stereo.
Another preference is used if it surely has fewer errors there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ...support.arrays import Array
from .interpolate import Interpolation
from .range_points import RangePoints

#: Error, px, above which a disparity is wrong, as in bad-1.
_WRONG_PX = 1.0
#: Share of wrong disparities where stereo rejects nothing, its increase per rejected share, and the side, px, of the
#: square in which rejected pixels are counted.
_MIN_WRONG, _WRONG_PER_REJECTED, _SQUARE_PX = 0.03, 0.5, 15
#: Weights of the image's means beside the points nearby: wrong disparities, and points for errors of the interpolation.
_WEIGHT_WRONG, _WEIGHT_POINTS = 1.0, 4.0
#: Usual error, px, of stereo's right disparities, and the weight of this value in points.
_USUAL_STEREO_PX, _WEIGHT_STEREO = 0.3, 4.0
#: Size of wrong disparities' errors as a share of the range of disparities, and this value's weight in wrong points.
_WRONG_SIZE, _WEIGHT_WRONG_SIZE = 0.25, 2.0
#: Ratio of the scale of Student's law to the geometric mean of errors, and the least error, px, in this mean.
_SCALE_PER_MEAN, _MIN_ERROR_PX = 1.2, 0.1
#: Beyond this multiple of the local distance between points, the scale of errors grows with the distance from the
#: nearest point, and a preference found at the points does not apply.
_FAR = 2.0
#: Stereo and the interpolation are averaged if they differ by at most this, px.
_AGREES_PX = 2.0
#: Preferences for stereo, as a difference of two probabilities. The first is used unless another is better by ``_SURE``
#: standard errors with ``_DOUBTED`` more points in doubt, because three of three points may be chance.
_PREFERENCES = (0.0, -1.0, -0.5, -0.2, -0.1, -0.03, 0.03, 0.1, 0.2, 0.5, 1.0)
_SURE, _DOUBTED = 1.5, 4.0
#: With this factor, the tail of the logistic law approximates the normal law's within 0.01.
_LOGISTIC = 1.702


@dataclass(frozen=True)
class _Beliefs:
    """Expected errors of both sources: numbers, or fields of one shape."""

    wrong: Array  # share of stereo's disparities that are wrong
    scale_px: Array  # of the interpolation's errors
    stereo_px: float  # standard deviation of stereo's errors where it is not wrong
    wrong_px: float  # scale of its errors where it is wrong

    def compare(self, difference: Array) -> Array:
        """Return the probability that stereo is wrong minus the probability that the interpolation is wrong.

        ``difference`` is their difference, px.
        """
        right = (1 - self.wrong) * _student_density(difference, self.scale_px)
        failed = self.wrong * _student_density(difference, np.hypot(self.scale_px, self.wrong_px))
        sound = right / (right + failed)
        stereo = sound * math.erfc(_WRONG_PX / self.stereo_px / math.sqrt(2)) + 1 - sound
        past = (_WRONG_PX - difference) / self.stereo_px
        interpolated = sound / (1 + np.exp(np.clip(_LOGISTIC * past, -50, 50)))
        return np.asarray(stereo - interpolated - (1 - sound) * _student_tail(_WRONG_PX / self.scale_px))


@dataclass(frozen=True)
class _Evidence:
    """Errors of both sources at points (n,), in px; NaN where stereo has no disparity."""

    stereo: Array
    left_out: Array
    between: Array  # stereo minus the interpolation without the point, without a sign
    noise_px: Array  # standard deviation of the points themselves
    rejected: Array  # expected share of wrong disparities of stereo, without knowledge of the points

    @property
    def has(self) -> Array:
        """The points (n,), bool, at which stereo has a disparity."""
        return np.isfinite(self.stereo)

    @property
    def limit_px(self) -> Array:
        """Difference from its range point, px, above which a disparity is wrong.

        The point's noise may cause smaller differences.
        """
        return np.hypot(_WRONG_PX, 2 * self.noise_px)

    @property
    def wrong(self) -> Array:
        """1 where stereo is wrong, else 0; 0 without a disparity."""
        return np.where(self.has, np.abs(self.stereo) > self.limit_px, False).astype(np.float64)


def choose_disparity(stereo: Array, interpolation: Interpolation, expected: Array, points: RangePoints) -> Array:
    """Return disparities (H, W), px: from ``stereo``, from the interpolation (``expected``), or means of both.

    ``stereo`` is NaN where it has none.
    """
    there = np.isfinite(stereo)
    if not there.any():
        return expected
    kept = cv2.blur(there.astype(np.float64), (_SQUARE_PX, _SQUARE_PX), borderType=cv2.BORDER_REFLECT)
    prior = _MIN_WRONG + _WRONG_PER_REJECTED * (1 - kept)
    evidence = _gather(stereo, prior, interpolation, points)
    span = max(16.0, float(np.ptp(stereo[there])))
    level, scale = _estimate_errors(evidence, interpolation, span, True)
    stereo_px, wrong_px = _measure_stereo(evidence, span)

    def fill(values: Array) -> Array:
        return np.clip(interpolation.with_values(values).fill(stereo.shape), values.min(), values.max())

    far = _find_distance(points, stereo.shape) / (_FAR * fill(interpolation.find_spacing().clip(1.0)))
    beliefs = _Beliefs((prior * fill(level)).clip(1e-3, 0.98), fill(scale) * far.clip(1.0), stereo_px, wrong_px)
    worse = beliefs.compare(np.where(there, np.abs(stereo - expected), 0.0))
    level, scale = _estimate_errors(evidence, interpolation, span, False)
    without = _Beliefs((evidence.rejected * level).clip(1e-3, 0.98), scale, stereo_px, wrong_px)
    found = _find_preference(evidence, without.compare(np.nan_to_num(evidence.between)))
    preference = np.where(far <= 1, found, _PREFERENCES[0])
    share = beliefs.scale_px**2 / (beliefs.scale_px**2 + stereo_px**2)  # by the inverses of their variances
    mean = expected + np.where(np.abs(stereo - expected) <= _AGREES_PX, share, 1.0) * (stereo - expected)
    return np.where(there & (worse <= preference), mean, expected)


def _find_distance(points: RangePoints, shape: tuple[int, ...]) -> Array:
    """Return the distance (H, W), px, of each pixel from the nearest point."""
    free = np.ones(shape, np.uint8)
    free[np.rint(points.row).astype(int), np.rint(points.column).astype(int)] = 0
    found = np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), np.float64)
    # OpenCV's last bits differ from call to call. Squares of distances between pixels are whole numbers.
    return np.asarray(np.sqrt(np.rint(found**2)))


def _gather(stereo: Array, prior: Array, interpolation: Interpolation, points: RangePoints) -> _Evidence:
    row, column = np.rint(points.row).astype(int), np.rint(points.column).astype(int)
    at, without = stereo[row, column], interpolation.predict_left_out()
    return _Evidence(
        at - points.disparity, without - points.disparity, np.abs(at - without), points.noise_px, prior[row, column]
    )


def _estimate_errors(
    evidence: _Evidence, interpolation: Interpolation, span_px: float, own: bool
) -> tuple[Array, Array]:
    """Estimate two values at each point, from its neighbours' errors and with ``own`` also its own error.

    They are the ratio of stereo's wrong disparities to their expected number, and the scale, px, of the interpolation's
    errors.
    """
    wrong, due = evidence.wrong, evidence.rejected * evidence.has
    level = (wrong.sum() + _WEIGHT_WRONG) / (due.sum() + _WEIGHT_WRONG)
    near = interpolation.add_neighbours(wrong, own), interpolation.add_neighbours(due, own)
    times = (near[0] + _WEIGHT_WRONG * level) / (near[1] + _WEIGHT_WRONG)
    # The noise of a point is not an error of the interpolation without it.
    square = evidence.left_out**2 - evidence.noise_px**2
    size = np.log(np.sqrt(square.clip(_MIN_ERROR_PX**2, span_px**2)))
    total, count = interpolation.add_neighbours(size, own), interpolation.add_neighbours(np.ones_like(size), own)
    mean = (total + _WEIGHT_POINTS * size.mean()) / (count + _WEIGHT_POINTS)
    return times, _SCALE_PER_MEAN * np.exp(mean)


def _measure_stereo(evidence: _Evidence, span_px: float) -> tuple[float, float]:
    """Measure the standard deviation of stereo's right disparities and the mean error of the wrong ones, in px."""
    wrong = evidence.wrong > 0
    sound = evidence.has & ~wrong
    square = (evidence.stereo**2 - evidence.noise_px**2)[sound].clip(0, _WRONG_PX**2)
    usual = (square.sum() + _WEIGHT_STEREO * _USUAL_STEREO_PX**2) / (len(square) + _WEIGHT_STEREO)
    size = np.abs(evidence.stereo[wrong]).clip(None, span_px)
    wrong_px = (size.sum() + _WEIGHT_WRONG_SIZE * _WRONG_SIZE * span_px) / (len(size) + _WEIGHT_WRONG_SIZE)
    return math.sqrt(usual), float(wrong_px)


def _find_preference(evidence: _Evidence, worse: Array) -> float:
    """Find the preference with the fewest errors at the points, if they are surely fewer than with the first
    preference.
    """
    stereo = ~evidence.has | (evidence.wrong > 0)
    interpolated = np.abs(evidence.left_out) > evidence.limit_px
    wrong = np.array(
        [np.where(evidence.has & (worse <= each), stereo, interpolated).astype(np.float64) for each in _PREFERENCES]
    )
    gain = wrong[0] - wrong
    total = gain.sum(axis=1)
    sure = total > _SURE * np.sqrt((gain**2).sum(axis=1) + _DOUBTED)
    return _PREFERENCES[int(np.argmax(np.where(sure, total, 0.0)))]


def _student_density(value: Array, scale: Array) -> Array:
    """Return the density of Student's t distribution with 3 degrees of freedom and this scale."""
    return np.asarray(2 / (math.pi * math.sqrt(3) * scale) / (1 + (value / scale) ** 2 / 3) ** 2)


def _student_tail(value: Array) -> Array:
    """Return the probability that a value of Student's t distribution with 3 degrees of freedom is farther from 0."""
    part = value / math.sqrt(3)
    return np.asarray(1 - 2 / math.pi * (part / (1 + part**2) + np.arctan(part)))
