"""Pictures of labels."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from icymoon.stereo.paper.figures import SHEETS, colour_labels, wrap_caption
from icymoon.stereo.paper.paper_datasets import FIGURES


def test_labels_have_colours_of_their_own():
    """Neighbouring numbers, as rocks have them, are told apart by eye: hues at least a tenth of the circle away."""
    labels = np.array([[0, 1, 2, 3], [100_000, 100_001, 100_002, 100_003]])
    shown = colour_labels(labels)
    assert shown.shape == (2, 4, 3)
    assert shown[0, 0].tolist() == [0, 0, 0]
    assert shown[0, 1].tolist() == [90, 90, 90]
    others = [tuple(shown[place]) for place in ((0, 2), (0, 3), (1, 0), (1, 1), (1, 2), (1, 3))]
    assert len(set(others)) == 6
    assert all(max(colour) == 255 and min(colour) == 0 for colour in others)
    for one, other in pairwise(others):
        assert np.abs(np.subtract(one, other, dtype=int)).max() > 25


def test_every_figure_has_a_sheet():
    assert tuple(SHEETS) == FIGURES


def test_captions_lose_no_word_and_fit_their_picture():
    """Also of the longest names, in the letters and sizes that the sheet has."""
    text = "Terrain: Medium ruggedness, hummocks, Sun Azimuth 180°, Sun Elevation 22.5°, Surface: Specular Level 0.5"
    title, below = wrap_caption(text)
    assert f"{title} {below}".split() == text.replace("°", " deg").split()
    for line, size in ((title, 0.5), *((each, 0.4) for each in below.splitlines())):
        assert 6 + cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0] <= 320
    assert wrap_caption("") == ("", "")
