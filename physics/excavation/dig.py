"""The states of an excavation, one after the other; every cubic metre and kilogram is accounted for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...settings.topics.excavation import ExcavationSettings
from ...support.arrays import Array
from ..gravity.slide_to_repose import GroundLayers, relax_slopes
from ..random_numbers.seeds import make_generator
from ..terrain.noise.lattice_noise import gradient_noise
from .clods import add_clods, find_least_width_m
from .dig_site import ExcavationSite
from .dust_apron import spread_dust
from .scoop_cut import Pull, fit_plane, measure_cut_depth_m
from .wall_slump import find_failed_m, make_strength

#: Wavelength of each noise of the clods over the height of the clods, and the noise's share of this height.
_CLOD_NOISE = ((9.0, 1.6), (3.5, 1.4), (1.6, 0.7))
#: Wavelength of the unevenness of a heap, over the height of the clods.
_LUMP_WAVELENGTH = 14.0
#: Height of this unevenness, over the height of the clods.
_LUMP_HEIGHT = 5.0
#: With clods of many sizes: unevenness of a heap, over the largest clod.
_UNEVENNESS_OF_MANY = 0.35
#: With clods of many sizes: radius of the heap's crest, over the largest clod.
_CREST_OF_MANY = 0.3
#: Change of height in metres at the rim of the patch that counts as spoil there.
_SPOIL_AT_RIM_M = 1.0e-4
#: Wavelength of chips along a rim, over the depth of the largest chip.
_CHIP_WAVELENGTH = 5.0
#: Slope of chips.
_CHIP_SLOPE = 1.5


@dataclass(frozen=True)
class DugState:
    """The ground after a step of the excavation, and the effects of the step: volumes in m³ of undisturbed ground,
    masses in kg. ``chipped_m3`` broke off standing rims, and ``slid_m3`` of ground slid because walls, or parts of
    them, did not stand. ``kept_kg`` was not dropped on the heap. ``stood`` is true if the walls stood, ``rests`` if all
    loose material came to rest.
    """

    layers: GroundLayers
    taken_m3: float
    taken_kg: float
    chipped_m3: float
    slid_m3: float
    kept_kg: float
    stood: bool
    rests: bool = True


@dataclass
class ExcavationSeries:
    """All states of an excavation that have been dug; the first is the untouched ground. ``level_m`` is the reference
    height of depths if the arm's joints give the path. ``bare`` are the layers of each state without clods, from which
    the next state is dug.
    """

    site: ExcavationSite
    excavation: ExcavationSettings
    seed: int
    before_m: Array
    level_m: float | None = None
    states: list[DugState] = field(default_factory=list)
    bare: list[GroundLayers] = field(default_factory=list)

    def __post_init__(self) -> None:
        spoil = np.zeros_like(self.before_m)
        self.bare.append(GroundLayers(self.before_m, spoil))
        self.states.append(DugState(self.bare[0], 0.0, 0.0, 0.0, 0.0, 0.0, True))

    @property
    def spoil_kg_m3(self) -> float:
        """Density of spoil in kg/m³: the density of the ground divided by the bulking factor."""
        return float(self.excavation.density_kg_m3 / self.excavation.bulking)

    def at(self, state: int) -> DugState:
        """Return the ground in a state; earlier states are dug first."""
        while len(self.states) <= state:
            self.states.append(self._dig_next(len(self.states)))
        return self.states[state]

    def _dig_next(self, number: int) -> DugState:
        pulls, cell = self.site.pulls[number - 1], self.site.grid.cell_m
        layers = self.bare[-1].copy()
        self.bare.append(layers)
        if not pulls:
            return DugState(self.states[-1].layers, 0.0, 0.0, 0.0, 0.0, 0.0, self.states[-1].stood)
        volume, mass = self._take_off(layers, self._cut_depth_m(layers, number))
        lowest = float((self.before_m - layers.ground).max())
        stood = self.states[-1].stood and lowest <= self.site.stands_m
        chipped, chips_kg = (
            self._take_off(layers, self._chip_rims(layers, pulls)) if stood and volume > 0.0 else (0.0, 0.0)
        )
        heaped_kg = self.excavation.heaped_share * mass + chips_kg
        self._drop_on_heap(layers, number, heaped_kg)
        solid = layers.ground.copy()
        if stood:
            self._break_walls(layers, number)
        _, rests = relax_slopes(
            layers,
            cell,
            self.excavation.friction_deg,
            self.excavation.bulking,
            *(() if stood else (self.before_m, self._find_sliding_area(number, lowest))),
        )
        slid = float(np.maximum(solid - layers.ground, 0.0).sum()) * cell**2
        return DugState(self._add_clods(layers), volume, mass, chipped, slid, mass + chips_kg - heaped_kg, stood, rests)

    @property
    def has_many_sizes(self) -> bool:
        """Whether clods are separate bodies of many sizes; otherwise they are noise."""
        return bool(self.excavation.clod_sizes == "MANY")

    def _make_lumps_m(self) -> Array:
        """Make the unevenness (rows, columns) in metres of the heap, for ``SpoilHeap.thickness``. Its wavelength is
        several clods.
        """
        size, key = float(self.excavation.clods_m), int(make_generator(self.seed, "terrain", 8).integers(0, 2**32))
        size *= _UNEVENNESS_OF_MANY if self.has_many_sizes else 1.0
        if size == 0.0:
            return np.zeros(self.before_m.shape)
        wave = _LUMP_WAVELENGTH * size
        east, north = np.broadcast_arrays(self.site.grid.east_m[None, :] / wave, self.site.grid.north_m[:, None] / wave)
        return _LUMP_HEIGHT * size * np.asarray(gradient_noise(east, north, key))

    def _add_clods(self, layers: GroundLayers) -> GroundLayers:
        """Add clods to the spoil of layers; the mass of the spoil is kept. Clods on thin spoil are as low as the
        spoil.
        """
        size, total = float(self.excavation.clods_m), float(layers.spoil.sum())
        if size == 0.0 or total == 0.0:
            return layers
        if self.has_many_sizes:
            return GroundLayers(layers.ground, self._make_clods(layers, size))
        grid, key = self.site.grid, int(make_generator(self.seed, "terrain", 7).integers(0, 2**32))
        clods = np.zeros(layers.spoil.shape)
        for octave, (waves, share) in enumerate(_CLOD_NOISE):
            wave = waves * size
            east, north = np.broadcast_arrays(grid.east_m[None, :] / wave, grid.north_m[:, None] / wave)
            # Creases where the noise is 0, and round tops between.
            clods += share * np.abs(gradient_noise(east, north, key + octave))
        spoil = layers.spoil + size * (clods - float(clods.mean())) * np.minimum(layers.spoil / size, 1.0)
        spoil = np.maximum(spoil, 0.0)
        return GroundLayers(layers.ground, spoil * (total / float(spoil.sum())))

    def _make_clods(self, layers: GroundLayers, largest_m: float) -> Array:
        """Return the thickness (rows, columns) in metres of spoil with clods of many sizes; none drops on dust beyond
        the heap.
        """
        dusty = self.excavation.dust_share > 0.0
        return add_clods(
            self.site.grid,
            layers.ground,
            layers.spoil,
            largest_m,
            float(self.excavation.friction_deg),
            make_generator(self.seed, "terrain", 9),
            float(self.excavation.sorting),
            find_least_width_m(self.site.grid.cell_m, largest_m) if dusty else 0.0,
        )

    def _find_sliding_area(self, number: int, lowest_m: float) -> Array:
        """Find the cells where ground may slide, bool (rows, columns): out to where a slope from the lowest floor
        reaches level ground. Without this limit a slide on a slope near the angle of friction would climb without end,
        over ground that stood before.
        """
        reach = lowest_m / math.tan(math.radians(self.excavation.friction_deg))
        near = np.zeros(self.before_m.shape, bool)
        for pull in (pull for each in self.site.pulls[:number] for pull in each):
            window = self.site.grid.window(*pull.bounds_m(reach))
            near[window] |= pull.beside(*self.site.grid.points(window))[0] <= reach
        return near

    @property
    def plane(self) -> Array:
        """The plane (3,) from which depths count: the plane of the untouched ground, see ``scoop_cut.fit_plane``, or a
        level one.
        """
        if self.level_m is not None:
            return np.array([self.level_m, 0.0, 0.0])
        return fit_plane(self.site.grid, self.before_m, [pull for each in self.site.pulls for pull in each])

    def _cut_depth_m(self, layers: GroundLayers, number: int) -> Array:
        """Compute the depth (rows, columns) in metres that the blade removes in a state.

        While walls stand, a partly cut cell keeps its uncut part, and later bites at the same cell leave that part.
        Once walls have slid, parts of cells are unknown.
        """
        pulls, top = self.site.pulls[:number], layers.top
        if not self.states[-1].stood:
            return measure_cut_depth_m(self.site.grid, top, self.plane, pulls[-1])
        every = [pull for each in pulls for pull in each]
        left = self.before_m - measure_cut_depth_m(self.site.grid, self.before_m, self.plane, every)
        # Spoil may lie on ground that no blade has touched.
        return np.where(left < self.before_m, np.maximum(top - left, 0.0), 0.0)

    def _take_off(self, layers: GroundLayers, cut: Array) -> tuple[float, float]:
        """Remove a depth (rows, columns) in metres from the surface, in place, spoil first. Return the volume in m³ and
        the mass in kg.
        """
        area = self.site.grid.cell_m**2
        loose = np.minimum(cut, layers.spoil)
        layers.spoil -= loose
        layers.ground -= cut - loose
        spoil, solid = float(loose.sum()) * area, float((cut - loose).sum()) * area
        return spoil + solid, spoil * self.spoil_kg_m3 + solid * self.excavation.density_kg_m3

    def _chip_rims(self, layers: GroundLayers, pulls: tuple[Pull, ...]) -> Array:
        """Return the depth (rows, columns) in metres of the material that breaks off the rims of standing walls."""
        most = float(self.excavation.chips_m)
        chipped = np.zeros_like(self.before_m)
        if most <= 0:
            return chipped
        grid = self.site.grid
        key = int(make_generator(self.seed, "terrain", 6).integers(0, 2**32))
        wave = _CHIP_WAVELENGTH * most
        east, north = np.broadcast_arrays(grid.east_m[None, :] / wave, grid.north_m[:, None] / wave)
        noise = gradient_noise(east, north, key) + 0.5 * gradient_noise(2.7 * east, 2.7 * north, key + 1)
        size = most * np.clip(0.35 + 1.3 * noise, 0.0, 1.0)
        for pull in pulls:
            window = grid.window(*pull.bounds_m(most))
            out, depth = pull.beside(*grid.points(window))
            chip = np.minimum(_CHIP_SLOPE * np.maximum(size[window] - out, 0.0), 0.5 * np.maximum(depth, 0.0))
            chipped[window] = np.maximum(chipped[window], np.where(out > 0, chip, 0.0))
        return np.maximum(layers.ground - (self.before_m - chipped), 0.0)

    def _break_walls(self, layers: GroundLayers, number: int) -> None:
        """Turn the ground of walls that are too weak to stand into spoil, in place."""
        weakening = float(self.excavation.slump)
        if weakening == 0.0 or self.site.deepest_m <= (1.0 - weakening) * self.site.stands_m:
            return
        key = int(make_generator(self.seed, "terrain", 10).integers(0, 2**32))
        stands = self.site.stands_m * make_strength(self.site.grid, self.site.deepest_m, weakening, key)
        pulls = [pull for each in self.site.pulls[:number] for pull in each]
        friction = float(self.excavation.friction_deg)
        failed = find_failed_m(self.site.grid, self.before_m, layers.ground, pulls, stands, friction)
        layers.ground -= failed
        layers.spoil += float(self.excavation.bulking) * failed

    def _drop_on_heap(self, layers: GroundLayers, number: int, mass_kg: float) -> None:
        """Drop spoil on the heap, in place. On level ground the growing heap keeps its shape."""
        volume = mass_kg / self.spoil_kg_m3
        if volume <= 0:
            return
        dust, lumps = float(self.excavation.dust_share), self._make_lumps_m()
        if dust < 1.0:
            layers.spoil += self._grow_heap(number, volume, 1.0 - dust, lumps)
        if dust > 0.0:
            landed = dust * self._grow_heap(number, volume, 1.0, lumps)
            layers.spoil += spread_dust(self.site.grid, landed, float(self.excavation.drop_m))

    def _grow_heap(self, number: int, volume_m3: float, share: float, lumps_m: Array) -> Array:
        """Return the thickness (rows, columns) in metres by which a heap grows from a volume of spoil. The heap gets
        this share of all spoil and has the unevenness ``lumps_m``.
        """
        grid, before = self.site.grid, self.measure_heaped_m3(number - 1)
        crest = _CREST_OF_MANY * float(self.excavation.clods_m) if self.has_many_sizes else 0.0
        volumes = (share * before, share * (before + volume_m3))
        less, more = (self.site.heap.thickness(grid, each, lumps_m, crest) for each in volumes)
        more = np.maximum(more - less, 0.0)
        return np.asarray(more * (share * volume_m3 / (float(more.sum()) * grid.cell_m**2)))

    def measure_heaped_m3(self, state: int) -> float:
        """Sum the volume in m³ of the spoil that was dropped on the heap up to a state."""
        chips = sum(each.chipped_m3 for each in self.states[1 : state + 1]) * self.excavation.bulking
        return chips + sum(each.taken_kg for each in self.states[1 : state + 1]) * (
            self.excavation.heaped_share / self.spoil_kg_m3
        )

    def mass_error(self, state: int) -> float:
        """Compute the mass gained or lost by rounding up to a state, relative to the mass that was dug; in kg if
        nothing was dug.
        """
        area, at = self.site.grid.cell_m**2, self.at(state)
        states = self.states[1 : state + 1]
        lost = float((self.before_m - at.layers.ground).sum()) * area * self.excavation.density_kg_m3
        found = float(at.layers.spoil.sum()) * area * self.spoil_kg_m3 + sum(each.kept_kg for each in states)
        dug = sum(each.taken_kg for each in states)
        return abs(lost - found) / dug if dug > 0 else abs(lost - found)

    def facts(self, state: int) -> dict[str, Any]:
        """Describe an excavation in a state for ``pair.json``, in metres, cubic metres and kilograms."""
        at, site = self.at(state), self.site
        done, area = self.states[1 : state + 1], self.site.grid.cell_m**2
        change = [each.layers.top - self.before_m for each in self.states[: state + 1]]
        west, south, east, north = site.trench_m
        rows, columns = site.grid.window(west, south, east, north)
        region = [west, south, east, north]
        return {
            "state": state,
            "states": int(self.excavation.states),
            "taken_m3": sum(each.taken_m3 for each in done),
            "taken_by_state_m3": [each.taken_m3 for each in self.states[: state + 1]],
            "spoil_m3": float(at.layers.spoil.sum()) * area,
            "mass_taken_kg": sum(each.taken_kg for each in done),
            "mass_in_spoil_kg": float(at.layers.spoil.sum()) * area * self.spoil_kg_m3,
            "mass_kept_kg": sum(each.kept_kg for each in done),
            "mass_error": self.mass_error(state),
            "chipped_m3": sum(each.chipped_m3 for each in done),
            "slid_m3": sum(each.slid_m3 for each in done),
            "walls": "stand" if at.stood else "slide",
            "walls_stand_to_m": site.stands_m,
            "region_m": region,
            "change_in_region_by_state_m3": [float(each[rows, columns].sum()) * area for each in change],
            "patch_m": list(site.grid.bounds_m),
            "change_in_patch_by_state_m3": [float(each.sum()) * area for each in change],
            "deepest_m": float(max(-change[-1].min(), 0.0)),
            "cell_m": site.grid.cell_m,
            "advice": self.advice(state),
        }

    def advice(self, state: int) -> list[str]:
        """List sentences about faults that show only after digging: no cut, spoil at the rim, and ground that still
        slides.
        """
        at, said = self.at(state), []
        wanted = [float(pull.depth_m.max()) for each in self.site.pulls[:state] for pull in each]
        if max(wanted, default=0.0) > 0.0 and not any(each.taken_m3 > 0.0 for each in self.states[: state + 1]):
            said.append(
                f"Nothing was dug up to state {state}, because the blade passes over less than a quarter of a "
                "cell of ground, or above it; lower excavation.cell_m, or dig deeper."
            )
        change = np.abs(at.layers.top - self.before_m)
        if max(side.max() for side in (change[0], change[-1], change[:, 0], change[:, -1])) > _SPOIL_AT_RIM_M:
            said.append(
                "Spoil slid as far as the rim of the patch of fine ground, where it is held as by a wall: the "
                "ground is too steep for a heap; change excavation.heap_side, or move the trench to gentler "
                "ground."
            )
        if not all(each.rests for each in self.states[: state + 1]):
            said.append(
                "Loose ground still slid when its sweeps ended, so that some slopes are too steep; raise "
                "excavation.cell_m, or move the trench to smoother ground."
            )
        return said
