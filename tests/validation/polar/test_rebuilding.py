"""A scene that is known, built again from its labels: camera, sand, lamp, masks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from icymoon.support.errors import IcyMoonError
from icymoon.validation.comparison import Bench
from icymoon.validation.polar.camera import Eye, fit_camera, make_camera_rotation, measure_compared_share
from icymoon.validation.polar.data_set import EYES, ROCK, Polygon, Rock, Terrain, View, read_terrains
from icymoon.validation.polar.label_agreement import measure_label_agreement, trace_pixels_to_sand
from icymoon.validation.polar.lamp import HeightTable, Shadows, fit_lamps, trace_lamp_to_sand
from icymoon.validation.polar.sand import measure_sand
from icymoon.validation.polar.scene import find_frame
from icymoon.validation.polar_comparison import compare_terrains
from polar_folders import BASELINE_M, FOCAL_PX, SAND_M, shadow_on_sand, write_polar_folder


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The truth, the terrain that was read, its camera and its sand."""
    folder = tmp_path_factory.mktemp("polar")
    truth = write_polar_folder(folder)
    (terrain,) = read_terrains(folder)
    camera = fit_camera(terrain)
    return folder, truth, terrain, camera, measure_sand(terrain)


def test_distortion_is_undone():
    eye = Eye(
        2000.0,
        np.array([968.0, 608.0]),
        -0.09,
        -0.03,
        make_camera_rotation(170.0, 25.0, 1.0),
        np.array([3.5, -0.3, 1.7]),
    )
    points = np.array([[0.5, -1.0, 0.2], [-1.0, 1.2, 0.1], [0.0, 0.0, 0.17]])
    inside = (points - eye.place_m) @ eye.turn.T
    assert eye.rays(eye.project(points)) == pytest.approx(inside / inside[:, 2:], abs=1e-9)
    assert eye.turn @ eye.turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(eye.turn) == pytest.approx(1.0)


@pytest.mark.long
@pytest.mark.heavy
def test_the_camera_is_found(scene):
    _, truth, _, camera, _ = scene
    # Of each egg the points farthest in 300 directions are kept, 12 degrees apart: 50 px (1 - cos 6°) is 0.3 px.
    assert camera.median_px < 0.2
    assert camera.matched_share == 1.0
    assert camera.baseline_m == pytest.approx(BASELINE_M, rel=0.01)
    for view, eye in camera.eyes.items():
        # Focal length and distance are nearly one from a single position; what counts is where points are seen.
        assert eye.focal_px == pytest.approx(FOCAL_PX, rel=0.02)
        points = np.array([[x, y, SAND_M] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])
        assert np.abs(eye.project(points) - truth.eyes[view].project(points)).max() < 1.0


@pytest.mark.long
@pytest.mark.heavy
def test_labels_of_other_rocks_are_refused(scene):
    _, _, terrain, _, _ = scene
    elsewhere = tuple(
        replace(rock, vertices=rock.vertices * [0.3, -0.3, 1.0] + np.sin(9 * k) * 0.8)
        for k, rock in enumerate(terrain.rocks)
    )
    with pytest.raises(IcyMoonError, match="of one terrain"):
        fit_camera(replace(terrain, rocks=elsewhere))


def test_rocks_without_an_outline_count():
    view, rocks = View("A", "L"), tuple(Rock(k, np.zeros((3, 3)), np.zeros((1, 3), int)) for k in range(10))
    outlines = tuple(Polygon(ROCK, np.zeros((3, 2))) for _ in range(8))
    terrain = Terrain("04", rocks, {(view, 30): outlines, (view, 180): outlines})
    found = np.full((10, 13), np.nan)
    found[:2] = 1.0
    # Of ten rocks eight are outlined, and two are compared.
    assert measure_compared_share(terrain, {view: found}) == pytest.approx(2 / 8)
    found[:] = 1.0
    assert measure_compared_share(replace(terrain, rocks=rocks[:4]), {view: found[:4]}) == 1.0


@pytest.mark.long
@pytest.mark.heavy
def test_a_camera_that_a_few_rocks_of_another_terrain_agree_with_is_refused(scene, monkeypatch):
    _, _, terrain, _, _ = scene
    monkeypatch.setattr("icymoon.validation.polar.camera.measure_compared_share", lambda *found: 0.1)
    with pytest.raises(IcyMoonError, match=r"only 10% of the outlines .* of one terrain"):
        fit_camera(terrain)


