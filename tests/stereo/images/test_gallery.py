"""The gallery: fifteen scenes that are presets, their pictures as bright as the camera exposes them, one sheet."""

from __future__ import annotations

import subprocess
import sys

import cv2
import numpy as np
import pairs
import pytest
from icymoon.settings import description, preset_files
from icymoon.settings.pair_ids import make_pair_id
from icymoon.stereo.images.gallery import write_picture, write_sheet
from icymoon.support.errors import IcyMoonError

NAMES = preset_files.preset_names("gallery")


def test_there_are_fifteen_of_960_by_720_each_another():
    described = [description.merged(description.defaults(), preset_files.load_preset(name)) for name in NAMES]
    assert len({make_pair_id(each) for each in described}) == len(NAMES) == 15
    assert {(each.rig.width_px, each.rig.height_px) for each in described} == {(960, 720)}
    assert len({preset_files.read_preset_header(name)[0] for name in NAMES}) == 15
    for name in NAMES:  # the sheet's letters are ASCII
        assert preset_files.read_preset_header(name)[0].isascii()


def test_a_picture_shows_the_light_as_a_screen_does(tmp_path):
    folder = tmp_path / "pairs" / "a"
    pairs.write_pair(folder)
    write_picture(folder, tmp_path / "a.jpg")
    image = cv2.imread(str(tmp_path / "a.jpg")).astype(float) / 255
    sensor = description.defaults().sensor
    write_picture(folder, tmp_path / "b.jpg", stops=-2.0)
    darker = cv2.imread(str(tmp_path / "b.jpg")).astype(float) / 255
    lit = (image > 0.2) & (image < 0.9)
    assert np.median((darker[lit] / image[lit]) ** 2.2) == pytest.approx(0.25, rel=0.05)
    # The quantile that the exposure is metered by is at its target, linearly; JPEG is off by a few of 255 steps.
    assert np.quantile(image, sensor.auto_percentile) ** 2.2 == pytest.approx(sensor.auto_target, abs=0.03)


def test_a_sheet_keeps_to_its_bytes_and_holds_every_picture(tmp_path):
    rng = np.random.default_rng(0)
    shown = []
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), rng.integers(0, 255, (72, 96, 3)).astype(np.uint8))
        shown.append((tmp_path / f"{k}.png", f"Title {k}", "command"))
    write_sheet(shown, tmp_path / "sheet.jpg", 200_000)
    assert (tmp_path / "sheet.jpg").stat().st_size <= 200_000
    sheet = cv2.imread(str(tmp_path / "sheet.jpg"))
    assert sheet.shape == (2 * (360 + 48), 3 * 480, 3)
    filled = [sheet[r : r + 360, c : c + 480].std() > 10 for r in (0, 408) for c in (0, 480, 960)]
    assert filled == [True] * 4 + [False] * 2
    write_sheet([(shown[0][0], "Title", "one\ntwo\nthree")], tmp_path / "lines.jpg")
    lines = cv2.imread(str(tmp_path / "lines.jpg"))
    assert lines.shape == (360 + 48 + 2 * 16, 480, 3)
    assert lines[-16:].max() > 200  # the third line
    (tmp_path / "0.png").write_bytes(b"no image")
    with pytest.raises(IcyMoonError, match=r"0\.png"):
        write_sheet(shown, tmp_path / "sheet.jpg")


@pytest.mark.long
def test_the_command_renders_a_scene_once_and_shows_it(tmp_path):
    command = [
        sys.executable,
        "-m",
        "icymoon",
        "gallery",
        "--scale",
        "0.05",
        "--only",
        "rugged_1_low",
        "--out",
        str(tmp_path),
    ]
    for words in ("rendered in", "was already there"):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert words in done.stdout
        assert "--preset gallery/rugged_1_low" in done.stdout
        assert cv2.imread(str(tmp_path / "rugged_1_low.jpg")).shape == (36, 48, 3)
    assert cv2.imread(str(tmp_path / "gallery.jpg")).shape[1] == 480
