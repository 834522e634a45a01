"""Rocks: the size laws, where they lie, how they rest, what they look like."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from icymoon.physics.rocks.beyond_patch import ViewBeyond
from icymoon.physics.rocks.place_rocks import draw_places, euler_xyz, scatter_rocks
from icymoon.physics.rocks.rock_shapes import (
    FAMILIES,
    SUBDIVISIONS_BY_LEVEL,
    find_polyhedron_corners,
    make_icosphere,
    make_rock_shapes,
)
from icymoon.physics.rocks.size_laws import GolombekLaw, PowerLaw, draw_diameters, make_size_law
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.rocks import RocksSettings
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from marks import heavy_but

SIZE_M = 20.0


def described(**changes: Any) -> RocksSettings:
    """``rocks`` settings: the defaults with 10 % of the ground covered, and changes."""
    return merged(defaults(), {"rocks": {"coverage": 0.1, "most": 200_000, **changes}}).rocks


def strewn(surface, seed: int = 5, clear=(0.0, 0.0, 0.0), size_m: float = SIZE_M, **changes):
    """Blocks on a surface."""
    rocks = described(**changes)
    return scatter_rocks(
        rocks, size_m, seed, surface, make_rock_shapes(rocks["family"], rocks["angularity"], seed), clear
    )


def level(x, y):
    return np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))


def rough(x, y):
    """Ground with steps and slopes up to about 60 degrees."""
    return 0.5 * np.sin(3 * x) * np.cos(2 * y) + 0.1 * np.sin(17 * x + 5 * y) + 0.05 * np.floor(2 * x) + 0.4 * y


def world_vertices(rocks, shapes, i: int) -> Array:
    """Vertices of one block, from its Euler angles as Blender reads them: about x, then y, then z."""
    shape = shapes[rocks.level[i]][rocks.shape[i]]
    (cx, cy, cz), (sx, sy, sz) = np.cos(rocks.rotation[i]), np.sin(rocks.rotation[i])
    turns = (
        np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    )
    return rocks.position_m[i] + (shape.vertices * rocks.scale_m[i]) @ turns.T


# Sizes

LAWS: dict[str, dict[str, Any]] = {
    "POWER": {"law": "POWER", "power_index": 2.5, "smallest_m": 0.1, "largest_m": 2.0, "coverage": 0.1},
    "GOLOMBEK": {"law": "GOLOMBEK", "smallest_m": 0.1, "largest_m": 2.0, "coverage": 0.1},
}


def share_above(rocks, d: Array) -> Array:
    """Share of the rocks larger than d, straight from the laws' definitions and by another quadrature."""
    low, high = rocks["smallest_m"], rocks["largest_m"]
    if rocks["law"] == "POWER":
        a = rocks["power_index"]
        return (d**-a - high**-a) / (low**-a - high**-a)
    q = 1.79 + 0.152 / rocks["coverage"]
    nodes, weights = np.polynomial.legendre.leggauss(80)

    def count(start: float) -> float:
        x = start + (nodes + 1) / 2 * (high - start)
        return float(np.sum(weights * np.exp(-q * x) / x**2) * (high - start) / 2)

    return np.array([count(v) for v in d]) / count(low)


def kolmogorov_smirnov(sample: Array, survival: Array) -> float:
    """Largest distance between a sample's distribution and a law, for the sample sorted downward."""
    n = len(sample)
    return float(max(np.abs(survival - np.arange(n) / n).max(), np.abs(survival - np.arange(1, n + 1) / n).max()))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_realised_sizes_follow_the_law(law, seed):
    rocks = described(**LAWS[law])
    sizes = strewn(level, seed, **LAWS[law]).diameter_m
    n = len(sizes)
    assert n > 300
    assert np.all(np.diff(sizes) <= 0)
    # Kolmogorov-Smirnov at the 1 % level: 1.63 / sqrt(n).
    critical = 1.63 / math.sqrt(n)
    assert kolmogorov_smirnov(sizes, share_above(rocks, sizes)) < critical
    # The same test tells a neighbouring law from it.
    other = {"power_index": 3.2} if law == "POWER" else {"coverage": 0.02}
    assert kolmogorov_smirnov(sizes, share_above({**rocks, **other}, sizes)) > critical


