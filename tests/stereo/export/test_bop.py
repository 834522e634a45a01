"""A rendered lander in pair.json and in BOP's layout: poses held against pixels that Cycles made."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from icymoon.formats.ply import read_triangles
from icymoon.physics.arm.silhouette import find_silhouette
from icymoon.stereo.export import bop
from icymoon.stereo.export.layouts import export
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from rendering import render

pytestmark = pytest.mark.heavy

LEVEL: dict[str, Any] = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 12.0, "resolution": 65},
    "rig": {"width_px": 160, "height_px": 120},
    "lander": {"kind": "PARAMETRIC"},
    "quality": {"samples": 1},
}


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    root = tmp_path_factory.mktemp("lander")
    pair, _ = render(root / "set", LEVEL)
    assert export([root / "set"], "bop", root / "bop") == []
    return pair, root / "bop"


def read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def mask(folder: Path, name: str, link: int) -> Array:
    image = cv2.imread(str(folder / name / f"000000_{link:06d}.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image > 0)


@pytest.mark.long
@pytest.mark.parametrize("scene", ["000000", "000001"])
def test_models_at_their_poses_cover_what_cycles_saw_of_them(rendered, scene):
    folder = rendered[1] / "test" / scene
    camera = read(folder / "scene_camera.json")["0"]
    matrix, union, seen = np.reshape(camera["cam_K"], (3, 3)), np.zeros((120, 160), bool), np.zeros((120, 160), bool)
    for k, entry in enumerate(read(folder / "scene_gt.json")["0"]):
        places, triangles = read_triangles(rendered[1] / "models" / f"obj_{entry['obj_id']:06d}.ply")
        turn, place = np.reshape(entry["cam_R_m2c"], (3, 3)), np.array(entry["cam_t_m2c"])
        union |= find_silhouette((places.astype(float) @ turn.T + place) / 1000.0, triangles, matrix, union.shape)
        seen |= mask(folder, "mask_visib", k)
        assert not (mask(folder, "mask_visib", k) & ~mask(folder, "mask", k)).any()
    # Only the soles of the pads are under the ground.
    assert seen.sum() > 1000
    assert (union & seen).sum() / (union | seen).sum() > 0.98


@pytest.mark.long
def test_models_are_centred_in_millimetres_with_their_facts(rendered):
    facts = read(rendered[1] / "models" / "models_info.json")
    assert len(facts) == 9  # body, mast, two legs and five links of the arm
    for number, fact in facts.items():
        places, _ = read_triangles(rendered[1] / "models" / f"obj_{int(number):06d}.ply")
        assert np.allclose(places.min(axis=0), [fact[f"min_{axis}"] for axis in "xyz"], atol=1e-2)
        assert np.allclose(places.max(axis=0), -places.min(axis=0), atol=1e-2)
        some = places[:: max(len(places) // 300, 1)].astype(float)
        farthest = np.linalg.norm(some[:, None] - some[None], axis=-1).max()
        assert farthest <= fact["diameter"] * (1 + 1e-6)
        assert fact["diameter"] <= np.linalg.norm(np.ptp(places, axis=0)) * (1 + 1e-6)


def test_both_eyes_see_one_lander_a_baseline_apart(rendered):
    for link in rendered[0].data["lander"]["links"]:
        left, right = np.array(link["link_to_left"]), np.array(link["link_to_right"])
        assert np.allclose(left[:3, 3] - right[:3, 3], [0.25, 0.0, 0.0], atol=1e-6)
        assert np.allclose(left[:3, :3], right[:3, :3], atol=1e-12)


def test_visible_keypoints_lie_on_the_lander_in_the_labels(rendered):
    lander = rendered[0].data["lander"]
    assert not lander["reached_ground"]
    seen = [point for point in lander["keypoints"] if point["visible_left"]]
    assert {"shoulder", "elbow"} <= {point["name"] for point in seen}
    folder = rendered[1] / "test" / "000000"
    names = [link["name"] for link in lander["links"]]
    for point in seen:
        column, row = (int(value) for value in point["left_px"])
        assert mask(folder, "mask", names.index(point["link"]))[
            max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3
        ].any()


def test_a_pair_without_a_lander_is_named(tmp_path):
    render(tmp_path / "set", {"rig": {"width_px": 32, "height_px": 24}, "quality": {"samples": 1}})
    (failed,) = export([tmp_path / "set"], "bop", tmp_path / "bop")
    assert "shows no lander" in failed


@pytest.mark.long
def test_a_pair_that_fails_is_nowhere(rendered, tmp_path, monkeypatch):
    """At the masks of its right eye, after images and models are written; the next one is as if it were the first."""
    folder = rendered[0].folder
    whole, calls = bop._make_pixel_facts, []

    def fail(*given):
        calls.append(given)
        if len(calls) == 10:  # the first link in the right eye
            raise IcyMoonError("cannot be")
        return whole(*given)

    other = shutil.copytree(folder, tmp_path / "set" / "pairs" / "other")
    monkeypatch.setattr(bop, "_make_pixel_facts", fail)
    assert len(export([folder], "bop", tmp_path / "none")) == 1
    assert not [path for path in (tmp_path / "none").rglob("*") if path.is_file()]
    calls.clear()
    assert len(export([folder, other], "bop", tmp_path / "one")) == 1
    files = [
        {path.relative_to(root): path.read_bytes() for path in root.rglob("*") if path.is_file()}
        for root in (rendered[1], tmp_path / "one")
    ]
    assert files[0] == files[1]
