"""Pictures of depth and error in colours, and the colour bars below them.

The scales are logarithmic. The depth scale spans the true depth of the pair. The error scale is the same for all pairs
and methods, so that pictures can be compared; its middle is 10 cm, the threshold of the L1-rate-10. Viridis and magma
are perceptually uniform (N. Smith and S. van der Walt, public domain).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ...support.arrays import Array, Numbers
from .lettering import measure_text_width_px, put_text

INVALID_GREY = 150  # no measurement
SKY_GREY = 60  # no truth to compare with

_STRIP_PX = 44  # height of the colour bar under a picture, at size 1

#: Colour maps: RGB of every fifth of 256 levels. Interpolated levels differ from the original by at most one step.
VIRIDIS = (
    "44015446085c471063481769481d6f482475472a7a46307e453781433d844142873f48893d4e8a3a538b38598c355e8d33638d31688e"
    "2e6d8e2c718e2a768e297b8e27808e25848e23898e218e8d20928c1f978b1e9c891fa18821a58524aa8328ae802eb37c35b7793dbc74"
    "46c06f50c46a5ac86465cb5e70cf577cd25089d54895d840a2da37b0dd2fbddf26cae11fd8e219e5e419f1e51dfde725"
)
MAGMA = (
    "00000402020b0504160907200e0b2b140e361a104221114e29115a311165390f6e420f754a107952137c5a167e6219806a1c81721f81"
    "792282812581892881912b81992d80a1307eaa337db2357bba3878c23b75ca3e72d2426fd9466be04c67e75263ec5860f1605df4695c"
    "f7725cf97b5dfb8560fc8e64fd9869fea16efeaa74feb47bfebd82fec68afecf92fed89afde2a3fdebacfcf4b6fcfdbf"
)


@lru_cache(maxsize=2)
def _read_colormap(colormap: str) -> Array:
    """Read a colour map as BGR uint8 (256, 3)."""
    stops = np.frombuffer(bytes.fromhex(colormap), np.uint8).reshape(-1, 3)
    at = np.linspace(0, 255, len(stops))
    return np.stack([np.rint(np.interp(np.arange(256), at, stops[:, k])) for k in (2, 1, 0)], axis=1).astype(np.uint8)


#: Share of a scale near each of its ends where only the end has a label.
_END_SHARE = 0.09


@dataclass(frozen=True)
class Scale:
    """A logarithmic colour scale from ``low`` to ``high`` metres."""

    low: float
    high: float
    colormap: str = VIRIDIS
    title: str = "Depth (m), log scale"

    @property
    def ticks(self) -> tuple[float, ...]:
        """Round numbers that label the scale."""
        return _choose_ticks(self.low, self.high)

    @property
    def labels(self) -> list[tuple[float, str]]:
        """Labels as positions from 0 to 1 and texts: both ends, with three digits, and the ticks that are not close to
        an end.
        """
        inner = [(float(self.position(tick)), f"{tick:g}") for tick in self.ticks]
        ends = [(0.0, f"{self.low:.3g}"), (1.0, f"{self.high:.3g}")]
        return [ends[0], *(each for each in inner if _END_SHARE < each[0] < 1 - _END_SHARE), ends[1]]

    def position(self, value: Numbers) -> Array:
        """Return the positions of values on the scale, from 0 to 1; values beyond its ends are put at the ends."""
        logarithm = np.log(np.maximum(value, np.finfo(np.float64).tiny))
        return np.clip((logarithm - math.log(self.low)) / math.log(self.high / self.low), 0.0, 1.0)

    def colours(self, value: Array, greys: Mapping[int, Array] | None = None) -> Array:
        """Colour values (H, W), BGR uint8 (H, W, 3). ``greys`` are masks by grey level, which replace the colours; the
        last mask wins. NaN outside the masks gets an arbitrary colour.
        """
        held = np.fmin(np.fmax(value, self.low), self.high).astype(np.float32)
        steps = (np.log(held) - np.float32(math.log(self.low))) * np.float32(255 / math.log(self.high / self.low))
        level = np.rint(steps).astype(np.int16)
        table = _read_colormap(self.colormap)
        for k, where in enumerate((greys or {}).values()):
            np.copyto(level, len(table) + k, where=where)
        greyscale = np.array([[grey] * 3 for grey in greys or ()], np.uint8).reshape(-1, 3)
        return np.take(np.concatenate([table, greyscale]), level, axis=0)  # far faster than an index

    def gradient(self, stops: int = 17) -> list[str]:
        """Return CSS colours at equal steps along the scale."""
        level = np.rint(np.linspace(0, 255, stops)).astype(np.uint8)
        return [f"rgb({r},{g},{b})" for b, g, r in _read_colormap(self.colormap)[level].tolist()]


ERROR_SCALE = Scale(0.01, 1.0, MAGMA, "|depth error| (m), log scale")
#: The scale of confidences: a confidence c is the expected error -ln c px.
CONFIDENCE_SCALE = Scale(0.03, 3.0, MAGMA, "Expected error (px), log scale")


_DEPTH_QUANTILES = (0.01, 0.99)
#: Words of a legend for the ends of a scale of depths, beyond which the colours do not change.
DEPTH_ENDS = "ends at 1 and 99 %"


def make_depth_scale(truth: Array) -> Scale:
    """Make the scale for a pair's depths: from the 1st to the 99th percentile of its true depth (m), wider for flat
    ground.
    """
    known = truth[np.isfinite(truth)]
    if not known.size:
        return Scale(1.0, 10.0)
    low, high = (float(q) for q in np.quantile(known, _DEPTH_QUANTILES))
    if high < low * 1.05:
        return Scale(low / 1.05, high * 1.05)
    return name_depth_scale(low, high, float(known.min()), float(known.max()))


def name_depth_scale(low: float, high: float, nearest: float, farthest: float) -> Scale:
    """Make the scale from ``low`` to ``high`` for depths from ``nearest`` to ``farthest``, all in metres. Its title
    states percentiles if depths lie beyond an end.
    """
    cut = nearest < low or high < farthest
    return Scale(low, high, title=f"Depth (m), log, {DEPTH_ENDS}" if cut else Scale.title)


def draw_depth(depth: Array, scale: Scale) -> Array:
    """Draw planar depth (m) as a BGR picture; INVALID_GREY where the depth is unknown."""
    return scale.colours(depth, {INVALID_GREY: ~np.isfinite(depth)})


def draw_true_depth(truth: Array, scale: Scale) -> Array:
    """Draw the true planar depth (m) as a BGR picture; SKY_GREY for sky."""
    return scale.colours(truth, {SKY_GREY: ~np.isfinite(truth)})


def draw_error(prediction: Array, truth: Array) -> Array:
    """Draw |prediction - truth| as a BGR picture on ERROR_SCALE; SKY_GREY without a truth, INVALID_GREY without a
    prediction.
    """
    return ERROR_SCALE.colours(
        np.abs(prediction - truth), {INVALID_GREY: ~np.isfinite(prediction), SKY_GREY: ~np.isfinite(truth)}
    )


def draw_confidence(confidence: Array, measured: Array) -> Array:
    """Draw confidences (H, W) from 0 to 1 as a BGR picture of expected errors on CONFIDENCE_SCALE. A low confidence is
    bright, like a large error. Pixels that are not ``measured`` are INVALID_GREY.
    """
    expected = -np.log(np.maximum(confidence, np.finfo(np.float32).tiny))
    return CONFIDENCE_SCALE.colours(expected, {INVALID_GREY: ~measured})


#: RGB of a measurement that is too near, too far, and right.
_TOO_NEAR, _TOO_FAR, _RIGHT = (0x2B, 0x5F, 0xC4), (0xC4, 0x2B, 0x2B), (0xF4, 0xF4, 0xF4)


def colour_signed_errors(error_m: Array, full_m: float = ERROR_SCALE.high, right_m: float = ERROR_SCALE.low) -> Array:
    """Colour signed depth errors, RGB uint8 (n, 3): blue for too near, red for too far, white below ``right_m``,
    INVALID_GREY for NaN. The scale is logarithmic, as in the error pictures; from ``full_m`` on the colour is full.
    """
    scale = replace(ERROR_SCALE, low=right_m, high=full_m)
    amount = scale.position(np.nan_to_num(np.abs(error_m.astype(np.float64))))[:, None]
    end = np.where(np.nan_to_num(error_m)[:, None] < 0, _TOO_NEAR, _TOO_FAR)
    colours = np.rint(_RIGHT + amount * (end - np.array(_RIGHT)))
    return np.where(np.isnan(error_m)[:, None], INVALID_GREY, colours).astype(np.uint8)


#: Colours, BGR, of a pixel's outcome: accepted, then the reasons for a rejection.
_OUTCOME_COLOURS = (
    (235, 206, 166),
    (128, 128, 128),
    (0, 94, 213),
    (160, 105, 192),
    (0, 159, 230),
    (115, 158, 0),
    (66, 66, 66),
    (66, 228, 240),
)


def draw_outcomes(flags: Array, shape: tuple[int, ...]) -> Array:
    """Draw each pixel's outcome as a BGR picture (H, W) of ``shape``, from ``flags`` (h, w) of any size."""
    colours = np.array(_OUTCOME_COLOURS, np.uint8)[flags.astype(np.intp) % len(_OUTCOME_COLOURS)]
    row, column = (np.arange(wanted) * had // wanted for wanted, had in zip(shape, flags.shape, strict=True))
    return np.asarray(colours[row[:, None], column])


def make_outcome_legend(counts: Mapping[str, int]) -> list[tuple[str, str, float]]:
    """Make the legend of outcomes: (name, CSS colour, share) of each that occurs, in the order of ``counts``, the
    number of pixels by outcome.
    """
    total = sum(counts.values())
    return [
        (name, "rgb({2},{1},{0})".format(*_OUTCOME_COLOURS[k % len(_OUTCOME_COLOURS)]), count / total)
        for k, (name, count) in enumerate(counts.items())
        if count
    ]


def add_colour_bar(picture: Array, scale: Scale) -> Array:
    """Return the picture with the scale's colour bar, ticks and title in a strip below it."""
    return np.vstack([picture, draw_colour_bar(picture.shape[1], scale)])


def draw_colour_bar(width: int, scale: Scale, size: float = 1.0, ink: int = 0, paper: int = 255) -> Array:
    """Draw the colour bar of a scale, with ticks and title: BGR (``_STRIP_PX`` times ``size``, ``width``, 3).

    ``ink`` is the grey level of ticks and text, and ``paper`` the grey level of the background.
    """

    def px(length: float) -> int:
        return round(length * size)

    strip = np.full((px(_STRIP_PX), width, 3), paper, np.uint8)
    left = min(px(8), width // 4)
    right = width - 1 - left
    strip[px(4) : px(16), left : right + 1] = _read_colormap(scale.colormap)[
        np.rint(np.linspace(0, 255, right - left + 1)).astype(np.intp)
    ]
    letter = 8 * size
    taken: list[tuple[int, int]] = []
    first, *inner, last = scale.labels
    for share, text in (first, last, *inner):
        column = left + round(share * (right - left))
        extent = measure_text_width_px(text, letter)
        start = min(max(column - extent // 2, 2), width - extent - 2)
        strip[px(16) : px(19), min(column, width - px(1)) :][:, : px(1)] = ink
        # A small picture has room for some numbers only.
        if all(start >= end + px(4) or start + extent + px(4) <= begin for begin, end in taken):
            put_text(strip, text, start, px(28), letter, ink)
            taken.append((start, start + extent))
    put_text(strip, scale.title, left, px(40), letter, round(ink + 0.2 * (paper - ink)))
    return strip


def _choose_ticks(low: float, high: float) -> tuple[float, ...]:
    """Choose round numbers between low and high: 1, 3 or 1, 2, 5 times powers of ten, or equal steps if too few of them
    fit.
    """
    digits = (1, 3) if high >= 100 * low else (1, 2, 5)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    series = tuple(t for t in (m * 10.0**d for d in decades for m in digits) if low <= t <= high)
    if len(series) >= 4:
        return series
    rough = (high - low) / 4
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough)
    first = math.ceil(low / step)
    return tuple(round(i * step, 12) for i in range(first, math.floor(high / step) + 1))
