"""Files that are right, as other programs write them; and hostile ones among others, which cost one pair each."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import foreign
import numpy as np
import pytest
from hostile_images import EXRS, JPEGS, PNGS, WEBPS
from icymoon.stereo.datasets.data_files import MapFile, read_image, read_map
from icymoon.stereo.datasets.input_faults import warn_dark_images
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import read_checksum
from icymoon.support.foreign_bytes import MAX_BYTES

CASES = Path(__file__).parents[2] / "data" / "cases"


def prepared(root: Path):
    (source,) = find_sources([root])
    return source.prepare({})


def test_bytes_behind_the_end_of_a_jpeg_are_fine():
    image = prepared(CASES / "16_jpeg_with_trailer" / "data").left
    content = (CASES / "16_jpeg_with_trailer" / "data" / "left" / "a.jpg").read_bytes()
    np.testing.assert_array_equal(image, cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED))
    assert b"\xff\xd9" not in content[-64:]


def test_a_pfm_of_windows_is_read():
    path = CASES / "17_pfm_crlf" / "data" / "truth" / "a.pfm"
    truth = prepared(path.parents[1]).truth
    width, height = truth.shape[::-1]
    body = np.frombuffer(path.read_bytes()[-4 * truth.size :], "<f4").reshape(height, width)[::-1]
    np.testing.assert_array_equal(np.nan_to_num(read_map(MapFile(path))), np.where(np.isfinite(body), body, 0))


def test_eight_bits_with_stated_steps_are_read(tmp_path):
    path = CASES / "19_disparity_png8" / "data" / "truth" / "a.png"
    counted = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert counted.dtype == np.uint8
    truth = prepared(path.parents[1]).pair.camera.disparity(prepared(path.parents[1]).truth)
    np.testing.assert_allclose(truth[counted > 0], counted[counted > 0] / 8)


def test_pictures_of_sceneflow_as_webp(tmp_path):
    root = foreign.sceneflow(tmp_path)
    for path in root.glob("frames_finalpass/**/*.png"):
        foreign.write_image(path.with_suffix(".webp"), cv2.imread(str(path)))
    both = {source.name for source in find_sources([root])}
    for path in root.glob("frames_finalpass/**/*.png"):
        path.unlink()
    found = find_sources([root])
    assert {source.name for source in found} == both
    assert all(source.prepare({}).left.shape == (foreign.HEIGHT, foreign.WIDTH, 3) for source in found)


def test_a_sparse_file_is_not_read_for_its_checksum(tmp_path):
    with (tmp_path / "a.png").open("wb") as stream:
        stream.truncate(2**40)
    assert read_checksum(tmp_path / "a.png", MAX_BYTES) == ""
    os.mkfifo(tmp_path / "pipe")
    assert read_checksum(tmp_path / "pipe", MAX_BYTES) == ""


@pytest.mark.heavy
def test_a_hostile_file_costs_one_pair(tmp_path):
    root = foreign.plain(tmp_path / "set", 'disparity = "truth/{pair}.npy"', "", foreign.constant())
    names = dict(zip("bcdefghi", ("left", "left", "right", "truth", "left", "right", "truth", "right"), strict=True))
    for pair in [*names, "z"]:
        for folder, ending in (("left", "png"), ("right", "png"), ("truth", "npy")):
            (root / folder / f"{pair}.{ending}").write_bytes((root / folder / f"a.{ending}").read_bytes())
    files = {pair: next((root / folder).glob(f"{pair}.*")) for pair, folder in names.items()}
    for file in files.values():
        file.unlink()
    for pair, content in {
        "b": PNGS["30000 x 20000"],
        "c": JPEGS["cut"],
        "d": JPEGS["more scans than there are"],
        "e": EXRS["1000 large channels"],
    }.items():
        files[pair].write_bytes(content)
    os.mkfifo(files["f"])
    files["g"].mkdir()
    files["h"].symlink_to(files["h"])
    with files["i"].open("wb") as stream:
        stream.truncate(2**40)
    result = evaluate([root], parse_methods("bm"), tmp_path / "out")
    assert {row["pair"]: row["status"] for row in result["rows"]} == dict.fromkeys(names, "failed") | {
        "a": "ok",
        "z": "ok",
    }
    assert [each["pair"] for each in result["failed"]] == sorted(names)
    for each in result["failed"]:
        assert str(files[each["pair"]]) in each["message"]
        assert "\n" not in each["message"]


@pytest.mark.parametrize(
    "content", [PNGS["30000 x 20000"], PNGS["two sizes"], JPEGS["cut"], WEBPS["an animation"]], ids=range(4)
)
def test_matching_a_hostile_file_is_one_sentence(tmp_path, content):
    right = foreign.write_image(tmp_path / "right.png", foreign.eyes()[1])
    (tmp_path / "left.png").write_bytes(content)
    ended = subprocess.run(
        [
            sys.executable,
            "-m",
            "icymoon.stereo",
            "match",
            "--method",
            "bm",
            "--left",
            str(tmp_path / "left.png"),
            "--right",
            str(right),
            "--out",
            str(tmp_path / "out.npz"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode != 0
    assert ended.stderr.count("\n") == 1
    assert "left.png" in ended.stderr
    assert not (tmp_path / "out.npz").exists()


@pytest.mark.parametrize("read", [read_image, lambda path: read_map(MapFile(path))])
def test_a_file_that_goes_while_it_is_read_is_one_sentence(tmp_path, read):
    with pytest.raises(IcyMoonError, match="cannot be read"):
        read(tmp_path / "gone.exr")


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        (100, 100, None),
        (60, 110, None),
        (200, 12, "left image is 16.7 times"),
        (12, 200, "right image is 16.7 times"),
        (50, 0, "left image is infinitely"),
        (0, 0, None),
    ],
)
def test_eyes_of_another_brightness_are_doubted(left, right, words):
    said = warn_dark_images(*(np.full((4, 5), value, np.uint8) for value in (left, right)))
    assert len(said) == (words is not None)
    assert all(words in each for each in said)
