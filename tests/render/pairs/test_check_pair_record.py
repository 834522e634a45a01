"""What a pair states and its settings contradict is refused where the pair is opened, and listed by ``verify``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.physics.light.lamps import describe_lamp
from icymoon.render.pairs.pair_folder import find_pairs, read_pair
from icymoon.settings import description
from icymoon.stereo.cli import main as stereo
from icymoon.support.errors import IcyMoonError
from olddata import OLD, copied
from stated_pairs import whole


@pytest.fixture
def folder(tmp_path) -> Path:
    made = whole(tmp_path / "set" / "pairs" / "0123456789ab")
    assert read_pair(made).id
    return made


def edit(folder: Path, key: str, value: Any) -> None:
    """Put another value at a key such as ``camera.K.0.0``; a function makes it from the one that is there."""
    path = folder / "pair.json"
    data = json.loads(path.read_text())
    *way, last = [int(part) if part.isdigit() else part for part in key.split(".")]
    inner = data
    for part in way:
        inner = inner[part]
    inner[last] = value(inner[last]) if callable(value) else value
    path.write_text(json.dumps(data))


FALSE = [
    ("camera.K.0.0", 60.0),
    ("camera.focal_baseline_px_m", 1.0),
    ("camera.pixel_centre", "(u, v)"),
    ("poses_rectified_to_world.right.0.3", 0.3),
    ("poses_rectified_to_world.left.0.3", 0.3),
    ("poses_rectified_to_world.left.1.1", lambda x: x + 1e-4),
    ("poses_camera_to_world.left.2.3", 1.0),
    ("poses_camera_to_world.right.3.3", 2.0),
    ("light.sun.elevation_deg", lambda x: x + 0.01),
    ("light.sun.azimuth_deg", lambda x: x + 0.01),
    ("light.sun.elevation_deg", "high"),
    ("light.sun.direction_to_world", [0.0, 0.0, 1.0]),
    ("light.sun.irradiance_wm2", 1.0),
    ("light.sun.ground_irradiance_wm2", 1.0),
    ("light.sun.distance_m", 3.0),
    ("light.planet", {}),
    ("light.j2000_to_world.0.0", 0.5),
    ("light.sun.source", "HAND"),
    ("denoiser", "OPTIX"),
    ("device", "GPU"),
    ("workspace", {"file": "left.exr", "cell_m": 0.1, "origin_m": [0, 0], "shape": [2, 2]}),
    ("blur", {"focus_distance_m": 1.0}),
]


@pytest.mark.parametrize(("key", "value"), FALSE, ids=[f"{key}-{k}" for k, (key, _) in enumerate(FALSE)])
def test_what_settings_contradict_is_named_with_both_values(folder, key, value):
    edit(folder, key, value)
    name = key.split(".")[0]
    with pytest.raises(
        IcyMoonError,
        match=rf"pair\.json: {name}\S* is .*, and its settings give .*; move the folder "
        r"away and render the pair again\.$",
    ):
        read_pair(folder)


def test_lamps_are_compared_with_the_settings(folder):
    lamp = {"kind": "POINT", "place": "SITE", "x_m": 1.0, "y_m": 2.0, "z_m": 3.0, "azimuth_deg": 90.0}
    settings = description.merged(description.defaults(), description.check({"light": {"lamps": [lamp]}}, "test"))
    (asked,) = settings.light.lamps
    record = {
        "group": "Lamp1",
        **describe_lamp(asked, settings.light),
        "position_m": [1.0, 2.0, 3.0],
        "direction_to_world": [1.0, 0.0, 0.0],
    }
    edit(folder, "settings.light.lamps", [dict(asked)])
    for wrong, told in (
        ([], "light.lamps is 0, and its settings give 1"),
        ([record | {"pair_w": 1.0}], "light.lamps[0].pair_w is 1"),
        ([record | {"position_m": [1.0, 2.0, 4.0]}], "light.lamps[0].position_m[2] is 4"),
        ([record | {"group": "Lamp2"}], "light.lamps[0].group is 'Lamp2'"),
        (["POINT"], "light.lamps[0] is 'POINT'"),
    ):
        edit(folder, "light.lamps", wrong)
        with pytest.raises(IcyMoonError, match=re.escape(told)):
            read_pair(folder)
    edit(folder, "light.lamps", [record])
    read_pair(folder)


def baked(**changes: Any) -> dict[str, Any]:
    return {"method": "BAKED", "share": 0.1, "noise": 0.01, "lights": {"Sun": {"noise": 0.01}}, **changes}


@pytest.mark.parametrize(
    ("asked", "noise", "stated", "words"),
    [
        ("TRACED", 0.02, baked(), "indirect is a table, and its settings give nothing"),
        ("BAKED", 0.02, None, "indirect is nothing, and its settings give a table"),
        ("BAKED", 0.02, "BAKED", "indirect is 'BAKED', and its settings give a table"),
        ("BAKED", 0.02, baked(noise=0.03), "indirect.noise is 0.03, and its settings give at most 0.02"),
        ("BAKED", 0.02, baked(noise="none"), "indirect.noise is 'none', and its settings give at most 0.02"),
        (
            "BAKED",
            0.02,
            baked(lights={"Planet": {}}),
            r"indirect.lights is \['Planet'\], and its settings give \['Sun'\]",
        ),
        ("BAKED", 0.02, baked(lights={}), r"indirect.lights is \[\], and its settings give \['Sun'\]"),
        ("TRACED", 0.02, None, ""),
        ("BAKED", 0.02, baked(), ""),
        ("BAKED", 0.0, baked(noise=0.03), ""),
        ("BAKED", 0.02, {"method": "TRACED", "why": "it is snow"}, ""),
    ],
)
def test_how_indirect_light_was_made_is_what_the_settings_ask_for(folder, asked, noise, stated, words):
    """A bake_noise of 0 sets no limit, and what was to be baked may be traced."""
    edit(folder, "settings.quality.indirect", asked)
    edit(folder, "settings.quality.bake_noise", noise)
    edit(folder, "indirect", stated)
    if not words:
        read_pair(folder)
        return
    with pytest.raises(IcyMoonError, match=words):
        read_pair(folder)


def test_files_that_settings_do_not_give_are_refused(folder):
    edit(folder, "files.left_truth", {"bytes": 1, "sha256": "0" * 64})
    with pytest.raises(IcyMoonError, match="files has left_truth, which its settings exclude"):
        read_pair(folder)


def test_what_single_precision_and_six_digits_of_a_heading_do_is_accepted(folder):
    for eye in ("left", "right"):
        for key in ("poses_rectified_to_world", "poses_camera_to_world"):
            edit(folder, f"{key}.{eye}.1.1", lambda x: x + 1e-5)
    edit(folder, "light.sun.irradiance_wm2", lambda x: float(np.float32(x)))
    edit(folder, "light.sun.azimuth_deg", lambda x: x + 360.0)
    read_pair(folder)


def test_a_scene_that_was_edited_by_hand_has_its_own_pose_and_sun(folder):
    edit(folder, "edited_by_hand", True)
    sun = {
        "source": "HAND",
        "direction_to_world": [0.0, 0.6, 0.8],
        "elevation_deg": 53.130102,
        "azimuth_deg": 0.0,
        "irradiance_wm2": 10.0,
        "angular_diameter_deg": 1.0,
        "ground_irradiance_wm2": 8.0,
    }
    edit(folder, "light.sun", sun)
    for eye, x_m in (("left", 5.0), ("right", 5.25)):
        pose = [[1.0, 0.0, 0.0, x_m], [0.0, 0.0, 1.0, 2.0], [0.0, -1.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0]]
        edit(folder, f"poses_rectified_to_world.{eye}", pose)
        edit(folder, f"poses_camera_to_world.{eye}", pose)
    read_pair(folder)
    edit(folder, "light.sun.elevation_deg", 20.0)
    with pytest.raises(IcyMoonError, match=r"light\.sun\.elevation_deg is 20\.0"):
        read_pair(folder)
    edit(folder, "light.sun", sun)
    edit(folder, "poses_rectified_to_world.right.0.3", 5.3)
    with pytest.raises(IcyMoonError, match=r"poses_rectified_to_world\.right\[0\]\[3\] is 5\.3"):
        read_pair(folder)


def test_settings_that_give_no_pair_are_told_in_a_sentence(folder):
    edit(folder, "settings.rig.sensor_width_mm", 0.0)
    with pytest.raises(IcyMoonError, match="no pair follows from its settings"):
        read_pair(folder)


@pytest.mark.parametrize("old", OLD)
def test_nothing_is_measured_or_exported_of_a_pair_that_contradicts_itself(old, tmp_path, capsys):
    dataset = copied(old, tmp_path)
    folder = find_pairs(dataset)[0].folder
    edit(folder, "poses_rectified_to_world.right.0.3", lambda x: x + 0.05)
    assert main(["verify", str(dataset)]) == 1
    said = capsys.readouterr()
    (line,) = said.out.splitlines()
    assert "poses_rectified_to_world.right[0][3] is " in line
    assert line.endswith("Its files are as they were rendered, so --remove leaves it.")
    assert "--remove removes" not in said.err
    for verb in (["evaluate", "--methods", "bm"], ["export", "--format", "colmap"]):
        assert stereo([verb[0], str(folder), "--out", str(tmp_path / verb[0]), *verb[1:]]) == 1
    assert "poses_rectified_to_world" in capsys.readouterr().err
    folder.rename(tmp_path / "away")
    assert main(["verify", str(dataset)]) == 1
    assert capsys.readouterr().out.splitlines() == [f"Pair {folder.name} is missing."]