@pytest.mark.parametrize(
    ("k", "above_10cm", "above_30cm", "above_1m"),
    [(0.05, 413, 32, 0.15), (0.10, 745, 84, 1.2), (0.20, 1330, 184, 4.8), (0.40, 2447, 375, 13)],
)
def test_golombeks_law_gives_the_counts_that_were_worked_out_by_hand(k, above_10cm, above_30cm, above_1m):
    law = GolombekLaw(k, 0.1, 50.0)
    counts = law.per_m2_above(np.array([0.1, 0.3, 1.0])) * 400
    assert counts == pytest.approx([above_10cm, above_30cm, above_1m], rel=0.04)


@given(st.floats(0.01, 5.0), st.floats(1.0001, 50.0), st.floats(0.5, 6.0), st.floats(0.01, 0.5))
def test_power_law_and_its_inverse_agree(smallest, ratio, index, coverage):
    law = PowerLaw(coverage, smallest, smallest * ratio, index)
    d = smallest * ratio ** np.linspace(0, 1, 50)
    back = law.diameter_m(law.per_m2_above(d))
    assert np.allclose(back, d, rtol=1e-6)
    shares = (np.arange(20_000) + 0.5) / 20_000 * law.total_per_m2
    assert np.mean(math.pi / 4 * law.diameter_m(shares) ** 2) == pytest.approx(law.mean_footprint_m2, rel=0.02)


@given(st.floats(0.01, 0.5), st.floats(0.01, 1.0), st.floats(1.01, 50.0))
def test_golombeks_law_and_its_inverse_agree_and_cover_what_it_says(k, smallest, ratio):
    law = GolombekLaw(k, smallest, smallest * ratio)
    shares = np.linspace(0.001, 1.0, 50) * law.total_per_m2
    assert np.allclose(law.per_m2_above(law.diameter_m(shares)), shares, rtol=1e-4)
    n = 20_000
    footprints = math.pi / 4 * law.diameter_m((np.arange(n) + 0.5) / n * law.total_per_m2) ** 2
    covered = float(law.cover_above(smallest) - law.cover_above(smallest * ratio))
    assert footprints.mean() * law.total_per_m2 == pytest.approx(covered, rel=0.02)


@pytest.mark.parametrize("coverage", [0.02, 0.1, 0.4])
def test_rocks_cover_what_is_asked(coverage):
    sizes = strewn(level, coverage=coverage, smallest_m=0.1, largest_m=1.0).diameter_m
    assert np.sum(math.pi / 4 * sizes**2) / SIZE_M**2 == pytest.approx(coverage, rel=0.02)


@pytest.mark.parametrize("law", LAWS)
def test_the_smallest_size_is_the_settings_unless_rocks_are_left_out(law):
    assert strewn(level, **LAWS[law]).smallest_m == LAWS[law]["smallest_m"]
    assert strewn(level, **LAWS[law], most=100).smallest_m > LAWS[law]["smallest_m"]


def test_too_many_rocks_lose_the_smallest_and_keep_the_law():
    rocks = described(smallest_m=0.01, largest_m=1.0)
    law = make_size_law(rocks)
    sizes, smallest = draw_diameters(law, 400.0, 500, np.random.default_rng(0))
    assert len(sizes) == 500
    assert sizes.min() >= smallest > 0.01
    # As many above any size as the whole law has there.
    for d in (smallest, 2 * smallest, 0.5):
        assert np.sum(sizes > d) == pytest.approx(law.per_m2_above(np.array(d)) * 400, abs=2)


