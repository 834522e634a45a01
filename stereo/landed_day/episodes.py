"""Runs landed days one after the other by a policy. A second start runs only the missing days."""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.light.ephemeris import format_date, parse_date
from ...physics.light.sky import compute_sky
from ...settings.description import merged
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import TABLE, TEXT, Maybe, Shape
from ...support.files import make_json_digest, write_json
from ...support.version import version
from ..decisions.guarantee import bound_share
from ..decisions.rules import Rules
from ..design.default_lander import LANDER
from ..design.made_workspaces import name_pair
from ..fusion.fuse import list_lidar_inputs
from ..fusion.match_prepared import list_method_inputs
from ..inference.risk_control import bound_risk
from ..learning.grounds import Recipe, make_split_generator
from ..matchers.methods import Method, parse_methods
from ..report.row_log import Row, RowLog
from .day import CHOOSE, DIG, ENDS, LOOK, SAMPLE_SHARE, STOP, UNSAFE, VERIFY, WAIT, LandedDay, Observation

#: Version of the days. It increases when equal input gives other days.
DAYS_VERSION = 1
_LOG_FILE, _SUMMARY_FILE = "days.jsonl", "days.json"
#: The files of a run, and the first bytes of each.
FIRST_BYTES = {_LOG_FILE: b'{"pair": ', _SUMMARY_FILE: b'{\n "days": '}
_ROW_SHAPE: dict[str, Shape] = {"status": TEXT, "error": TEXT, "day": Maybe(TABLE, null=True)}
#: Elevation of the Sun in degrees at which a day begins, in the morning, and the least for a look by the policy.
_MORNING_DEG, _LOOK_DEG = 16.0, 12.0
#: Hours between two times at which the Sun's elevation is computed, and the most hours until a morning.
_STEP_H, _MAX_H = 0.5, 200.0
_DAYS_OF_YEAR = 365
#: Most steps of a day. A policy that takes more counts as endless.
MAX_STEPS = 200
#: 1 - confidence of intervals.
_DOUBT = 0.05
#: The topics of a lander's settings.
LANDER_TOPICS = ("rig", "sensor", "workspace", "excavation", "light")
#: The lander of the ray-traced studies, with a scoop, at a place on Enceladus where the Sun rises above 43 degrees.
DAY_LANDER = merged(
    LANDER,
    {
        "light": {
            "directions_from": "DATE",
            "body": "ENCELADUS",
            "date_utc": "2045-01-01T00:00:00",
            "latitude_deg": -20.0,
            "longitude_deg": 30.0,
        },
        "excavation": {"length_m": 0.2, "bite_m": 0.02, "states": 4},
    },
)


@dataclass(frozen=True)
class Step:
    """Arguments of ``LandedDay.step``."""

    action: str
    hours: float = 0.0
    site: tuple[int, int] | None = None


Policy = Callable[[Observation], Step]


@dataclass(frozen=True)
class LookChooseDig:
    """The shipped policy: look, choose a site, dig.

    It looks at least ``looks`` times, ``wait_h`` hours apart, and up to ``most_looks`` times while no site has the
    ``least_margin``; then it abstains. It digs and verifies by turns until the measured volume is a sample.
    """

    scoop_m3: float  # the volume of all bites
    bites: int
    looks: int = 2
    most_looks: int = 4
    wait_h: float = 3.0
    least_margin: float = 0.0

    def __call__(self, seen: Observation) -> Step:
        """Return the next step."""
        return self._decide_on_site(seen) if seen.chosen is None else self._decide_on_trench(seen)

    def _decide_on_site(self, seen: Observation) -> Step:
        good = seen.best_margin is not None and seen.best_margin >= self.least_margin
        if seen.looks >= self.looks and good:
            return Step(CHOOSE)
        if seen.looks >= self.most_looks:
            return Step(STOP)
        if seen.last_look_h is not None and seen.hours < seen.last_look_h + self.wait_h:
            return Step(WAIT, seen.last_look_h + self.wait_h - seen.hours)
        return Step(LOOK) if seen.sun_elevation_deg >= _LOOK_DEG else Step(WAIT, 1.0)

    def _decide_on_trench(self, seen: Observation) -> Step:
        if not seen.bites:
            return Step(DIG)
        if not seen.verified:
            return Step(VERIFY) if seen.sun_elevation_deg >= _LOOK_DEG else Step(WAIT, 1.0)
        enough = seen.removed_m3 is not None and seen.removed_m3 >= SAMPLE_SHARE * self.scoop_m3
        return Step(STOP) if enough or seen.bites == self.bites else Step(DIG)


def read_method(text: str) -> Method:
    """Parse the matcher of a lander. Raises IcyMoonError for several matchers, and as ``parse_methods``."""
    methods = parse_methods(text)
    if len(methods) > 1:
        raise IcyMoonError(f"The method is {text!r}, but a lander has one matcher; give one.")
    return methods[0]


def make_policy(lander: Settings, looks: int = 2, least_margin: float = 0.0) -> LookChooseDig:
    """Make the shipped policy for the scoop of a lander."""
    scoop, bites = lander.excavation, int(lander.excavation.states) - 1
    volume = bites * scoop.bite_m * scoop.length_m * scoop.width_m
    return LookChooseDig(volume, bites, looks, max(looks, LookChooseDig.most_looks), least_margin=least_margin)


