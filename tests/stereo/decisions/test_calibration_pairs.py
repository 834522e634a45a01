"""What a pair states for a calibration: its ground, its group, and which settings make other devices."""

from __future__ import annotations

from pathlib import Path

import pytest
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.pairs.pair_folder import Pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.decisions.calibration_pairs import CELLS, TRUTH, state_pair


def state(response=None, data=None, cell_m=0.02, pair_id="0" * 12, **changes):
    """The statements of a pair with these settings, in groups by the Sun's elevation."""
    settings = merged(defaults(), changes)
    pair = Pair(Path(), pair_id, settings, StereoCamera.from_settings(settings.rig), data or {})
    return state_pair(pair, response or {}, ["light.sun_elevation_deg"], cell_m)


@pytest.mark.parametrize(
    ("changes", "other"),
    [
        ({"rig": {"heading_deg": 90.0, "x_m": 2.0, "pitch_deg": 40.0}}, None),
        ({"sensor": {"noise_seed": 5}}, None),
        ({"quality": {"threads": 2, "device": "GPU"}}, None),
        ({"rig": {"baseline_m": 0.3}}, "rig"),
        ({"rig": {"height_m": 1.0}}, "rig"),
        ({"calibration_error": {"right_yaw_deg": 0.1}}, "rig"),
        ({"sensor": {"read_noise_e": 50.0}}, "camera response"),
        ({"quality": {"samples": 3}}, "render quality"),
        ({"workspace": {"size_m": 8.0}}, "size of the workspace"),
        ({"lander": {"kind": "PARAMETRIC"}}, "lander"),
        ({"arm": {"upper_m": 2.0}}, "lander"),
        ({"arm": {"yaw_deg": 5.0, "elbow_offset_deg": 1.0, "roll_deg": 9.0}}, None),
    ],
)
def test_what_aims_a_rig_or_draws_noise_is_no_other_device(changes, other):
    first, second = state().devices, state(**changes).devices
    assert [name for name in first if first[name] != second[name]] == ([other] if other else [])


def test_another_response_at_evaluation_is_another_device():
    assert state({"sensor": {"bits": 10}}).devices == state(sensor={"bits": 10}).devices != state().devices


def test_the_cells_are_those_of_the_pair_or_of_the_run():
    assert state(cell_m=0.05).devices[CELLS] == "0.05 m"
    assert state(data={"workspace": {"cell_m": 0.01}}, cell_m=0.05).devices[CELLS] == "0.01 m"


def test_true_heights_from_two_eyes_are_another_truth():
    first, second = state().devices, state(data={"workspace": {"cell_m": 0.02}}).devices
    assert [name for name in first if first[name] != second[name]] == [TRUTH]


FILE = {"source": {"kind": "HEIGHT_MAP", "file": "heights.tif"}}


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({"excavation": {"state": 3}}, True),
        ({"light": {"sun_elevation_deg": 3.0}}, True),
        ({"rig": {"x_m": 3.0}}, True),
        ({"dataset": {"seed": 99}}, False),
        ({"rocks": {"coverage": 0.02}}, True),
        ({"terrain": {"rms_slope_deg": 3.0}}, True),
    ],
)
def test_grounds_of_one_seed_count_once(changes, same):
    """Terrain of one seed has the same random numbers at any slope, so its losses are not independent."""
    assert (state(**changes).ground == state().ground) == same


@pytest.mark.parametrize(
    ("changes", "data", "same"),
    [
        ({"dataset": {"seed": 99}}, {"own_files_sha256": "a"}, True),
        ({}, {"own_files_sha256": "b"}, False),
        ({"source": FILE["source"] | {"origin_x_m": 50.0}}, {"own_files_sha256": "a"}, False),
    ],
)
def test_ground_from_a_file_is_the_same_for_all_seeds(changes, data, same):
    file = state(data={"own_files_sha256": "a"}, **FILE).ground
    assert (state(data=data, **(FILE | changes)).ground == file) == same
    assert file != state().ground


def test_a_scene_edited_by_hand_is_one_ground_under_all_suns():
    """Its id differs from Sun to Sun, so it names no ground."""
    grounds = {
        state(data={"edited_by_hand": True}, pair_id=name * 12, light={"sun_elevation_deg": sun}).ground
        for name, sun in (("1", 20.0), ("2", 40.0))
    }
    assert len(grounds) == 1


def test_grounds_are_in_groups_by_settings():
    assert state(light={"sun_elevation_deg": 12.5}).group == "light.sun_elevation_deg=12.5"
