"""Texels that are baked for vertices: where they are, and that no light is lost between them and the vertices."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.light.baked_texels import Texels, gather_to_vertices, gather_uncovered, lay_out_texels
from icymoon.support.arrays import Array

#: A square, a triangle at its side, and a square at that of the triangle: facets of 1, 2 and 3 m².
CORNERS, COUNTS = np.array([0, 1, 2, 3, 1, 4, 2, 4, 5, 6, 2]), np.array([4, 3, 4])
AREAS, VERTICES = np.array([1.0, 2.0, 3.0]), 7


def mesh(*wanted: bool) -> Texels:
    return lay_out_texels(np.array([0, 4, 7]), COUNTS, CORNERS, AREAS, np.array(wanted or (True, True, True)))


def image_of(found: Texels, light: Array) -> Array:
    """An image in which only texels of the facets are baked, with ``light`` (texels, 3) in their order."""
    image = np.zeros((found.side**2, 4), np.float32)
    rows = np.concatenate([each.ravel() for each in found.texels])
    image[rows] = np.column_stack([light, np.ones(len(rows))])
    return image


def test_each_corner_has_a_texel_of_its_own_inside_its_facet():
    found = mesh()
    rows = np.concatenate([each.ravel() for each in found.texels])
    assert len(set(rows)) == len(rows) == len(CORNERS)
    first = found.places[4:7] * found.side  # the triangle
    at = np.stack([found.texels[0][0] % found.side, found.texels[0][0] // found.side], axis=-1) + 0.5
    weights = np.linalg.solve(np.column_stack([first, np.ones(3)]).T, np.column_stack([at, np.ones(3)]).T).T
    assert weights == pytest.approx((np.eye(3) * 3 + 1) / 6, abs=1e-5)


def test_facets_that_are_not_wanted_have_no_texels_and_are_outside_of_the_image():
    found = mesh(True, False, True)
    assert [each.shape for each in found.texels] == [(0, 3), (2, 4)]
    assert len(np.unique(found.texels[1])) == 8
    assert found.texels[1].max() < found.side**2
    assert (found.places[4:7] < 0.0).all()
    inside = np.delete(found.places, [4, 5, 6], axis=0)
    assert ((inside > -0.1) & (inside < 1.1)).all()  # a turned square is a little larger than its texels
    assert mesh(False, False, False).areas[0].size == 0


@pytest.mark.parametrize("diagonal", [(0, 2), (1, 3)])
def test_both_triangles_of_a_quadrilateral_have_two_texels(diagonal):
    found = mesh()
    corners = found.places[:4].astype(np.float64) * found.side
    start, along = corners[diagonal[0]], corners[diagonal[1]] - corners[diagonal[0]]
    at = np.stack([found.texels[1][0] % found.side, found.texels[1][0] // found.side], axis=-1) + 0.5
    off = along[0] * (at - start)[:, 1] - along[1] * (at - start)[:, 0]
    assert sorted(np.sign(off)) == [-1, -1, 1, 1]
    assert np.abs(off).min() / np.linalg.norm(along) > 0.05  # none is on the diagonal, in texels


def test_light_over_the_facets_is_that_of_their_texels():
    """A facet's share of what is linear between its corners is a third, or a quarter, of each of them."""
    found = mesh()
    light = np.random.default_rng(3).uniform(0.0, 1.0, (len(CORNERS), 3))
    at_vertices = gather_to_vertices(found, image_of(found, light), VERTICES)
    shown = sum(
        areas @ at_vertices[corners].mean(axis=1) for areas, corners in zip(found.areas, found.vertices, strict=True)
    )
    of_triangles = found.texels[0].size
    baked = found.areas[0] @ light[:of_triangles].reshape(-1, 3, 3).mean(axis=1)
    baked = baked + found.areas[1] @ light[of_triangles:].reshape(-1, 4, 3).mean(axis=1)
    assert shown == pytest.approx(baked, rel=1e-6)


def test_texels_that_were_not_baked_do_not_count():
    found = mesh()
    image = image_of(found, np.full((len(CORNERS), 3), 0.25))
    image[found.texels[1][0, 1]] = 0.0
    assert gather_to_vertices(found, image, VERTICES) == pytest.approx(np.full((VERTICES, 3), 0.25))
    assert np.all(gather_to_vertices(found, np.zeros_like(image), VERTICES) == 0.0)


def test_facets_of_more_than_four_corners_are_refused():
    with pytest.raises(ValueError, match="four corners"):
        lay_out_texels(np.array([0]), np.array([5]), np.arange(5), np.array([1.0]), np.array([True]))


def test_covered_texels_do_not_count_and_what_is_covered_has_the_light_beside_it():
    found = mesh()
    image = image_of(found, np.full((len(CORNERS), 3), 0.25))
    covered = np.zeros(len(image), bool)
    covered[found.texels[1][1]] = True  # a whole facet, two of whose corners are in no other
    image[covered, :3] = 9.0
    assert gather_uncovered(found, image, covered, VERTICES) == pytest.approx(np.full((VERTICES, 3), 0.25))
    assert np.all(gather_uncovered(found, image, np.ones(len(image), bool), VERTICES) == 0.0)
