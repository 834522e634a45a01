"""Finds the share of the grains falling on rocks from one side that arrives, past other rocks and the ground.

Rocks are instances of a few shapes, so their vertices cannot have values of their own. Each rock has a plane of values
instead: the share that others keep away is ``level`` + ``slope`` · position, held between 0 and 1. The plane is fitted
to rays from vertices of the rock that look toward the origin of the grains, so it is as sharp as half of the rock. A
shape of few vertices, for a small or distant rock, has one value, from the vertex nearest to the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array
from .exposure import find_exposed_share
from .shapes import Placed, World, dot_products, normalize
from .surface import Tracer

#: Number of vertices of a shape from which a plane is fitted, and of a shape that gets one.
_SAMPLES, _MIN_VERTICES = 24, 2000
#: Weight of a plane without slope, over the weight of the samples: it decides where samples lie on one line.
_LEVEL_WEIGHT = 0.02
#: Least cosine between the axis of the fall and the normal of a sample: paths of a cone do not graze its own rock.
_MIN_COSINE = 0.3
#: Distance of samples from their rock, in metres.
_CLEARANCE_M = 2e-3


@dataclass(frozen=True)
class RockShelter:
    """Shelter of n rocks: the share of grains that other ground and rocks keep away is ``level`` (n,) + ``slope``
    (n, 3) · position in metres, before it is held between 0 and 1."""

    level: Array
    slope: Array


def find_rock_shelter(world: World, tracer: Tracer, rocks: list[Placed], count: int, directions: Array) -> RockShelter:
    """Find the shelter of ``count`` rocks from grains of ``directions`` (k, 3). The numbers in ``rocks`` are the rocks'
    indices. The first shape of the world is the ground."""
    found = RockShelter(np.zeros(count), np.zeros((count, 3)))
    axis = normalize(directions.sum(axis=0)[None])[0]
    chosen = [_choose_points(each, axis) for each in rocks]
    asked = np.concatenate([points[weights > 0.0] for points, weights in chosen])
    sheltered = 1.0 - find_exposed_share(world, tracer, asked, directions)
    buried = _are_buried(tracer, asked)
    start = 0
    for each, (points, weights) in zip(rocks, chosen, strict=True):
        wanted, values = weights > 0.0, np.zeros(weights.shape)
        own = slice(start, start + int(wanted.sum()))
        start = own.stop
        values[wanted] = sheltered[own]
        weights[wanted] *= ~buried[own]
        level, slope = _fit_planes(points, weights, values, each.places[:, :3, 3])
        found.level[each.numbers], found.slope[each.numbers] = level, slope
    return found


def _are_buried(tracer: Tracer, points: Array) -> Array:
    """Return whether points (n, 3) are under the ground, where no image shows them, as bool (n,): the first thing above
    them is the ground."""
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), points.shape)
    return np.asarray(tracer.intersect(points, up, 0.0, np.inf).place == 0)


def _choose_points(rocks: Placed, axis: Array) -> tuple[Array, Array]:
    """Choose points (k, m, 3), a little outside k rocks of one shape, and their weights (k, m), which tell how much
    they look along ``axis`` (3,)."""
    shape, matrices = rocks.shape, rocks.places[:, :3, :3]
    chosen = np.unique(np.linspace(0, len(shape.vertices) - 1, _SAMPLES).round().astype(int))
    points = shape.vertices[chosen].astype(np.float64) @ matrices.swapaxes(1, 2) + rocks.places[:, None, :3, 3]
    normals = normalize((shape.normals[chosen] @ np.linalg.inv(matrices)).reshape(-1, 3)).reshape(points.shape)
    weights = np.maximum(normals @ axis - _MIN_COSINE, 0.0)
    if len(shape.vertices) < _MIN_VERTICES:
        nearest = np.argmax(points @ axis, axis=1)
        weights = (np.arange(points.shape[1]) == nearest[:, None]).astype(np.float64)
    return points + _CLEARANCE_M * normals, weights


def _fit_planes(points: Array, weights: Array, values: Array, middles: Array) -> tuple[Array, Array]:
    """Fit planes through ``values`` (k, m) at points (k, m, 3), with middles (k, 3). Return their levels (k,) and
    slopes (k, 3)."""
    away = points - middles[:, None]
    size = np.maximum(np.linalg.norm(away, axis=2).max(axis=1), 1e-9)
    terms = np.concatenate([np.ones((*weights.shape, 1)), away / size[:, None, None]], axis=2)
    weighted = terms * weights[..., None]
    matrix = weighted.swapaxes(1, 2) @ terms
    total = np.maximum(weights.sum(axis=1), 1e-9)
    matrix += total[:, None, None] * np.diag([1e-9, *[_LEVEL_WEIGHT] * 3])
    fitted = np.linalg.solve(matrix, (weighted * values[..., None]).sum(axis=1)[..., None])[..., 0]
    slope = fitted[:, 1:] / size[:, None]
    return fitted[:, 0] - dot_products(slope, middles), slope