@pytest.mark.long
@pytest.mark.heavy
def test_the_sand_is_level_where_it_is(scene):
    *_, sand = scene
    # The rims of the eggs are on the sand, written to 0.1 µm.
    assert sand.level_m == pytest.approx(SAND_M, abs=1e-6)
    assert sand.heights(np.array([[0.0, 0.0], [-0.5, 0.5], [3.0, 3.0]])) == pytest.approx(SAND_M, abs=1e-6)


@pytest.mark.heavy
def test_labels_without_error_agree_with_themselves(scene):
    _, _, terrain, camera, sand = scene
    hand = measure_label_agreement(terrain, camera, sand)
    assert np.isnan(hand.rocks["A"])  # there is one lamp
    assert hand.shadows["A"] > 0.93  # a pixel around shadows 20 px wide, and rows of sand a few millimetres off


def test_pixels_are_laid_on_the_sand():
    eye = Eye(
        2000.0,
        np.array([968.0, 608.0]),
        -0.09,
        -0.03,
        make_camera_rotation(170.0, 25.0, 1.0),
        np.array([3.5, -0.3, 1.7]),
    )
    points = np.array([[0.5, -1.0, 0.0], [-1.0, 1.2, 0.0], [0.0, 0.0, 0.0]])
    points[:, 2] = 0.1 + 0.05 * points[:, 0]
    assert trace_pixels_to_sand(eye, eye.project(points), lambda xy: 0.1 + 0.05 * xy[:, 0]) == pytest.approx(
        points, abs=1e-6
    )


@pytest.mark.heavy
def test_shadows_fall_where_rays_meet_the_sand(scene):
    _, truth, terrain, _, _ = scene
    points = terrain.rocks[0].vertices
    found = trace_lamp_to_sand(points, truth.lamp, lambda xy: np.full(len(xy), SAND_M))
    assert found == pytest.approx(shadow_on_sand(points, truth.lamp), abs=1e-3)


@pytest.mark.long
@pytest.mark.heavy
def test_the_lamp_is_found(scene):
    _, truth, terrain, camera, sand = scene
    lamps, raised = fit_lamps(terrain, camera, sand)
    # A pixel of the masks is 8 mm. Sideways it is that of the lamp at 4 m over a shadow of 0.8 m, five times as much.
    assert lamps[30] == pytest.approx(truth.lamp, abs=0.05)
    assert Shadows(terrain, camera, raised).measure_agreement(30, lamps[30], HeightTable(raised)) > 0.95


@pytest.mark.heavy
def test_the_frame_of_our_rig_sees_what_the_eyes_see(scene):
    _, _, terrain, camera, sand = scene
    frame = find_frame(terrain, camera, sand, "A", 480)
    points = terrain.rocks[4].vertices
    for eye in EYES:
        seen = frame.rectify(camera, eye, camera.eyes[View("A", eye)].project(points))
        assert seen == pytest.approx(frame.project(points, eye), abs=1e-3)
        assert (seen > 0).all()
        assert (seen < frame.size).all()
    left, right = (frame.project(points, eye) for eye in EYES)
    assert left[:, 1] == pytest.approx(right[:, 1], abs=1e-9)  # rows of both eyes are one
    level = frame.world @ frame.axes[0]
    assert level == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_known_scene_agrees_with_its_labels(scene, tmp_path):
    folder, *_ = scene
    rows = compare_terrains(Bench(tmp_path, quick=True, polar=folder))
    found = {row.quantity: row for row in rows}
    # An egg is 22 to 45 px wide: half a pixel all around it is 5 to 9 % of its area.
    for eye in ("left", "right"):
        assert found[f"rocks, position A, {eye} eye: intersection over union"].ours > 0.9
        assert found[f"shadows, position A, {eye} eye: intersection over union"].ours > 0.85
    tips = next(row for name, row in found.items() if name.startswith("tips") and "size" in name)
    assert tips.ours < 0.05  # a pixel of the masks by which lamp and sand are fitted is 4 % of these lengths
    assert next(row for name, row in found.items() if name.startswith("disparity")).ours < 0.2
    pictures = sorted((tmp_path / "terrain07").glob("twins_*.png"))
    assert [path.name for path in pictures] == ["twins_A_L.png", "twins_A_R.png"]
