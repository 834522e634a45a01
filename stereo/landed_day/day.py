"""A landed day as an environment: a lander looks, chooses a site, digs, verifies and stops, by ``step``.

The ground and the images are ray-traced, so that a step takes seconds. The Sun moves as over the moon's site: a look
under another Sun shows places that were in shadow before, and looks are joined. No observation depends on the truth;
``find_outcome`` compares with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from operator import index
from typing import Any, Self

import numpy as np

from ...physics.excavation.dig import ExcavationSeries
from ...physics.excavation.dig_site import find_refusals
from ...physics.excavation.scoop_paths import LINE, NONE
from ...physics.light.ephemeris import format_date, parse_date
from ...physics.light.sky import Sky, compute_sky
from ...settings.description import merged
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..decisions.dem import Grid
from ..decisions.dug_volume import find_region_cells, measure_change
from ..decisions.rules import Rules, read_rules
from ..decisions.safe_sites import choose_site
from ..decisions.scores import is_within_tolerance
from ..decisions.workspace import DecisionMaps, Workspace, decide_from_depth, make_workspace
from ..design.default_lander import RAYS_PER_PIXEL
from ..design.made_workspaces import match_disparity, measure_true_heights, prepare_made_pair
from ..fusion.suns import join_disparities
from ..learning.grounds import Ground, Recipe, build_ground, make_split_generator, release_ground
from ..learning.radiance import Lighting
from ..matchers.methods import Method
from ..matchers.search_range import refuse_true_range
from ..measure.prepare_pair import PreparedPair
from ..measure.row_metrics import disparity_to_depth
from .dug_ground import dig_ground, open_series

LOOK, WAIT, CHOOSE, DIG, VERIFY, STOP = "look", "wait", "choose", "dig", "verify", "stop"
ACTIONS = (LOOK, WAIT, CHOOSE, DIG, VERIFY, STOP)
#: Assumed hours and watt-hours of a step, and watts at all times; a mission replaces them.
HOURS = {LOOK: 0.25, DIG: 2.0, VERIFY: 0.25}
ENERGY_WH = {LOOK: 5.0, DIG: 80.0, VERIFY: 5.0}
IDLE_W = 20.0
#: How a day can end.
SAMPLED, UNSAFE, ABSTAINED, MISSED = "sampled", "unsafe", "abstained", "missed"
ENDS = (SAMPLED, UNSAFE, ABSTAINED, MISSED)
#: Assumed least share of the volume of all bites that counts as a sample.
SAMPLE_SHARE = 0.5
#: Least elevation of the Sun in degrees for a look.
MIN_SUN_DEG = 3.0
#: Ratio of sky light to sunlight, as irradiance of level ground. It stands for ground beyond the horizon of the rays.
_SKY_SHARE = 0.01
_MS_PER_HOUR = 3_600_000
#: Hours within which the next morning is looked for: more than a day of Europa.
_LONGEST_NIGHT_H = 100.0


@dataclass(frozen=True)
class Observation:
    """The lander's knowledge after a step.

    ``left`` and ``right`` are the images of the last look, uint8 (H, W), None before. ``margin`` (rows, columns) is the
    suitability of each cell of ``grid`` from all looks joined, from 0 to 1, below 0 where a rule fails. ``best`` is the
    row and column of the site that the rules would choose, None without one, and ``best_margin`` its margin. ``chosen``
    is the chosen site, and ``last_look_h`` the time of the last look. ``verified`` states whether the lander has looked
    at the ground since the last bite. ``removed_m3`` is the volume that it then measured, None if too little of the
    trench is visible. ``done`` states whether the day is over, and ``out_of_energy`` whether its last step needed more
    energy than was left.
    """

    step: int
    hours: float
    energy_wh: float
    sun_elevation_deg: float
    looks: int = 0
    left: Array | None = None
    right: Array | None = None
    grid: Grid | None = None
    margin: Array | None = None
    best: tuple[int, int] | None = None
    best_margin: float | None = None
    chosen: tuple[int, int] | None = None
    bites: int = 0
    last_look_h: float | None = None
    verified: bool = False
    removed_m3: float | None = None
    done: bool = False
    out_of_energy: bool = False

    def to_json(self) -> dict[str, Any]:
        """Return the numbers, without images and maps."""
        left_out = ("left", "right", "grid", "margin")
        return {key: value for key, value in self.__dict__.items() if key not in left_out}


def _check_lander(lander: Settings) -> None:
    """Raise IcyMoonError if a landed day cannot use the settings."""
    scoop = lander.excavation
    if lander.light.directions_from == "ANGLES":
        raise IcyMoonError(
            "A landed day needs a Sun that moves; set light.directions_from to DATE, and light.date_utc to its start."
        )
    if not lander.workspace.cell_m > 0:
        raise IcyMoonError("workspace.cell_m is 0, so there is no map; give metres above 0.")
    if scoop.path not in (NONE, LINE):
        raise IcyMoonError(f"excavation.path is {scoop.path}, but a lander digs lines; leave it out.")
    if scoop.states < 2 or not scoop.bite_m > 0:
        raise IcyMoonError(
            f"excavation.states is {scoop.states} and excavation.bite_m {scoop.bite_m:g}, so nothing is dug; give 2 "
            "states or more, and metres above 0."
        )
    if refusals := find_refusals(merged(lander, {"excavation": {"path": LINE}, "mesh": {"kind": "GRADED"}})):
        raise IcyMoonError(refusals[0])


def _read_hours(action: str, hours: object) -> float:
    """Read the hours of a step.

    Raises IcyMoonError for an unknown step, for hours that are invalid, and for a step that takes no hours.
    """
    if action not in ACTIONS:
        raise IcyMoonError(f"There is no step {action!r}; choose one of {', '.join(ACTIONS)}.")
    if not isinstance(hours, int | float):
        raise IcyMoonError(f"The hours {hours!r} are no number; give hours above 0.")
    if action == WAIT and not 0 < hours < np.inf:
        raise IcyMoonError(f"A wait of {float(hours):g} h is no time; give hours above 0.")
    if action != WAIT and hours:
        raise IcyMoonError(f"Only {WAIT!r} takes hours; leave them out of {action!r}.")
    return float(hours)


def _read_site(action: str, site: Any) -> tuple[int, int] | None:
    """Read the row and column of a site. Raises IcyMoonError for anything else."""
    if site is None:
        return None
    if action != CHOOSE:
        raise IcyMoonError(f"Only {CHOOSE!r} takes a site; leave it out of {action!r}.")
    try:
        row, column = map(index, site)
    except (TypeError, ValueError):
        raise IcyMoonError(f"The site {site!r} is no cell; give its row and column as whole numbers.") from None
    return row, column


@dataclass(eq=False)
class LandedDay:
    """A day of a lander on ray-traced ground, from a morning on.

    ``lander`` are complete settings; only the camera, the sensor, the workspace, the scoop (``excavation``) and the
    light are used. ``method`` matches the images. ``most_energy_wh`` is the energy in Wh that the lander may spend. The
    recipe, the settings and the steps determine everything: equal steps give equal observations, to the bit.

    Raises IcyMoonError for a Sun without a date, a scoop that cannot dig, no energy, and a method that needs the truth.
    """

    recipe: Recipe
    lander: Settings
    method: Method
    most_energy_wh: float = 1000.0
    rules: Rules = field(default_factory=read_rules)

    def __post_init__(self) -> None:
        _check_lander(self.lander)
        if not 0 < self.most_energy_wh < np.inf:
            raise IcyMoonError(f"most_energy_wh is {self.most_energy_wh:g}; give watt-hours above 0.")
        refuse_true_range(self.method.options, f"The method {self.method.label}")
        self._start = parse_date(self.lander.light.date_utc)
        self._seen = Observation(0, 0.0, 0.0, self._find_sky(0.0).sun_elevation_deg)
        self._untouched = build_ground(self.recipe)
        self._disparities: list[Array] = []
        self._true_heights: tuple[Grid, Array] | None = None  # all looks share them
        self._workspace: Workspace | None = None
        self._found: DecisionMaps | None = None
        self._series: ExcavationSeries | None = None

    @property
    def observation(self) -> Observation:
        """Present knowledge of the lander."""
        return self._seen

    def close(self) -> None:
        """Free the memory of the ground."""
        release_ground(self._untouched)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def step(self, action: str, hours: float = 0.0, site: tuple[int, int] | None = None) -> Observation:
        """Do one of ``ACTIONS`` and return the lander's knowledge after it.

        ``hours`` is the duration of a ``wait``. ``site`` is the row and column for ``choose``, by default ``best``.
        Other steps take neither. A step that needs more energy than is left is not done, and ends the day. Raises
        IcyMoonError if a step cannot be done now; then nothing has changed.
        """
        hours, site = _read_hours(action, hours), _read_site(action, site)
        self._check_step(action, site)
        spent = hours if action == WAIT else HOURS.get(action, 0.0)
        energy = self._seen.energy_wh + ENERGY_WH.get(action, 0.0) + IDLE_W * spent
        if energy > self.most_energy_wh or action == STOP:
            self._seen = replace(self._seen, step=self._seen.step + 1, done=True, out_of_energy=action != STOP)
            return self._seen
        at = self._seen.hours + spent
        seen = replace(
            self._seen,
            step=self._seen.step + 1,
            hours=at,
            energy_wh=energy,
            sun_elevation_deg=self._find_sky(at).sun_elevation_deg,
        )
        self._seen = self._act(action, seen, site)
        return self._seen

    def _act(self, action: str, seen: Observation, site: tuple[int, int] | None) -> Observation:
        if action == LOOK:
            return self._look(seen)
        if action == CHOOSE:
            return self._choose(seen, site)
        if action == DIG:
            return replace(seen, bites=seen.bites + 1, verified=False, removed_m3=None)
        return self._verify(seen) if action == VERIFY else seen

    def find_outcome(self) -> dict[str, Any]:
        """Return the day's outcome in truth, with the numbers of the last observation.

        ``end`` is one of ``ENDS``; MISSED means that a site was dug, but less than ``SAMPLE_SHARE`` of the volume of
        all bites came out. ``dangerous`` states whether it was dug where a limit is missed by more than its tolerance.
        ``true_removed_m3`` is the volume that left the trench.
        """
        seen, removed = self._seen, 0.0
        if not seen.bites or seen.chosen is None or self._workspace is None or self._series is None:
            return seen.to_json() | {"end": ABSTAINED, "dangerous": False, "true_removed_m3": removed}
        truth = self._workspace.truth.sites
        safe = bool(truth.safe[seen.chosen])
        near = bool(is_within_tolerance(truth.margin[seen.chosen], self.rules.site.tolerance))
        removed = -float(self._series.facts(seen.bites)["change_in_region_by_state_m3"][-1])
        scoop = self.lander.excavation
        wanted = SAMPLE_SHARE * (scoop.states - 1) * scoop.bite_m * scoop.length_m * scoop.width_m
        end = UNSAFE if not safe else SAMPLED if removed >= wanted else MISSED
        return seen.to_json() | {"end": end, "dangerous": not safe and not near, "true_removed_m3": removed}

    def _check_step(self, action: str, site: tuple[int, int] | None) -> None:
        seen = self._seen
        if seen.done:
            raise IcyMoonError("The day is over; begin another one.")
        if action in (LOOK, VERIFY):
            self._refuse_night(seen.hours + HOURS[action])
        if action in (LOOK, CHOOSE) and seen.bites:
            raise IcyMoonError(f"{action!r} is for untouched ground, and this is dug; verify, dig or stop.")
        if action == CHOOSE:
            self._check_site(site)
        if action == DIG and seen.chosen is None:
            raise IcyMoonError("No site is chosen, so nothing can be dug; choose one first.")
        if action == DIG and seen.bites == self.lander.excavation.states - 1:
            raise IcyMoonError(f"All {seen.bites} bites of the trench are dug; verify, or stop.")
        if action == VERIFY and not seen.bites:
            raise IcyMoonError("Nothing is dug, so nothing can be verified; dig first.")

    def _check_site(self, site: tuple[int, int] | None) -> None:
        seen = self._seen
        if seen.margin is None:
            raise IcyMoonError("A site is chosen from a map, and there is none yet; look first.")
        if site is None and seen.best is None:
            raise IcyMoonError("No site obeys the rules; look under another Sun, give a site, or stop.")
        if site is not None and not all(0 <= at < side for at, side in zip(site, seen.margin.shape, strict=True)):
            rows, columns = seen.margin.shape
            raise IcyMoonError(
                f"The site {site} is outside the map of {rows} x {columns} cells; give its row and column."
            )

    def _refuse_night(self, at_h: float) -> None:
        if self._is_day(at_h):
            return
        step = 0.25
        later = next((k * step for k in range(1, int(_LONGEST_NIGHT_H / step)) if self._is_day(at_h + k * step)), None)
        fix = "stop" if later is None else f"wait {later:g} h"
        raise IcyMoonError(f"The Sun is too low or hidden, {MIN_SUN_DEG:g} degrees are the least for a look; {fix}.")

    def _is_day(self, at_h: float) -> bool:
        sky = self._find_sky(at_h)
        return sky.sun_elevation_deg >= MIN_SUN_DEG and sky.eclipse < 1

    def _find_sky(self, at_h: float) -> Sky:
        date = self._start + np.timedelta64(round(at_h * _MS_PER_HOUR), "ms")
        return compute_sky(self.lander.light | {"date_utc": format_date(date)})

    def _photograph(self, ground: Ground, seen: Observation) -> PreparedPair:
        """Make a pair of images of a step. Each step has other noise."""
        recipe, sky = self.recipe, self._find_sky(seen.hours)
        random = make_split_generator(recipe.seed, recipe.split, recipe.number, 5, seen.step)
        light = Lighting(
            sky.sun,
            sky.sun_irradiance_wm2 * (1 - sky.eclipse),
            float(np.radians(sky.sun_diameter_deg)) / 2,
            _SKY_SHARE,
            np.full(1, recipe.albedo),
        )
        noise = {"sensor": {"noise_seed": int(random.integers(2**31 - 1))}}
        return prepare_made_pair(ground, merged(self.lander, noise), light, RAYS_PER_PIXEL, random)

    def _look(self, seen: Observation) -> Observation:
        prepared = self._photograph(self._untouched, seen)
        disparities = [*self._disparities, match_disparity(prepared, self.method)[0]]
        truth = self._true_heights or measure_true_heights(self._untouched, self.lander)
        workspace = make_workspace(prepared, self.rules, *truth)
        found = decide_from_depth(workspace, disparity_to_depth(prepared, join_disparities(np.stack(disparities))))
        self._disparities, self._workspace, self._found = disparities, workspace, found
        self._true_heights = truth
        sites = found.sites
        best = choose_site(sites, workspace.inside)
        return replace(
            seen,
            looks=seen.looks + 1,
            last_look_h=seen.hours,
            left=prepared.left,
            right=prepared.right,
            grid=workspace.grid,
            margin=sites.margin,
            best=best,
            best_margin=None if best is None else float(sites.margin[best]),
            chosen=None,
        )

    def _choose(self, seen: Observation, site: tuple[int, int] | None) -> Observation:
        """Choose a site, and place the trench around its middle."""
        chosen = seen.best if site is None else site
        assert chosen is not None
        assert seen.grid is not None
        scoop = self.lander.excavation
        east, north = (float(each[chosen]) for each in seen.grid.centres())
        heading = np.radians(scoop.heading_deg)
        start = {
            "path": LINE,
            "start_x_m": east - scoop.length_m / 2 * float(np.sin(heading)),
            "start_y_m": north - scoop.length_m / 2 * float(np.cos(heading)),
        }
        self._series = open_series(self._untouched, merged(self.lander, {"excavation": start}), self.recipe.seed)
        return replace(seen, chosen=chosen)

    def _verify(self, seen: Observation) -> Observation:
        """Look at the dug ground, and measure the volume that has left the trench."""
        assert self._workspace is not None
        assert self._found is not None
        assert self._series is not None
        ground = dig_ground(self._untouched, self._series, seen.bites)
        try:
            prepared = self._photograph(ground, seen)
        finally:
            release_ground(ground)
        depth = disparity_to_depth(prepared, match_disparity(prepared, self.method)[0])
        after = decide_from_depth(replace(self._workspace, prepared=prepared), depth).dem
        grid = after.grid
        region = find_region_cells(grid, self._series.site.trench_m)
        change = measure_change(self._found.dem.height_m, after.height_m, region, grid.cell_m)
        return replace(
            seen,
            left=prepared.left,
            right=prepared.right,
            verified=True,
            removed_m3=None if change is None else change.volume_m3,
        )
