"""The measure of contrast by which the window's lane judges screenshots."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "gui"))
from contrast import find_luminance, measure_words


def lettered(paper: int, ink: int) -> np.ndarray:
    """A picture with two words of strokes two pixels wide, whose edges are mixed with the paper."""
    picture = np.full((40, 120, 3), paper, np.uint8)
    for left in (*range(10, 40, 6), *range(70, 100, 6)):
        picture[12:22, left : left + 2] = ink
        picture[12:22, left + 2] = (paper + ink) // 2
    return picture


@pytest.mark.parametrize(("paper", "ink", "ratio"), [(255, 0, 21.0), (0, 255, 21.0), (255, 119, 4.478)])
def test_the_ratio_is_that_of_wcag(paper, ink, ratio):
    words = measure_words(lettered(paper, ink))
    assert [word.top for word in words] == [12, 12]
    assert [word.left for word in words] == [10, 70]
    assert [word.ratio for word in words] == pytest.approx([ratio] * 2, rel=1e-3)


def test_an_empty_picture_has_no_words():
    assert measure_words(np.full((30, 30, 3), 70, np.uint8)) == []


def test_luminance_weighs_the_primaries():
    primaries = 255 * np.eye(3, dtype=np.uint8)
    assert find_luminance(primaries) == pytest.approx([0.2126, 0.7152, 0.0722])
