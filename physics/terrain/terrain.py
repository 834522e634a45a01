"""The ground: heights by position, summed over the parts that the settings name.

The parts are a random surface of stated roughness (``roughness``), extra layers of noise (``noise_layers``), landforms
(``landforms``) on a regional slope, and hills (``hills``) to the horizon. There is ``talus`` where ground has failed,
snow in the hollows, and ``skirts`` at the feet of rocks. Points may come in any number and order: the height of a place
does not depend on the mesh, except for the wavelengths that the mesh cannot carry.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...settings.topics.ground import HillsSettings, TerrainLayer, TerrainSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..random_numbers.seeds import make_ground_generator
from .far_roughness import FarRoughness, make_far_roughness
from .hills import make_hills
from .landforms import MAKERS, Landform, make_plugin_landforms
from .noise_layers import NoiseLayer, make_layer
from .roughness.roughness import (
    LAW_FROM,
    LAW_TO,
    RoughSurface,
    fit_amplitudes,
    make_rough_surface,
    octave_wavelengths_m,
    resolved_share,
)
from .roughness.structure_function import structure_function
from .skirts import Skirts, make_skirts_of_scene
from .talus import Talus, advise_on_talus, make_talus

#: Side in points of a tile, whose arrays fit the processor's cache.
_TILE_SIDE = 128
#: Points per side of the grid on which mean heights of the patch are taken.
_MEAN_GRID_SIDE = 65
#: RMS slope in degrees above which extrapolated roughness gets a warning.
_STEEPEST_PLAUSIBLE_DEG = 50.0
#: Share of the RMS deviation that a mesh may lose without a warning.
_MAX_LOST_SHARE = 0.1


@dataclass(frozen=True)
class Terrain:
    """A patch of ground. All lengths in metres; build it with :func:`make_terrain`."""

    size_m: float
    base: RoughSurface
    layers: tuple[NoiseLayer, ...] = ()
    landforms: tuple[Landform, ...] = ()
    slope_east: float = 0.0
    slope_north: float = 0.0
    mantle_thickness_m: float = 0.0
    mantle_length_m: float = 0.0
    mantle_feather_m: float = 0.0
    mantle_level_m: float = field(default=0.0, repr=False)
    hills: Landform | None = None
    far_roughness: FarRoughness | None = None
    skirts: Skirts | None = field(default=None, repr=False)
    talus: Talus | None = field(default=None, repr=False)

    def heights(self, x_m: Numbers, y_m: Numbers, shortest_m: Numbers = 0.0) -> Array:
        """Compute heights in metres at east and north coordinates (arrays that broadcast).

        Waves shorter than ``shortest_m`` (a number, or one per point) are left out. A mesh with vertices d apart cannot
        carry wavelengths below 2 d, and would show them as noise of other statistics.
        """
        return _compute_by_tiles(self._compute_tile, x_m, y_m, shortest_m)

    def measure_loose(self, x_m: Numbers, y_m: Numbers, shortest_m: Numbers = 0.0) -> Array:
        """Measure thicknesses in metres, along the vertical, of loose material at the same heights: talus, mantle,
        skirts.

        For the arguments see ``heights``, which are lower by these thicknesses without loose material.
        """
        return _compute_by_tiles(self._compute_loose_tile, x_m, y_m, shortest_m)

    def with_sharp_crests(self) -> Terrain:
        """Return the same ground with sharp crests, for a mesh that has edges along the crests of its landforms."""
        return replace(self, landforms=tuple(each.with_sharp_crests() for each in self.landforms))

    def without_skirts(self) -> Terrain:
        """Return the same ground without skirts, on which rocks lie."""
        return replace(self, skirts=None) if self.skirts else self

    def _compute_tile(self, x: Array, y: Array, shortest_m: Numbers) -> Array:
        """Compute the heights of one tile of points."""
        total, talus = self._find_settled(x, y, shortest_m)
        if talus is not None:
            total += talus
        if self.mantle_thickness_m:
            total += self._measure_mantle(total, x, y, shortest_m)
        if self.slope_east or self.slope_north:
            total += self._regional_slope(x, y)
        if self.skirts:
            total += self.skirts.heights(x, y, shortest_m)
        return total

    def _compute_loose_tile(self, x: Array, y: Array, shortest_m: Numbers) -> Array:
        """Compute the thicknesses of loose material at one tile of points."""
        loose = np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))
        if self.talus or self.mantle_thickness_m:
            total, talus = self._find_settled(x, y, shortest_m)
            if talus is not None:
                loose += talus
                total += talus
            if self.mantle_thickness_m:
                loose += self._measure_mantle(total, x, y, shortest_m)
        if self.skirts:
            loose += self.skirts.heights(x, y, shortest_m)
        return loose

    def _find_settled(self, x: Array, y: Array, shortest_m: Numbers) -> tuple[Array, Array | None]:
        """Find the heights, m, of the hard ground that stands, without the regional slope, and the thicknesses of the
        talus on it; None without talus. A uniform mesh that leaves out a share of a landform leaves out as much of its
        talus.
        """
        hard = self._sum_hard(x, y, shortest_m)
        if self.talus is None:
            return hard, None
        share = 1.0
        if np.ndim(shortest_m) == 0:
            share = min([float(each.resolved_share(shortest_m)) for each in self.landforms], default=1.0)
        slope = self._regional_slope(x, y)
        left, talus = self.talus.settle(hard + slope, x, y, shortest_m)
        return hard + share * (left - slope - hard), share * talus

    def _sum_hard(self, x: Array, y: Array, shortest_m: Numbers) -> Array:
        """Sum the heights, m, of the random surface with hills and landforms, before any of it fails."""
        total = self._sum_ground(x, y, shortest_m)
        for landform in self.landforms:
            # Only a uniform mesh leaves out landforms that are too fine for it; a graded mesh bounds their error.
            share = landform.resolved_share(shortest_m) if np.ndim(shortest_m) == 0 else 1.0
            if share:
                total += share * landform.heights(x, y, shortest_m)
        return total

    def _measure_mantle(self, hard_m: Array, x: Array, y: Array, shortest_m: Numbers) -> Array:
        """Measure the thickness, m, of the mantle on ground of the heights ``hard_m``."""
        smooth = self._sum_ground(x, y, np.maximum(shortest_m, self.mantle_length_m))
        return snow_depth_m(smooth + (self.mantle_level_m - hard_m), self.mantle_thickness_m, self.mantle_feather_m)

    def _regional_slope(self, x: Array, y: Array) -> Array:
        """Compute the regional slope: a plane on the patch, which levels out beyond it at twice the patch's height."""
        rise = self.slope_east * x + self.slope_north * y
        end = math.hypot(self.slope_east, self.slope_north) * self.size_m * math.sqrt(0.5)
        beyond = np.maximum(np.abs(rise) - end, 0.0)
        return rise if not np.any(beyond) else rise - np.sign(rise) * (beyond + end * np.expm1(-beyond / end))

    def _sum_ground(self, x: Array, y: Array, shortest_m: Numbers) -> Array:
        """Sum the heights, m, of the random surface, its layers, and the distant hills under them."""
        total = self.base.heights(x, y, shortest_m)
        for each in self.layers:
            total += each.heights(x, y, shortest_m)
        if self.far_roughness:
            total *= self.far_roughness.factor(x, y)
        if self.hills:
            total += self.hills.heights(x, y, shortest_m)
        return total

    def _find_rough(self, x: Array, y: Array, shortest_m: Numbers) -> Array:
        """Compute the heights, m, of the random surface and its layers."""
        return sum((each.heights(x, y, shortest_m) for each in self.layers), self.base.heights(x, y, shortest_m))


