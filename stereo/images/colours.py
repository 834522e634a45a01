"""Pictures of depth and error in colours, and the colour bars below them.

The scales are logarithmic. That of depth spans the true depth of the pair. That of error is the same for all pairs
and methods, so that pictures can be compared; its middle is 10 cm, the threshold of the L1-rate-10. Viridis and magma
are perceptually uniform.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

INVALID_GREY = 150  # no measurement
SKY_GREY = 60  # no truth to compare with

_STRIP_PX = 44  # height of the colour bar under a picture


@dataclass(frozen=True)
class Scale:
    """A logarithmic colour scale from ``low`` to ``high`` metres."""

    low: float
    high: float
    colormap: int = cv2.COLORMAP_VIRIDIS
    title: str = "Depth (m), log scale"

    @property
    def ticks(self) -> tuple[float, ...]:
        """Round numbers that label the scale."""
        return _ticks(self.low, self.high)

    def position(self, value: np.ndarray | float) -> np.ndarray:
        """Where values lie on the scale, from 0 to 1; values beyond its ends lie at the ends."""
        logarithm = np.log(np.maximum(value, np.finfo(np.float64).tiny))
        return np.clip((logarithm - math.log(self.low)) / math.log(self.high / self.low), 0.0, 1.0)

    def colours(self, value: np.ndarray) -> np.ndarray:
        """BGR uint8 (H, W, 3) of values (H, W); NaN gets an arbitrary colour."""
        level = np.rint(self.position(np.nan_to_num(value, nan=self.low)) * 255).astype(np.uint8)
        return np.asarray(cv2.applyColorMap(level, self.colormap))

    def gradient(self, stops: int = 17) -> list[str]:
        """CSS colours at equal steps along the scale."""
        level = np.rint(np.linspace(0, 255, stops)).astype(np.uint8)[None]
        return [f"rgb({r},{g},{b})" for b, g, r in cv2.applyColorMap(level, self.colormap)[0].tolist()]


ERROR = Scale(0.01, 1.0, cv2.COLORMAP_MAGMA, "|depth error| (m), log scale")


def depth_scale(truth: np.ndarray) -> Scale:
    """The scale for a pair's depths: from the 1st to the 99th percentile of its true depth (m)."""
    known = truth[np.isfinite(truth)]
    low, high = (float(q) for q in np.quantile(known, (0.01, 0.99))) if known.size else (1.0, 10.0)
    if high < low * 1.05:
        low, high = low / 1.05, high * 1.05
    return Scale(low, high)


def depth_picture(depth: np.ndarray, scale: Scale) -> np.ndarray:
    """BGR picture of planar depth (m); INVALID_GREY where there is none."""
    return np.where(np.isfinite(depth)[..., None], scale.colours(depth), np.uint8(INVALID_GREY))


def true_depth_picture(truth: np.ndarray, scale: Scale) -> np.ndarray:
    """BGR picture of the true planar depth (m); SKY_GREY for sky."""
    return np.where(np.isfinite(truth)[..., None], scale.colours(truth), np.uint8(SKY_GREY))


def error_picture(prediction: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """BGR picture of |prediction - truth| on the scale ERROR; SKY_GREY and INVALID_GREY elsewhere."""
    picture = ERROR.colours(np.abs(prediction - truth))
    picture[~np.isfinite(prediction)] = INVALID_GREY
    picture[~np.isfinite(truth)] = SKY_GREY
    return picture


#: Colours, BGR, of a pixel's outcome: accepted first, then the reasons for a rejection.
_OUTCOMES = ((235, 206, 166), (128, 128, 128), (0, 94, 213), (160, 105, 192), (0, 159, 230), (115, 158, 0),
             (66, 66, 66), (66, 228, 240))


def outcome_picture(flags: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """BGR picture of ``shape`` (H, W) of each pixel's outcome, from whole numbers (h, w) of any size."""
    colours = np.array(_OUTCOMES, np.uint8)[flags.astype(np.intp) % len(_OUTCOMES)]
    return np.asarray(cv2.resize(colours, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST))


def outcome_legend(counts: Mapping[str, int]) -> list[tuple[str, str, float]]:
    """(name, CSS colour, share) of each outcome that occurs; ``counts``: pixels by name, in the order of the flags."""
    total = sum(counts.values())
    return [(name, "rgb({2},{1},{0})".format(*_OUTCOMES[k % len(_OUTCOMES)]), count / total)
            for k, (name, count) in enumerate(counts.items()) if count]


def with_bar(picture: np.ndarray, scale: Scale) -> np.ndarray:
    """The picture, with the scale's colour bar, ticks and title in a strip below it."""
    width = picture.shape[1]
    strip = np.full((_STRIP_PX, width, 3), 255, np.uint8)
    left = min(8, width // 4)
    right = width - 1 - left
    ramp = np.rint(np.linspace(0, 255, right - left + 1)).astype(np.uint8)[None]
    strip[4:16, left:right + 1] = np.asarray(cv2.applyColorMap(ramp, scale.colormap))
    free_from = 0
    for tick in scale.ticks:
        text = f"{tick:g}"
        column = left + round(float(scale.position(tick)) * (right - left))
        extent = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.36, 1)[0][0]
        start = min(max(column - extent // 2, 2), width - extent - 2)
        strip[16:19, min(column, width - 1)] = 0
        if start >= free_from:  # a small picture has no room for all numbers
            cv2.putText(strip, text, (start, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (0, 0, 0), 1, cv2.LINE_AA)
            free_from = start + extent + 4
    cv2.putText(strip, scale.title, (left, 40), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (60, 60, 60), 1, cv2.LINE_AA)
    return np.vstack([picture, strip])


def _ticks(low: float, high: float) -> tuple[float, ...]:
    """Round numbers between low and high: 1, 3 or 1, 2, 5 times powers of ten, or equal steps if too few fit."""
    digits = (1, 3) if high >= 100 * low else (1, 2, 5)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    series = tuple(t for t in (m * 10.0 ** d for d in decades for m in digits) if low <= t <= high)
    if len(series) >= 4:
        return series
    rough = (high - low) / 4
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough)
    first = math.ceil(low / step)
    return tuple(round(i * step, 12) for i in range(first, math.floor(high / step) + 1))