def test_one_size_and_no_room_are_possible_and_a_contradiction_is_named():
    assert np.allclose(strewn(level, smallest_m=0.3, largest_m=0.3).diameter_m, 0.3)
    assert len(strewn(level, most=0).diameter_m) == 0
    assert len(strewn(lambda x, y: np.full(np.broadcast_shapes(x.shape, y.shape), np.nan)).diameter_m) == 0
    with pytest.raises(IcyMoonError, match=r"rocks\.largest_m \(0\.2 m\) is below rocks\.smallest_m \(0\.3 m\)"):
        strewn(level, smallest_m=0.3, largest_m=0.2)


# Places


def pairs_within(xy: Array, r: float, size_m: float) -> int:
    """Ordered pairs of points nearer than r, on a square whose sides are joined."""
    apart = np.abs(xy[:, None] - xy)
    apart = np.minimum(apart, size_m - apart)
    return int((np.hypot(apart[..., 0], apart[..., 1]) < r).sum()) - len(xy)


@pytest.mark.parametrize("clustering", [0.0, 0.5, 1.0])
def test_places_have_the_pair_statistics_of_a_thomas_process(clustering):
    n, size, sigma, each = 800, 30.0, 0.7, 15.0
    rocks = described(clustering=clustering, cluster_blocks=each, cluster_radius_m=sigma)
    for r in (0.5, 1.5):
        # Ripley's K of the mixture: pi r² + f² (1 - exp(-r²/4 sigma²)) / density of clusters.
        clusters = max(1, round(n * clustering / each)) / size**2
        ripley = math.pi * r**2 + clustering**2 * (1 - math.exp(-(r**2) / (4 * sigma**2))) / clusters
        expected = n**2 / size**2 * ripley
        found = [pairs_within(draw_places(rocks, n, size, np.random.default_rng(s)), r, size) for s in range(12)]
        # Uniform: pairs are Poisson, each counted twice. Clustered: the spread of the twelve draws tells.
        error = max(math.sqrt(2 * expected), float(np.std(found))) / math.sqrt(12)
        assert abs(np.mean(found) - expected) < 4 * error
        if clustering == 0.0:
            assert np.mean(found) == pytest.approx(expected, rel=0.1)
        else:
            assert np.mean(found) > 1.3 * n**2 / size**2 * math.pi * r**2


def test_rocks_lie_evenly_on_the_whole_patch():
    x, y, _ = strewn(level, smallest_m=0.05, largest_m=0.3, clustering=0.3).position_m.T
    assert np.abs([x, y]).max() <= SIZE_M / 2
    for coordinate in (x, y):
        counts = np.histogram(coordinate, bins=4, range=(-SIZE_M / 2, SIZE_M / 2))[0]
        assert counts.min() > 0.75 * counts.mean()


@pytest.mark.parametrize("radius", [0.0, 2.0])
def test_no_vertex_reaches_into_the_clear_circle(radius):
    rocks = strewn(rough, clear=(1.0, -2.0, radius), coverage=0.3, largest_m=2.0, elongation=2.0)
    shapes = make_rock_shapes("MIXED", described()["angularity"], 5)
    nearest = min(
        np.hypot(*(world_vertices(rocks, shapes, i)[:, :2] - [1.0, -2.0]).T).min()
        for i in range(0, len(rocks.diameter_m), 7)
    )
    assert nearest > radius
    # Elsewhere the circle changes nothing: same seed, same rocks.
    every = strewn(rough, clear=(1e6, 0.0, 0.0), coverage=0.3, largest_m=2.0, elongation=2.0)
    kept = {tuple(p) for p in rocks.position_m.tolist()}
    assert kept <= {tuple(p) for p in every.position_m.tolist()}
    assert len(kept) > 0.8 * len(every.diameter_m)


