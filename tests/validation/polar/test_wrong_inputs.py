"""The comparison must fail where the scene was built wrongly: a moved lamp, a missing rock, a tilted camera.

Twins are drawn and not rendered, from the truth of a scene that is known. Eggs and their shadows are convex.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from icymoon.stereo.images.masks import fill_hulls, fill_polygons
from icymoon.validation.comparison import FAILS, Bench, Comparison, run_comparison
from icymoon.validation.polar.camera import make_camera_rotation
from icymoon.validation.polar.data_set import EYES, HEIGHT_PX, ROCK, SHADOW, WIDTH_PX, View
from icymoon.validation.polar.sand import Sand
from icymoon.validation.polar.scans import find_left_out
from icymoon.validation.polar.scene import Masks, Twin, find_frame
from icymoon.validation.polar.skirts import BOUND_M
from icymoon.validation.polar_comparison import Rebuilt, judge_terrain
from polar_folders import SAND_M, read_known, shadow_on_sand

_SCALE = 0.5
_SHAPE = (int(HEIGHT_PX * _SCALE), int(WIDTH_PX * _SCALE))


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The terrain that was read, and its true camera, sand and lamps."""
    return read_known(tmp_path_factory.mktemp("polar"))


def _draw(terrain, camera, lamps, left_out, hollow):
    """The masks of every photograph, as the renders of these inputs would have them."""
    found = {}
    for (view, azimuth), bare in left_out.items():
        eye, lamp = camera.eyes[view], lamps[azimuth]
        rock = fill_hulls(_SHAPE, [eye.project(each.vertices) * _SCALE for each in terrain.rocks])
        cast = [eye.project(shadow_on_sand(each.vertices, lamp)) * _SCALE for each in terrain.rocks]
        labelled, shadow, unknown = (
            fill_polygons(_SHAPE, [each * _SCALE for each in outlines])
            for outlines in (
                terrain.polygons(view, azimuth, ROCK),
                terrain.polygons(view, azimuth, SHADOW),
                [*bare.rocks, *bare.shadows],
            )
        )
        judged = ~unknown
        dark = fill_hulls(_SHAPE, cast) & ~rock
        own = np.full(_SHAPE, hollow)
        found[view, azimuth] = Masks(
            labelled & judged,
            shadow & ~labelled & judged,
            rock & judged,
            dark & judged,
            judged,
            Twin(rock, dark, own, np.ones(_SHAPE), np.ones(_SHAPE)),
        )
    return found


def _result(tmp_path, terrain, camera, sand, lamps, hollow=False):
    left_out = {each: find_left_out(terrain, camera, *each) for each in terrain.photographs}
    masks = _draw(terrain, camera, lamps, left_out, hollow)
    frames = {position: find_frame(terrain, camera, sand, position, 480) for position in terrain.positions}
    rows = judge_terrain(Rebuilt(terrain, camera, sand, lamps, left_out, frames), masks)
    return run_comparison(Comparison("polar", "A real scene", "", lambda bench: rows), Bench(tmp_path))


def _failing(found):
    return {row.quantity for row in found.rows if row.verdict == FAILS}


def _some(quantities, *words):
    return any(all(word in each for word in words) for each in quantities)


def test_a_scene_that_is_built_rightly_passes(known, tmp_path):
    found = _result(tmp_path, *known)
    assert found.passes, _failing(found)
    unjudged = [row.quantity for row in found.rows if row.note and not row.fitted]
    assert unjudged == ["matchers on the photographs"]


@pytest.mark.parametrize(
    ("moved", "quantities"),
    [
        ((0.0, 0.6, 0.0), ["lamp", "shadows"]),
        ((0.0, 0.0, 0.25), ["shadows", "tips"]),
        ((0.0, 0.0, -0.1), ["tips"]),
    ],
)
def test_a_moved_lamp_fails(known, tmp_path, moved, quantities):
    terrain, camera, sand, lamps = known
    found = _result(tmp_path, terrain, camera, sand, {30: lamps[30] + moved})
    assert not found.passes
    assert all(_some(_failing(found), word) for word in quantities)


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("number", range(10))
def test_a_rock_that_was_not_scanned_fails_though_its_outlines_are_left_out(known, tmp_path, number):
    terrain, camera, sand, lamps = known
    rocks = tuple(rock for k, rock in enumerate(terrain.rocks) if k != number)
    less = replace(sand, middles=np.delete(sand.middles, number, axis=0), offs=np.zeros(len(rocks)))
    found = _result(tmp_path, replace(terrain, rocks=rocks), camera, less, lamps)
    assert not found.passes
    assert _some(_failing(found), "without a scan")
    # What is left is right, and the missing rock and its shadow count in no mask.
    assert not _some(_failing(found), "rocks, position")
    assert not _some(_failing(found), "shadows, position")