def change_lander(changes: Settings) -> Settings:
    """Return the shipped lander with changes. Raises IcyMoonError for a topic that does not act on the lander."""
    if other := sorted(set(changes) - set(LANDER_TOPICS)):
        raise IcyMoonError(
            f"The lander has settings of {other[0]}, which do not act on it; give {', '.join(LANDER_TOPICS)} only, and "
            "terrain and rocks with the ground."
        )
    return merged(DAY_LANDER, changes)


def draw_start(lander: Settings, recipe: Recipe) -> Settings:
    """Return the lander's settings on a random morning for each ground, within a year from their date on.

    Raises IcyMoonError if the Sun does not rise to 16 degrees there.
    """
    random = make_split_generator(recipe.seed, recipe.split, recipe.number, 6)
    first = parse_date(lander.light.date_utc) + np.timedelta64(int(random.integers(_DAYS_OF_YEAR * 24)), "h")
    before = np.inf
    for k in range(round(_MAX_H / _STEP_H)):
        date = format_date(first + np.timedelta64(round(k * _STEP_H * 60), "m"))
        elevation = compute_sky(lander.light | {"date_utc": date}).sun_elevation_deg
        if before < _MORNING_DEG <= elevation:
            return merged(lander, {"light": {"date_utc": date}})
        before = elevation
    raise IcyMoonError(
        f"The Sun does not rise to {_MORNING_DEG:g} degrees over light.latitude_deg {lander.light.latitude_deg:g} in "
        f"the {_MAX_H:g} h after {format_date(first)}; choose a latitude nearer to the equator."
    )


def live_day(day: LandedDay, policy: Policy) -> dict[str, Any]:
    """Live a day by a policy and return its outcome, with its ``steps``. Raises IcyMoonError if the policy does not
    stop.
    """
    steps: list[dict[str, Any]] = []
    while not day.observation.done:
        if len(steps) == MAX_STEPS:
            raise IcyMoonError(f"The policy did not stop within {MAX_STEPS} steps; let it return a step {STOP!r}.")
        step = policy(day.observation)
        day.step(step.action, step.hours, step.site)
        steps.append({key: value for key, value in asdict(step).items() if value})
    return day.find_outcome() | {"steps": steps}


def run_days(
    recipes: Sequence[Recipe],
    lander: Settings,
    method: Method,
    rules: Rules,
    policy: Policy,
    out: Path,
    most_energy_wh: float,
    on_day: Callable[[Row], None] = lambda row: None,
) -> dict[str, Any]:
    """Live a day on each ground and return the summary. Each day adds a row to ``days.jsonl``.

    A row depends on its ground, the settings, the method and the policy (its values if it is a dataclass, its name and
    its code). A day that fails has a row with the reason. Raises IcyMoonError if the disk refuses.
    """
    log = RowLog(out / _LOG_FILE, _ROW_SHAPE)
    inputs = [
        DAYS_VERSION,
        version(),
        lander,
        rules.to_json(),
        list_method_inputs(method),
        _describe_policy(policy),
        most_energy_wh,
    ]
    rows = []
    for recipe in recipes:
        name = name_pair(recipe)
        key = make_json_digest([*inputs, *list_lidar_inputs(method, name)])
        row = log.find(name, method.label, key)
        if row is None:
            row = _live_logged_day(recipe, lander, method, rules, policy, most_energy_wh)
            row = {"pair": name, "method": method.label, "key": key, **row}
            log.append(row)
        rows.append(row)
        on_day(row)
    summary = summarise_days(rows)
    write_json(out / _SUMMARY_FILE, summary)
    return summary


def _describe_policy(policy: Policy) -> list[str]:
    """Describe the identity of a policy equally in every process.

    The ``repr`` of a function would contain an address.
    """
    named = policy if inspect.isroutine(policy) else type(policy)
    values = repr(policy) if is_dataclass(policy) else ""
    try:
        code = inspect.getsource(named)
    except (OSError, TypeError):
        code = ""
    return [f"{named.__module__}.{named.__qualname__}", values, code]


def _live_logged_day(
    recipe: Recipe, lander: Settings, method: Method, rules: Rules, policy: Policy, most_energy_wh: float
) -> Row:
    try:
        start = draw_start(lander, recipe)
        day = LandedDay(recipe, start, method, most_energy_wh, rules)
        try:
            found = live_day(day, policy)
        finally:
            day.close()
    except IcyMoonError as error:
        return {"status": "failed", "error": str(error), "day": None}
    return {"status": "ok", "error": "", "day": {"date_utc": start.light.date_utc, "terrain": recipe.terrain, **found}}


def summarise_days(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Count days by their end, with 95 % intervals of their shares over grounds, and average their numbers.

    ``unsafe_bound`` is the largest share of unsafe days that agrees with their number (one-sided). There are also the
    means of hours, energy and looks, and the mean error of the last verified volume.
    """
    days = [row["day"] for row in rows if row["day"]]
    ends = Counter(day["end"] for day in days)
    off = [day["removed_m3"] - day["true_removed_m3"] for day in days if day["removed_m3"] is not None]
    return {
        "days": len(days),
        "failed": len(rows) - len(days),
        "ends": {end: {"days": ends[end], "share": bound_share(ends[end], len(days), _DOUBT)} for end in ENDS if days},
        "unsafe_bound": bound_risk(ends[UNSAFE], len(days), _DOUBT) if days else None,
        "dangerous": sum(day["dangerous"] for day in days),
        **{
            key: float(np.mean([day[key] for day in days])) if days else None for key in ("hours", "energy_wh", "looks")
        },
        "verified": len(off),
        "volume_bias_m3": float(np.mean(off)) if off else None,
        "volume_rms_m3": float(np.sqrt(np.mean(np.square(off)))) if off else None,
    }
