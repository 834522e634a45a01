"""The graded ground in Blender: round like the body, as near to the described ground as stated, in every heading."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.ground.heights_under import probe_heights
from icymoon.nodes.ground.terrain_mesh import measure_patch_roughness
from icymoon.physics.mesh.horizon import drop_m, horizon_m
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from rendering import complete, empty_scene, render

GRADED = {"mesh": {"kind": "GRADED"}, "quality": {"samples": 1}}
FLAT = {"terrain": {"rms_slope_deg": 0.0}, "surface": {"grain_amplitude_m": 0.0}}
RADIUS = 252_100.0


def vertices(item: bpy.types.Object) -> Array:
    """Vertex positions (n, 3) of an object's mesh."""
    out = np.empty(3 * len(item.data.vertices), np.float32)
    item.data.vertices.foreach_get("co", out)
    return out.reshape(-1, 3)


def rays(pair, eye: str) -> tuple[Array, Array]:
    """Centre (3,) of an eye and directions (rows, columns, 3) of its pixels, of unit planar depth."""
    camera, pose = pair.camera, np.array(pair.data["poses_camera_to_world"][eye])
    u, v = (np.arange(n) + 0.5 for n in (camera.width_px, camera.height_px))
    tangent = np.stack(
        np.broadcast_arrays(
            ((u - camera.cx_px) / camera.focal_px)[None, :], ((v - camera.cy_px) / camera.focal_px)[:, None], 1.0
        ),
        axis=-1,
    )
    return pose[:3, 3], tangent @ pose[:3, :3].T


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(("pitch", "focal"), [(45.84, 32.0), (20.0, 32.0), (0.5, 300.0)])
def test_depth_of_a_smooth_body_is_that_of_a_sphere(tmp_path, pitch, focal):
    pair, _ = render(tmp_path, GRADED, FLAT, {"rig": {"pitch_deg": pitch, "focal_length_mm": focal}})
    for eye in ("left", "right"):
        centre, ray = rays(pair, eye)
        depth = read_view(pair.image(eye)).depth
        # |centre + t ray - (0, 0, -R)|² = R², the nearer root, without the difference of nearly equal numbers.
        a, half_b = (ray**2).sum(axis=-1), ray @ (centre + np.array([0, 0, RADIUS]))
        c = centre[:2] @ centre[:2] + centre[2] * (centre[2] + 2 * RADIUS)
        inside = half_b**2 - a * c
        with np.errstate(invalid="ignore"):
            sphere = np.where((inside > 0) & (half_b < 0), c / (np.sqrt(np.maximum(inside, 0)) - half_b), np.nan)
        assert np.array_equal(np.isnan(depth), np.isnan(sphere))  # the horizon is where it belongs
        # A ray that grazes the ground makes much of little: rounding to 24 bits, and the sag of the edges.
        grazing = np.sqrt(np.maximum(inside, 0) / a) / RADIUS
        sure = grazing > 0.005
        assert np.nanmax(np.abs(depth / sphere - 1)[sure]) < 1e-4
        if pitch < 10:
            assert np.nanmax(sphere[sure]) > 200.0  # it was a test of the far field


def off_px(pair, ground, eye: str) -> Array:
    """How far the points that the depth of an eye states are off the ground, in pixels where they are seen."""
    centre, ray = rays(pair, eye)
    depth = read_view(pair.image(eye)).depth
    seen = np.isfinite(depth)
    depth, ray = depth[seen], ray[seen]
    place = centre + ray * depth[:, None]
    step = 1e-3

    def height(dx: float, dy: float) -> Array:
        x, y = place[:, 0] + dx, place[:, 1] + dy
        return ground.heights(x, y) - drop_m(np.hypot(x, y), RADIUS)

    slope = [(height(dx, dy) - height(-dx, -dy)) / (2 * step) for dx, dy in ((step, 0.0), (0.0, step))]
    away = np.abs(place[:, 2] - height(0.0, 0.0)) / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    # A small thing across the ray at the tangents (a, b) spans up to f (1 + a² + b²) pixels per radian.
    return away / depth * np.linalg.norm(ray, axis=1) * pair.camera.focal_px


