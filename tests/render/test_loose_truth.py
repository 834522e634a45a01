"""The thickness of loose material in the truth of a pair, held against rays through the ground with and without it."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.library.rendered_pair import RenderedPair
from icymoon.nodes.build_scene import build_scene
from icymoon.nodes.ground.terrain_mesh import LOOSE as LOOSE_ATTRIBUTE
from icymoon.physics.scene_checks import find_reasons_in_settings
from icymoon.render.ray_stage import SceneRays
from icymoon.render.ray_truth import _PASSES_BY_TRUTH
from icymoon.render.render_pair import open_render_scene
from icymoon.settings.pair_ids import make_pair_id
from icymoon.support.arrays import Array
from icymoon.support.labels import LOOSE, ROCK, TERRAIN
from rendering import complete, empty_scene, render

#: Ground with a mantle, rocks and skirts, whose mesh is a grid, so that bare ground has the same triangles.
BURIED = {
    "terrain": {"size_m": 6.0, "resolution": 129},
    "mantle": {"thickness_m": 0.15, "length_m": 1.5},
    "rocks": {"coverage": 0.15, "smallest_m": 0.2, "skirt": 0.3},
    "quality": {"loose_thickness": True},
    "surface": {"relief": "BUMP"},
}
BARE = {"mantle": {"thickness_m": 0.0}, "rocks": {"skirt": 0.0}, "quality": {"loose_thickness": False}}


def heights_at(settings, places: Array) -> Array:
    """Heights (n,) of the ground under places (n, 2), by vertical rays."""
    built = build_scene(empty_scene(), settings)
    with open_render_scene(built, 1) as scene:
        rays = SceneRays(scene, np.inf)
        try:
            with rays.open_ground(False) as (_, tracer):
                start = np.column_stack([places, np.full(len(places), 50.0)])
                down = np.broadcast_to([0.0, 0.0, -1.0], start.shape)
                return 50.0 - tracer.intersect(start, down, 0.0, np.inf).along
        finally:
            rays.close()


def points_of(eye) -> Array:
    """World points (H, W, 3) that an eye sees."""
    camera, depth = eye._pair.camera, eye.depth_m
    row, column = np.indices(depth.shape)
    own = (
        np.stack(
            [
                (column + 0.5 - camera.cx_px) / camera.focal_px,
                (row + 0.5 - camera.cy_px) / camera.focal_px,
                np.ones(depth.shape),
            ],
            axis=-1,
        )
        * depth[..., None]
    )
    return own @ eye.pose_to_world[:3, :3].T + eye.pose_to_world[:3, 3]


@pytest.mark.parametrize("relief", ["BUMP", "DISPLACEMENT"])
def test_the_truth_is_the_height_that_rays_find_between_bare_and_covered_ground(tmp_path, relief):
    """Also where the material moves the vertices, whose loose material moves with them."""
    shaded = {"surface": {"relief": relief, "grain_amplitude_m": 0.004}}
    pair, _ = render(tmp_path, BURIED, shaded)
    eye = RenderedPair(pair).left
    loose, ground = eye.loose_thickness_m, eye.semantic == TERRAIN
    assert loose.dtype == np.float32
    assert (eye.semantic == ROCK).any()
    assert (loose[~ground] == 0.0).all()
    assert loose[ground].max() > 0.05
    ground &= np.abs(points_of(eye)[..., :2]).max(axis=-1) < 2.95  # moved vertices are beyond the edge of the others
    places = points_of(eye)[ground][:, :2]
    covered, bare = (
        heights_at(complete(BURIED, {"surface": {"relief": "BUMP"}}, change), places) for change in ({}, BARE)
    )
    # Embree's distances from 50 m above are right to 1e-5 m. Grains move a vertex by 2 mm at most, and the ground's
    # loose material is nowhere steeper than 1.
    assert loose[ground] == pytest.approx(covered - bare, abs=5e-5 if relief == "BUMP" else 2.5e-3)


def test_a_pair_that_is_not_asked_for_it_has_none_and_keeps_its_id(tmp_path):
    pair, built = render(tmp_path, BURIED, {"quality": {"loose_thickness": False}})
    assert RenderedPair(pair).left.loose_thickness_m is None
    assert "loose_thickness" not in pair.data["channels"]
    assert LOOSE_ATTRIBUTE not in built.terrain.data.attributes
    with_it, without = (complete(BURIED, {"quality": {"loose_thickness": asked}}) for asked in (True, False))
    assert make_pair_id(with_it) != make_pair_id(without)
    assert LOOSE not in {name for names in _PASSES_BY_TRUTH.values() for name in names}


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"quality": {"truth": "DEPTH"}}, "quality.truth to FULL"),
        ({"quality": {"truth_by": "CYCLES"}}, "quality.truth_by to RAYS"),
        ({"rig": {"images": "HEAD"}}, "rig.images to PAIR"),
        ({"source": {"kind": "STAND_IN"}}, "source.kind to PROCEDURAL"),
    ],
)
def test_a_truth_that_cannot_have_it_is_a_sentence(change, name):
    said = [each for each in find_reasons_in_settings(complete(BURIED, change)) if "loose_thickness" in each]
    assert len(said) == 1
    assert said[0].endswith(f"set {name}, or quality.loose_thickness to false.")
