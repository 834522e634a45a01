"""Contrast of text in screenshots, as WCAG 2 defines it; numpy alone, since it runs inside Blender."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[Any]
#: Largest difference of a channel from the background that is not text, of 255.
_MIN_STEP = 24
#: Columns without text that end a word; rows of the smallest and of the largest letters.
_GAP_PX, _LETTER_PX = 9, (4, 18)
#: Share of a word's pixels that are taken for its ink: thin strokes mix with the background.
_INK_SHARE = 0.1


class Word(NamedTuple):
    """A piece of text: its first row, row after the last, first and last column, and its contrast ratio."""

    top: int
    bottom: int
    left: int
    right: int
    ratio: float


def find_luminance(picture: Pixels) -> Pixels:
    """Relative luminance, 0 to 1, of uint8 sRGB pixels (…, 3)."""
    shown = picture[..., :3].astype(float) / 255
    light = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    return np.asarray(light @ np.array([0.2126, 0.7152, 0.0722]))


def measure_words(picture: Pixels) -> list[Word]:
    """The pieces of text on one plain background in a picture, uint8 (H, W, 3), with the contrast of each."""
    flat = picture[..., :3].reshape(-1, 3)
    colours, counts = np.unique(flat, axis=0, return_counts=True)
    background = colours[counts.argmax()].astype(int)
    differs = np.abs(picture[..., :3].astype(int) - background).max(axis=-1) > _MIN_STEP
    light, paper = find_luminance(picture), float(find_luminance(background.astype(np.uint8)))
    words = []
    for top, bottom in _find_runs(differs.any(axis=1), 1):
        if not _LETTER_PX[0] <= bottom - top <= _LETTER_PX[1]:
            continue
        for left, right in _find_runs(differs[top:bottom].any(axis=0), _GAP_PX):
            inked = light[top:bottom, left:right][differs[top:bottom, left:right]]
            ratios = np.sort((np.maximum(inked, paper) + 0.05) / (np.minimum(inked, paper) + 0.05))
            words.append(Word(top, bottom, left, right, float(ratios[-max(1, int(_INK_SHARE * ratios.size)) :].mean())))
    return words


def _find_runs(marked: Pixels, gap: int) -> list[tuple[int, int]]:
    """First index and index after the last of each run of marked ones; gaps shorter than ``gap`` do not end a run."""
    where = np.flatnonzero(marked)
    if not where.size:
        return []
    ends = np.flatnonzero(np.diff(where) > gap)
    starts = np.concatenate([[0], ends + 1])
    return [(int(where[a]), int(where[b]) + 1) for a, b in zip(starts, np.append(ends, where.size - 1), strict=True)]
