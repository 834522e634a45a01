"""Simple solids of triangles: the parts of the lander.

Faces that meet at a sharp edge share no vertices, so that smooth shading does not round the ends of a tube.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .kinematics import make_rigid_transform


@dataclass(frozen=True)
class Solid:
    """A mesh: vertices (n, 3) in metres, and triangles (m, 3) counter-clockwise from outside. Each triangle has the
    name of its material, and ``smooth`` (m,) is true where it is shaded smooth.
    """

    vertices: Array
    triangles: Array
    materials: tuple[str, ...]
    smooth: Array


def transform_solid(solid: Solid, at: Array) -> Solid:
    """Apply a rigid transformation (4, 4) to a solid."""
    return Solid(solid.vertices @ at[:3, :3].T + at[:3, 3], solid.triangles, solid.materials, solid.smooth)


def join_solids(solids: Sequence[Solid]) -> Solid:
    """Join several solids into one."""
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    return Solid(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.triangles + start for solid, start in zip(solids, starts, strict=False)]),
        tuple(name for solid in solids for name in solid.materials),
        np.concatenate([solid.smooth for solid in solids]),
    )


def make_lathe(material: str, profile: Sequence[tuple[float, float]], sides: int = 40) -> Solid:
    """Make the solid of revolution of a profile of (x, radius) about the x axis. On a convex solid, the profile goes
    from low to high x. Each step of the profile is smooth around the axis and has sharp edges. A profile that starts
    and ends with radius 0 gives a closed solid.
    """
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.zeros(sides), np.cos(angles), np.sin(angles)], axis=1)
    after = np.roll(np.arange(sides), -1)
    vertices: list[Array] = []
    triangles: list[Array] = []
    for (x0, r0), (x1, r1) in itertools.pairwise(profile):
        start = len(vertices) * 2 * sides
        vertices.append(np.concatenate([ring * r0 + [x0, 0, 0], ring * r1 + [x1, 0, 0]]))
        a, b, c, d = np.arange(sides), after, after + sides, np.arange(sides) + sides
        if r0 > 0:
            triangles.append(start + np.stack([a, b, c], axis=1))
        if r1 > 0:
            triangles.append(start + np.stack([a, c, d], axis=1))
    found = np.concatenate(triangles)
    return Solid(np.concatenate(vertices), found, (material,) * len(found), np.ones(len(found), bool))


def make_pose_toward(start: Sequence[float], end: Sequence[float]) -> Array:
    """Make a pose (4, 4) at ``start`` whose x axis points to ``end``."""
    along = np.subtract(end, start)
    x = along / np.linalg.norm(along)
    side = np.cross([0.0, 0.0, 1.0] if abs(x[2]) < 0.95 else [0.0, 1.0, 0.0], x)
    y = side / np.linalg.norm(side)
    return make_rigid_transform(np.stack([x, y, np.cross(x, y)], axis=1), tuple(start))


def make_rod(
    material: str,
    start: Sequence[float],
    end: Sequence[float],
    radius: float,
    end_radius: float | None = None,
    bevel: float = 0.15,
    sides: int = 40,
) -> Solid:
    """Make a round bar between two points. ``bevel`` is the share of the radius by which its ends are bevelled."""
    length, r1 = float(np.linalg.norm(np.subtract(end, start))), radius if end_radius is None else end_radius
    b0, b1 = bevel * min(radius, length / 2), bevel * min(r1, length / 2)
    profile = [(0.0, 0.0), (0.0, radius - b0), (b0, radius), (length - b1, r1), (length, r1 - b1), (length, 0.0)]
    return transform_solid(make_lathe(material, profile, sides), make_pose_toward(start, end))


def make_ball(material: str, centre: Sequence[float], radius: float, sides: int = 32) -> Solid:
    """Make a sphere; ``sides`` is its number of facets around the axis."""
    turns = np.linspace(0.0, np.pi, 13)
    profile = [
        (-radius * float(np.cos(t)), radius * float(np.sin(t)) if 0 < k < 12 else 0.0) for k, t in enumerate(turns)
    ]
    return transform_solid(make_lathe(material, profile, sides), make_rigid_transform(place=tuple(centre)))


def make_box(
    material: str, size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0), bevel_m: float = 0.004
) -> Solid:
    """Make a box with sides of ``size``, whose edges and corners are cut off by ``bevel_m``."""
    half = np.asarray(size, float) / 2
    cut = min(bevel_m, float(half.min()) * 0.9)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    # Each corner has three vertices, one on each of the three sides that meet there.
    corners = np.stack([signs * np.where(np.arange(3) == k, half, half - cut) for k in range(3)], axis=1)
    faces: list[list[tuple[int, int]]] = []
    for k in range(3):
        u, v = (k + 1) % 3, (k + 2) % 3
        for sign in (-1, 1):
            face = [(n, k) for n in range(8) if signs[n, k] == sign]
            faces.append([face[0], face[1], face[3], face[2]])
        for su in (-1, 1):
            for sv in (-1, 1):  # the edge along k
                ends = np.flatnonzero((signs[:, u] == su) & (signs[:, v] == sv))
                faces.append([(ends[0], u), (ends[1], u), (ends[1], v), (ends[0], v)])
    faces += [[(n, 0), (n, 1), (n, 2)] for n in range(8)]
    return transform_solid(
        _make_flat_faced(material, [np.array([corners[each] for each in face]) for face in faces]),
        make_rigid_transform(place=tuple(centre)),
    )


def _make_flat_faced(material: str, faces: Sequence[Array]) -> Solid:
    """Make a convex solid around the origin with flat faces of corners (k, 3). Each face has separate vertices and
    faces outward.
    """
    vertices, triangles, start = [], [], 0
    for face in faces:
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        outward = face if normal @ face.mean(axis=0) > 0 else face[::-1]
        vertices.append(outward)
        triangles += [(start, start + k, start + k + 1) for k in range(1, len(face) - 1)]
        start += len(face)
    return Solid(
        np.concatenate(vertices), np.array(triangles), (material,) * len(triangles), np.zeros(len(triangles), bool)
    )


def make_prism(
    material: str,
    outline: Sequence[tuple[float, float]],
    low: float,
    high: float,
    bevel_m: float = 0.0,
    low_scale: float = 1.0,
) -> Solid:
    """Make a prism with a convex outline of (x, y), counter-clockwise from above, between the heights ``low`` and
    ``high``.

    A bevel cuts off its upper edge. Its lower end is ``low_scale`` times as large, about the mean of the outline.
    """
    top = np.asarray(outline, float)
    middle = top.mean(axis=0)
    inner = middle + (top - middle) * (1.0 - bevel_m / float(np.linalg.norm(top - middle, axis=1).min()))
    levels = [(middle + (top - middle) * low_scale, low), (top, high - bevel_m), (inner, high)]
    rings = [np.column_stack([xy, np.full(len(top), z)]) for xy, z in (levels if bevel_m else [levels[0], levels[1]])]
    centre = np.array([*middle, (low + high) / 2])
    faces = [rings[0] - centre, rings[-1] - centre]
    for one, other in itertools.pairwise(rings):
        for k in range(len(top)):
            n = (k + 1) % len(top)
            faces.append(np.array([one[k], one[n], other[n], other[k]]) - centre)
    return transform_solid(_make_flat_faced(material, faces), make_rigid_transform(place=tuple(centre)))
