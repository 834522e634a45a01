"""Rocks of the user's own shape: unit size, closed, one shape at all levels of detail."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.operators.object_as_rock import encode_rock
from icymoon.physics.rocks import own_rock
from icymoon.physics.rocks.rock_shapes import make_icosphere, make_rock_shapes
from icymoon.settings.description import defaults, merged
from icymoon.settings.user_files import find_used_files, hash_content
from icymoon.support.errors import IcyMoonError

#: The corners of a box of 4 x 2 x 1, somewhere, and its twelve triangles.
CORNERS = np.array([[x, y, z] for x in (5.0, 9.0) for y in (1.0, 3.0) for z in (7.0, 8.0)])
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
BOX = np.array([triangle for a, b, c, d in SIDES for triangle in ((a, b, c), (a, c, d))], np.int32)


def signed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("nk,nk->n", a, np.cross(b, c)).sum()) / 6


def test_a_box_has_unit_size_and_keeps_its_outline():
    shape, proportions = own_rock.make_own_shape(CORNERS, BOX, "box")
    long, wide, high = np.ptp(shape.vertices, axis=0)
    assert long * wide == pytest.approx(np.pi / 4, rel=0.01)
    assert (long / wide, high) == pytest.approx((2.0, 1.0))
    assert proportions == pytest.approx(1.0 / np.sqrt(8.0 / (np.pi / 4)), rel=0.005)
    assert shape.vertices.min(axis=0) == pytest.approx(-shape.vertices.max(axis=0))
    assert signed_volume(shape.vertices, shape.triangles) == pytest.approx(long * wide * high)


def test_a_ball_covers_a_circle():
    points, triangles = make_icosphere(3)
    shape, proportions = own_rock.make_own_shape(3.0 * points, triangles, "ball")
    assert proportions == pytest.approx(1.0, abs=0.01)
    assert np.linalg.norm(shape.vertices, axis=1) == pytest.approx(0.5, abs=0.005)


def test_separate_corners_are_joined_and_what_is_inside_out_is_turned():
    apart = CORNERS[BOX[:, ::-1]].reshape(-1, 3)
    shape, _ = own_rock.make_own_shape(apart, np.arange(36).reshape(12, 3), "box")
    assert len(shape.vertices) == 8
    assert signed_volume(shape.vertices, shape.triangles) > 0


@pytest.mark.parametrize(
    ("vertices", "triangles", "why"),
    [
        (CORNERS, BOX[1:], "must be closed"),
        (CORNERS, np.concatenate([BOX[:1, ::-1], BOX[1:]]), "let normals point out"),
        (CORNERS * [1.0, 1.0, 0.0], BOX, "must be closed|encloses no volume"),
        (CORNERS, np.tile(BOX, (2000, 1)), "decimate it"),
    ],
)
def test_what_is_no_rock_is_refused(vertices, triangles, why):
    with pytest.raises(IcyMoonError, match=why):
        own_rock.make_own_shape(vertices, triangles, "box")


def test_all_levels_have_the_shape_of_the_file_and_its_content_counts(tmp_path):
    path = tmp_path / "rock.obj"
    path.write_bytes(encode_rock(CORNERS, BOX))
    settings = merged(defaults(), {"rocks": {"family": "OWN", "shape_file": str(path), "coverage": 0.1}})
    levels = own_rock.find_rock_shapes(settings.rocks, 1)
    assert [len(level) for level in levels] == [1, 1, 1]
    assert levels[0][0].vertices.shape == (8, 3)
    assert find_used_files(settings)["rocks.shape_file"] == path
    before = hash_content(settings)
    path.write_bytes(encode_rock(2.0 * CORNERS, BOX))
    assert hash_content(settings) != before
    path.unlink()
    with pytest.raises(IcyMoonError, match=r"rock\.obj"):
        own_rock.find_rock_shapes(settings.rocks, 1)


def test_other_families_are_made_as_before():
    rocks = defaults().rocks
    assert own_rock.find_rock_shapes(rocks, 3) is make_rock_shapes(rocks.family, rocks.angularity, 3)
