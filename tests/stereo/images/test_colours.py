"""Colours of depth and error against OpenCV's colour maps, and the letters of their legends."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from icymoon.stereo.images import colours
from icymoon.stereo.images.colours import (
    CONFIDENCE_SCALE,
    DEPTH_ENDS,
    ERROR_SCALE,
    INVALID_GREY,
    MAGMA,
    VIRIDIS,
    Scale,
    draw_colour_bar,
    draw_confidence,
    draw_outcomes,
    make_depth_scale,
)
from icymoon.stereo.images.lettering import draw_text, measure_text_width_px, put_text
from icymoon.stereo.twin.compare_twin import DISPARITY_TITLE


def test_a_confidence_has_the_colour_of_its_expected_error():
    """Confidence 0 and 1 are the ends, and a pixel without a measurement is grey."""
    error_px = np.array([[0.1, 1.0, 0.0, 1e9, 0.5]])
    with np.errstate(all="raise", under="ignore"):
        drawn = draw_confidence(np.exp(-error_px), np.array([[True, True, True, True, False]]))
    ends = CONFIDENCE_SCALE.low, CONFIDENCE_SCALE.high
    np.testing.assert_array_equal(drawn[:, :4], CONFIDENCE_SCALE.colours(np.array([[0.1, 1.0, *ends]])))
    assert (drawn[0, 4] == INVALID_GREY).all()


@pytest.mark.parametrize(("colormap", "reference"), [(VIRIDIS, cv2.COLORMAP_VIRIDIS), (MAGMA, cv2.COLORMAP_MAGMA)])
def test_the_colour_maps_are_opencvs_within_a_step(colormap, reference):
    scale = Scale(1.0, np.exp(1.0), colormap)
    values = np.exp(np.linspace(0, 1, 256))[None]
    wanted = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[None], reference)
    assert np.abs(scale.colours(values).astype(int) - wanted).max() <= 1
    np.testing.assert_array_equal(scale.colours(values)[0, ::5], wanted[0, ::5])


def test_outcomes_are_enlarged_as_opencv_does():
    flags = np.arange(35).reshape(5, 7) % 8
    small = draw_outcomes(flags, flags.shape)
    for shape in ((5, 7), (13, 16), (50, 70), (4, 3)):
        wanted = cv2.resize(small, shape[::-1], interpolation=cv2.INTER_NEAREST)
        np.testing.assert_array_equal(draw_outcomes(flags, shape), wanted)


@pytest.mark.parametrize("size", [1.0, 2.4])
@pytest.mark.parametrize("width", [1, 30, 640])
def test_a_bar_shows_the_scale_from_end_to_end(width, size):
    strip = draw_colour_bar(width, ERROR_SCALE, size)
    assert strip.shape == (round(44 * size), width, 3)
    left = min(round(8 * size), width // 4)
    row = strip[round(10 * size), left : width - left]
    ends = ERROR_SCALE.colours(np.array([[0.01, 1.0]]))[0] if width > 1 else ERROR_SCALE.colours(np.array([[0.01]]))[0]
    np.testing.assert_array_equal(row[[0, -1]] if width > 1 else row, ends)


def test_every_character_of_a_legend_is_drawn_and_no_two_are_alike():
    depth = "True depth, 1e-05 to 1e+07 m", f"Depth (m), {DEPTH_ENDS}", DEPTH_ENDS.capitalize(), "No depth"
    texts = ERROR_SCALE.title, Scale(1, 2).title, *depth, "Left", "Right", "sky"
    letters = {c: draw_text(c, 12.0) for c in {*"0123456789abcdefghijklmnopqrstuvwxyz", *"".join(texts)} - {" "}}
    assert all(covered.max() > 0.6 for covered in letters.values())
    assert len({(covered.shape, covered.tobytes()) for covered in letters.values()}) == len(letters)
    assert not draw_text(" ", 12.0).any()


@pytest.mark.parametrize("height", [8.0, 20.0])
def test_capitals_have_the_stated_height_and_stand_on_the_baseline(height):
    picture = np.full((60, 40, 3), 255, np.uint8)
    put_text(picture, "L", 5, 45, height, 0)
    rows, columns = np.nonzero(picture[..., 0] < 128)
    assert abs(rows.max() + 1 - 45) <= 1 + height / 12
    assert abs(np.ptp(rows) + 1 - height * 7 / 6) <= 1  # of a stroke's middle, and the stroke is as wide as its unit
    assert columns.min() >= 5
    assert columns.max() < 5 + measure_text_width_px("L", height)


def test_text_beyond_an_edge_is_cut():
    picture = np.zeros((10, 12, 3), np.uint8)
    for left, baseline in ((-7, 5), (8, 8), (0, 0), (0, 20), (50, 5), (0, -30)):
        put_text(picture, "Left", left, baseline, 10.0, 255)
    assert picture.any()


@pytest.mark.parametrize(("low", "high"), [(0.01, 1.0), (1.234, 5.678), (0.93, 311.0), (9.99, 10.31)])
def test_both_ends_of_a_scale_are_labelled_and_no_label_is_close_to_them(low, high):
    labels = Scale(low, high).labels
    assert [share for share, _ in labels] == sorted(share for share, _ in labels)
    assert (labels[0][0], labels[-1][0]) == (0.0, 1.0)
    assert [float(labels[k][1]) for k in (0, -1)] == pytest.approx([low, high], rel=5e-3)
    assert all(0.09 < share < 0.91 for share, _ in labels[1:-1])


def test_a_depth_scale_says_that_it_ends_before_the_depth_and_only_then():
    depth = np.append(np.linspace(1.0, 9.0, 998), [500.0, np.nan])
    scale = make_depth_scale(depth)
    assert scale.title.endswith("ends at 1 and 99 %")
    assert np.mean(depth < scale.low) == pytest.approx(0.01, abs=1e-3)  # one of a thousand values
    assert np.mean(depth > scale.high) == pytest.approx(0.01, abs=1e-3)
    flat = make_depth_scale(np.linspace(5.0, 5.1, 1000))
    assert flat.low < 5.0 < 5.1 < flat.high
    assert "ends" not in flat.title
    assert "ends" not in make_depth_scale(np.full(3, np.nan)).title


def test_every_character_of_a_scale_has_strokes():
    """A character without any is drawn as a space, as the E of "Expected error" was."""
    titles = [each.title for each in vars(colours).values() if isinstance(each, colours.Scale)]
    assert len(titles) >= 2
    for title in [*titles, colours.Scale.title, DISPARITY_TITLE]:
        for character in set(title) - {" "}:
            assert draw_text(character, 8.0).any(), f"{character} of {title}"
