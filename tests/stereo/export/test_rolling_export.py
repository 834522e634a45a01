"""What becomes of pairs with a rolling shutter: poses of rows are used, stated or refused."""

from __future__ import annotations

import csv
import json

import numpy as np
import pairs
import pytest
from icymoon.library.rendered_pair import open_pair
from icymoon.physics.camera.rotations import from_vector
from icymoon.settings.description import defaults, merged
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.workspace import open_workspace
from icymoon.stereo.export.layouts import export
from icymoon.stereo.export.points import make_measured_points
from icymoon.stereo.export.radiance_factor import measure_angle_deg, measure_photometry
from icymoon.stereo.measure.prepare_pair import load_pair, prepare_pair
from icymoon.support.errors import IcyMoonError

RIG = pairs.camera(96, 72)
MOVING = {"speed_right_m_s": 0.5, "roll_deg_s": 40.0, "motion_exposure_s": 0.01}
READOUT_S = 0.2


def write(folder, **rig):
    """A pair whose left eye is at the origin of the site and looks down, east to its right."""
    settings = merged(defaults(), {"rig": MOVING | {"stamp": "1.5"} | rig})
    pairs.write_pair(folder, pairs.Scene(rock=False), RIG, settings=settings)
    data = json.loads((folder / "pair.json").read_text())
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    beside = pose.copy()
    beside[0, 3] = RIG.baseline_m
    data["light"] = {"sun": {"direction_to_world": [0.6, 0.0, 0.8], "irradiance_wm2": 14.8}}
    data |= {"poses_rectified_to_world": {"left": pose.tolist(), "right": beside.tolist()}, "edited_by_hand": True}
    (folder / "pair.json").write_text(json.dumps(data))
    return folder


@pytest.fixture(scope="module")
def rolling(tmp_path_factory):
    return write(tmp_path_factory.mktemp("rolling") / "pairs" / ("a" * 12), readout_s=READOUT_S)


def times():
    return READOUT_S * (np.arange(RIG.height_px) / (RIG.height_px - 1) - 0.5)


def test_measured_points_lie_where_the_poses_of_their_rows_put_them(rolling, tmp_path):
    places = []
    for folder in (rolling, write(tmp_path / "pair")):
        prepared = prepare_pair(folder, {})
        points = make_measured_points(prepared, prepared.pair.camera.disparity(prepared.truth))
        places.append(np.stack([points[axis] for axis in "xyz"], -1).astype(float).reshape(72, 96, 3))
    for row, time in enumerate(times()):
        turn = from_vector(np.array([0.0, 0.0, -np.radians(40.0) * time]))  # clockwise, seen from above
        np.testing.assert_allclose(places[0][row], places[1][row] @ turn.T + (0.5 * time, 0, 0), atol=1e-5)
    poses = open_pair(rolling).right.row_poses_to_world
    place = 0.25 * np.array([np.cos(np.radians(4.0)), np.sin(np.radians(4.0)), 0.0]) - (0.05, 0.0, 0.0)
    np.testing.assert_allclose(poses[0, :3, 3], place, atol=1e-9)


@pytest.mark.parametrize("kind", ["cahvor", "colmap", "bop"])
def test_layouts_with_one_pose_for_all_rows_refuse_it_and_write_nothing(rolling, tmp_path, kind):
    (said,) = export([rolling], kind, tmp_path / kind)
    assert "rolling shutter" in said
    assert "export tum, flow, raw or png8" in said
    assert not list(tmp_path.rglob("*.png"))


@pytest.mark.parametrize("kind", ["png8", "raw", "tum"])
def test_layouts_with_poses_state_the_readout_and_the_motion(rolling, tmp_path, kind):
    assert export([rolling], kind, tmp_path) == []
    if kind == "tum":
        (row,) = csv.DictReader((tmp_path / "0000" / "frames.csv").read_text().splitlines())
        stated = [float(row[key]) for key in ("readout_s", "vx_m_s", "vy_m_s", "wx_deg_s", "wz_deg_s")]
        assert stated == [READOUT_S, 0.5, 0.0, 0.0, 40.0]
        return
    stated = json.loads(next(tmp_path.rglob("calibration.json")).read_text())["rolling_shutter"]
    assert (stated["readout_s"], stated["rows"], stated["turn_deg_s"]) == (READOUT_S, 72, [0.0, 0.0, 40.0])


def test_without_a_readout_no_file_states_one(tmp_path):
    folder = write(tmp_path / "pair")
    export([folder], "png8", tmp_path / "png8")
    export([folder], "tum", tmp_path / "tum")
    assert "rolling" not in next((tmp_path / "png8").rglob("calibration.json")).read_text()
    assert (tmp_path / "tum" / "0000" / "frames.csv").read_text().splitlines()[0] == "number,stamp_s,pair"


def test_angles_of_photometry_are_those_of_the_rows(rolling):
    pair = load_pair(rolling, {})
    found = measure_photometry(pair, "left").phase_deg
    sun = np.asarray(pair.pair.sun.direction)
    for row, time in ((0, -0.1), (71, 0.1)):
        turn = from_vector(np.array([0.0, 0.0, -np.radians(40.0) * time]))
        ray = np.array([(10.5 - RIG.cx_px) / RIG.focal_px, -(row + 0.5 - RIG.cy_px) / RIG.focal_px, -1.0])
        assert found[row, 10] == pytest.approx(measure_angle_deg(-turn @ ray / np.linalg.norm(ray), sun))


def test_a_lander_decides_nothing_from_rows_of_different_poses(rolling):
    with pytest.raises(IcyMoonError, match=r"rolling shutter \(rig.readout_s\).*with rig.readout_s 0"):
        open_workspace(prepare_pair(rolling, {}), read_rules())


def test_a_lens_that_distorts_is_refused_when_the_images_are_developed(rolling):
    with pytest.raises(IcyMoonError, match=r"set rig\.distortion_k1 to 0"):
        load_pair(rolling, {"rig": {"distortion_k1": -0.1}})
