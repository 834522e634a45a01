"""Talus: ground that is too steep for its strength has failed, and lies at rest below.

The heights of the patch, and of a margin around it, are found once on a square grid; ``gravity.failing_slopes`` and
``gravity.fallen_ground`` let them fail. A second grid with as many points, four times as wide, does the same for the
ground around the patch. Every mesh, coarse or fine, then asks the same result for the height of its points, so a
preview has the talus of the finished ground. Relief that is finer than the grid stays on broken faces and, less high,
on talus. Time and memory do not depend on the size of the patch.

Cohesion may vary from place to place; the pattern of weak places is a guess, as are all strengths of the ice of moons
at metres. The angle of repose is the angle of friction of the ground: of cohesionless grains it is the same at 0.1,
0.38 and 1 g (Kleinhans et al. 2011, J. Geophys. Res. 116, E11004), while the height of a wall that stands grows as
1 / g.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ...settings.topics.landforms import TalusSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..gravity.failing_slopes import Strength
from ..gravity.fallen_ground import FallenGround, Grid, let_ground_fail
from ..gravity.standing_slopes import critical_height_m, find_gravity_m_s2
from ..random_numbers.seeds import make_ground_generator
from .landforms.landform import draw_key, sample_shifted_noise, smooth_step

#: Points along a side of the grid.
_SIDE = 512
#: Sides of the squares whose ground fails, over the side of the patch, and width of the margin around each over its
#: side. The ground of a square fades into the ground of the next one there.
_SQUARES, _MARGIN = (1.0, 4.0), 0.1
#: Waves shorter than this many cells are finer than the grid.
_CARRIED = 2.0
#: Wavelengths of cohesion, over the height of the strongest upright wall, and the factors on their noise.
_WEAK_WAVES = ((8.0, 1.2), (2.5, 0.4))
#: Topics of settings on which hard ground does not depend.
_IRRELEVANT = frozenset(
    (
        "source",
        "mesh",
        "mantle",
        "excavation",
        "surface",
        "hapke",
        "textures",
        "rocks",
        "rock_surface",
        "light",
        "veil",
        "rig",
        "left_eye",
        "right_eye",
        "calibration_error",
        "lander",
        "arm",
        "workspace",
        "sensor",
        "quality",
        "dataset",
    )
)

#: Heights in metres at east and north coordinates, without waves shorter than a length.
FindHeights = Callable[[Array, Array, Numbers], Array]


@dataclass(frozen=True)
class Talus:
    """The talus of a patch. ``key`` has the settings and the seed that determine it, as JSON. ``find_hard`` returns
    heights of the ground before it fails, and ``find_rough`` heights of its random part. Nothing is computed before it
    is needed, and equal keys share one result.
    """

    size_m: float
    strength: Strength
    volume_ratio: float
    weakness: float
    roughness: float
    noise_keys: tuple[int, int]
    key: str
    find_hard: FindHeights = field(repr=False, compare=False)
    find_rough: FindHeights = field(repr=False, compare=False)

    def make_grid(self, square: float) -> Grid:
        """Make the grid on which the ground of a square fails, whose side is ``square`` times the side of the patch."""
        return Grid(_SIDE, (1.0 + 2.0 * _MARGIN) * square * self.size_m / _SIDE)

    @property
    def wall_m(self) -> float:
        """Height in metres of the highest upright wall that stands."""
        of = self.strength
        return critical_height_m(of.cohesion_pa, of.friction_deg, of.density_kg_m3, of.gravity_m_s2)

    @property
    def fallen(self) -> FallenGround | None:
        """The ground of the patch after it has failed; None if all of it stands."""
        return _find_fallen(self, _SQUARES[0])

    def settle(self, hard_m: Array, x_m: Array, y_m: Array, shortest_m: Numbers) -> tuple[Array, Array]:
        """Compute the heights of the hard ground that stands and the thicknesses of the talus on it, at places with
        heights ``hard_m`` before, all arrays of one shape; ``shortest_m`` is as in ``Terrain.heights``.
        """
        shape = hard_m.shape
        hard, x, y = (np.broadcast_to(a, shape).reshape(-1) for a in (hard_m, x_m, y_m))
        shortest = np.broadcast_to(shortest_m, shape).reshape(-1)
        left, loose, open_share = hard.copy(), np.zeros(hard.size), np.ones(hard.size)
        for square in _SQUARES:
            side = square * self.size_m
            outside = (np.maximum(np.abs(x), np.abs(y)) - side / 2) / (_MARGIN * side)
            some = np.flatnonzero((outside < 1.0) & (open_share > 0.0))
            fallen = _find_fallen(self, square) if len(some) else None
            share = open_share[some] * (1.0 - smooth_step(outside[some]))
            open_share[some] -= share
            if fallen is None:
                continue
            fine = partial(self._find_fine, shortest[some], _CARRIED * fallen.grid.cell_m)
            standing, talus = fallen.settle(hard[some], x[some], y[some], fine, self.roughness)
            left[some] += share * (standing - hard[some])
            loose[some] += share * talus
        return left.reshape(shape), loose.reshape(shape)

    def _find_fine(self, shortest_m: Array, longest_m: float, x_m: Array, y_m: Array, which: Array) -> Array:
        """Compute the heights of the random part of the ground with wavelengths up to ``longest_m``, at the places
        ``which``.
        """
        carried = shortest_m[which]
        return self.find_rough(x_m, y_m, carried) - self.find_rough(x_m, y_m, np.maximum(carried, longest_m))

    def find_cohesion_share(self, grid: Grid) -> Numbers:
        """Compute the cohesion at the points of a grid over the cohesion of strong ground."""
        if self.weakness == 0.0 or self.wall_m == 0.0:
            return 1.0
        noise = np.zeros((grid.side, grid.side))
        for (wave, factor), key in zip(_WEAK_WAVES, self.noise_keys, strict=True):
            u, v = np.broadcast_arrays(
                *(a / (wave * self.wall_m) for a in (grid.axis_m[None, :], grid.axis_m[:, None]))
            )
            noise += factor * sample_shifted_noise(u, v, key)
        return np.asarray(1.0 - self.weakness * np.clip(0.5 + noise, 0.0, 1.0))


@functools.lru_cache(maxsize=6)
def _find_fallen(talus: Talus, square: float) -> FallenGround | None:
    """Find the ground of a square after it has failed, once for all grounds with the same key."""
    grid = talus.make_grid(square)
    x, y = np.broadcast_arrays(grid.axis_m[None, :], grid.axis_m[:, None])
    # One wavelength for each point keeps landforms whole; a single one leaves out those that a grid cannot carry.
    height = talus.find_hard(x, y, np.full(x.shape, _CARRIED * grid.cell_m))
    return let_ground_fail(height, grid, talus.strength, talus.volume_ratio, talus.find_cohesion_share(grid))


def make_talus(settings: Settings, seed: int, find_hard: FindHeights, find_rough: FindHeights) -> Talus | None:
    """Make the talus of complete settings and the seed of their data set; None if they ask for none, or for ground from
    a file. For the functions of heights see ``Talus``. Raises IcyMoonError if the gravity of the moon is unknown.
    """
    asked: TalusSettings = settings.talus
    if asked.share == 0.0 or settings.source.kind != "PROCEDURAL":
        return None
    gravity = find_gravity_m_s2(float(asked.gravity_m_s2), str(settings.light.body), "talus.gravity_m_s2")
    random = make_ground_generator(seed, int(settings.terrain.variant), 6)
    decides = {topic: values for topic, values in settings.items() if topic not in _IRRELEVANT}
    return Talus(
        float(settings.terrain.size_m),
        Strength(float(asked.cohesion_pa), float(asked.friction_deg), float(asked.density_kg_m3), gravity),
        float(asked.share * asked.bulking),
        float(asked.weakness),
        float(asked.roughness),
        (draw_key(random), draw_key(random)),
        json.dumps([decides, seed], sort_keys=True),
        find_hard,
        find_rough,
    )


def advise_on_talus(talus: Talus | None) -> list[str]:
    """Return a sentence, in a list, if no ground is steep enough to fail; else an empty list."""
    if talus is None or talus.fallen is not None:
        return []
    return [
        f"No ground fails, so there is no talus: upright walls of {talus.wall_m:.2g} m stand at "
        f"{talus.strength.gravity_m_s2:.3g} m/s². Lower talus.cohesion_pa, or set talus.share to 0."
    ]
