"""The states of an excavation, one after the other, with every cubic metre and kilogram accounted for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ...typed_settings import ExcavationSettings
from ..random_numbers.seeds import generator
from ..terrain.noise.lattice_noise import gradient_noise
from .cut import Pull, cut_heights, fit_plane
from .relax import Layers, relax
from .site import Site

#: Wavelength of chips along a rim, in depths of the largest chip, and their slope.
_CHIP_WAVES, _CHIP_SLOPE = 5.0, 1.5


@dataclass(frozen=True)
class State:
    """The ground after a step, and what the step did: volumes in m³ as they lay in the ground, masses in kg.

    ``chipped_m3`` fell off standing rims, ``slid_m3`` of ground slid as its walls did not stand. ``kept_kg`` is what
    was not heaped. ``stood`` is whether walls stood.
    """

    layers: Layers
    taken_m3: float
    taken_kg: float
    chipped_m3: float
    slid_m3: float
    kept_kg: float
    stood: bool
    sweeps: int = 0


@dataclass
class Series:
    """The states of an excavation that have been dug so far; the first is the untouched ground.

    ``level_m`` is the height that depths count from where the path is that of the arm's joints.
    """

    site: Site
    excavation: ExcavationSettings
    seed: int
    before_m: np.ndarray
    level_m: float | None = None
    states: list[State] = field(default_factory=list)

    def __post_init__(self) -> None:
        spoil = np.zeros_like(self.before_m)
        self.states.append(State(Layers(self.before_m, spoil), 0.0, 0.0, 0.0, 0.0, 0.0, True))

    @property
    def spoil_kg_m3(self) -> float:
        """Density of spoil: that of the ground over the bulking."""
        return float(self.excavation.density_kg_m3 / self.excavation.bulking)

    def at(self, state: int) -> State:
        """The ground in a state; the states before it are dug first."""
        while len(self.states) <= state:
            self.states.append(self._dig(len(self.states)))
        return self.states[state]

    def _dig(self, number: int) -> State:
        pulls, cell = self.site.pulls[number - 1], self.site.grid.cell_m
        layers = self.states[-1].layers.copy()
        if not pulls:
            return State(layers, 0.0, 0.0, 0.0, 0.0, 0.0, self.states[-1].stood)
        volume, mass = self._take(layers, self._cut(layers, number))
        lowest = float((self.before_m - layers.ground).max())
        stood = self.states[-1].stood and lowest <= self.site.stands_m
        chipped, chips_kg = self._take(layers, self._chips(layers, pulls)) if stood else (0.0, 0.0)
        heaped_kg = self.excavation.heaped_share * mass + chips_kg
        self._heap(layers, number, heaped_kg)
        solid = layers.ground.copy()
        sweeps = relax(layers, cell, self.excavation.friction_deg, self.excavation.bulking,
                       *(() if stood else (self.before_m, self._slides(number, lowest))))
        slid = float(np.maximum(solid - layers.ground, 0.0).sum()) * cell**2
        return State(layers, volume, mass, chipped, slid, mass + chips_kg - heaped_kg, stood, sweeps)

    def _slides(self, number: int, lowest_m: float) -> np.ndarray:
        """Where ground may slide: as far from the blade as a slope rises from the lowest floor on level ground.

        On a slope near the angle of friction a slide would climb without end, over ground that stood before.
        """
        reach = lowest_m / math.tan(math.radians(self.excavation.friction_deg))
        x, y = self.site.grid.east_m[None, :], self.site.grid.north_m[:, None]
        return np.any([pull.beside(x, y)[0] <= reach for each in self.site.pulls[:number] for pull in each], axis=0)

    @property
    def plane(self) -> np.ndarray:
        """The plane (3,) that depths count from: of the untouched ground, see ``cut.fit_plane``, or level."""
        if self.level_m is not None:
            return np.array([self.level_m, 0.0, 0.0])
        return fit_plane(self.site.grid, self.before_m, [pull for each in self.site.pulls for pull in each])

    def _cut(self, layers: Layers, number: int) -> np.ndarray:
        """What the blade takes away in a state, as a depth (rows, columns) in metres.

        While walls stand, what is left of a cell that was cut in part is its uncut part, which no later bite through
        the same place cuts. Once they have slid, nothing is known of parts of cells.
        """
        pulls, top = self.site.pulls[:number], layers.top
        if not self.states[-1].stood:
            return cut_heights(self.site.grid, top, self.plane, pulls[-1])
        every = [pull for each in pulls for pull in each]
        left = self.before_m - cut_heights(self.site.grid, self.before_m, self.plane, every)
        # What no blade has come to may have spoil on it.
        return np.where(left < self.before_m, np.maximum(top - left, 0.0), 0.0)

    def _take(self, layers: Layers, cut: np.ndarray) -> tuple[float, float]:
        """Take a depth (rows, columns) off the surface, in place: spoil first; the volume and the mass."""
        area = self.site.grid.cell_m**2
        loose = np.minimum(cut, layers.spoil)
        layers.spoil -= loose
        layers.ground -= cut - loose
        spoil, solid = float(loose.sum()) * area, float((cut - loose).sum()) * area
        return spoil + solid, spoil * self.spoil_kg_m3 + solid * self.excavation.density_kg_m3

    def _chips(self, layers: Layers, pulls: tuple[Pull, ...]) -> np.ndarray:
        """What breaks off the rims of standing walls, as a depth (rows, columns) in metres."""
        most = float(self.excavation.chips_m)
        chipped = np.zeros_like(self.before_m)
        if most <= 0:
            return chipped
        grid = self.site.grid
        x, y = grid.east_m[None, :], grid.north_m[:, None]
        key = int(generator(self.seed, "terrain", 6).integers(0, 2**32))
        wave = _CHIP_WAVES * most
        east, north = np.broadcast_arrays(x / wave, y / wave)
        noise = gradient_noise(east, north, key) + 0.5 * gradient_noise(2.7 * east, 2.7 * north, key + 1)
        size = most * np.clip(0.35 + 1.3 * noise, 0.0, 1.0)
        for pull in pulls:
            out, depth = pull.beside(x, y)
            chip = np.minimum(_CHIP_SLOPE * np.maximum(size - out, 0.0), 0.5 * np.maximum(depth, 0.0))
            chipped = np.maximum(chipped, np.where(out > 0, chip, 0.0))
        return np.maximum(layers.ground - (self.before_m - chipped), 0.0)

    def _heap(self, layers: Layers, number: int, mass_kg: float) -> None:
        """Drop spoil on the heap, in place, so that on level ground it keeps its shape as it grows."""
        volume = mass_kg / self.spoil_kg_m3
        if volume <= 0:
            return
        grid, area = self.site.grid, self.site.grid.cell_m**2
        before = self.heaped_m3(number - 1)
        more = np.maximum(self.site.heap.thickness(grid, before + volume) - self.site.heap.thickness(grid, before), 0.0)
        layers.spoil += more * (volume / (float(more.sum()) * area))

    def heaped_m3(self, state: int) -> float:
        """Volume of the spoil that was dropped on the heap up to a state."""
        chips = sum(each.chipped_m3 for each in self.states[1:state + 1]) * self.excavation.bulking
        return chips + sum(each.taken_kg for each in self.states[1:state + 1]) * (
            self.excavation.heaped_share / self.spoil_kg_m3)

    def mass_error(self, state: int) -> float:
        """Mass that came or went by rounding up to a state, as a share of what was dug; 0 if nothing was."""
        area, at = self.site.grid.cell_m**2, self.at(state)
        states = self.states[1:state + 1]
        lost = float((self.before_m - at.layers.ground).sum()) * area * self.excavation.density_kg_m3
        found = float(at.layers.spoil.sum()) * area * self.spoil_kg_m3 + sum(each.kept_kg for each in states)
        dug = sum(each.taken_kg for each in states)
        return abs(lost - found) / dug if dug > 0 else abs(lost - found)

    def facts(self, state: int) -> dict[str, object]:
        """What ``pair.json`` has of an excavation in a state: metres, cubic metres and kilograms."""
        at, site = self.at(state), self.site
        done, area = self.states[1:state + 1], self.site.grid.cell_m**2
        change = [each.layers.top - self.before_m for each in self.states[:state + 1]]
        west, south, east, north = site.trench_m
        rows, columns = site.grid.window(west, south, east, north)
        region = [west, south, east, north]
        return {"state": state, "states": int(self.excavation.states),
                "taken_m3": sum(each.taken_m3 for each in done),
                "taken_by_state_m3": [each.taken_m3 for each in self.states[:state + 1]],
                "spoil_m3": float(at.layers.spoil.sum()) * area,
                "mass_taken_kg": sum(each.taken_kg for each in done),
                "mass_in_spoil_kg": float(at.layers.spoil.sum()) * area * self.spoil_kg_m3,
                "mass_kept_kg": sum(each.kept_kg for each in done),
                "mass_error": self.mass_error(state),
                "chipped_m3": sum(each.chipped_m3 for each in done), "slid_m3": sum(each.slid_m3 for each in done),
                "walls": "stand" if at.stood else "slide", "walls_stand_to_m": site.stands_m,
                "region_m": region,
                "change_in_region_by_state_m3": [float(each[rows, columns].sum()) * area for each in change],
                "patch_m": list(site.grid.bounds_m),
                "change_in_patch_by_state_m3": [float(each.sum()) * area for each in change],
                "deepest_m": float(max(-change[-1].min(), 0.0)), "cell_m": site.grid.cell_m}
