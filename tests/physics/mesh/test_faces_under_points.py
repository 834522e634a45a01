"""The search for faces under points misses none that a plain search finds, and returns few others."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.mesh import faces_under_points
from icymoon.physics.mesh.faces_under_points import FacesOnMap
from icymoon.support.arrays import Array


def draw_faces(random: np.random.Generator, count: int) -> tuple[Array, Array, Array]:
    """Vertices (n, 3), the vertex of each corner, and the first corner of each of ``count`` faces: of 3 to 6 corners
    and 1 mm to 10 m wide, some of them a line or a point."""
    sizes = random.integers(3, 7, count)
    starts = np.cumsum(sizes) - sizes
    width = np.repeat(10.0 ** random.uniform(-3.0, 1.0, count), sizes)[:, None]
    positions = np.repeat(random.uniform(-20.0, 20.0, (count, 3)), sizes, axis=0)
    spread = random.normal(size=positions.shape) * width
    kind = np.repeat(np.arange(count) % 10, sizes)
    spread[kind == 0] = 0.0
    spread[kind == 1, 1] = 0.0
    return (positions + spread).astype(np.float32), np.arange(len(positions), dtype=np.int32), starts


def find_plainly(positions: Array, starts: Array, x_m: Array, y_m: Array, far_m: float) -> Array:
    """The faces that have a point within ``far_m`` of their bounds, one face after the other."""
    found = []
    for face, some in enumerate(np.split(positions[:, :2].astype(float), starts[1:])):
        low, high = some.min(axis=0) - far_m, some.max(axis=0) + far_m
        if ((x_m >= low[0]) & (x_m <= high[0]) & (y_m >= low[1]) & (y_m <= high[1])).any():
            found.append(face)
    return np.array(found, np.int64)


def draw_points(random: np.random.Generator, positions: Array, count: int) -> tuple[Array, Array]:
    """Points beside the faces, at vertices and anywhere among the faces, in single precision as Blender has them."""
    at = np.concatenate([positions[random.integers(0, len(positions), count), :2], random.uniform(-25, 25, (count, 2))])
    at[0] = 400.0, -300.0
    x, y = at.astype(np.float32).T
    return x, y


@pytest.mark.parametrize(("block", "run"), [(2**18, 128), (8, 4), (6, 3), (1, 1)])
@pytest.mark.parametrize("count", [1, 3, 40])
def test_no_face_is_missed_and_no_distant_face_is_found(monkeypatch, block, run, count):
    monkeypatch.setattr(faces_under_points, "_BLOCK", block)
    monkeypatch.setattr(faces_under_points, "_RUN", run)
    random = np.random.default_rng(count)
    positions, corners, starts = draw_faces(random, 301)
    x, y = draw_points(random, positions, count)
    x, y = (x[1:], y[1:]) if count > 3 else (x, y)
    found = FacesOnMap.measure(positions, corners, starts).find_under(x, y)
    assert (np.diff(found) > 0).all()
    assert np.isin(find_plainly(positions, starts, x, y, 0.0), found).all()
    # A face reaches into a cell that has a point, so it is no farther from it than the side of a cell.
    side = max(np.ptp(x), np.ptp(y)) / (4 * math.ceil(math.sqrt(len(x))))
    assert np.isin(found, find_plainly(positions, starts, x, y, 1.001 * side)).all()


def test_a_point_on_the_border_of_a_face_finds_it():
    """The cells of the map begin at the points, so that all borders are in question here."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    faces = FacesOnMap.measure(positions, np.arange(4, dtype=np.int32), np.array([0]))
    one = np.nextafter(np.float32(1.0), np.float32(2.0))
    for x, y in [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (one, 0.5), (0.5, one), (0.3, 0.4)]:
        assert faces.find_under(np.array([x], np.float32), np.array([y], np.float32)).tolist() == [0]
    for x, y in [(1.1, 0.5), (-0.1, 0.5), (0.5, 1.1), (0.5, -0.1)]:
        assert not len(faces.find_under(np.array([x], np.float32), np.array([y], np.float32)))


def test_points_without_place_find_nothing():
    positions, corners, starts = draw_faces(np.random.default_rng(0), 20)
    faces = FacesOnMap.measure(positions, corners, starts)
    nowhere = np.array([np.nan, np.inf], np.float32)
    assert not len(faces.find_under(nowhere, np.zeros(2, np.float32)))
    assert not len(faces.find_under(nowhere[:0], nowhere[:0]))
    assert np.array_equal(
        faces.find_under(np.append(nowhere, positions[:, 0]), np.append(nowhere, positions[:, 1])), np.arange(20)
    )


def test_picked_faces_have_their_corners():
    positions, corners, starts = draw_faces(np.random.default_rng(1), 30)
    shuffled = np.random.default_rng(2).permutation(corners)
    picked, firsts = FacesOnMap.measure(positions, shuffled, starts).pick(np.array([3, 4, 17, 29]))
    expected = [np.split(shuffled, starts[1:])[face] for face in (3, 4, 17, 29)]
    assert [part.tolist() for part in np.split(picked, firsts[1:])] == [part.tolist() for part in expected]