def test_a_seed_gives_the_same_rocks_and_concerns_do_not_mix():
    one, two, other = strewn(rough, 7), strewn(rough, 7), strewn(rough, 8)
    for name in ("position_m", "rotation", "scale_m", "level", "shape", "diameter_m"):
        assert np.array_equal(getattr(one, name), getattr(two, name))
    assert not np.array_equal(one.position_m, other.position_m)
    deeper = strewn(rough, 7, burial=0.6)
    assert np.array_equal(deeper.position_m[:, :2], one.position_m[:, :2])
    assert np.array_equal(deeper.rotation, one.rotation)
    gathered = strewn(rough, 7, clustering=0.5)
    assert np.array_equal(gathered.diameter_m, one.diameter_m)


# Resting


@pytest.mark.parametrize("surface", [level, rough])
@pytest.mark.parametrize("burial", [0.0, 0.25, 0.9])
def test_every_block_touches_the_ground(surface, burial):
    rocks = strewn(surface, burial=burial, coverage=0.05, tilt_deg=30.0)
    shapes = make_rock_shapes("MIXED", described()["angularity"], 5)
    for i in range(len(rocks.diameter_m)):
        x, y, z = world_vertices(rocks, shapes, i).T
        assert (z - surface(x, y)).min() < 1e-9


def test_burial_is_the_share_of_the_height_under_level_ground():
    rocks = strewn(level, burial=0.4, tilt_deg=20.0)
    shapes = make_rock_shapes("MIXED", described()["angularity"], 5)
    shares = []
    for i in range(len(rocks.diameter_m)):
        z = world_vertices(rocks, shapes, i)[:, 2]
        shares.append(-z.min() / np.ptp(z))
    # The standard deviation between rocks is 0.1.
    assert np.mean(shares) == pytest.approx(0.4, abs=4 * 0.1 / math.sqrt(len(shares)))
    assert np.std(shares) == pytest.approx(0.1, rel=0.15)


@given(st.lists(st.floats(-math.pi, math.pi), min_size=3, max_size=3))
def test_euler_angles_make_the_rotation_they_came_from(angles):
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)

    def matrix(cx, sx, cy, sy, cz, sz):
        return (
            np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
            @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
            @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        )

    turned = matrix(cx, sx, cy, sy, cz, sz)
    back = euler_xyz(turned[None])[0]
    c, s = np.cos(back), np.sin(back)
    # Within what the arc sine leaves of 1e-16 near the vertical.
    assert np.allclose(matrix(c[0], s[0], c[1], s[1], c[2], s[2]), turned, atol=1e-6)


def test_rocks_lie_along_a_slope():
    slope = math.radians(35.0)
    rocks = strewn(lambda x, y: x * math.tan(slope) + 0 * y, tilt_deg=0.0, coverage=0.02, family="SLABS")
    cx, sx, cz, sz = (f(rocks.rotation[:, k]) for k in (0, 2) for f in (np.cos, np.sin))
    cy, sy = np.cos(rocks.rotation[:, 1]), np.sin(rocks.rotation[:, 1])
    up = np.stack([cz * sy * cx + sz * sx, sz * sy * cx - cz * sx, cy * cx], axis=1)  # third column
    assert np.allclose(up, [-math.sin(slope), 0.0, math.cos(slope)], atol=1e-9)


# Shapes


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("angularity", heavy_but([1.0], [0.0, 0.5, 1.0]))
def test_shapes_are_closed_have_unit_size_and_face_outward(family, angularity):
    for shape in (s for kind in make_rock_shapes(family, angularity, 3) for s in kind):
        edges = np.concatenate([shape.triangles[:, k] for k in ([0, 1], [1, 2], [2, 0])])
        # Every edge is used once each way: the surface is closed and its triangles turn alike.
        assert len({tuple(e) for e in edges.tolist()}) == len(edges)
        assert {tuple(e) for e in edges.tolist()} == {tuple(e) for e in edges[:, ::-1].tolist()}
        a, b, c = (shape.vertices[shape.triangles[:, k]] for k in range(3))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
        assert 0.2 < volume < 1.0
        assert np.ptp(shape.vertices[:, 2]) == pytest.approx(1.0, rel=0.1)
        # Area seen from above: that of the triangles that face up. Coarse levels lose a few per cent.
        (ux, uy, _), (vx, vy, _) = (b - a).T, (c - a).T
        flat = (ux * vy - uy * vx) / 2
        assert flat[flat > 0].sum() == pytest.approx(math.pi / 4, rel=0.07)