def _compute_by_tiles(
    compute: Callable[[Array, Array, Numbers], Array], x_m: Numbers, y_m: Numbers, shortest_m: Numbers
) -> Array:
    """Compute the values that ``compute`` finds for tiles of points, at coordinates that broadcast."""
    x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
    shape = np.broadcast_shapes(x.shape, y.shape, np.shape(shortest_m))
    if len(shape) == 2 and x.shape == (1, shape[1]) and y.shape == (shape[0], 1) and np.ndim(shortest_m) == 0:
        result = np.empty(shape)
        for rows, columns in _list_tiles(*shape):
            result[rows, columns] = compute(x[:, columns], y[rows], shortest_m)
        return result
    x, y = (np.broadcast_to(a, shape).reshape(-1) for a in (x, y))
    shortest = np.broadcast_to(shortest_m, shape).reshape(-1) if np.ndim(shortest_m) else None
    order = _order_by_place(x, y)
    result = np.empty(x.size)
    for start in range(0, x.size, _TILE_SIDE**2):
        some = order[start : start + _TILE_SIDE**2]
        result[some] = compute(x[some], y[some], shortest_m if shortest is None else shortest[some])
    return result.reshape(shape)


def _list_tiles(rows: int, columns: int) -> Iterator[tuple[slice, slice]]:
    for j in range(0, rows, _TILE_SIDE):
        for i in range(0, columns, _TILE_SIDE):
            yield slice(j, j + _TILE_SIDE), slice(i, i + _TILE_SIDE)


