"""Where fine relief is geometry, and how fine the mesh is there."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from icymoon.physics.mesh import finer_in_view
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.mesh.vertex_spacing import find_fine_relief, make_grading_view
from icymoon.physics.rig.seen_points import is_in_view
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings import description, rebuilt_parts

#: A small camera near rough ice, so that meshes are small.
NEAR = {
    "rig": {"height_m": 0.4, "width_px": 120, "height_px": 90, "baseline_m": 0.06},
    "surface": {"grain_size_m": 0.05, "grain_amplitude_m": 0.02},
    "terrain": {"rms_slope_deg": 10.0},
}


def described(*changed):
    return description.merged(description.defaults(), NEAR, *changed)


def meshed(settings):
    return grade_ground(make_terrain(settings, 1), settings)


def test_the_default_scene_has_no_fine_relief_in_its_mesh_and_does_not_pay_for_it():
    """Its relief is 1.1 mm high, half a pixel at 1.1 m, and nothing is seen nearer than 1.6 m."""
    default = description.defaults()
    assert find_fine_relief(default) is None
    assert rebuilt_parts.describe_mesh_relief(default) == ""


@pytest.mark.parametrize(
    "change",
    [
        {"surface": {"relief": "BUMP"}},
        {"surface": {"relief": "DISPLACEMENT"}},
        {"surface": {"grain_amplitude_m": 0.0}},
        {"source": {"kind": "HEIGHT_MAP"}},
    ],
    ids=str,
)
def test_only_real_relief_of_procedural_ground_is_in_the_mesh(change):
    assert find_fine_relief(described()) is not None
    assert find_fine_relief(described(change)) is None


def test_relief_ends_where_it_is_half_a_pixel_high():
    relief = find_fine_relief(described())
    at = make_grading_view(described().rig)
    assert finer_in_view.relief_height_m(described().surface) * at.pixels_per_radian / relief.to_m == pytest.approx(0.5)


def test_the_mesh_is_as_fine_as_the_image_where_the_cameras_see_it():
    settings = described()
    made = meshed(settings).mesh_with_relief()
    eye = np.array([0.0, 0.0, made.positions[0, 2] + 0.4])
    corners = made.positions[made.faces[made.fine]]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    away = np.linalg.norm(corners.mean(axis=1) - eye, axis=1)
    px = np.median(sides, axis=1) / away * make_grading_view(settings.rig).pixels_per_radian
    assert np.median(px) < 1.4
    assert np.quantile(px, 0.99) < 3.0  # slopes lengthen the sides
    assert made.positions[made.faces[made.fine]].mean(axis=(0, 1))[1] > 0.1  # north, where the cameras look


def test_vertices_at_the_border_are_not_moved_and_the_mesh_without_relief_is_inside():
    """What is moved is surrounded by what is not, so that no crack opens."""
    settings = described()
    made, plain = meshed(settings).mesh_with_relief(), meshed(described({"surface": {"relief": "BUMP"}})).mesh()
    moved = np.isfinite(made.spacing_m)
    assert moved.any()
    assert not moved[np.unique(made.faces[~made.fine])].any()
    assert len(made.positions) < 2.5 * len(plain[0])
    assert len(np.unique(made.faces)) == len(made.positions)


def test_a_mesh_may_be_too_large_for_it_and_says_what_is_left():
    enough = meshed(described()).mesh_with_relief()
    settings = described({"mesh": {"most": int(0.7 * len(enough.positions))}})
    ground = meshed(settings)
    assert len(ground.mesh()[0]) <= settings.mesh.most
    (sentence,) = ground.advice(settings)
    assert "% of the height of the nearest relief is geometry" in sentence
    assert meshed(described()).advice(described()) == []


def test_a_camera_that_turns_needs_another_mesh_only_for_real_relief():
    for relief, differs in (("REAL", True), ("BUMP", False)):
        one, other = (
            described({"surface": {"relief": relief}, "rig": {"heading_deg": heading}}) for heading in (0.0, 30.0)
        )
        assert (rebuilt_parts.select_scene(one) != rebuilt_parts.select_scene(other)) == differs


FINE = {"mesh": {"seen": "FINE"}}


def _middles(settings, made):
    """Middles (m, 3) of triangles, and which of them the cameras see from 1 m to 50 m away."""
    middles = made.positions[made.faces].mean(axis=1)
    east, north = middles[:, 0], middles[:, 1]
    away = np.hypot(east, north)
    above = middles[:, 2] - made.positions[0, 2] - settings.rig.height_m
    return middles, (away > 1.0) & (away < 50.0) & is_in_view(settings.rig, east, north, above)


def _off_the_ground(settings):
    """RMS distance in pixels of the middles of triangles that are seen from the ground with all its waves."""
    ground, at = meshed(settings), make_grading_view(settings.rig)
    middles, seen = _middles(settings, ground.mesh_with_relief())
    x, y, z = middles[seen].T
    return np.sqrt(np.mean(((z - ground.heights(x, y)) * at.pixels_per_radian / at.nearest_m(np.hypot(x, y))) ** 2))


@pytest.mark.parametrize("relief", ["REAL", "BUMP"])
def test_ground_that_is_seen_finer_is_nearer_to_what_is_stated(relief):
    """Triangles a third as wide leave out waves a third as long. Heights of waves go as their lengths to the power of
    the Hurst exponent, 0.8, so the mesh is 3^0.8 = 2.4 times as near; of few hills, 1.8 at least."""
    even, fine = (described({"surface": {"relief": relief}}, change) for change in ({}, FINE))
    assert _off_the_ground(even) > 1.8 * _off_the_ground(fine)


def test_finer_ground_ends_where_the_cameras_see_nothing():
    """Behind the camera the mesh is the same, and what is cut is surrounded by what is not, so that no crack opens."""
    fine = described({"surface": {"relief": "BUMP"}}, FINE)
    made, plain = meshed(fine).mesh_with_relief(), meshed(fine | {"mesh": fine.mesh | {"seen": "EVEN"}}).mesh()
    whole = made.faces[~made.fine]
    behind = plain[0][plain[1]][..., 1].max(axis=1) < -1.0
    assert behind.any()
    np.testing.assert_array_equal(
        made.positions[whole][made.positions[whole][..., 1].max(axis=1) < -1.0], plain[0][plain[1]][behind]
    )
    assert not np.isfinite(made.spacing_m[np.unique(whole)]).any()
    assert _middles(fine, made)[1][: len(whole)].mean() < 0.01  # nothing that is seen is left whole


def test_a_camera_that_turns_needs_another_mesh_where_it_is_finer():
    def scene(*changed):
        return rebuilt_parts.select_scene(described({"surface": {"relief": "BUMP"}}, *changed))

    turned = {"rig": {"heading_deg": 30.0}}
    assert scene(turned) == scene()
    assert scene(FINE, turned) != scene(FINE) != scene()


def test_a_mesh_may_be_too_large_to_be_finer_and_says_so():
    bare = {"surface": {"grain_amplitude_m": 0.0}}
    enough = meshed(described(bare, FINE)).mesh_with_relief()
    settings = described(bare, FINE, {"mesh": {"most": int(0.7 * len(enough.positions))}})
    ground = meshed(settings)
    assert len(ground.mesh()[0]) <= settings.mesh.most
    (sentence,) = ground.advice(settings)
    assert "mesh.most" in sentence
    assert "mesh.seen" in sentence


def test_displacement_that_loses_relief_says_how_much():
    settings = described({"surface": {"relief": "DISPLACEMENT"}})
    assert finer_in_view.advise_on_displacement(settings, 0.001) == []
    (sentence,) = finer_in_view.advise_on_displacement(settings, 0.02)
    assert "20 mm apart" in sentence
    assert f"{finer_in_view.resolved_share(settings.surface, 0.02):.0%}" in sentence
    assert finer_in_view.advise_on_displacement(described(), 0.02) == []


def test_the_share_that_is_carried_falls_from_all_to_nothing():
    surface = described().surface
    shares = [finer_in_view.resolved_share(surface, spacing) for spacing in (0.004, 0.006, 0.01, 0.02, 0.04, 0.05)]
    assert shares[0] == 1.0
    assert shares[-1] == 0.0
    assert all(a > b for a, b in itertools.pairwise(shares))
