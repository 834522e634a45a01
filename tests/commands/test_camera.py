"""The rig of two camera models: what was written is read again, and what no rig here is, is refused."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.commands.camera import read_rig
from icymoon.commands.cli import main
from icymoon.errors import IcyMoonError
from icymoon.formats.cahvor import cahvor_text, from_pinhole, pds_text
from icymoon.render.pairs.pair_folder import StereoCamera
from icymoon.settings.description import defaults, merged

RIG = merged(defaults(), {"rig": {"width_px": 640, "height_px": 480, "baseline_m": 0.3, "principal_x_px": 3.0,
                                  "distortion_k1": -0.125, "distortion_k2": 0.03125}}).rig
K = (-0.125, 0.03125, 0.0, 0.0, 0.0)
TURN = np.array([[0.6, 0.8, 0], [0, 0, -1], [-0.8, 0.6, 0]])


def written(tmp_path, at=(0.3, 0, 0), turn=0.0, text=cahvor_text):
    camera = StereoCamera.from_settings(RIG)
    matrix = np.array(camera.matrix)
    matrix[:2, 2] -= 0.5
    paths = []
    for name, place, angle in (("left", (0, 0, 0), 0.0), ("right", at, turn)):
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) @ TURN
        model = from_pinhole(matrix, rotation, np.array(place) @ TURN + np.array([5, 6, 7]), (640, 480), K)
        paths.append(tmp_path / f"{name}.txt")
        paths[-1].write_text(text(model), encoding="utf-8")
    return paths


@pytest.mark.parametrize("text", [cahvor_text, lambda model: pds_text(model, "SITE")])
def test_the_rig_is_that_of_its_models(tmp_path, text, capsys):
    left, right = written(tmp_path, text=text)
    found, residual = read_rig(left, right)
    assert residual == 0
    wanted = {key: value for key, value in RIG.items() if key in found.rig}
    assert found.rig == pytest.approx(wanted, rel=1e-6, abs=1e-6)
    assert len(wanted) == 12
    assert main(["camera", str(left), str(right)]) == 0
    printed = capsys.readouterr().out
    assert "baseline_m = 0.3" in printed
    assert "principal_y_px = 0.0\n" in printed, "what is in the middle is printed so, without rounding errors"


@pytest.mark.parametrize(("at", "turn", "words"), [
    ((0.3, 0, 0), 0.02, r"1\.15 degrees"), ((0.3, 0.1, 0), 0.0, "side by side"), ((-0.3, 0, 0), 0.0, "side by side")])
def test_what_is_no_rig_here_is_refused(tmp_path, at, turn, words):
    with pytest.raises(IcyMoonError, match=words):
        read_rig(*written(tmp_path, at, turn))