def test_angular_rocks_have_plane_faces_and_worn_ones_have_not():
    def plane_share(angularity: float) -> float:
        shapes = make_rock_shapes("FRAGMENTS", angularity, 3)[0]
        areas = [
            np.linalg.norm(
                np.cross(
                    s.vertices[s.triangles[:, 1]] - s.vertices[s.triangles[:, 0]],
                    s.vertices[s.triangles[:, 2]] - s.vertices[s.triangles[:, 0]],
                ),
                axis=1,
            )
            for s in shapes
        ]
        return float(np.mean([area[s.plane].sum() / area.sum() for area, s in zip(areas, shapes, strict=True)]))

    assert plane_share(1.0) > 0.6
    assert plane_share(0.0) < 0.25


def test_faces_of_broken_ice_are_stepped_and_no_triangle_is_folded():
    finest, coarse, _ = make_rock_shapes("BROKEN_ICE", 0.9, 3)
    for shape, rough in zip(finest, coarse, strict=True):
        a, b, c = (shape.vertices[shape.triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        outward = np.einsum("ij,ij->i", normal, a + b + c)
        assert (outward <= 0).mean() < 2e-4  # two, at corners of several faces
        assert shape.plane.all()
        # Neighbours on a plane face would have one normal; on stepped faces half of them differ by more than 3 degrees.
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        edges = np.concatenate([np.sort(shape.triangles[:, k], axis=1) for k in ([0, 1], [1, 2], [2, 0])])
        order = np.lexsort(edges.T)
        two = (order % len(normal)).reshape(-1, 2)
        turn = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", *normal[two.T]), -1, 1)))
        assert np.median(turn) > 3
        # The coarser level is the same block: its vertices are near the finer one's.
        near = np.linalg.norm(rough.vertices[::40, None] - shape.vertices[None], axis=2).min(axis=1)
        assert near.max() < 0.05


def test_mixed_rocks_are_those_of_three_families_as_before():
    mixed = make_rock_shapes("MIXED", 0.7, 5)[0]
    for number, family in enumerate(("FRAGMENTS", "BOULDERS", "SLABS")):
        for shape, alone in zip(mixed[number::3], make_rock_shapes(family, 0.7, 5)[0], strict=True):
            np.testing.assert_array_equal(shape.vertices, alone.vertices)


def test_corners_of_a_cube():
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    corners = find_polyhedron_corners(normals, np.full(6, 0.5))
    assert {tuple(c) for c in np.round(corners, 12).tolist()} == {
        (a, b, c) for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)
    }


@pytest.mark.parametrize("subdivisions", SUBDIVISIONS_BY_LEVEL)
def test_the_sphere_is_a_sphere(subdivisions):
    directions, triangles = make_icosphere(subdivisions)
    assert len(directions) == 10 * 4**subdivisions + 2
    assert len(triangles) == 20 * 4**subdivisions
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)


@given(st.floats(0, 1), st.integers(0, 10_000), st.sampled_from(("MIXED", *FAMILIES)))
@budget(max_examples=15, deadline=None)
def test_any_seed_makes_shapes(angularity, seed, family):
    for kind in make_rock_shapes(family, angularity, seed):
        assert len(kind) in (6, 18)
        assert all(np.isfinite(s.vertices).all() and np.abs(s.vertices).max() < 1.2 for s in kind)