def _order_by_place(x: Array, y: Array) -> Array:
    """Return indices that order scattered points so that neighbours follow each other and share lattice cells."""
    if x.size <= _TILE_SIDE**2:
        return np.arange(x.size)
    squares = max(1, round(math.sqrt(x.size) / _TILE_SIDE))
    column, row = (
        np.minimum(((a - a.min()) * (squares / max(float(np.ptp(a)), 1e-300))).astype(np.int64), squares - 1)
        for a in (x, y)
    )
    return np.argsort(row * squares + column, kind="stable")


def make_terrain(settings: Settings, seed: int, with_skirts: bool = True) -> Terrain:
    """Make the ground of complete settings and of the seed of their data set, with the skirts of its rocks or without.

    Raises IcyMoonError where lengths contradict each other, or where a file of rocks with skirts cannot be read.
    """
    ground = settings.terrain
    size, variant = float(ground.size_m), int(ground.variant)
    layers = [_make_layer(tuple(entry.items()), seed, variant, k) for k, entry in enumerate(ground.layers)]
    landforms = [
        make(settings[topic], make_ground_generator(seed, variant, 3, k), size)
        for k, (topic, make) in enumerate(MAKERS.items())
    ]
    landforms += make_plugin_landforms(settings, lambda key: make_ground_generator(seed, variant, 5, key)).values()
    fall, azimuth = (math.radians(ground[k]) for k in ("regional_slope_deg", "regional_slope_azimuth_deg"))
    mantle = settings.mantle
    base = make_rough_surface(ground, size, make_ground_generator(seed, variant, 0))
    made = Terrain(
        size,
        base,
        tuple(a for a in layers if a),
        tuple(a for a in landforms if a),
        -math.tan(fall) * math.sin(azimuth),
        -math.tan(fall) * math.cos(azimuth),
        mantle.thickness_m,
        mantle.length_m,
        mantle.feather_m,
        hills=_make_hills(tuple(settings.hills.items()), seed, variant, size),
        far_roughness=_make_far_roughness(
            tuple(settings.hills.items()), float(ground.outer_scale_m), seed, variant, size
        ),
        skirts=make_skirts_of_scene(settings, seed) if with_skirts else None,
    )
    if mantle.thickness_m and made.landforms:
        made = _level_mantle(made)
    bare = replace(made, mantle_thickness_m=0.0, skirts=None)
    return replace(made, talus=make_talus(settings, seed, bare.heights, bare._find_rough))


# The statistics of layers and hills take longer than the rest of a ground, and most sliders do not change them.


@functools.lru_cache(maxsize=16)
def _make_layer(values: tuple[tuple[str, Any], ...], seed: int, variant: int, number: int) -> NoiseLayer | None:
    """Make the layer of an entry's ``values``, kept for the next ground."""
    return make_layer(TerrainLayer.from_values(values), make_ground_generator(seed, variant, 2, number))


@functools.lru_cache(maxsize=4)
def _make_hills(values: tuple[tuple[str, Any], ...], seed: int, variant: int, size_m: float) -> Landform | None:
    """Make the hills of the settings' ``values``, kept for the next ground."""
    return make_hills(HillsSettings.from_values(values), make_ground_generator(seed, variant, 4), size_m)


@functools.lru_cache(maxsize=4)
def _make_far_roughness(
    values: tuple[tuple[str, Any], ...], longest_m: float, seed: int, variant: int, size_m: float
) -> FarRoughness | None:
    """Make the places of unlike roughness of the hills' ``values``, kept for the next ground."""
    random = make_ground_generator(seed, variant, 6)
    return make_far_roughness(HillsSettings.from_values(values), longest_m, random, size_m)


def _level_mantle(made: Terrain) -> Terrain:
    """Return the terrain with its mantle at the mean height of the landforms on the patch."""
    axis = np.linspace(-made.size_m / 2, made.size_m / 2, _MEAN_GRID_SIDE)
    x, y = axis[None, :], axis[:, None]
    mean = sum(float(np.mean(landform.heights(x, y, 0.0))) for landform in made.landforms)
    return replace(made, mantle_level_m=float(f"{mean:.9e}"))


