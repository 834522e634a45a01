"""Short texts in pictures, drawn with strokes in NumPy, because Blender has no OpenCV."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...support.arrays import Array

# Rows of the grid of a letter: below the letters, in the height of capitals, and in total.
_ROWS_BELOW, _CAPITAL_ROWS, _GRID_ROWS = 2, 6, 9
_GAP_COLUMNS = 2  # columns between letters, and half a space
#: Strokes of each character, as points with a digit for the column and a digit for the row, counted from below.
_STROKES = {
    "0": "120307183847433212",
    "1": "062822",
    "2": "0718384746 0242 4602",
    "3": "07183847463515 3544433212 1203",
    "4": "32380444",
    "5": "480805354443321203",
    "6": "4738180703123243443505",
    "7": "084812",
    "8": "15060718384746351504031232434435",
    "9": "45150607183847433212",
    "a": "4642 4536160503123243",
    "b": "0802 0516364543321203",
    "c": "4536160503123243",
    "d": "4842 4536160503123243",
    "e": "04444536160503123243",
    "f": "38281712 0636",
    "g": "4641301001 4536160503123243",
    "h": "0802 0516364542",
    "i": "0602 0808",
    "j": "161100 1818",
    "k": "0802 0436 1532",
    "l": "0802",
    "m": "0602 0516263532 3546566562",
    "n": "0602 0516364542",
    "o": "120305163645433212",
    "p": "0600 0516364543321203",
    "q": "4640 4536160503123243",
    "r": "0602 051636",
    "s": "461605143443 4332 3202",
    "t": "18132232 0636",
    "u": "0603123243 4642",
    "v": "062246",
    "w": "0612365266",
    "x": "0642 0246",
    "y": "0622 4610",
    "z": "06460242",
    "D": "02083847433202",
    "E": "48080242 0535",
    "L": "080242",
    "R": "02083847463505 2542",
    "T": "0848 2822",
    "N": "02084248",
    "S": "4738180706153544433212 1203",
    ".": "0212 0313",
    ",": "1201",
    "-": "0444",
    "|": "0900",
    "(": "19070311",
    ")": "09171301",
    "+": "0444 2622",
    "/": "0048",
    "%": "0248 0708181707 3233434232",
}


@lru_cache(maxsize=64)
def draw_text(text: str, height_px: float) -> Array:
    """Draw a text in a strip: the share of each pixel that strokes cover, float32 (rows, columns).

    ``height_px`` is the height of capitals; the strip is half as high again. A character without strokes is a space.
    """
    unit, across = height_px / _CAPITAL_ROWS, 1
    lines = []
    for character in text:
        strokes = [
            np.array([(int(a), int(b)) for a, b in zip(s[::2], s[1::2], strict=True)], float)
            for s in _STROKES.get(character, "").split()
        ]
        lines += [points + np.array([across, 0]) for points in strokes]
        across += _GAP_COLUMNS + int(max((points[:, 0].max() for points in strokes), default=_GAP_COLUMNS))
    covered = np.zeros((round((_GRID_ROWS + 1) * unit), max(1, round(across * unit))), np.float32)
    for points in lines:
        x, y = points[:, 0] * unit, (_GRID_ROWS + 0.5 - points[:, 1]) * unit
        for k in range(max(1, len(points) - 1)):
            end = min(k + 1, len(points) - 1)
            _draw_stroke(covered, (x[k], y[k]), (x[end], y[end]), 0.5 * max(unit, 1.0))
    return covered


def _draw_stroke(covered: Array, start: tuple[float, float], end: tuple[float, float], radius: float) -> None:
    """Draw a round-ended line with this ``radius`` and soft edges one pixel wide."""
    (x0, y0), (x1, y1), reach = start, end, radius + 1
    left, right = max(0, int(min(x0, x1) - reach)), int(max(x0, x1) + reach) + 1
    top, bottom = max(0, int(min(y0, y1) - reach)), int(max(y0, y1) + reach) + 1
    part = covered[top:bottom, left:right]
    x = np.arange(part.shape[1]) + left + 0.5 - x0
    y = (np.arange(part.shape[0]) + top + 0.5 - y0)[:, None]
    length = (x1 - x0) ** 2 + (y1 - y0) ** 2
    along = np.clip((x * (x1 - x0) + y * (y1 - y0)) / (length or 1.0), 0.0, 1.0)
    distance = np.hypot(x - along * (x1 - x0), y - along * (y1 - y0))
    np.maximum(part, np.clip(radius + 0.5 - distance, 0.0, 1.0), out=part)


def put_text(picture: Array, text: str, left: int, baseline: int, height_px: float, level: int) -> None:
    """Write a text in a grey ``level`` onto a picture (H, W, 3) uint8, in place, cut at its edges."""
    covered = draw_text(text, height_px)
    top = baseline - round((_GRID_ROWS + 0.5 - _ROWS_BELOW) * height_px / _CAPITAL_ROWS)
    inside = covered[max(0, -top) :, max(0, -left) :]
    part = picture[max(0, top) :, max(0, left) :][: inside.shape[0], : inside.shape[1]]
    share = inside[: part.shape[0], : part.shape[1], None]
    part[:] = np.rint(part + share * (level - part.astype(np.float32)))


def measure_text_width_px(text: str, height_px: float) -> int:
    """Measure the columns that a text takes."""
    return int(draw_text(text, height_px).shape[1])