@pytest.mark.parametrize(("family", "spread_deg"), [("FRAGMENTS", 3.0), ("SLABS", 3.0), ("BROKEN_ICE", 45.0)])
def test_triangles_of_one_face_look_one_way_and_every_level_has_the_same_faces(family, spread_deg):
    """Faces of fragments are plane but for rounded edges; steps tilt the triangles of broken ice."""
    for levels in zip(*make_rock_shapes(family, 1.0, 3), strict=True):
        shape = levels[0]
        corners = shape.vertices[shape.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        assert len(np.unique(shape.face)) >= 6
        for face in np.unique(shape.face):
            of_face = (shape.face == face) & shape.plane
            mean = normals[of_face].sum(axis=0)
            off = np.degrees(np.arccos(np.clip(normals[of_face] @ mean / areas[of_face] / np.linalg.norm(mean), -1, 1)))
            assert np.average(off < spread_deg, weights=areas[of_face]) > 0.8  # slivers at edges may lean over
        common = np.bincount(shape.face, areas, 30) / areas.sum()
        for other in levels[1:]:
            c = other.vertices[other.triangles]
            area = np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1)
            assert np.bincount(other.face, area, 30) / area.sum() == pytest.approx(common, abs=0.03)


def test_worn_boulders_have_no_faces():
    assert all(not shape.face.any() for kind in make_rock_shapes("BOULDERS", 0.5, 3) for shape in kind)


RESTING = {"clustering": 0.5, "smallest_m": 0.2, "largest_m": 1.0}
SEEN_FROM = (20.0, 3, rough, (2.0, -1.0, 0.5))  # side of the patch, seed, ground and clear circle


def assert_same_as_among_all(rocks: dict, where: tuple, beyond: ViewBeyond | None) -> None:
    """Of the rocks that look largest, all is as it is among all rocks, to the bit."""
    settings, (size_m, seed, surface, site) = described(**rocks), where
    shapes = make_rock_shapes(settings.family, 0.7, 1)
    every, some = (scatter_rocks(settings, size_m, seed, surface, shapes, site, beyond, most) for most in (None, 50))
    looks = [rocks.diameter_m / np.hypot(*(rocks.position_m[:, :2] - site[:2]).T) for rocks in (every, some)]
    kept = looks[0] >= looks[1].min()
    assert 0 < len(looks[1]) <= 50 < len(looks[0])
    for key in ("position_m", "rotation", "scale_m", "level", "shape", "diameter_m", "reach_m"):
        np.testing.assert_array_equal(getattr(some, key), getattr(every, key)[kept], err_msg=key)
    assert (some.smallest_m, some.beyond_rad) == (every.smallest_m, every.beyond_rad)


@pytest.mark.parametrize("beyond", [None, ViewBeyond(0.02, 1.6, 1000.0)], ids=["patch", "beyond"])
def test_rocks_that_look_largest_are_the_same_as_among_all(beyond):
    """A preview leaves rocks out, but moves, turns and reshapes none."""
    assert_same_as_among_all(RESTING, SEEN_FROM, beyond)


@pytest.mark.parametrize(
    ("rocks", "where", "beyond"),
    [
        ({}, (20.0, 3, level, (2.0, -1.0, 0.5)), None),
        ({}, (20.0, 4, rough, (2.0, -1.0, 0.5)), None),
        ({}, (18.0, 3, rough, (2.0, -1.0, 0.5)), None),
        ({}, (20.0, 3, rough, (-4.0, 1.0, 0.5)), None),
        ({"burial": 0.8}, SEEN_FROM, None),
        ({"family": "MIXED"}, SEEN_FROM, None),
        ({}, SEEN_FROM, ViewBeyond(0.02, 1.6, 1000.0)),
    ],
    ids=["ground", "seed", "side", "site", "burial", "shapes", "beyond"],
)
def test_rocks_of_an_earlier_preview_do_not_stay(rocks, where, beyond):
    """A preview draws its rocks once for several grounds, but only for the same settings, seed and view."""
    assert_same_as_among_all(RESTING, SEEN_FROM, None)
    assert_same_as_among_all(RESTING | rocks, where, beyond)


# Low ground


def plates(x, y):
    """Plates of 3 m, 1 m high, with 1 m of low ground between them, on a slope."""
    inside = (np.mod(x, 4.0) < 3.0) & (np.mod(y, 4.0) < 3.0)
    return inside + 0.1 * x - 0.2 * y


