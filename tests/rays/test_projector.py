"""Patterns as eyes see them by rays: planes decode to their columns, shadows are dark, sizes do not matter."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.projector.decode import decode_columns, triangulate_columns
from icymoon.physics.projector.device import Projector
from icymoon.physics.projector.patterns import Pattern, make_gray_and_phase
from icymoon.rays.embree import EmbreeTracer, load_library
from icymoon.rays.projector import find_sample_offsets, trace_patterns
from icymoon.rays.shapes import Placed, World
from icymoon.rays.stereo_truth import Eye, Stage
from icymoon.support.arrays import Array
from ray_worlds import shape

LIBRARY = load_library()
pytestmark = pytest.mark.skipif(LIBRARY is None, reason="there is no Embree; pip install embreex")
SQUARE = [[0, 1, 2], [0, 2, 3]]


def open_stage(*squares: Array) -> Stage:
    """Squares (4, 3) before an eye at the origin that looks along z."""
    world = World([Placed(shape(each, SQUARE), np.eye(4)[None], np.array([k + 1])) for k, each in enumerate(squares)])
    assert LIBRARY is not None
    tracer = EmbreeTracer(LIBRARY, world)
    return Stage(world, tracer, World([]), tracer)


def make_wall(z: float, half: float, lean: float = 0.0, x: float = 0.0) -> Array:
    """A square about (x, 0, z) that leans back toward its right."""
    return np.array(
        [[x + sx * half, sy * half, z + sx * half * lean] for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )


def make_eye(columns: int = 48, rows: int = 6, focal: float = 60.0) -> Eye:
    return Eye(columns, rows, focal, columns / 2, rows / 2, np.eye(3), np.zeros(3))


@pytest.mark.parametrize("size", [0.1, 5.0, 1e4])
def test_a_leaning_plane_decodes_within_a_tenth_of_a_pixel_at_any_distance(size):
    projector = Projector(160, 120, 80.0, right_m=0.4 * size)
    stage, eye, pose = open_stage(make_wall(size, 3 * size, 0.3)), make_eye(), projector.place(np.eye(4))
    patterns = make_gray_and_phase(projector, 16.0, 4)
    seen = trace_patterns(stage, eye, projector, pose, patterns, (1e-3 * size, 1e3 * size))
    column = decode_columns(100 + 900 * seen.share, projector, 16.0, 50.0)
    lit = np.isfinite(seen.place[..., 0])
    assert lit.mean() > 0.9
    assert np.isfinite(column[lit]).mean() > 0.97
    # At its edge the field covers a part of a pixel, whose light is the mean of that part.
    inner = np.isfinite(column) & (seen.place[..., 0] > 2) & (seen.place[..., 0] < 158)
    off = np.abs(column - seen.place[..., 0])[inner]
    assert off.max() < 0.1
    rays = eye.directions(np.arange(48 * 6)).reshape(6, 48, 3)
    depth = triangulate_columns(column, projector, pose, np.eye(4), rays)
    true = size / (1 - 0.3 * rays[..., 0])
    assert np.nanmedian(np.abs(depth / true - 1)) < 5e-4


def test_a_block_throws_a_shadow_and_a_projector_in_a_box_lights_nothing_outside():
    projector, eye = Projector(64, 64, 90.0, right_m=1.0), make_eye()
    pose, white = projector.place(np.eye(4)), np.ones((1, 64, 64), np.float32)
    stage = open_stage(make_wall(4.0, 9.0), make_wall(2.0, 0.2))
    share = trace_patterns(stage, eye, projector, pose, white, (0.01, 100.0)).share[0]
    # From 1 m at the right the block of 0.4 m at 2 m shades the wall at 4 m from -1.4 to -0.6 m.
    at = (np.arange(48) + 0.5 - 24) / 60 * 4
    row = share[3]
    np.testing.assert_array_equal(row[(at < -0.7) & (at > -1.3)], 0.0)
    assert (row[(at > -0.3)] > 0.99).all()
    assert (row[at < -1.5] > 0.99).all()
    inside = open_stage(make_wall(4.0, 9.0), make_wall(0.5, 0.9, x=1.0), make_wall(0.5, 9.0, x=20.0))
    assert not trace_patterns(inside, eye, projector, pose, white, (1.0, 100.0)).share.any()


def test_shares_are_linear_in_the_pattern_and_samples_follow_the_filter():
    projector, eye = Projector(64, 48, 60.0), make_eye(16, 8, 20.0)
    stage, pose = open_stage(make_wall(3.0, 9.0, 0.2)), projector.place(np.eye(4))
    one, two = Pattern("DOTS", dots=60).make(projector)[0], Pattern("STRIPES", period_px=9.0).make(projector)[0]
    seen = trace_patterns(stage, eye, projector, pose, np.stack([one, two, 0.25 * one + 0.5 * two]), (0.01, 100.0))
    np.testing.assert_allclose(seen.share[2], 0.25 * seen.share[0] + 0.5 * seen.share[1], atol=1e-6)
    offsets = np.array(find_sample_offsets(4))
    assert offsets.mean() == pytest.approx(0.0, abs=1e-6)
    assert np.abs(offsets).max() < 1.5
    # The variance of the filter by its formula.
    at = np.linspace(-0.5, 0.5, 4001)
    weight = sum(a * np.cos(2 * np.pi * k * at) for k, a in enumerate((0.35875, 0.48829, 0.14128, 0.01168)))
    assert offsets.std() == pytest.approx(3.0 * np.sqrt((weight * at**2).sum() / weight.sum()), rel=1e-4)
    assert find_sample_offsets(1) == (0.0,)
