"""Worlds and rays whose meeting is found triangle by triangle, in double precision."""

from __future__ import annotations

import numpy as np
from icymoon.rays.shapes import Placed, Shape, World
from icymoon.support.arrays import Array
from numpy.typing import ArrayLike

HERE = np.zeros(3)


def shape(
    vertices: ArrayLike, triangles: ArrayLike, label: int = 1, passing: Array | None = None, smooth: bool = False
) -> Shape:
    corners = np.asarray(triangles, np.uint32)
    return Shape(
        np.asarray(vertices, np.float32),
        corners,
        np.full(len(corners), smooth),
        np.full(len(corners), label, np.uint8),
        passing,
    )


def rough_sheet(random: np.random.Generator, side: int = 12) -> Shape:
    """A sheet of triangles about z = 5, from -3 to 3 m."""
    at = np.linspace(-3, 3, side)
    x, y = np.meshgrid(at, at)
    vertices = np.stack([x, y, 5 + 0.4 * random.normal(size=x.shape)], axis=-1).reshape(-1, 3)
    corner = (np.arange(side - 1) + side * np.arange(side - 1)[:, None]).ravel()
    return shape(
        vertices,
        np.concatenate(
            [
                np.stack([corner, corner + 1, corner + side], axis=1),
                np.stack([corner + 1, corner + side + 1, corner + side], axis=1),
            ]
        ),
    )


def somewhere(random: np.random.Generator, scale: float = 1.0, mirrored: bool = False) -> Array:
    """A matrix that turns, scales along its axes, and moves to about z = 5."""
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn) * (-1 if mirrored else 1)
    matrix = np.eye(4)
    matrix[:3, :3] = turn * random.uniform(0.5, 1.5, 3) * scale
    matrix[:3, 3] = [*random.uniform(-2, 2, 2), random.uniform(4, 8)]
    return matrix


BOX = shape(
    [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ],
    label=2,
)


def some_world(seed: int = 0) -> World:
    """A sheet, and boxes in front of it and in it, one of them mirrored."""
    random = np.random.default_rng(seed)
    boxes = np.array([somewhere(random, 0.3, k == 3) for k in range(9)])
    return World([Placed(rough_sheet(random), np.eye(4)[None], np.array([7])), Placed(BOX, boxes, 100 + np.arange(9))])


def some_rays(count: int, seed: int = 1) -> Array:
    """Directions (count, 3) about z, from a point at or near ``HERE``."""
    random = np.random.default_rng(seed)
    return np.stack([*random.uniform(-0.5, 0.5, (2, count)), np.ones(count)], axis=1)


def by_hand(world: World, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Distance, number and normal of what each ray meets first, by the formula of Möller and Trumbore (1997)."""
    count = len(direction)
    along, number, normal = np.full(count, np.inf), np.zeros(count, int), np.zeros((count, 3))
    for each in world.placed:
        for place, own in zip(each.places, each.numbers, strict=True):
            corners = each.shape.vertices[each.shape.triangles].astype(float) @ place[:3, :3].T + place[:3, 3]
            for a, b, c in corners:
                p = np.cross(direction, c - a)
                det = p @ (b - a)
                u = p @ (origin - a) / det
                q = np.cross(origin - a, b - a)
                v, t = direction @ q / det, (c - a) @ q / det
                first = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < along)
                n = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
                along[first], number[first] = t[first], own
                normal[first] = -n * np.sign(direction[first] @ n)[:, None]
    return along, number, normal


def block_field(count: int, half_width_m: float, roughness_m: float = 0.005, seed: int = 3, side: int = 200) -> World:
    """Rough ground of ``side``² vertices about z = 0 with ``count`` turned blocks of 0.03 to 0.6 m on it."""
    random = np.random.default_rng(seed)
    at = np.linspace(-half_width_m, half_width_m, side)
    x, y = np.meshgrid(at, at)
    corner = (np.arange(side - 1) + side * np.arange(side - 1)[:, None]).ravel()
    ground = shape(
        np.stack([x, y, roughness_m * random.normal(size=x.shape)], axis=-1).reshape(-1, 3),
        np.concatenate(
            [
                np.stack([corner, corner + 1, corner + side], axis=1),
                np.stack([corner + 1, corner + side + 1, corner + side], axis=1),
            ]
        ),
    )
    size = np.minimum(0.05 * random.pareto(1.8, count) + 0.03, 0.6)
    places = np.tile(np.eye(4), (count, 1, 1))
    turns = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    places[:, :3, :3] = turns * (size[:, None] * random.uniform(0.6, 1.4, (count, 3)))[:, None]
    places[:, :2, 3] = random.uniform(-half_width_m, half_width_m, (count, 2))
    places[:, 2, 3] = 0.4 * size
    return World([Placed(ground, np.eye(4)[None], np.array([1])), Placed(BOX, places, 100_000 + np.arange(count))])