CASES = {
    "rough": {"terrain": {"rms_slope_deg": 15.0, "hurst": 0.75}, "rig": {"pitch_deg": 5.0}},
    "steep and patchy": {
        "terrain": {"rms_slope_deg": 25.0, "hurst": 0.6, "multifractality": 1.0, "inner_scale_m": 0.05},
        "rig": {"pitch_deg": 45.84},
    },
    "smooth": {"terrain": {"rms_slope_deg": 5.0, "hurst": 0.95}, "rig": {"pitch_deg": 20.0}, "mesh": {"error_px": 0.3}},
    "wide baseline": {"terrain": {"rms_slope_deg": 12.0}, "rig": {"pitch_deg": 30.0, "baseline_m": 1.5}},
    "low and finer": {"terrain": {"rms_slope_deg": 12.0}, "rig": {"height_m": 0.5}, "mesh": {"error_px": 0.5}},
    "low Hurst": {"terrain": {"rms_slope_deg": 12.0, "hurst": 0.3, "inner_scale_m": 0.2}, "rig": {"pitch_deg": 15.0}},
    "penitentes": {"terrain": {"rms_slope_deg": 5.0}, "penitentes": {"height_m": 1.0}, "rig": {"pitch_deg": 10.0}},
    "flank with cracks and craters": {
        "terrain": {"rms_slope_deg": 8.0, "regional_slope_deg": 20.0},
        "cracks": {"depth_m": 0.3},
        "craters": {"coverage": 0.2},
    },
}
_SLOW = [pytest.mark.slow]
_MARKS = {
    "penitentes": _SLOW,
    "flank with cracks and craters": _SLOW,
    **{case: [pytest.mark.slow, pytest.mark.long] for case in ("steep and patchy", "smooth", "low Hurst")},
}


@pytest.mark.ci_takes(3)
@pytest.mark.timeout(600)
@pytest.mark.parametrize("case", [pytest.param(c, marks=_MARKS.get(c, ())) for c in CASES])
def test_the_bound_holds_in_every_heading_and_both_eyes(tmp_path, case):
    settings = complete(GRADED, CASES[case], {"dataset": {"headings": 4}})
    built = scenes.build_scene(empty_scene(), settings)
    assert built.warnings == ()
    folders = render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    ground = scenes.make_ground(settings)
    shares = []
    for pair in map(read_pair, folders):
        for eye in ("left", "right"):
            shares.append(float(np.mean(off_px(pair, ground, eye) <= settings.mesh.error_px)))
    assert len(shares) == 8
    assert min(shares) >= 0.95, shares


def test_the_camera_stands_over_the_mesh_and_two_builds_are_equal():
    settings = complete(GRADED, {"rig": {"x_m": 3.0, "y_m": -4.0}, "terrain": {"rms_slope_deg": 25.0}})
    built = scenes.build_scene(empty_scene(), settings)
    first, triangles = vertices(built.terrain), len(built.terrain.data.polygons)
    assert built.terrain.data.validate() is False
    normals = np.empty(3 * triangles, np.float32)
    built.terrain.data.polygons.foreach_get("normal", normals)
    assert normals[2::3].min() > 0
    assert np.allclose(first[0, :2], [3.0, -4.0])
    with probe_heights(built.terrain) as height_at:
        under = float(height_at(np.array([3.0]), np.array([-4.0]))[0])
        wide = height_at(np.array([1000.0, -1000.0]), np.array([500.0, 0.0]))
    assert built.camera.location.z - under == pytest.approx(settings.rig.height_m, abs=1e-5)
    assert np.isfinite(wide).all()
    again = scenes.build_scene(bpy.context.scene, settings)
    assert np.array_equal(vertices(again.terrain), first)


def test_it_reaches_the_horizon_of_the_body():
    for radius in (252_100.0, 1_560_800.0):
        built = scenes.build_scene(empty_scene(), complete(GRADED, FLAT, {"terrain": {"body_radius_m": radius}}))
        reach = np.hypot(*vertices(built.terrain)[:, :2].T).max()
        assert horizon_m(1.6, radius) <= reach < 1.5 * horizon_m(1.6, radius)


def test_the_roughness_of_the_patch_is_measured():
    settings = complete(GRADED)
    built = scenes.build_scene(empty_scene(), settings)
    found = measure_patch_roughness(scenes.measure_patch(built), settings.terrain)
    # The patch is made to show what is asked for, to a tenth.
    assert found.slope_deg == pytest.approx(settings.terrain.rms_slope_deg, rel=0.1)
    assert built.statistics["made"] == found.numbers()
