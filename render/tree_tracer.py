"""Traces rays by Blender's own trees of triangles, where Embree is missing."""

from __future__ import annotations

import numpy as np
from mathutils.bvhtree import BVHTree

from ..rays.shapes import Hits, World, cross_products, dot_products, normalize
from ..support.arrays import Array

#: Number of consecutive rays that are tested together for the spheres that they may meet. They start at one point, or
#: each is alone.
_RAYS_PER_BUNDLE = 16
#: Most rays traced at a time, a multiple of ``_RAYS_PER_BUNDLE``: Blender's answer for a ray takes 500 bytes.
_MAX_RAYS = 2**16
#: Number of spheres in the next larger one.
_SPHERES_PER_GROUP = 8
#: Bits per axis by which the order of spheres tells their places apart.
_BITS_PER_AXIS = 10
#: Share by which spheres are larger than their contents; it exceeds the error of single precision.
_SPHERE_MARGIN = 1e-5
#: Cosine of half the angle between rays. Bundles wider than that are tested against everything.
_MIN_BUNDLE_COSINE = 0.1
#: Longest ray that Blender accepts as finite.
_LONGEST_RAY = 1e37


class TreeTracer:
    """A ``rays.surface.Tracer`` with a tree for each shape.

    Places are found by spheres around them, so the shapes are not copied for each place. A ray takes some microseconds,
    six to nine times as long as with Embree.
    """

    name = "BVHTree"

    def __init__(self, world: World) -> None:
        shapes = [each.shape for each in world.placed]
        self._trees = [BVHTree.FromPolygons(each.vertices, each.triangles, all_triangles=True) for each in shapes]
        #: Lowest and highest corners, (shapes, 2, 3).
        self._boxes = np.array(
            [(each.vertices.min(axis=0), each.vertices.max(axis=0)) for each in shapes], float
        ).reshape(-1, 2, 3)
        self.place(world)

    def place(self, world: World) -> None:
        """Move the shapes to their places in ``world``, which contains the same shapes."""
        self._world = world
        self._inverse = np.linalg.inv(world.places)
        boxes = self._boxes[world.of]
        own = (boxes[:, 0] + boxes[:, 1]) / 2
        turned = world.places[:, :3, :3]
        signs = np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(-1, 3)
        corners = np.einsum("nij,nkj->nki", turned, (boxes[:, 1] - boxes[:, 0])[:, None] / 2 * signs)
        self._spheres = _Spheres(
            np.einsum("nij,nj->ni", turned, own) + world.places[:, :3, 3],
            np.linalg.norm(corners, axis=2).max(axis=1, initial=0.0),
        )

    def close(self) -> None:
        """Free the memory of the search trees."""
        self._trees = []

    def intersect(self, origin: Array, direction: Array, near: float, far: float) -> Hits:
        """Find the first hits of rays (n, 3) from ``near`` to ``far`` times their direction. ``origin`` is (3,) or
        (n, 3).

        Rays are traced fastest if sixteen in a row have similar directions. Distances have single precision.
        """
        return self._trace(origin, direction, near, np.full(len(direction), far))

    def is_blocked(self, origin: Array, direction: Array, near: float, far: Array) -> Array:
        """Return whether (n,) rays (n, 3) meet anything from ``near`` to ``far`` (n,) times their direction; a ray that
        ends before it begins meets nothing."""
        return self._trace(origin, direction, near, np.asarray(far, float)).met

    def _trace(self, origin: Array, direction: Array, near: float, far: Array) -> Hits:
        count = len(direction)
        hits = Hits(
            np.full(count, np.inf),
            np.full(count, -1, np.int32),
            np.full(count, -1, np.int32),
            np.zeros(count, np.float32),
            np.zeros(count, np.float32),
        )
        for first in range(0, count, _MAX_RAYS):
            part = np.arange(first, min(count, first + _MAX_RAYS))
            ray, place, entry = self._spheres.find_entered_spheres(
                origin if origin.ndim == 1 else origin[part], direction[part], far[part]
            )
            ray = part[ray]
            order = np.lexsort((entry, ray))
            ray, place, entry = ray[order], place[order], entry[order]
            begins = np.flatnonzero(np.diff(ray, prepend=-1))
            turn = np.arange(len(ray)) - np.repeat(begins, np.diff(begins, append=len(ray)))
            by_turn = np.split(np.argsort(turn, kind="stable"), np.cumsum(np.bincount(turn))[:-1])
            for pairs in by_turn:  # the nearest place of each ray, then the second, until the ray has a nearer hit
                end = np.minimum(far, hits.along)[ray[pairs]]
                self._record_hits(hits, origin, direction, near, end, ray[pairs], place[pairs], entry[pairs] <= end)
        return hits

    def _record_hits(
        self,
        hits: Hits,
        origin: Array,
        direction: Array,
        near: float,
        far: Array,
        ray: Array,
        place: Array,
        asked: Array,
    ) -> None:
        """Record the hits of rays (k,) at distances (k,) before ``far`` (k,), for the rays that are ``asked``."""
        asked &= far > near
        far, ray, place = far[asked], ray[asked], place[asked]
        start = (origin if origin.ndim == 1 else origin[ray]) + near * direction[ray]
        inverse = self._inverse[place]
        own = np.einsum("nij,nj->ni", inverse[:, :3, :3], start) + inverse[:, :3, 3]
        toward = np.einsum("nij,nj->ni", inverse[:, :3, :3], direction[ray])
        of = self._world.of[place]
        entered = _enters_box(self._boxes[of], own, toward)
        length = np.sqrt(dot_products(toward, toward))
        most = np.minimum((far - near) * length, _LONGEST_RAY)
        for number in np.unique(of[entered]):
            rays = np.flatnonzero(entered & (of == number))
            told = [
                each[2:]
                for each in map(
                    self._trees[number].ray_cast, own[rays].tolist(), toward[rays].tolist(), most[rays].tolist()
                )
            ]
            met = np.array([triangle is not None for triangle, _ in told], bool)
            triangle, distance = np.array([each for each in told if each[0] is not None]).reshape(-1, 2).T
            rays = rays[met]
            found = ray[rays]
            hits.along[found], hits.place[found] = near + distance / length[rays], place[rays]
            hits.triangle[found] = triangle
            shape = self._world.placed[number].shape
            corners = shape.vertices[shape.triangles[hits.triangle[found]]].astype(float)
            hits.u[found], hits.v[found] = _find_in_triangle(corners, own[rays], toward[rays])


