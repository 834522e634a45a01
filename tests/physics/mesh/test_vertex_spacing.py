"""The graded mesh: the body's roundness, rings without cracks, and an error under its bound."""

from __future__ import annotations

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.mesh.horizon import drop_m, horizon_m
from icymoon.physics.mesh.vertex_rings import VertexRings
from icymoon.physics.mesh.vertex_spacing import EDGE_OVER_SPACING, make_grading_view
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import check, defaults, merged
from icymoon.support.arrays import Array

#: Small images, so that meshes are small.
SMALL = {"rig": {"width_px": 96, "height_px": 72}}
#: Grounds that a law of roughness would or would not describe.
GROUNDS = {
    "smooth": {"terrain": {"rms_slope_deg": 5.0, "hurst": 0.9}},
    "rough": {"terrain": {"rms_slope_deg": 15.0, "hurst": 0.75}},
    "steep, low Hurst": {"terrain": {"rms_slope_deg": 25.0, "hurst": 0.5, "inner_scale_m": 0.1}},
    "patchy": {"terrain": {"rms_slope_deg": 20.0, "multifractality": 1.0}},
    "penitentes": {"terrain": {"rms_slope_deg": 5.0}, "penitentes": {"height_m": 1.0}},
    "cracks": {"terrain": {"rms_slope_deg": 8.0}, "cracks": {"depth_m": 0.3}},
    "craters": {"terrain": {"rms_slope_deg": 5.0}, "craters": {"coverage": 0.3}},
    "slope": {"terrain": {"rms_slope_deg": 8.0, "regional_slope_deg": 25.0}},
}


def made(*changes):
    """The graded ground of a description, and the description."""
    settings = merged(defaults(), SMALL, *(check(c, "test") for c in changes))
    return grade_ground(make_terrain(settings, 1), settings), settings


@pytest.mark.parametrize("radius", [252_100.0, 1_560_800.0, 1.0e4])
@pytest.mark.parametrize("height", [1e-3, 1.6, 1000.0])
def test_horizon_and_drop_are_those_of_a_sphere(radius, height):
    getcontext().prec = 50
    r, h = Decimal(radius), Decimal(height)
    # The tangent from a height h touches where R, the ray and R + h make a right angle: at R/(R + h) of R below
    # the eye's axis, sqrt(R² - (R²/(R + h))²) beside it.
    beside = (r * r - (r * r / (r + h)) ** 2).sqrt()
    assert horizon_m(height, radius) == pytest.approx(float(beside), rel=1e-14)
    for distance in (1e-3, 1.0, 100.0, 5000.0):
        under = r - (r * r - Decimal(distance) ** 2).sqrt()
        assert float(drop_m(distance, radius)) == pytest.approx(float(under), rel=1e-14)
    # The ground there lies R - R²/(R + h) = R h/(R + h) under the tangent plane.
    assert float(drop_m(horizon_m(height, radius), radius)) == pytest.approx(
        radius * height / (radius + height), rel=1e-9
    )
    assert horizon_m(0.0, radius) == 0.0


def _edges(faces: Array) -> Array:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _check_closed(rings: VertexRings) -> None:
    x, y = rings.map_positions()
    faces = rings.faces()
    assert len(x) == rings.vertices
    assert np.array_equal(np.unique(faces), np.arange(rings.vertices))  # every vertex is used, none is missing
    edges = _edges(faces)
    directed = edges[:, 0].astype(np.int64) * rings.vertices + edges[:, 1]
    backward = edges[:, 1].astype(np.int64) * rings.vertices + edges[:, 0]
    # Consistent orientation: no directed edge twice. Closed: each but the outermost ring's meets its reverse.
    assert len(np.unique(directed)) == len(directed)
    alone = edges[~np.isin(directed, backward)]
    outermost = rings.vertices - rings.count[-1]
    assert len(alone) == rings.count[-1]
    assert (alone >= outermost).all()
    corner = np.stack([x, y], axis=1)[faces]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    assert area.min() > 0  # none degenerate or turned over
    # A disc with one boundary: V - E + F = 1, and no ground is covered twice or left out.
    assert rings.vertices - (len(edges) + len(alone)) // 2 + len(faces) == 1
    n = rings.count[-1]
    assert area.sum() == pytest.approx(n / 2 * rings.radius_m[-1] ** 2 * math.sin(2 * math.pi / n), rel=1e-9)


@given(st.lists(st.integers(6, 60), min_size=1, max_size=8))
def test_rings_of_any_numbers_close_without_a_crack(counts):
    # Rings so far apart that a chord of one does not reach the next, however few its vertices.
    _check_closed(VertexRings(2.5 ** np.arange(len(counts)), np.array(counts)))


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("name", GROUNDS)
def test_the_mesh_is_closed_and_grows_coarser_outward(name):
    ground, _ = made(GROUNDS[name])
    rings = ground.grading.rings
    _check_closed(rings)
    assert np.all(np.diff(rings.radius_m) > 0)
    assert rings.radius_m[-1] == pytest.approx(ground.grading.farthest_m, rel=1e-12)
    r = np.geomspace(0.01, ground.grading.farthest_m, 200)
    steps, distances = (np.diff(np.log(a)) for a in (ground.grading.spacing_at(r), ground.grading.view.nearest_m(r)))
    assert np.all(np.abs(steps) <= 4 * distances + 1e-12)  # no step from one fineness to another


