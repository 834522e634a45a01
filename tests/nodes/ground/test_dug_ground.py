"""The patch of an excavation in the mesh of the ground: no crack, and the volumes that the records state."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from icymoon.nodes.change_scene import open_empty_scene
from icymoon.nodes.ground import dug_ground
from icymoon.nodes.ground.dug_ground import DEPTH, mesh_whole_ground
from icymoon.physics.excavation.camera_jitter import jitter_rig
from icymoon.settings import description
from icymoon.support.errors import IcyMoonError
from rendering import complete

DUG = {"path": "LINE", "states": 3, "bite_m": 0.05, "length_m": 0.2, "cell_m": 0.01, "start_y_m": 2.0}
GRADED = {"mesh": {"kind": "GRADED", "most": 20000, "farthest_m": 100.0}}
FINE = {
    "mesh": {"kind": "GRADED", "most": 60000, "farthest_m": 100.0, "error_px": 4.0, "edge_px": 24.0, "seen": "FINE"}
}


def dug(*more, **changes):
    return mesh_whole_ground(complete({"excavation": DUG | changes}, *more))


def volume_m3(positions, faces):
    """The volume between triangles and the plane z = 0, by the corners of each."""
    a, b, c = (positions[faces[:, k]].astype(np.float64) for k in range(3))
    area = ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / 2
    return float((area * (a[:, 2] + b[:, 2] + c[:, 2])).sum() / 3), float(area.min())


def count_edges(faces):
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    return np.unique(edges[:, 0] * (int(faces.max()) + 1) + edges[:, 1], return_counts=True)


@pytest.mark.parametrize("mesh", [{}, GRADED], ids=["grid", "graded"])
def test_the_patch_leaves_no_crack(mesh):
    made = dug(mesh)
    _, times = count_edges(made.faces)
    assert times.max() == 2
    # Only the rim of the whole ground is used once: for a grid its sides, for rings the outermost.
    edges, times = count_edges(made.faces)
    many = int(made.faces.max()) + 1
    ends = np.unique(np.concatenate([edges[times == 1] // many, edges[times == 1] % many]))
    distance = np.hypot(*made.positions[ends, :2].T)
    assert distance.min() > 9.0
    assert len(np.unique(made.faces)) == len(made.positions)


@pytest.mark.parametrize("mesh", [{}, GRADED, FINE], ids=["grid", "graded", "fine"])
def test_volumes_between_triangles_are_those_on_record(mesh):
    untouched, made = dug(mesh, state=0), dug(mesh, state=2)
    (before, least), (after, _) = (volume_m3(each.positions, each.faces) for each in (untouched, made))
    facts = made.series.facts(2)
    assert least > 0.0  # no triangle lies upside down
    # Sums over 1e4 triangles of up to 1e3 m² in double precision.
    assert after - before == pytest.approx(facts["change_in_patch_by_state_m3"][2], abs=1e-7)
    assert facts["taken_m3"] == pytest.approx(0.08 * 0.2 * 0.1, rel=1e-6)


@pytest.mark.parametrize("east_m", [-0.8, 0.8, 1.2])
def test_the_edge_of_what_is_seen_may_cross_the_patch(east_m):
    """There small triangles lie along a side of a larger one, three corners in a line; nothing else is used once."""
    made = dug(FINE, start_x_m=east_m)
    edges, times = count_edges(made.faces)
    assert times.max() == 2
    many = int(made.faces.max()) + 1
    once = np.stack([edges[times == 1] // many, edges[times == 1] % many], axis=1)
    middle = made.positions[once, :2].mean(axis=1)
    west, south, east, north = made.grid.bounds_m
    beside = (middle > (west - 0.1, south - 0.1)) & (middle < (east + 0.1, north + 0.1))
    assert not beside.all(axis=1).any()
    assert volume_m3(made.positions, made.faces)[1] > 0.0


def test_finer_ground_around_it_leaves_a_trench_as_it_is():
    coarse, fine = dug(FINE, {"mesh": {"seen": "EVEN"}}), dug(FINE)
    # Triangles in view are cut into nine, so the ground around the patch is another one.
    many = fine.series.before_m.size
    assert len(fine.positions) - many > 1.5 * (len(coarse.positions) - many)
    np.testing.assert_array_equal(fine.positions[-many:], coarse.positions[-many:])
    depth = fine.series.before_m.ravel() - fine.positions[-many:, 2]
    # Depths count from a plane, and ground of some degrees is uneven by less than a centimetre on a decimetre.
    assert depth.max() == pytest.approx(0.1, abs=0.02)
    assert fine.series.facts(2) == coarse.series.facts(2)


def test_only_heights_of_the_patch_differ_between_states():
    first, second = dug(state=1), dug(state=2)
    np.testing.assert_array_equal(first.faces, second.faces)
    np.testing.assert_array_equal(first.positions[:, :2], second.positions[:, :2])
    around = len(first.positions) - first.series.before_m.size
    np.testing.assert_array_equal(first.positions[:around], second.positions[:around])


def test_digging_takes_loose_material_first_and_leaves_spoil_loose():
    """Hard ground is never raised, and is lowered only where the scoop goes deeper than the loose material."""
    buried = {"mantle": {"thickness_m": 0.04, "length_m": 1.0}, "quality": {"loose_thickness": True}}
    untouched, made = dug(buried, state=0), dug(buried, state=2)
    patch = slice(-made.series.before_m.size, None)
    hard, hard_before = (each.positions[patch, 2] - each.loose_m[patch] for each in (made, untouched))
    dug_to = made.series.at(2).layers.ground.ravel()
    assert hard == pytest.approx(np.minimum(hard_before, dug_to), abs=1e-6)
    assert (hard < hard_before - 1e-3).any()
    assert (made.loose_m[patch] > untouched.loose_m[patch] + 1e-3).any()
    assert made.loose_m[: patch.start] == pytest.approx(untouched.loose_m[: patch.start])


def test_the_next_state_makes_no_new_ground(monkeypatch):
    dug(state=1)
    monkeypatch.setattr(dug_ground, "mesh_ground", None)  # whoever calls it fails
    made = dug(state=2)
    assert made.state == 2


def test_a_state_is_the_same_whichever_was_dug_before():
    # As in a series that goes on after it was stopped.
    loose = {"cohesion_pa": 0.0, "clods_m": 0.01}
    made = []
    for states in ((2,), (0, 1, 2), (1, 0, 2)):
        dug(state=0, length_m=0.3)  # only the last ground is kept
        made.append([dug(state=state, **loose) for state in states][-1])
    for other in made[1:]:
        assert other.positions.tobytes() == made[0].positions.tobytes()
        np.testing.assert_array_equal(other.faces, made[0].faces)
        assert other.series.facts(2) == made[0].series.facts(2)


@pytest.mark.parametrize("path", ["RECORDED", "JOINTS"])
def test_a_path_that_is_edited_is_dug_anew(path, tmp_path):
    file = tmp_path / "path.csv"
    head, places = {
        "RECORDED": ("state,x_m,y_m,depth_m", ("1,0,2,{}", "1,0,1.9,{}", (0.04, 0.06))),
        "JOINTS": (
            "state,yaw_deg,shoulder_deg,elbow_deg,wrist_deg,roll_deg",
            ("1,0,20,-70,{},0", "1,1,20,-70,{},0", (-40, -41)),
        ),
    }[path]
    taken = []
    for value in places[2]:
        file.write_text("\n".join([head, *(line.format(value) for line in places[:2])]), encoding="utf-8")
        made = dug(path=path, file=str(file), states=2, state=1)
        taken.append(made.series.site.deepest_m)
    assert taken[0] != taken[1]


def test_a_built_scene_records_what_was_dug():
    built = open_empty_scene(complete({"excavation": DUG | {"state": 1}}))
    assert built.excavation["taken_m3"] == pytest.approx(0.08 * 0.2 * 0.05, rel=1e-6)
    assert DEPTH in built.terrain.data.attributes
    assert json.dumps(built.excavation)
    assert not open_empty_scene(complete()).excavation


def test_the_camera_of_a_series_moves_by_the_seed_and_the_state():
    still = complete({"excavation": DUG})
    assert jitter_rig(still) == still.rig
    shaken = [
        complete({"excavation": DUG | {"jitter_m": 0.01, "jitter_deg": 0.1, "state": state}}) for state in (0, 1, 1)
    ]
    first, second, again = map(jitter_rig, shaken)
    assert first != second == again
    assert abs(first.x_m) < 0.05
    off = description.merged(shaken[0], {"excavation": {"path": "NONE"}})
    assert jitter_rig(off) == off.rig


def test_a_rock_over_the_trench_falls_to_its_floor():
    rock = {"rocks": {"coverage": 0.02, "smallest_m": 0.05, "largest_m": 0.06}}
    heights = {}
    for state in (0, 2):
        wide = {"state": state, "length_m": 0.8, "width_m": 0.5, "cell_m": 0.02, "heaped_share": 0.2}
        built = open_empty_scene(complete(rock, {"excavation": DUG | wide}))
        mesh = next(item for item in built.collection.all_objects if item.get("icymoon") == "rock").data
        co = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", co)
        heights[state] = co.reshape(-1, 3)
        rocks_moved = built.excavation["rocks_moved"]
    moved = heights[2][:, 2] < heights[0][:, 2] - 1e-3  # spoil at the rim lifts some beside it by less
    assert 0 < moved.sum() == rocks_moved < 0.1 * len(moved)
    assert (heights[2] - heights[0])[moved, 2].min() < -0.05  # to the floor, which is 0.1 m deep
    # They stay at the trench, or roll a little.
    assert np.hypot(*(heights[2] - heights[0])[moved, :2].T).max() < 0.5


def test_ground_that_overhangs_at_the_rim_is_a_sentence_with_its_fix():
    made, grid = mesh_whole_ground(complete()), dug(state=0).grid
    step = float(np.diff(np.unique(made.positions[:, 0].round(6))).min())
    shift = np.random.default_rng(1).normal(0.0, step, made.positions.shape) * (1.0, 1.0, 0.0)
    folded = replace(made, positions=made.positions + shift)
    with pytest.raises(IcyMoonError, match=r"mesh\.walls to FLUTED"):
        dug_ground.join_patch(folded, grid, np.zeros((grid.rows, grid.columns)))
