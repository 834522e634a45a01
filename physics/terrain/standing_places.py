"""Places where a camera can stand on procedural ground and beside its rocks, found without building them.

Rocks lie at the places of a build; their heights are on the described ground, which the mesh follows within the error
of the settings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..rocks.beyond_patch import make_view_beyond
from ..rocks.own_rock import find_rock_shapes
from ..rocks.place_rocks import Rocks, euler_matrices, scatter_rocks
from ..rocks.rock_shapes import RockShape
from .skirts import make_skirts
from .terrain import Terrain, make_terrain

#: Number of places tried for each wanted place before too few are returned.
_TRIES_PER_PLACE = 1000
#: A clear circle that removes no rock, because each camera has its own.
_NO_CIRCLE = 0.0, 0.0, -math.inf


@dataclass(frozen=True)
class EyeSurroundings:
    """Obstacles at the right eyes of n cameras. ``above_m`` is the height in metres of each eye above the ground
    (negative below it), and ``in_rock`` is true if it is in a rock.
    """

    above_m: Array
    in_rock: Array


@dataclass(frozen=True)
class RockyGround:
    """Ground and rocks of complete settings whose ground is procedural."""

    ground: Terrain
    settings: Settings
    half_m: float  # of the square that has ground, infinite where it goes to the horizon

    @property
    def shortest_m(self) -> float:
        """Shortest wavelength in metres of the ground: the shortest that a grid carries, 0 for other meshes."""
        patch = self.settings.terrain
        return 2 * patch.size_m / (patch.resolution - 1) if math.isfinite(self.half_m) else 0.0

    def heights(self, x_m: Numbers, y_m: Numbers) -> Array:
        """Compute heights in metres at east and north coordinates; NaN where there is no ground."""
        return self._limit_to_ground(self.ground, x_m, y_m)

    def _limit_to_ground(self, ground: Terrain, x_m: Numbers, y_m: Numbers) -> Array:
        inside = np.maximum(np.abs(x_m), np.abs(y_m)) <= self.half_m
        return np.where(inside, ground.heights(x_m, y_m, self.shortest_m), np.nan)

    @cached_property
    def shapes(self) -> Sequence[Sequence[RockShape]]:
        """The shapes from which rocks are chosen."""
        return find_rock_shapes(self.settings.rocks, int(self.settings.dataset.seed))

    @cached_property
    def rocks(self) -> Rocks | None:
        """All rocks, including those that a camera's clear circle will remove."""
        if self.settings.rocks.coverage <= 0:
            return None
        return scatter_rocks(
            self.settings.rocks,
            self.ground.size_m,
            int(self.settings.dataset.seed),
            partial(self._limit_to_ground, self.ground.without_skirts()),
            self.shapes,
            _NO_CIRCLE,
            make_view_beyond(self.settings),
            skirted=self.heights,
        )

    def clearance_m(self, x_m: float, y_m: float) -> float:
        """Compute the distance in metres on the map to the nearest rock; negative over a rock, infinite without
        rocks.
        """
        rocks = self.rocks
        if rocks is None or not len(rocks.reach_m):
            return math.inf
        away = np.hypot(rocks.position_m[:, 0] - x_m, rocks.position_m[:, 1] - y_m)
        return float((away - rocks.reach_m).min())

    def eyes(self, x_m: Array, y_m: Array, height_m: Array, aside_m: Array) -> EyeSurroundings:
        """Find the surroundings of the right eyes of n cameras whose left eyes are ``height_m`` above the ground.

        ``aside_m`` (n, 3) are the vectors from the left to the right eyes. Heights are NaN outside the ground. A left
        eye is in no rock, because the build removes rocks around it.
        """
        x, y = x_m + aside_m[:, 0], y_m + aside_m[:, 1]
        eye = self.heights(x_m, y_m) + height_m + aside_m[:, 2]
        inside = [
            self._is_in_rock(np.array(right), left)
            for *right, left in zip(x, y, eye, zip(x_m, y_m, strict=True), strict=True)
        ]
        return EyeSurroundings(eye - self.heights(x, y), np.array(inside, bool))

    def _is_in_rock(self, eye_m: Array, left_m: tuple[float, float]) -> bool:
        # The build keeps this circle about the left eye clear; without it rocks need not be drawn.
        if math.dist(eye_m[:2], left_m) <= self.settings.rocks.clear_radius_m:
            return False
        rocks = self.rocks
        if rocks is None:
            return False
        centres = rocks.position_m
        near = np.hypot(*(centres[:, :2] - eye_m[:2]).T) < rocks.reach_m
        stays = np.hypot(*(centres[:, :2] - left_m).T) > self.settings.rocks.clear_radius_m + rocks.reach_m
        return any(self._contains(rocks, k, eye_m) for k in np.flatnonzero(near & stays))

    def _contains(self, rocks: Rocks, k: int, point_m: Array) -> bool:
        """Return whether a point is behind all faces of a rock; shapes are convex but for the lumps of boulders."""
        shape = self.shapes[rocks.level[k]][rocks.shape[k]]
        turn = euler_matrices(rocks.rotation[k : k + 1])[0]
        local = (point_m - rocks.position_m[k]) @ turn / rocks.scale_m[k]
        a, b, c = (shape.vertices[shape.triangles[:, j]] for j in range(3))
        return bool((np.einsum("nk,nk->n", np.cross(b - a, c - a), local - a) < 0).all())

    def choose_places(
        self, count: int, clearance_m: float, margin_m: float, apart_m: float, random: np.random.Generator
    ) -> Array:
        """Choose up to ``count`` random positions (k, 2) in metres on the patch. Each is at least ``clearance_m`` from
        every rock, ``margin_m`` from the patch's edge and ``apart_m`` from the others. Fewer are returned if there is
        too little room."""
        half = self.ground.size_m / 2 - margin_m
        places: list[tuple[float, float]] = []
        for _ in range(_TRIES_PER_PLACE * count if half > 0 else 0):
            x, y = (float(f"{v:.6g}") for v in random.uniform(-half, half, 2))
            if all(math.hypot(x - a, y - b) >= apart_m for a, b in places) and self.clearance_m(x, y) >= clearance_m:
                places.append((x, y))
                if len(places) == count:
                    break
        return np.array(places).reshape(-1, 2)


def make_rocky_ground(settings: Settings) -> RockyGround:
    """Make ground and rocks of complete settings with ``source.kind`` PROCEDURAL.

    Raises IcyMoonError where the settings contradict each other.
    """
    half = math.inf if settings.mesh.kind == "GRADED" else settings.terrain.size_m / 2
    seed = int(settings.dataset.seed)
    ground = make_terrain(settings, seed)
    if ground.skirts:
        ground = replace(
            ground, skirts=make_skirts(settings.rocks, ground.size_m, seed, _NO_CIRCLE, make_view_beyond(settings))
        )
    return RockyGround(ground, settings, half)
