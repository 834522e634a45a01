"""The rays of a beam against the moments of a Gaussian, and the receiver's overlap against counted points."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.lidar.beam import FWHM_PER_HALF_ANGLE, compute_overlap, make_sub_rays, spread_beams


@pytest.mark.parametrize("count", [20, 60])
def test_the_rays_have_the_moments_of_the_beam(count):
    rays = make_sub_rays(count)
    assert len(rays.weight) == count + 1
    assert rays.weight.sum() == pytest.approx(1, rel=1e-15)
    assert rays.weight[0] == 0
    assert not rays.offset[0].any()
    x, y = rays.offset.T
    assert [rays.weight @ (x**a * y**b) for a, b in ((1, 0), (0, 1), (3, 0), (2, 1), (1, 2), (0, 3))] == pytest.approx(
        [0] * 6, abs=1e-16
    )
    # exp(-2 θ²) has the variance 1/4 along each axis.
    assert [rays.weight @ (x * x), rays.weight @ (y * y), rays.weight @ (x * y)] == pytest.approx(
        [0.25, 0.25, 0], abs=1e-15
    )
    assert (np.diff(np.hypot(x, y)) >= -1e-15).all()


def test_half_of_the_intensity_is_left_at_half_of_the_full_width():
    assert np.exp(-2 * (FWHM_PER_HALF_ANGLE / 2) ** 2) == pytest.approx(0.5)


def test_one_ray_is_the_axis_with_all_energy():
    rays = make_sub_rays(1)
    assert rays.weight.tolist() == [1.0]
    assert not rays.offset.any()
    assert len(rays.neighbours) == 0


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0.6, -0.48, 0.64], [0, 0, 1.0], [0, 0, -1.0]])
def test_rays_leave_the_axis_by_their_angles(axis):
    rays = make_sub_rays(20)
    direction = spread_beams(np.array([axis]), rays, (0.02, 0.005))[0]
    assert np.linalg.norm(direction, axis=1) == pytest.approx(np.ones(21), rel=1e-14)
    assert direction[0] == pytest.approx(axis, abs=1e-15)
    away = np.arctan2(np.linalg.norm(np.cross(direction, axis), axis=1), direction @ axis)
    assert away == pytest.approx(np.hypot(*(rays.offset * [0.02, 0.005]).T), rel=1e-9, abs=1e-12)
    # The wide side of the beam is level: its vertical extent is that of the narrow side.
    if axis[2] == 0:
        assert np.abs(direction[:, 2]).max() == pytest.approx(0.005 * np.abs(rays.offset[:, 1]).max(), rel=1e-3)


def test_neighbours_are_near():
    rays = make_sub_rays(60)
    apart = np.linalg.norm(rays.offset[rays.neighbours[:, 0]] - rays.offset[rays.neighbours[:, 1]], axis=1)
    counts = np.bincount(rays.neighbours.ravel(), minlength=61)
    assert counts.min() >= 6
    assert np.median(apart) < 0.5


def test_the_overlap_is_the_share_of_counted_points():
    points = np.random.default_rng(0).uniform(-1, 1, (30_000, 2))
    points = points[np.hypot(*points.T) <= 1]
    for range_m in (0.1, 1.0, 3.0, 20.0):
        beam, seen = 0.005 + 0.01 * range_m, 0.02 + 0.004 * range_m
        counted = (np.hypot(points[:, 0] * beam - 0.03, points[:, 1] * beam) <= seen).mean()
        found = compute_overlap(range_m, 0.03, 0.005, 0.01, 0.02, 0.004)
        assert found == pytest.approx(counted, abs=5 * 0.5 / np.sqrt(len(points)))


def test_the_overlap_at_its_ends():
    assert compute_overlap(np.array([0.1, 1e4]), 0.0, 0.005, 0.001, 0.02, 0.001).tolist() == [1, 1]
    assert compute_overlap(0.0, 0.1, 0.005, 0.001, 0.02, 0.001) == 0  # side by side
    assert compute_overlap(np.array([1.0, 60.0]), 0.1, 0.0, 0.0, 0.02, 0.002).tolist() == [0, 1]  # a beam without width