def law_range_m(ground: TerrainSettings) -> tuple[float, float]:
    """Return the shortest and the longest distance over which ``terrain`` settings ask for the power law."""
    return LAW_FROM * ground.inner_scale_m, LAW_TO * ground.outer_scale_m


def _share_lost_to_mesh(ground: TerrainSettings, shortest_m: float) -> float:
    """Compute the share of the stated RMS deviation that a mesh loses, at three times the shortest wavelength that it
    carries.
    """
    wavelength = octave_wavelengths_m(ground)
    lag = 3 * shortest_m
    if not LAW_FROM * wavelength[-1] <= lag <= LAW_TO * wavelength[0]:
        return 0.0
    squares = fit_amplitudes(wavelength, ground.hurst) ** 2 * structure_function(lag / wavelength)
    return 1.0 - math.sqrt(resolved_share(wavelength, shortest_m) ** 2 @ squares / squares.sum())


def advise_on_terrain(settings: Settings, shortest_m: float) -> list[str]:
    """List sentences about features of the ground that a mesh with the shortest wavelength ``shortest_m`` cannot
    show.
    """
    ground, notes = settings.terrain, []
    finer = "raise terrain.resolution" if settings.mesh.kind == "GRID" else "lower mesh.edge_px"
    finest = max(ground.inner_scale_m, shortest_m)
    slope = math.tan(math.radians(ground.rms_slope_deg))
    steep = math.degrees(math.atan(slope * (finest / ground.slope_baseline_m) ** (ground.hurst - 1.0)))
    if ground.hurst < 0.5 and steep > _STEEPEST_PLAUSIBLE_DEG:
        notes.append(
            f"With a Hurst exponent of {ground.hurst:g}, {ground.rms_slope_deg:g} degrees at "
            f"{ground.slope_baseline_m:g} m become {steep:.0f} degrees at {finest:.2g} m, which no ice "
            "holds; raise terrain.hurst or terrain.inner_scale_m."
        )
    lost = _share_lost_to_mesh(ground, shortest_m)
    if slope and lost > _MAX_LOST_SHARE:
        notes.append(
            f"The mesh carries no wave under {shortest_m:.2g} m, so that the ground is {lost:.0%} smoother "
            f"than stated at {3 * shortest_m:.2g} m; {finer} or raise terrain.inner_scale_m."
        )
    if slope and ground.outer_scale_m <= shortest_m:
        notes.append(
            f"The mesh carries no wave under {shortest_m:.3g} m, and the longest is terrain.outer_scale_m, "
            f"{ground.outer_scale_m:g} m: the ground is flat; {finer}."
        )
    landforms = {
        topic: make(settings[topic], np.random.default_rng(0), ground.size_m) for topic, make in MAKERS.items()
    }
    landforms |= make_plugin_landforms(settings, lambda key: np.random.default_rng(0))
    for topic, landform in landforms.items():
        share = landform.resolved_share(shortest_m) if landform else 1.0
        if landform and share < 1.0:
            notes.append(
                f"The mesh is too coarse for the {topic} (they need vertices {landform.finest_m / 1.5:.2g} m "
                f"apart), so they are {f'{share:.0%} of their height' if share else 'left out'}; {finer}."
            )
    if settings.talus.share > 0:
        notes += advise_on_talus(make_terrain(settings, int(settings.dataset.seed), with_skirts=False).talus)
    return notes


def snow_depth_m(below_m: Array, thickness_m: float, feather_m: float = 0.0) -> Array:
    """Compute the depth in metres of plume fall-out or frost on ground that lies ``below_m`` under its smoothed
    surroundings (negative: above).

    Shallow hollows are filled to that surface, deep ones by ``thickness_m``, with no step between: the depth is e -
    e²/4T up to e = 2T, then T. With a feather w the snow starts at e = -w, without a crease; up to e = w, the same law
    takes (e + w)²/4w in place of e. So the relief around the edge of the snow shows through it, ever lower toward the
    hollow, as thin snow damps the roughness under it (Veitinger et al. 2014, The Cryosphere 8, 547).
    """
    if thickness_m == 0.0:
        return np.zeros_like(below_m)
    if feather_m:
        risen = np.clip(below_m + feather_m, 0.0, 2.0 * feather_m)
        below_m = np.maximum(below_m, risen * risen / (4.0 * feather_m))
    e = np.clip(below_m, 0.0, 2.0 * thickness_m)
    return e - e * e / (4.0 * thickness_m)
