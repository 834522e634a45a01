"""Where fine relief is geometry, and how fine the mesh is there."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from icymoon.physics.mesh import fine_relief
from icymoon.physics.mesh.graded_ground import grade_ground
from icymoon.physics.mesh.grading import fine_relief_of, view_of
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings import changes, description

#: A small camera near rough ice, so that meshes are small.
NEAR = {"rig": {"height_m": 0.4, "width_px": 120, "height_px": 90, "baseline_m": 0.06},
        "surface": {"grain_size_m": 0.05, "grain_amplitude_m": 0.02}, "terrain": {"rms_slope_deg": 10.0}}


def described(*changed):
    return description.merged(description.defaults(), NEAR, *changed)


def meshed(settings):
    return grade_ground(make_terrain(settings, 1), settings)


def test_the_default_scene_has_no_fine_relief_in_its_mesh_and_does_not_pay_for_it():
    """Its relief is 1.1 mm high, half a pixel at 1.1 m, and nothing is seen nearer than 1.6 m."""
    default = description.defaults()
    assert fine_relief_of(default) is None
    assert changes.relief_in_mesh(default) == ""


@pytest.mark.parametrize("change", [
    {"surface": {"relief": "BUMP"}}, {"surface": {"relief": "DISPLACEMENT"}}, {"surface": {"grain_amplitude_m": 0.0}},
    {"source": {"kind": "HEIGHT_MAP"}}], ids=str)
def test_only_real_relief_of_procedural_ground_is_in_the_mesh(change):
    assert fine_relief_of(described()) is not None
    assert fine_relief_of(described(change)) is None


def test_relief_ends_where_it_is_half_a_pixel_high():
    relief = fine_relief_of(described())
    at = view_of(described().rig)
    assert fine_relief.height_m(described().surface) * at.pixels_per_radian / relief.to_m == pytest.approx(0.5)


def test_the_mesh_is_as_fine_as_the_image_where_the_cameras_see_it():
    settings = described()
    made = meshed(settings).mesh_with_relief()
    eye = np.array([0.0, 0.0, made.positions[0, 2] + 0.4])
    corners = made.positions[made.faces[made.fine]]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    away = np.linalg.norm(corners.mean(axis=1) - eye, axis=1)
    px = np.median(sides, axis=1) / away * view_of(settings.rig).pixels_per_radian
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
        one, other = (described({"surface": {"relief": relief}, "rig": {"heading_deg": heading}})
                      for heading in (0.0, 30.0))
        assert (changes.scene(one) != changes.scene(other)) == differs


def test_points_are_seen_from_the_place_that_the_image_shows():
    rig = described({"rig": {"pitch_deg": 0.0, "heading_deg": 90.0}}).rig
    half = rig.sensor_width_mm / rig.focal_length_mm / 2
    east = np.full(5, 10.0)
    north = -east * half * np.array([-1.3, -0.9, 0.0, 0.9, 1.3])  # south is to the right of east
    assert fine_relief.is_seen(rig, east, north, np.zeros(5)).tolist() == [False, True, True, True, False]
    assert not fine_relief.is_seen(rig, -east, north, np.zeros(5)).any()


def test_displacement_that_loses_relief_says_how_much():
    settings = described({"surface": {"relief": "DISPLACEMENT"}})
    assert fine_relief.displacement_advice(settings, 0.001) == []
    (sentence,) = fine_relief.displacement_advice(settings, 0.02)
    assert "20 mm apart" in sentence
    assert f"{fine_relief.carried_share(settings.surface, 0.02):.0%}" in sentence
    assert fine_relief.displacement_advice(described(), 0.02) == []


def test_the_share_that_is_carried_falls_from_all_to_nothing():
    surface = described().surface
    shares = [fine_relief.carried_share(surface, spacing) for spacing in (0.004, 0.006, 0.01, 0.02, 0.04, 0.05)]
    assert shares[0] == 1.0
    assert shares[-1] == 0.0
    assert all(a > b for a, b in itertools.pairwise(shares))
