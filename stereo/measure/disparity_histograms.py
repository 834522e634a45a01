"""Histograms of disparity errors and of the fractional part of disparities, summed over pairs.

A matcher that fits a curve through few costs prefers whole or half pixels (pixel locking): too many of its disparities
lie there, and its mean error depends on the fractional part of the true disparity (Shimizu and Okutomi 2001).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...support.arrays import Array
from .metrics import is_usable

#: Bounds of the bins of the signed error, px. Larger errors are in the first and the last bin.
ERROR_BOUNDS_PX = np.linspace(-2.0, 2.0, 81)
#: Number of bins of the fractional part, a power of 2; the first is centred on whole pixels. Matchers give sixteenths
#: of a pixel.
FRACTION_BINS = 16
#: Largest error that counts as fine; larger errors are mismatches, which are unrelated to fractional parts.
_MAX_FINE_ERROR_PX = 1.0
#: The histograms and their lengths, all over the measured pixels. ``error`` counts measured minus true disparities.
#: ``part`` and ``true_part`` count the fractional parts of measured and of true disparities. ``fine`` counts pixels
#: with an error below 1 px, by the fractional part of the true disparity, and ``fine_error_px`` sums their signed
#: errors.
HISTOGRAM_LENGTHS = {
    "error": len(ERROR_BOUNDS_PX) + 1,
    "part": FRACTION_BINS,
    "true_part": FRACTION_BINS,
    "fine": FRACTION_BINS,
    "fine_error_px": FRACTION_BINS,
}

Histograms = dict[str, list[float]]


def make_histograms(disparity: Array, true_disparity: Array) -> Histograms:
    """Make the histograms of a disparity map, px, NaN where there is no disparity."""
    both = is_usable(disparity) & is_usable(true_disparity)
    measured, true = disparity[both].astype(np.float64), true_disparity[both].astype(np.float64)
    error, part = measured - true, _find_fraction_bin(true)
    fine = np.abs(error) < _MAX_FINE_ERROR_PX
    # Far faster than sorting, or a search for each error.
    below = [np.count_nonzero(error < bound) for bound in ERROR_BOUNDS_PX]
    return {
        "error": np.diff(below, prepend=0, append=error.size).tolist(),
        "part": np.bincount(_find_fraction_bin(measured), minlength=FRACTION_BINS).tolist(),
        "true_part": np.bincount(part, minlength=FRACTION_BINS).tolist(),
        "fine": np.bincount(part[fine], minlength=FRACTION_BINS).tolist(),
        "fine_error_px": np.bincount(part[fine], error[fine], minlength=FRACTION_BINS).tolist(),
    }


def _find_fraction_bin(disparity: Array) -> Array:
    """Find the bin of the fractional part of a disparity. The remainder is taken first, because a disparity may exceed
    any integer type.
    """
    return np.asarray(np.rint(disparity % 1.0 * FRACTION_BINS).astype(np.intp) & FRACTION_BINS - 1)


def add_histograms(total: Mapping[str, Sequence[float]] | None, more: Mapping[str, Sequence[float]]) -> Histograms:
    """Add two sets of histograms; ``total`` may be None."""
    return {key: np.add(total[key] if total else 0.0, more[key]).tolist() for key in HISTOGRAM_LENGTHS}
