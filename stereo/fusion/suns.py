"""Joins the disparities of one view under several Suns, or of several images under one Sun."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Distance from the median, px, within which a disparity agrees with it. It is a choice: right matches err by a few
#: tenths of a pixel, and false matches by many pixels.
AGREES_PX = 1.0
#: Fewest disparities that must agree.
FEWEST_AGREEING = 2


def join_disparities(disparities: Array) -> Array:
    """Join disparity maps (n, H, W) of one view into one (H, W), px: the mean of the values that agree with the median.

    It is NaN where fewer than ``FEWEST_AGREEING`` agree; a single map is returned unchanged. The median of an even
    number is the lower of its middle two, so that two matches that contradict each other do not agree on a value
    between them.
    """
    if len(disparities) == 1:
        return np.asarray(disparities[0])
    known = np.isfinite(disparities)
    count = known.sum(axis=0)
    ordered = np.sort(np.where(known, disparities, np.inf), axis=0)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)
    agrees = np.abs(disparities - np.where(count > 0, middle, np.nan)) <= AGREES_PX
    number = agrees.sum(axis=0)
    total = np.where(agrees, disparities, 0.0).sum(axis=0)
    return np.where(number >= FEWEST_AGREEING, total / np.maximum(number, 1), np.nan)
