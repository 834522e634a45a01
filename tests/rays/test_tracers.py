"""Rays against triangles by each engine, held against every triangle one by one, in double precision."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from icymoon.rays import embree, engine
from icymoon.rays.embree import EmbreeTracer, load_library
from icymoon.rays.shapes import Placed, World
from icymoon.rays.surface import Tracer, find_shading_normals, find_surface, intersect_opaque
from icymoon.support.errors import IcyMoonError
from ray_worlds import BOX, HERE, by_hand, shape, some_rays, some_world, somewhere

LIBRARY = load_library()
NO_EMBREE = "there is no Embree; pip install embreex"
Make = Callable[[World], Tracer]


@pytest.fixture(params=["Embree", "BVHTree"])
def make(request: pytest.FixtureRequest) -> Make:
    """What makes a tracer of each kind."""
    if request.param == "BVHTree":
        pytest.importorskip("bpy")
        from icymoon.render.tree_tracer import TreeTracer

        return TreeTracer
    if LIBRARY is None:
        pytest.skip(NO_EMBREE)
    return partial(EmbreeTracer, LIBRARY)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 4000])
@pytest.mark.parametrize("origin", [HERE, np.array([0.4, -0.2, 1.5])], ids=["here", "moved"])
def test_rays_meet_what_every_triangle_one_by_one_says(make, count, origin):
    world, direction = some_world(), some_rays(count)
    tracer = make(world)
    hits = tracer.intersect(origin, direction, 0.0, np.inf)
    found = find_surface(world, hits, origin, direction)
    tracer.close()
    along, number, normal = by_hand(world, origin, direction)
    assert np.array_equal(np.isinf(found.along), np.isinf(along))
    met = np.isfinite(along)
    assert hits.along[met] == pytest.approx(along[met], rel=5e-6)  # of single precision where a ray grazes
    # Where two triangles cross, single precision may take either.
    crossing = found.number != number
    assert crossing.sum() <= 1
    assert found.along[crossing] == pytest.approx(along[crossing], rel=2e-7)
    assert found.along[met & ~crossing] == pytest.approx(along[met & ~crossing], rel=1e-12)
    assert found.normal[~crossing] == pytest.approx(normal[~crossing], abs=1e-9)
    assert set(found.label[met]) <= {1, 2}
    assert not found.label[~met].any()
    assert not found.normal[~met].any()


def test_a_ray_is_blocked_by_what_it_meets_before_its_end(make):
    world, direction = some_world(), some_rays(1000)
    tracer = make(world)
    along = by_hand(world, HERE, direction)[0]
    end = np.random.default_rng(2).uniform(3, 8, 1000)
    assert np.array_equal(tracer.is_blocked(HERE, direction, 0.0, end), along < end)
    assert not tracer.is_blocked(HERE, direction, 0.0, np.full(1000, -1.0)).any()
    assert not tracer.is_blocked(HERE, direction, 0.0, np.full(1000, 0.5)).any()


def test_near_and_far_are_times_the_direction(make):
    sheet = World([Placed(shape([[-9, -9, 2], [9, -9, 2], [0, 9, 2]], [[0, 1, 2]]), np.eye(4)[None], np.array([1]))])
    tracer = make(sheet)
    ahead = np.array([[0.0, 0.0, 0.5]])
    met = [tracer.intersect(HERE, ahead, near, far).met[0] for near, far in ((0, 3.9), (0, 4.1), (3.9, 9), (4.1, 9))]
    assert met == [False, True, True, False]


@pytest.mark.ci_takes(1)
def test_rays_from_many_places_and_more_than_are_traced_at_a_time(make, monkeypatch):
    world, direction = some_world(), some_rays(1000)
    origin = np.random.default_rng(3).uniform(-0.5, 0.5, (1000, 3))
    tracer = make(world)
    whole = tracer.intersect(origin, direction, 0.0, np.inf)
    monkeypatch.setattr(embree, "_MAX_PACKETS", 3)
    if tracer.name == "BVHTree":
        monkeypatch.setattr(sys.modules[type(tracer).__module__], "_MAX_RAYS", 48)
    parts = tracer.intersect(origin, direction, 0.0, np.inf)
    for name in ("along", "place", "triangle"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name))
    alone = [by_hand(world, start, ray[None])[0][0] for start, ray in zip(origin[:50], direction[:50], strict=True)]
    assert whole.along[:50] == pytest.approx(alone, rel=1e-6)
    assert find_surface(world, whole, origin, direction).along[:50] == pytest.approx(alone, rel=1e-12)


def test_the_highest_of_a_world_is_that_of_its_boxes():
    boxes = some_world().placed[1]
    heights = BOX.vertices.astype(float) @ boxes.places[:, 2, :3].T + boxes.places[:, 2, 3]
    assert World([boxes]).highest_m() == pytest.approx(heights.max(), rel=1e-12)
    assert World([]).highest_m() == World([Placed(BOX, boxes.places[:0], boxes.numbers[:0])]).highest_m() == 0.0


def test_no_rays_and_no_world(make):
    tracer = make(World([]))
    assert not tracer.intersect(HERE, some_rays(5), 0.0, np.inf).met.any()
    assert not tracer.is_blocked(HERE, some_rays(5), 0.0, np.ones(5)).any()
    assert len(make(some_world()).intersect(HERE, some_rays(0), 0.0, np.inf).along) == 0


def test_shapes_that_have_moved_are_met_where_they_are_now(make):
    before, after = some_world(), some_world(seed=0)
    after = World([after.placed[0], Placed(BOX, before.placed[1].places[::-1], np.arange(9) + 500)])
    tracer, direction = make(before), some_rays(1000)
    tracer.place(after)
    found = find_surface(after, tracer.intersect(HERE, direction, 0.0, np.inf), HERE, direction)
    assert np.array_equal(found.number, by_hand(after, HERE, direction)[1])


def test_depth_is_exact_where_single_precision_is_not(make):
    """Ground 10 km away, seen at an angle of 0.1° from an eye far from the origin of its coordinates."""
    corners = np.array([[-2e4, -2e4, 0.0], [6e4, -2e4, 0.0], [-2e4, 6e4, 0.0]])
    world = World([Placed(shape(corners, [[0, 1, 2]]), np.eye(4)[None], np.array([1]))])
    origin = np.array([3000.123, 2000.456, 1.7])
    direction = np.stack(
        [np.cos(np.radians(np.arange(40))), np.sin(np.radians(np.arange(40))), np.full(40, -1.7 / 9000.0)], axis=1
    )
    found = find_surface(world, make(world).intersect(origin, direction, 1e-4, 1e6), origin, direction)
    focal_baseline = 429.0
    assert found.along == pytest.approx(np.full(40, 9000.0), rel=1e-10)
    assert np.abs(focal_baseline / found.along - focal_baseline / 9000.0).max() < 1e-6


def test_a_ray_goes_on_behind_what_lets_most_of_the_light_pass(make):
    """Three sheets, of which the second lets pass a share that grows from 0 to 1 along x, and the third everything."""
    corners = np.array([[-4.0, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]])
    two = [[0, 1, 2], [0, 2, 3]]
    lifted = [np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, z], [0, 0, 0, 1]])[None] for z in (4, 5, 6)]
    share = np.array([0, 1, 1, 0], np.float32)
    world = World(
        [
            Placed(shape(corners, two, 3, np.ones(4, np.float32)), lifted[0], np.array([1])),
            Placed(shape(corners, two, 4, share), lifted[1], np.array([2])),
            Placed(shape(corners, two, 5), lifted[2], np.array([3])),
        ]
    )
    tracer = make(world)
    direction = some_rays(500)
    hits = intersect_opaque(tracer, world, HERE, direction, 0.0, np.inf)
    found = find_surface(world, hits, HERE, direction)
    wanted = np.where(direction[:, 0] * 5 >= 0, 3, 2)
    sure = np.abs(direction[:, 0]) > 1e-5
    assert np.array_equal(found.number[sure], wanted[sure])
    assert found.along == pytest.approx(np.where(found.number == 3, 6.0, 5.0), rel=1e-12)
    alone = World(world.placed[:1])
    through = intersect_opaque(make(alone), alone, HERE, direction, 0.0, np.inf)
    assert not through.met.any()


@pytest.mark.parametrize("mirrored", [False, True])
def test_shading_normals_of_a_ball_are_those_of_an_ellipsoid(make, mirrored):
    """A ball of triangles that is stretched: normals between corners are near those of the ellipsoid."""
    steps = 60
    up, around = np.linspace(0.02, np.pi - 0.02, steps)[:, None], np.arange(steps) * 2 * np.pi / steps
    ball = np.stack(np.broadcast_arrays(np.sin(up) * np.cos(around), np.cos(up), np.sin(up) * np.sin(around)), axis=-1)
    ball = ball.reshape(-1, 3)
    k = np.arange((steps - 1) * steps)
    right = k // steps * steps + (k + 1) % steps
    triangles = np.concatenate([np.stack([k, k + steps, right], 1), np.stack([right, k + steps, right + steps], 1)])
    matrix = np.diag([-1.5 if mirrored else 1.5, 0.7, 1.0, 1.0])
    matrix[2, 3] = 6.0
    world = World([Placed(shape(ball, triangles, smooth=True), matrix[None], np.array([1]))])
    direction = some_rays(300) * [0.1, 0.1, 1.0]
    hits = make(world).intersect(HERE, direction, 0.0, np.inf)
    surface = find_surface(world, hits, HERE, direction)
    points = direction[hits.met] * surface.along[hits.met, None] - [0, 0, 6]
    wanted = points / np.diag(matrix)[:3] ** 2
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    found = find_shading_normals(world, hits, surface)[hits.met]
    assert hits.met.sum() > 100
    assert (wanted * found).sum(axis=1).min() > np.cos(np.radians(1.5))
    assert (wanted * surface.normal[hits.met]).sum(axis=1).min() < np.cos(np.radians(2.0))


def test_rays_in_all_directions_among_many_places(make):
    """Rays in a row go nowhere together, some start inside a box, and others have nothing ahead."""
    random = np.random.default_rng(5)
    places = np.array([somewhere(random, 0.3) for _ in range(90)])
    places[:, :3, 3] = random.uniform(-3, 3, (90, 3))
    world = World([Placed(BOX, places[:60], np.arange(60)), Placed(BOX, places[60:], 60 + np.arange(30))])
    direction = random.normal(size=(500, 3))
    for origin in (HERE, places[3, :3, 3], np.array([9.0, 0.0, 0.0])):
        along, number, _ = by_hand(world, origin, direction)
        tracer = make(world)
        found = find_surface(world, tracer.intersect(origin, direction, 0.0, np.inf), origin, direction)
        assert np.array_equal(np.isinf(found.along), np.isinf(along))
        assert np.array_equal(found.number[np.isfinite(along)], number[np.isfinite(along)])
        assert found.along == pytest.approx(along, rel=1e-9)
        end = random.uniform(0.1, 5.0, 500)
        assert np.array_equal(tracer.is_blocked(origin, direction, 0.0, end), along < end)


def other_engine(world: World) -> Tracer:
    raise LookupError


def test_without_embree_another_engine_is_used_or_the_error_states_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(engine, "load_library", lambda folders: None)
    with pytest.raises(LookupError):
        engine.open_tracer(World([]), (tmp_path,), other_engine)
    with pytest.raises(IcyMoonError, match=r"lacks Embree; run .* -m pip install embreex"):
        engine.open_tracer(World([]), (tmp_path,))


@pytest.mark.skipif(LIBRARY is None, reason=NO_EMBREE)
def test_with_embree_no_other_engine_is_used():
    assert engine.open_tracer(World([]), (), other_engine).name == "Embree"


@pytest.mark.skipif(LIBRARY is None, reason=NO_EMBREE)
def test_embree_of_blender_and_of_embreex_give_the_same_bits():
    bpy = pytest.importorskip("bpy")
    pytest.importorskip("embreex")
    from icymoon.support.blender import compat

    own = [file for folder in compat.list_library_folders() for file in folder.glob("*embree4*")]
    assert own, bpy.app.version_string
    world, direction = some_world(), some_rays(2000)
    found = [
        EmbreeTracer(load_library(folders), world).intersect(HERE, direction, 0.0, np.inf)
        for folders in ((own[0].parent,), ())
    ]
    for name in ("place", "triangle"):
        assert np.array_equal(*(getattr(each, name) for each in found))
    assert found[0].along == pytest.approx(found[1].along, rel=3e-7)


def test_a_file_that_is_no_library_is_passed_over(tmp_path, monkeypatch):
    (tmp_path / "libembree4.so").write_bytes(b"none")
    monkeypatch.setattr(embree, "_LIBRARY_NAMES", ())
    monkeypatch.setitem(sys.modules, "embreex", None)
    monkeypatch.setattr(embree.importlib.util, "find_spec", lambda name: None)
    assert load_library((tmp_path, Path("/nowhere"))) is None


def test_rays_along_a_plane_of_two_axes_meet_what_is_there(make):
    """Directions with a component that is next to 0, as in the middle column of a camera: 1 over it overflows."""
    across, down = np.linspace(-1e-19, 1e-19, 160), np.tile(np.linspace(-0.4, 0.4, 16), 10)
    corners = np.array([[-5.0, -5.0, 3.0], [5.0, -5.0, 3.0], [0.0, 9.0, 3.0]])
    world = World([Placed(shape(corners, [[0, 1, 2]]), np.eye(4)[None], np.array([1]))])
    tracer = make(world)
    direction = np.stack([across, down, np.ones(160)], axis=1)
    assert np.isfinite(tracer.intersect(np.zeros(3), direction, 0.0, np.inf).along).all()
    tracer.close()
