"""A mask and the right eye's truth are held against the left eye's truth; what contradicts it is no visibility."""

from __future__ import annotations

from pathlib import Path

import foreign
import numpy as np
import pairs
import pytest
from icymoon.stereo.datasets.data_files import MapFile
from icymoon.stereo.datasets.visibility import check_right_truth, find_better_reading
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.measure.fit_check import compute_ray_lengths
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

RIG = pairs.camera(192, 144)
SCENE = pairs.Scene(distance_m=1.5, slope_x=0.8, slope_y=0.3)
LEFT, RIGHT = (pairs.view(SCENE, RIG, eye)[0] for eye in ("left", "right"))
DISPARITY = RIG.disparity(LEFT)
#: Seen by the right eye: in its frame, and not just left of the rock, in whose shadow of sight it is.
COLUMN = np.arange(192) - DISPARITY
ROCK = np.isclose(LEFT, 0.75 * SCENE.distance_m)
BESIDE = np.zeros_like(ROCK)
for _row in np.flatnonzero(ROCK.any(axis=1)):
    _edge = np.flatnonzero(ROCK[_row])[0]
    BESIDE[_row, :_edge] = COLUMN[_row, :_edge] > COLUMN[_row, _edge]
SEEN = (COLUMN >= -0.5) & ~BESIDE


def right(values: Array, kind: str = "depth") -> list[str]:
    return check_right_truth(MapFile(Path("r.npy"), kind), values, RIG, DISPARITY)


@pytest.mark.parametrize("gaps", [False, True])
def test_the_sound_map_of_the_right_eye_fits(gaps):
    values = np.where(np.arange(192) % 3 == 0, np.nan, RIGHT) if gaps else RIGHT
    assert right(values) == []
    assert right(RIG.disparity(values), "disparity") == []
    assert right(np.where(np.arange(144)[:, None] < 20, 1e10, values)) == []  # sky


@pytest.mark.parametrize(
    ("values", "kind", "words"),
    [
        (RIGHT[::-1], "depth", "only upside down"),
        (RIGHT[:, ::-1], "depth", "only mirrored from left to right"),
        (1000 * RIGHT, "depth", "only with depths divided by 1000"),
        (RIG.disparity(RIGHT) / 16, "disparity", "only with disparities multiplied by 16"),
        (LEFT, "depth", "only as the map of the left eye"),
        (1 / RIGHT, "depth", "only as 1 / depth"),
        (RIGHT * compute_ray_lengths(RIG), "depth", "only as distances along the ray"),
        (-RIGHT, "depth", "has negative depths"),
        (np.full_like(RIGHT, np.nan), "depth", "has no known value in any pixel"),
    ],
)
def test_a_fault_of_the_right_map_is_named(values, kind, words):
    with pytest.raises(IcyMoonError) as caught:
        right(values, kind)
    assert str(caught.value).startswith("r.npy ")
    assert words in str(caught.value)


def test_a_right_map_of_something_else_is_doubtful():
    other = np.random.default_rng(3).uniform(1, 9, (18, 24)).repeat(8, 0).repeat(8, 1)
    (sentence,) = right(other)
    assert sentence.startswith("r.npy does not fit the left eye's truth")


def test_a_fault_is_named_with_the_readings_of_the_mask():
    assert find_better_reading(SEEN, DISPARITY) is None
    assert find_better_reading(~SEEN, DISPARITY) == "with seen and hidden exchanged"
    assert find_better_reading(SEEN[:, ::-1], DISPARITY) == "mirrored from left to right"


@pytest.mark.parametrize(
    "seen",
    [
        np.ones_like(SEEN),
        np.zeros_like(SEEN),
        SEEN & (np.arange(192) > 100),
        SEEN & (np.arange(144)[:, None] > 100),
        np.random.default_rng(1).random(SEEN.shape) < 0.5,
    ],
    ids=["all", "none", "right part", "lower part", "noise"],
)
def test_a_mask_of_another_extent_is_not_called_wrong(seen):
    assert find_better_reading(seen, DISPARITY) is None


def folder(tmp_path, mask=None, right_values=None):
    """A pair whose depth rises to the right, with a mask or a map of the right eye."""
    keys = 'visible = "m/{pair}.png"\n' if mask is not None else ""
    keys += 'right = "r/{pair}.npy"\n' if right_values is not None else ""
    root = foreign.plain(tmp_path, f'disparity = "truth/{{pair}}.npy"\n{keys}', "", foreign.constant())
    if mask is not None:
        foreign.write_image(root / "m" / "a.png", mask)
    if right_values is not None:
        (root / "r").mkdir()
        np.save(root / "r" / "a.npy", right_values)
    (source,) = find_sources([root])
    return source


INSIDE = (np.arange(foreign.WIDTH) >= foreign.SHIFT_PX) & np.ones((foreign.HEIGHT, 1), bool)


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (INSIDE.astype(np.uint8), "has numbers up to 1, and 255 marks"),
        (255 * (~INSIDE).astype(np.uint8), "fits the truth only with seen and hidden exchanged"),
        (255 * INSIDE[:, ::-1].astype(np.uint8), "fits the truth only mirrored from left to right"),
        (np.zeros_like(INSIDE, np.uint8), "marks no pixel that both images show according to the truth"),
        (np.arange(96, dtype=np.uint8) * np.ones((64, 1), np.uint8) * 2 + 60, "has many numbers between 0 and 255"),
        (255 * INSIDE[:60].astype(np.uint8), "is 96 x 60 px, and the images are 96 x 64 px"),
    ],
)
def test_a_wrong_mask_is_one_sentence(tmp_path, mask, words):
    with pytest.raises(IcyMoonError) as caught:
        folder(tmp_path, mask).prepare({})
    assert str(caught.value).startswith(str(tmp_path / "m" / "a.png"))
    assert words in str(caught.value)


def test_a_sound_mask_determines_what_is_visible(tmp_path):
    soft = np.where(INSIDE, 255, 0).astype(np.uint8)
    soft[:, foreign.SHIFT_PX] = 190  # an edge that a smaller image was made with
    np.testing.assert_array_equal(folder(tmp_path, soft).prepare({}).visible, soft == 255)


def test_a_wrong_right_map_costs_the_pair(tmp_path):
    with pytest.raises(IcyMoonError, match=r"r.a\.npy fits the left eye's truth only with disparities divided by 256"):
        folder(tmp_path / "wrong", right_values=256 * foreign.constant()).prepare({})
    assert folder(tmp_path / "sound", right_values=foreign.constant()).prepare({}).occlusion_known


def test_the_files_of_the_left_eye_are_not_those_of_the_right(tmp_path):
    root = foreign.plain(tmp_path, 'depth = "truth/{pair}.npy"\nright = "truth/{pair}.npy"', "", foreign.constant())
    with pytest.raises(IcyMoonError, match=r"truth.right names the files of truth.depth"):
        find_sources([root])