@pytest.mark.parametrize("debris", [0.0, 0.3])
def test_rocks_of_low_ground_lie_between_plates_as_they_did(debris):
    """Between plates all points of the rings are as low or higher, and on a plate's middle none is higher."""
    every, some = (
        strewn(plates, coverage=0.2, debris=debris, low_ground_m=radius, rolling_deg=60.0) for radius in (0.0, 2.0)
    )
    x, y = some.position_m[:, :2].T
    assert not ((np.abs(np.mod(x, 4.0) - 1.5) < 0.5) & (np.abs(np.mod(y, 4.0) - 1.5) < 0.5)).any()
    assert np.mean(plates(x, y) - 0.1 * x + 0.2 * y < 0.5) > 0.9
    where = {tuple(at): k for k, at in enumerate(every.position_m[:, :2])}
    same = [where[tuple(at)] for at in some.position_m[:, :2]]
    np.testing.assert_array_equal(every.rotation[same], some.rotation)
    np.testing.assert_array_equal(every.position_m[same], some.position_m)
    x, y = every.position_m[:, :2].T
    between = (np.mod(x, 4.0) > 3.2) & (np.mod(x, 4.0) < 3.8)
    rock = np.arange(len(between)) < every.debris_start
    assert np.isin(np.flatnonzero(between & rock), same).all()
    assert some.debris_start == np.sum(np.array(same) < every.debris_start)


def test_debris_on_low_ground_is_of_rocks_that_are_there():
    """Fragments lie beside their rocks: beyond the outline, at an exponential distance whose mean is a twentieth of the
    diameter at most; beyond one diameter, one in e^20 would lie. Slopes leave out
    none here."""
    found = strewn(
        plates, coverage=0.3, largest_m=0.8, debris=0.3, debris_reach=0.1, low_ground_m=2.0, rolling_deg=89.0
    )
    rocks, fragments = (
        found.position_m[part, :2] for part in (np.s_[: found.debris_start], np.s_[found.debris_start :])
    )
    size = found.diameter_m[: found.debris_start]
    away = np.hypot(*(fragments[:, None] - rocks).T).T - found.reach_m[: found.debris_start] - size
    assert len(fragments) > 50
    assert (away.min(axis=1) < 0.0).all()


def test_a_steep_wall_of_low_ground_holds_no_rock():
    """A trench of 6 m with walls of 45 degrees, 2 m high and 1.9 m wide where the footprint is on them alone."""

    def trench(x, y):
        return np.clip(np.abs(x) - 3.0, 0.0, 2.0) + 0.0 * y

    steep, gentle = (strewn(trench, coverage=0.3, low_ground_m=4.0, rolling_deg=most) for most in (44.0, 46.0))
    across, size = np.abs(gentle.position_m[:, 0]), gentle.diameter_m
    on_wall = (across - size / 2 > 3.0) & (across + size / 2 < 5.0)
    assert on_wall.any()
    kept = {tuple(at) for at in steep.position_m}
    assert not kept & {tuple(at) for at in gentle.position_m[on_wall]}
    assert kept >= {tuple(at) for at in gentle.position_m[across + size < 3.0]}


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, 0.0), (0.123456789, -0.7)])
def test_no_place_of_a_plane_is_low(tilt):
    assert not len(strewn(lambda x, y: tilt[0] * x + tilt[1] * y, low_ground_m=1.7).diameter_m)


def test_low_ground_at_the_border_counts_the_ground_that_there_is():
    def bowl(x, y):
        return np.where(np.hypot(x, y) < 9.0, (x * x + y * y) / 50.0, np.nan)

    every, some = (strewn(bowl, low_ground_m=radius) for radius in (0.0, 0.5))
    inside = np.hypot(*every.position_m[:, :2].T) < 8.4
    kept = {tuple(at) for at in some.position_m}
    assert kept >= {tuple(at) for at in every.position_m[inside]}