def _enters_box(boxes: Array, origin: Array, direction: Array) -> Array:
    """Return whether (n,) rays (n, 3) enter boxes (n, 2, 3), which are slightly enlarged."""
    low, high = boxes[:, 0], boxes[:, 1]
    spare = _SPHERE_MARGIN * (high - low).max(axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = (low - spare - origin) / direction, (high + spare - origin) / direction
    into, out = np.minimum(*sides).max(axis=1), np.maximum(*sides).min(axis=1)
    return np.asarray(np.maximum(into, 0.0) <= out)


def _find_in_triangle(corners: Array, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Find the points where rays (n, 3) meet triangles (n, 3, 3), as the barycentric weights of the second and the
    third corner."""
    second, third = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    away, beside = origin - corners[:, 0], cross_products(direction, third)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / dot_products(second, beside)
        u, v = dot_products(away, beside) * scale, dot_products(direction, cross_products(away, second)) * scale
    u = np.clip(np.nan_to_num(u), 0.0, 1.0)
    return u, np.clip(np.nan_to_num(v), 0.0, 1.0 - u)


class _Spheres:
    """Bounding spheres, in a hierarchy with ``_SPHERES_PER_GROUP`` spheres in each larger one, up to one around all."""

    def __init__(self, centre: Array, radius: Array) -> None:
        """Make the hierarchy of spheres with ``centre`` (n, 3) and ``radius`` (n,)."""
        self._order = _order_along_curve(centre)
        self._levels = [(centre[self._order], radius[self._order] * (1 + _SPHERE_MARGIN))]
        while len(self._levels[0][1]) > 1:
            self._levels.insert(0, _group_spheres(*self._levels[0]))

    def find_entered_spheres(self, origin: Array, direction: Array, far: Array) -> tuple[Array, Array, Array]:
        """Find the pairs of rays (n, 3) and spheres that they enter. Return, for each pair, the ray, the sphere, and
        the distance in units of the ray's direction.

        ``origin`` is (3,) or (n, 3); rays go to ``far`` (n,) times their direction.
        """
        length = np.sqrt(dot_products(direction, direction))
        ahead = direction / length[:, None]
        side = _RAYS_PER_BUNDLE if origin.ndim == 1 else 1
        bundle, sphere = self._find_entered_by_bundles(
            origin, _pad_bundles(ahead, side), _pad_bundles(far * length, side)
        )
        ray = (bundle[:, None] * side + np.arange(side)).reshape(-1)
        sphere = np.repeat(sphere, side)[ray < len(direction)]
        ray = ray[ray < len(direction)]
        centre, radius = self._levels[-1]
        away = centre[sphere] - (origin if origin.ndim == 1 else origin[ray])
        middle = dot_products(away, ahead[ray])
        aside = away - middle[:, None] * ahead[ray]
        half = np.sqrt(np.maximum(radius[sphere] ** 2 - dot_products(aside, aside), 0.0))
        entry = np.maximum(middle - half, 0.0) / length[ray]
        entered = (dot_products(aside, aside) <= radius[sphere] ** 2) & (middle + half >= 0) & (entry <= far[ray])
        return ray[entered], self._order[sphere[entered]], entry[entered]

    def _find_entered_by_bundles(self, origin: Array, ahead: Array, far: Array) -> tuple[Array, Array]:
        """Find the pairs of bundles and spheres that the bundles may enter. The rays of bundles are unit vectors
        (m, k, 3) of up to (m, k) metres."""
        axis = normalize(ahead.sum(axis=1))
        cosine = np.einsum("mkj,mj->mk", ahead, axis).min(axis=1, initial=1.0)
        sine, end = np.sqrt(np.maximum(1 - cosine**2, 0.0)), far.max(axis=1, initial=0.0)
        bundle, node = np.arange(len(ahead)), np.zeros(len(ahead), int)
        for level, (centre, radius) in enumerate(self._levels):
            if level:
                bundle = np.repeat(bundle, _SPHERES_PER_GROUP)
                node = (node[:, None] * _SPHERES_PER_GROUP + np.arange(_SPHERES_PER_GROUP)).reshape(-1)
            bundle, node = bundle[node < len(radius)], node[node < len(radius)]
            away = centre[node] - (origin if origin.ndim == 1 else origin[bundle])
            distance = np.sqrt(dot_products(away, away))
            along = dot_products(away, axis[bundle])
            across = np.sqrt(np.maximum(distance**2 - along**2, 0.0))
            inside = distance <= radius[node]
            # The sphere is beside the bundle's cone by less than its radius, and not behind the apex.
            touched = (across * cosine[bundle] - along * sine[bundle] <= radius[node]) & (
                along * cosine[bundle] + across * sine[bundle] >= 0
            )
            entered = (inside | touched | (cosine[bundle] < _MIN_BUNDLE_COSINE)) & (
                distance - radius[node] <= end[bundle]
            )
            bundle, node = bundle[entered], node[entered]
        return bundle, node


def _pad_bundles(values: Array, side: int) -> Array:
    """Arrange the values (n, …) of rays in bundles (m, side, …); the last bundle is filled up with the last ray."""
    more = -len(values) % side
    return np.concatenate([values, np.repeat(values[-1:], more, axis=0)]).reshape(-1, side, *values.shape[1:])


def _group_spheres(centre: Array, radius: Array) -> tuple[Array, Array]:
    """Return the spheres around each ``_SPHERES_PER_GROUP`` consecutive spheres."""
    starts = np.arange(0, len(radius), _SPHERES_PER_GROUP)
    least = np.minimum.reduceat(centre - radius[:, None], starts)
    middle = (least + np.maximum.reduceat(centre + radius[:, None], starts)) / 2
    reach = np.linalg.norm(centre - np.repeat(middle, _SPHERES_PER_GROUP, axis=0)[: len(radius)], axis=1) + radius
    return middle, np.maximum.reduceat(reach, starts)


def _order_along_curve(points: Array) -> Array:
    """Order points (n, 3) along a Morton curve (G. M. Morton, 1966), so that near points are close in the order. Return
    their indices (n,)."""
    least, most = (edge(axis=0, initial=0.0) for edge in (points.min, points.max))
    whole = ((points - least) / np.maximum(most - least, np.finfo(float).tiny) * (2**_BITS_PER_AXIS - 1)).astype(
        np.int64
    )
    code = np.zeros(len(points), np.int64)
    for bit in range(_BITS_PER_AXIS):
        for axis in range(3):
            code |= (whole[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
