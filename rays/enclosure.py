"""Finds out whether a place is inside a rock or under the ground."""

from __future__ import annotations

import numpy as np

from ..physics.lidar.beam import GOLDEN_ANGLE
from ..support.arrays import Array
from ..support.labels import ROCK, TERRAIN
from .shapes import World
from .surface import Tracer

#: Number of rays. A place is inside if more than half of the rays that meet ground or rocks meet the inner side, so
#: that a hole or an overhang does not count.
_RAYS = 96


def find_enclosure(world: World, tracer: Tracer, position: Array) -> int | None:
    """Find the label, TERRAIN or ROCK, of the object that encloses a position (3,) in metres; None in the open.

    Triangles of ground and rocks face outward. A position is inside if most rays from it meet such triangles from
    behind."""
    k = np.arange(_RAYS) + 0.5
    height = 1.0 - 2.0 * k / _RAYS
    level = np.sqrt(1.0 - height**2)
    turn = k * GOLDEN_ANGLE
    direction = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1)
    hits = tracer.intersect(np.asarray(position, np.float64), direction, 0.0, np.inf)
    met, inner = dict.fromkeys((TERRAIN, ROCK), 0), dict.fromkeys((TERRAIN, ROCK), 0)
    for ray in np.flatnonzero(hits.met).tolist():
        place, triangle = hits.place[ray : ray + 1], hits.triangle[ray : ray + 1]
        number = int(world.of[place[0]])
        label = int(world.placed[number].shape.label[triangle[0]])
        if label in met:
            normal, _ = world.move_planes(number, place, triangle)
            met[label] += 1
            inner[label] += bool(normal[0] @ direction[ray] * np.sign(_determinant(world, int(place[0]))) > 0)
    if 2 * sum(inner.values()) <= sum(met.values()):
        return None
    return max(inner, key=lambda label: inner[label])


def _determinant(world: World, place: int) -> float:
    """Return the determinant of an instance's matrix; negative for a mirrored instance, whose normals turn inward."""
    return float(np.linalg.det(world.places[place, :3, :3]))
