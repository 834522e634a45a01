"""Painted masks: what an image states at a place, and which rocks it leaves."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.formats.png import encode_png
from icymoon.physics.rocks.beyond_patch import ViewBeyond
from icymoon.physics.rocks.painted_mask import PaintedMask, read_mask
from icymoon.physics.rocks.place_rocks import Rocks, scatter_rocks
from icymoon.physics.rocks.rock_shapes import make_rock_shapes
from icymoon.settings.description import defaults, merged
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.user_files import find_used_files, hash_content
from icymoon.support.errors import IcyMoonError

SIZE_M = 20.0


def saved(path: Path, values: object) -> Path:
    np.save(path, np.asarray(values, np.float32))
    return path


def strewn(
    mask: Path | None, *, beyond: ViewBeyond | None = None, most_seen: int | None = None, debris: float = 0.0
) -> Rocks:
    changes = {"debris": debris, **({"mask_file": str(mask)} if mask else {})}
    rocks = merged(defaults(), {"rocks": {"coverage": 0.04, "smallest_m": 0.15, "clustering": 0.3, **changes}}).rocks
    shapes = make_rock_shapes(rocks.family, rocks.angularity, 5)
    return scatter_rocks(
        rocks, SIZE_M, 5, lambda x, y: 0.1 * x + 0.0 * y, shapes, (0.0, 0.0, -math.inf), beyond, most_seen
    )


def rows_of(rocks: Rocks) -> np.ndarray:
    """All that a rock has, a row each."""
    return np.column_stack([rocks.position_m, rocks.rotation, rocks.scale_m, rocks.level, rocks.shape])


def is_among(some: Rocks, all_: Rocks) -> np.ndarray:
    """Whether each rock of ``all_`` is in ``some``; fails unless all of ``some`` are there, the same to the bit."""
    rows = {row.tobytes() for row in rows_of(some)}
    there = np.array([row.tobytes() in rows for row in rows_of(all_)])
    assert there.sum() == len(some.level) == len(rows)
    return there


def test_between_centres_a_mask_is_bilinear_and_beyond_it_stays():
    x, y = np.meshgrid((np.arange(5) + 0.5) / 5 - 0.5, 0.5 - (np.arange(4) + 0.5) / 4)
    mask = PaintedMask(0.5 + 0.3 * x + 0.4 * y + 0.2 * x * y, SIZE_M)
    at = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 500))
    inside = np.clip(at, [[-0.4], [-0.375]], [[0.4], [0.375]])
    expected = 0.5 + 0.3 * inside[0] + 0.4 * inside[1] + 0.2 * inside[0] * inside[1]
    np.testing.assert_allclose(mask.shares(*(at * SIZE_M)), expected, atol=1e-12)


def test_one_pixel_is_one_value():
    assert PaintedMask(np.array([[0.25]]), SIZE_M).shares(np.array([-30.0, 3.0]), np.zeros(2)).tolist() == [0.25] * 2


def test_rocks_that_a_mask_removes_take_their_debris_along(tmp_path):
    without = strewn(None, debris=0.1)
    half = np.zeros((2, 2))
    half[0] = 1.0  # the north
    some = strewn(saved(tmp_path / "north.npy", half), debris=0.1)
    there = is_among(some, without)
    rocks, debris = there[: without.debris_start], there[without.debris_start :]
    assert some.debris_start == rocks.sum()
    # Fragments lie within decimetres of their rocks, which are all there in the north and all gone in the south.
    y = without.position_m[without.debris_start :, 1]
    assert debris[y >= SIZE_M / 4 + 2.0].all()
    assert not debris[y <= -SIZE_M / 4 - 2.0].any()
    assert 100 < debris.sum() < len(debris) - 100
    black = strewn(saved(tmp_path / "black.npy", np.zeros((3, 7))), debris=0.1)
    assert len(black.level) == 0


def test_what_stays_is_as_without_the_mask(tmp_path):
    without = strewn(None)
    half = np.zeros((2, 2))
    half[0] = 1.0  # the north
    there = is_among(strewn(saved(tmp_path / "north.npy", half)), without)
    y = without.position_m[:, 1]
    assert there[y >= SIZE_M / 4].all()
    assert not there[y <= -SIZE_M / 4].any()
    assert is_among(strewn(saved(tmp_path / "white.npy", np.ones((3, 7)))), without).all()
    assert not is_among(strewn(saved(tmp_path / "black.npy", np.zeros((3, 7)))), without).any()


def test_a_grey_mask_leaves_its_share_and_a_lighter_one_leaves_more(tmp_path):
    without = strewn(None)
    dark, light = (
        is_among(strewn(saved(tmp_path / f"{share}.npy", np.full((2, 2), share))), without) for share in (0.3, 0.6)
    )
    n = len(without.level)
    assert n > 300
    for there, share in ((dark, 0.3), (light, 0.6)):
        assert abs(there.sum() - share * n) < 4 * math.sqrt(n * share * (1 - share))
    assert light[dark].all()


def test_rocks_beyond_the_patch_follow_the_edge(tmp_path):
    view = ViewBeyond(0.02, 1.5, 200.0)
    without = strewn(None, beyond=view)
    west = saved(tmp_path / "west.npy", [[1.0, 0.0]])
    there = is_among(strewn(west, beyond=view), without)
    x, far = without.position_m[:, 0], np.abs(without.position_m[:, :2]).max(axis=1) > SIZE_M / 2
    assert far.sum() > 20
    assert there[far & (x < -SIZE_M / 4)].all()
    assert not there[far & (x > SIZE_M / 4)].any()


def test_the_largest_of_those_that_stay_are_seen(tmp_path):
    mask = saved(tmp_path / "grey.npy", np.full((2, 2), 0.5))
    every, some = strewn(mask), strewn(mask, most_seen=40)
    look = every.diameter_m / np.hypot(*every.position_m[:, :2].T)
    np.testing.assert_array_equal(is_among(some, every), look >= np.sort(look)[-40])


def test_a_png_counts_as_it_is_stored(tmp_path):
    values = np.random.default_rng(3).integers(0, 65536, (4, 6), np.uint16)
    (tmp_path / "m.png").write_bytes(encode_png(values))
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png"), (values / np.float32(65535)).astype(np.float32))
    (tmp_path / "c.png").write_bytes(encode_png(np.full((2, 2, 3), (255, 0, 0), np.uint8)))
    assert read_mask(tmp_path / "c.png") == pytest.approx(np.full((2, 2), 1 / 3))


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("a.npy", np.full((2, 2), 1.5), "numbers from 0 to 1"),
        ("a.npy", np.full((2, 2), np.nan), "numbers from 0 to 1"),
        ("a.npy", np.ones((2, 2, 3)), "an array .rows, columns."),
        ("a.npy", np.ones((0, 2)), "an array .rows, columns."),
        ("a.tif", b"II*\0", "is not a PNG or NPY file; save it as PNG"),
        ("a.png", b"\x89PNG\r\n\x1a\n", "a mask"),
        ("a.png", None, "cannot be read"),
    ],
)
def test_what_is_no_mask_is_refused(tmp_path, name, content, why):
    if isinstance(content, bytes):
        (tmp_path / name).write_bytes(content)
    elif content is not None:
        saved(tmp_path / name, content)
    with pytest.raises(IcyMoonError, match=why):
        read_mask(tmp_path / name)


def test_only_the_content_of_a_mask_in_use_counts_in_the_id(tmp_path):
    one, two = saved(tmp_path / "1.npy", [[0.0, 1.0]]), saved(tmp_path / "2.npy", [[0.0, 1.0]])
    on: dict[str, dict[str, Any]] = {
        "rocks": {"coverage": 0.1, "mask_file": str(one)},
        "surface": {"dirt_mask_file": str(one)},
    }
    settings = merged(defaults(), on)
    assert list(find_used_files(settings)) == ["rocks.mask_file"]
    moved = merged(settings, {"rocks": {"mask_file": str(two)}})
    ids = [make_pair_id(each, hash_content(each)) for each in (settings, moved)]
    assert ids[0] == ids[1]
    saved(one, [[1.0, 0.0]])
    assert make_pair_id(settings, hash_content(settings)) != ids[0]
    unused = merged(settings, {"rocks": {"coverage": 0.0}})
    plain = merged(unused, {"rocks": {"mask_file": ""}, "surface": {"dirt_mask_file": ""}})
    assert make_pair_id(unused, hash_content(unused)) == make_pair_id(plain, hash_content(plain))
    soiled = merged(unused, {"surface": {"slope_dirt": 0.5, "frost_mask_file": str(two), "frost_share": 0.2}})
    assert list(find_used_files(soiled)) == ["surface.dirt_mask_file", "surface.frost_mask_file"]


def test_a_repainted_mask_leaves_other_rocks_in_a_preview(tmp_path):
    path = tmp_path / "mask.npy"
    counts = [len(strewn(saved(path, values), most_seen=50).level) for values in ([[1.0]], [[0.0, 0.0]])]
    assert counts == [50, 0]
