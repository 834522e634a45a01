"""The twin of a rendered pair, rendered with the same settings, is that pair but for its noise; of others it is not."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.formats.calibrations.registry import write_calibration
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from icymoon.render.pairs.pair_folder import find_pair_folders, read_pair
from icymoon.settings.description import merged
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.image_files import write_png
from icymoon.stereo.images.views import read_eye

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

WIDTH, HEIGHT = 128, 96
SMALL = ("terrain.resolution=65", "mesh.kind=GRID", "quality.samples=64", "surface.model=LAMBERT", "rocks.coverage=0")


def run(files, calibration, out, *settings):
    words = [word for setting in (*SMALL, *settings) for word in ("--set", setting)]
    given = [*map(str, files), "--calibration", str(calibration), "--methods", "sgbm", "--out", str(out)]
    assert main(["twin", *given, *words]) == 0
    with (out / "twin.csv").open(encoding="utf-8") as stream:
        photograph, twin = csv.DictReader(stream)
    return ({key: float(value) for key, value in each.items() if key not in ("pair", "side", "twin") and value}
            for each in (photograph, twin))  # fmt: skip


@pytest.mark.long
def test_a_render_as_a_photograph_has_the_numbers_of_its_twin(tmp_path):
    left = CalibratedCamera(WIDTH, HEIGHT, 90.0, 90.0, 63.5, 47.5)
    right = left.placed(np.eye(3), np.array([-0.2, 0.0, 0.0]))
    calibration = tmp_path / "stereo.yml"
    write_calibration(CalibratedRig((left, right)), [calibration], "opencv")
    files = [tmp_path / "left.png", tmp_path / "right.png"]
    for file in files:
        write_png(file, np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8))
    run(files, calibration, tmp_path / "first")

    pair = read_pair(find_pair_folders(tmp_path / "first" / "twins")[0])
    (left_light, _), (right_light, _) = (read_eye(pair, eye) for eye in ("left", "right"))
    taken = develop(pair, left_light, right_light, merged(pair.settings, {"sensor": {"noise_seed": 77}}))
    for file, image in zip(files, taken.for_matchers(), strict=True):
        write_png(file, image)
    photograph, twin = run(files, calibration, tmp_path / "same")
    assert photograph != twin, "the noise differs"
    # The noise of a sensor of 100 000 electrons is below 1 % of white ground; the 8 bits of a file are 0.4 %.
    for key in ("contrast", "gradient", "texture", "slope"):
        assert photograph[key] == pytest.approx(twin[key], rel=0.02)
    # SGBM drops speckles of up to 100 pixels, 0.8 % of so small an image, as a whole; noise moves some of them.
    assert photograph["sgbm coverage"] == pytest.approx(twin["sgbm coverage"], abs=0.05)

    photograph, twin = run(files, calibration, tmp_path / "other", "light.sun_elevation_deg=75")
    assert abs(photograph["contrast"] / twin["contrast"] - 1) > 0.1
    assert abs(photograph["texture"] / twin["texture"] - 1) > 0.1
