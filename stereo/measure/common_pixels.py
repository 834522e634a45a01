"""Errors of two methods on the pixels that both measured; only on these can their errors be compared.

The pixels are common to two methods, not to all of them: a method that measures few pixels does not restrict the
comparisons of the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...support.arrays import Array
from .metrics import BAD_RATES, L1_RATES, is_usable
from .prepare_pair import PreparedPair, none_if_not_finite

#: The metrics, all of which are means over pixels or functions of such means; ``metrics`` defines them.
METRICS = ("l1_m", "rmse_m", "l1_rate_10", "si_rmse", "epe_px", "bad_1", "d1")
#: Prefix -> the subset of the common pixels over which its metrics are averaged.
REGIONS = {"": "all of them", "visible_": "those that the right eye sees too"}
#: The numbers of a method beside another method; ``n`` is the number of common pixels.
NUMBERS = tuple(prefix + key for prefix in REGIONS for key in ("n", *METRICS))


def measure_common_pixels(
    prepared: PreparedPair, disparities: Mapping[str, Array]
) -> dict[str, dict[str, dict[str, Any]]]:
    """Measure ``NUMBERS`` of each method on the pixels that it shares with each other method; return them by the labels
    of both.

    An undefined number is None.
    """
    known = is_usable(prepared.truth)
    visible = prepared.visible[known] & prepared.occlusion_known
    measured = {label: is_usable(disparity[known]) for label, disparity in disparities.items()}
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for label, disparity in disparities.items():
        terms = _make_error_terms(prepared, disparity[known], prepared.truth[known], measured[label])
        found[label] = {}
        for other in (other for other in measured if other != label):
            both = measured[label] & measured[other]
            found[label][other] = {
                prefix + key: value
                for prefix, pixels in (("", both), ("visible_", both & visible))
                for key, value in _average_terms(terms, pixels).items()
            }
    return found


def _make_error_terms(prepared: PreparedPair, disparity: Array, truth: Array, measured: Array) -> Array:
    """Make the terms that are averaged over pixels (terms, pixels); 0 where nothing was measured."""
    camera = prepared.pair.camera
    true_disparity = camera.disparity(truth)
    disparity = np.where(measured, disparity, true_disparity)
    depth = np.where(measured, prepared.depth_camera.depth(disparity), truth)
    terms = np.empty((8, truth.size))
    np.abs(depth - truth, out=terms[0])
    np.subtract(np.log(depth), np.log(truth), out=terms[3])
    np.abs(disparity - true_disparity, out=terms[5])
    error, ratio, pixels = terms[0], terms[3], terms[5]
    np.multiply(error, error, out=terms[1])
    terms[2] = error > L1_RATES["l1_rate_10"]
    np.multiply(ratio, ratio, out=terms[4])
    terms[6] = pixels > BAD_RATES["bad_1"]
    terms[7] = (pixels > 3) & (pixels > 0.05 * true_disparity)
    return terms


def _average_terms(terms: Array, pixels: Array) -> dict[str, Any]:
    n = int(pixels.sum())
    if not n:
        return {"n": 0, **dict.fromkeys(METRICS)}
    error, square, rate, ratio, ratio_square, epe, bad, d1 = (terms @ pixels.astype(np.float64) / n).tolist()
    numbers = (error, math.sqrt(square), rate, math.sqrt(max(0.0, ratio_square - ratio**2)), epe, bad, d1)
    return {"n": n, **{key: none_if_not_finite(value) for key, value in zip(METRICS, numbers, strict=True)}}