def test_no_edge_on_level_ground_is_longer_than_stated():
    for changes in ({}, {"rig": {"baseline_m": 2.0}}, {"mesh": {"edge_px": 3.0}}, {"rig": {"height_m": 20.0}}):
        ground, settings = made({"terrain": {"rms_slope_deg": 0.0}}, changes)
        positions, faces, _ = ground.mesh()
        at = ground.grading.view
        ends = positions[_edges(faces)]
        middle = np.hypot(*ends.mean(axis=1)[:, :2].T)
        longest = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / at.nearest_m(middle) * at.pixels_per_radian
        assert longest.max() < settings["mesh"]["edge_px"]
        assert longest.max() > settings["mesh"]["edge_px"] / EDGE_OVER_SPACING  # and not much finer either


def test_the_pixels_of_a_radian_are_those_of_the_image():
    at = make_grading_view(merged(defaults(), {"rig": {"focal_length_mm": 1000.0}}).rig)
    # A narrow lens has f pixels per radian everywhere: 640 * 1000 / 60.
    assert at.pixels_per_radian == pytest.approx(640 * 1000 / 60, rel=1e-3)
    wide = make_grading_view(defaults().rig)
    # The mean over the paper's image of 1 + tan², on a grid.
    a, b = np.linspace(-30, 30, 601) / 32, np.linspace(-22.5, 22.5, 451) / 32
    assert wide.pixels_per_radian == pytest.approx(640 * 32 / 60 * (1 + (a**2).mean() + (b**2).mean()), rel=1e-2)


def test_the_drop_of_the_ground_is_in_the_mesh():
    ground, _ = made({"terrain": {"rms_slope_deg": 0.0}})
    positions, _, _ = ground.mesh()
    r = np.hypot(positions[:, 0], positions[:, 1])
    assert np.allclose(positions[:, 2], -drop_m(r, 252_100.0), rtol=1e-12)
    assert r.max() >= horizon_m(1.6, 252_100.0)  # the horizon is on it
    assert positions[0].tolist() == [0, 0, 0]


def test_hills_beyond_the_horizon_are_in_the_mesh():
    flat, rough = made({"terrain": {"rms_slope_deg": 0.0}})[0], made(GROUNDS["rough"])[0]
    relief = rough.mesh()[0][:, 2].max()
    assert relief > 0.2
    assert rough.grading.farthest_m > flat.grading.farthest_m + horizon_m(relief, 252_100.0)


def test_farthest_and_most_are_kept_to():
    near, _ = made({"mesh": {"farthest_m": 50.0}})
    assert near.grading.farthest_m == 50.0
    assert np.hypot(*near.mesh()[0][:, :2].T).max() == pytest.approx(50.0)
    for most in (1000, 20_000):
        ground, settings = made({"mesh": {"most": most, "error_px": 0.3}})
        assert 0.5 * most < ground.grading.rings.vertices <= most
        assert ground.grading.error_px > 0.3
        (sentence,) = ground.advice(settings)
        assert "mesh.most" in sentence
    ground, settings = made()
    assert ground.grading.error_px == pytest.approx(1.0)
    assert ground.advice(settings) == []


def test_a_smaller_error_costs_more_and_a_larger_image_too():
    count = [
        made(GROUNDS["rough"], c)[0].grading.rings.vertices
        for c in (
            {"mesh": {"error_px": 2.0}},
            {},
            {"mesh": {"error_px": 0.5}},
            {"mesh": {"error_px": 0.5}, "rig": {"width_px": 192, "height_px": 144}},
        )
    ]
    assert count == sorted(count)
    assert count[-1] > 3 * count[-2]


@pytest.mark.long
def test_the_ground_goes_on_beyond_the_patch():
    settings = merged(
        defaults(), {"terrain": {"rms_slope_deg": 0.0, "regional_slope_deg": 30.0, "regional_slope_azimuth_deg": 90.0}}
    )
    ground = make_terrain(settings, 1)
    x = np.array([-1e6, -1e3, -14.0, -5.0, 0.0, 5.0, 14.0, 1e3, 1e6])
    z = ground.heights(x, 0 * x)
    fall = math.tan(math.radians(30.0))
    assert np.allclose(z[2:7], -fall * x[2:7])  # a plane as far as the patch's corners
    assert np.all(np.diff(z) <= 0)
    assert abs(z[0]) == pytest.approx(2 * fall * 10 * math.sqrt(2), rel=1e-6)  # a flank of finite height
    cratered = make_terrain(merged(defaults(), {"terrain": {"rms_slope_deg": 0.0}, "craters": {"coverage": 0.3}}), 1)
    axis = np.linspace(-200, 200, 401)
    far = cratered.heights(axis[None, :], axis[:, None])
    blocks = far[:400, :400].reshape(20, 20, 20, 20).std(axis=(1, 3))
    assert blocks.min() > 0.2 * np.median(blocks)  # craters everywhere, no bare ring round the patch
    patch = np.abs(axis) <= 10
    alone = cratered.heights(axis[None, patch], axis[patch, None])
    assert np.allclose(far[np.ix_(patch, patch)], alone, atol=1e-12)


def test_a_height_does_not_depend_on_the_points_beside_it():
    for name in GROUNDS:
        ground = make_terrain(merged(defaults(), *(check(c, "test") for c in (GROUNDS[name],))), 1)
        x, y = np.random.default_rng(0).uniform(-50, 50, (2, 4000))
        shortest = np.geomspace(0.01, 3.0, 4000)
        together = ground.heights(x, y, shortest)
        for some in (slice(0, 100), slice(3900, 4000)):
            assert np.array_equal(ground.heights(x[some], y[some], shortest[some]), together[some]), name