def test_rocks_that_no_photograph_shows_fail(known, tmp_path):
    terrain, camera, sand, lamps = known
    fewer = {at: outlines[4:] for at, outlines in terrain.photographs.items()}  # two rocks and their shadows
    found = _result(tmp_path, replace(terrain, photographs=fewer), camera, sand, lamps)
    assert not found.passes
    assert _some(_failing(found), "rocks, position A, right eye")


def test_a_tilted_camera_fails(known, tmp_path):
    terrain, camera, sand, lamps = known
    tilt = make_camera_rotation(0.0, 1.0, 0.0) @ make_camera_rotation(0.0, 0.0, 0.0).T
    eyes = {view: replace(eye, turn=tilt @ eye.turn) for view, eye in camera.eyes.items()}
    found = _result(tmp_path, terrain, replace(camera, eyes=eyes), sand, lamps)
    assert not found.passes
    assert _some(_failing(found), "rocks, position A, right eye")


def test_eyes_that_are_not_beside_each_other_fail_by_disparity(known, tmp_path):
    terrain, camera, sand, lamps = known
    right = camera.eyes[View("A", "R")]
    eyes = {**camera.eyes, View("A", "R"): replace(right, place_m=right.place_m + 0.03 * right.turn[0])}
    found = _result(tmp_path, terrain, replace(camera, eyes=eyes), sand, lamps)
    assert _some(_failing(found), "disparity")
    assert _some(_failing(found), "baseline")


def test_sand_that_casts_shadows_of_its_own_fails(known, tmp_path):
    terrain, camera, sand, lamps = known
    found = _result(tmp_path, terrain, camera, sand, lamps, hollow=True)
    assert _some(_failing(found), "shadow of the sand")


def test_the_sand_is_bounded_smooth_and_returns_to_its_plane(known):
    _, _, sand, _ = known
    wild = replace(
        sand, offs=np.resize([0.3, -0.3], len(sand.offs)), nodes=np.array([[0.0, 0.0]]), raised=np.array([1.0])
    )
    grid = np.stack(np.meshgrid(np.linspace(-2, 2, 201), np.linspace(-2, 2, 201)), axis=-1).reshape(-1, 2)
    assert np.abs(wild.heights(grid) - SAND_M).max() <= BOUND_M + 1e-12
    alone = Sand(sand.plane, np.zeros((1, 2)), np.array([BOUND_M]), np.zeros((1, 2)), np.zeros(1))
    heights = alone.heights(grid).reshape(201, 201)
    slope = np.hypot(*np.gradient(heights, 0.02)).max()
    # A Gaussian of this height and width; the lamps' light falls with 0.14 at the far end of the sandbox.
    assert slope == pytest.approx(BOUND_M / 0.3 * np.exp(-0.5), rel=0.1)
    assert slope < 0.14
    assert np.abs(heights[[0, -1]] - SAND_M).max() < 1e-6


@pytest.mark.parametrize("eye", EYES)
def test_a_shadow_is_left_out_with_its_rock_only(known, eye):
    terrain, camera, *_ = known
    view = View("A", eye)
    assert find_left_out(terrain, camera, view, 30).share == 0.0
    fewer = replace(terrain, rocks=terrain.rocks[1:])
    found = find_left_out(fewer, camera, view, 30)
    (rock,), (shadow,) = found.rocks, found.shadows
    assert rock is terrain.polygons(view, 30, ROCK)[0]
    assert shadow is terrain.polygons(view, 30, SHADOW)[0]
    areas = [np.count_nonzero(fill_polygons(_SHAPE, [each * _SCALE])) for each in terrain.polygons(view, 30, ROCK)]
    assert found.share == pytest.approx(areas[0] / sum(areas), rel=0.05)
