"""Progress of an excavation by each matcher: volumes between the elevation models of a series of states.

False changes of a matcher are measured on null pairs. These are pairs of the same site in which nothing had been dug,
each with independent noise, and with the jitter of the camera and the Sun of its state.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...settings.table import TOPICS
from ...support.arrays import Array
from ...support.number_text import format_count
from ..images.image_files import write_png
from ..matchers.methods import describe_method
from .dem import Grid, read_cells
from .dug_volume import (
    FEWEST_NULL_PAIRS,
    Change,
    VolumeNoise,
    detect_change,
    find_region_cells,
    find_volume_noise,
    measure_change,
)
from .pictures import draw_changes

#: The setting that numbers the states of a series, whose pairs otherwise differ only in light and cameras.
_STATE_SETTING = ("excavation", "state")
_EXCAVATION_TOPIC = "excavation"
_GEOMETRY_EFFECTS = ("geometry",)
#: Facts that are equal for elevation models with the same cells.
_GRID_KEYS = ("cell_m", "rows", "columns", "origin_m")
#: Largest change of the true volume, m3, that counts as no change.
_UNCHANGED_M3 = 1e-9
_Entry = Mapping[str, Any]


def name_series(settings: Mapping[str, Mapping[str, Any]]) -> str:
    """Name a pair's ground; all states of one excavation share this name."""
    return _name_ground(settings, lambda topic, key: (topic, key) != _STATE_SETTING)


def name_site(settings: Mapping[str, Mapping[str, Any]]) -> str:
    """Name a pair's untouched ground; all series on the same site share this name."""
    return _name_ground(settings, lambda topic, key: topic != _EXCAVATION_TOPIC)


def _name_ground(settings: Mapping[str, Mapping[str, Any]], counts: Callable[[str, str], bool]) -> str:
    kept = {
        f"{topic}.{key}": value
        for topic, values in settings.items()
        for key, value in values.items()
        if topic in TOPICS and TOPICS[topic][key].effect in _GEOMETRY_EFFECTS and counts(topic, key)
    }
    return json.dumps(kept, sort_keys=True)


def find_progress(
    rows: Sequence[_Entry], facts: Sequence[_Entry], labels: Sequence[str], out: Path, disc_m: float
) -> list[dict[str, Any]]:
    """Find the ``steps`` of each series of states by each method, and the errors of a volume by null pairs.

    A step has ``state``, ``true_m3``, ``found_m3``, ``error_m3``, ``depth_m`` and ``known``. It also has ``level_m``,
    ``noticed`` and ``false_alarm`` of its cells (see ``dug_volume.Detection``), with the errors of a disc of
    ``disc_m``, and the path ``map`` of a picture of the cells, which is written here. Null pairs give ``bias_m3``,
    ``sigma_m3``, ``smallest_m3`` (detected at 95 %) and its ``bounds_m3``, or None. ``notes`` are sentences on missing
    numbers and their reasons.

    A series starts with the state of the smallest number. All states with a dug volume are compared with it.
    """
    dug = [fact for fact in facts if fact.get("excavation")]
    series: dict[str, list[_Entry]] = {}
    for fact in dug:
        series.setdefault(fact["scene"], []).append(fact)
    found = []
    for states in series.values():
        ordered = sorted(states, key=lambda fact: int(fact["excavation"]["state"]))
        if any(_is_dug(state) for state in ordered):
            found += [_find_series_progress(ordered, label, rows, dug, out, disc_m) for label in labels]
    return found


def _find_series_progress(
    states: Sequence[_Entry], label: str, rows: Sequence[_Entry], dug: Sequence[_Entry], out: Path, disc_m: float
) -> dict[str, Any]:
    own = {row["pair"]: row for row in rows if row["method"] == label and row["status"] == "ok"}
    first, name, steps, notes = states[0], describe_method(label), [], []
    for state in filter(_is_dug, states[1:]):
        step = _measure_step(first, state, own, out, disc_m)
        steps.append(step)
        notes += [f"By {name} there is no volume of state {step['state']}: {step['missing']}."] * bool(step["missing"])
    noise, why = _find_null_noise(states, dug, own, out)
    notes += [f"By {name} the smallest volume noticed cannot be given: {why}."] * bool(why)
    return {
        "pair": first["pair"],
        "method": label,
        "steps": steps,
        "notes": notes,
        "bias_m3": noise and noise.bias_m3,
        "sigma_m3": noise and noise.sigma_m3,
        "smallest_m3": noise and noise.smallest_m3,
        "bounds_m3": noise and list(noise.bounds_m3),
        "null_pairs": noise.pairs if noise else 0,
    }


def _measure_step(first: _Entry, state: _Entry, own: Mapping[str, _Entry], out: Path, disc_m: float) -> dict[str, Any]:
    """Measure a method's result for a state; ``missing`` is the reason for a missing volume, or empty."""
    true = _measure_removed_from_region_m3(state) - _measure_removed_from_region_m3(first)
    step: dict[str, Any] = {
        "pair": state["pair"],
        "state": int(state["excavation"]["state"]),
        "true_m3": true,
        **dict.fromkeys(("found_m3", "error_m3", "depth_m", "known", "level_m", "noticed", "false_alarm", "map")),
        "missing": "",
    }
    lost = [fact["pair"] for fact in (first, state) if fact["pair"] not in own]
    if lost:
        return step | {"missing": f"pair {lost[0]} failed or contradicts itself"}
    if not _have_same_cells(first, state):
        return step | {"missing": "its cells are not those of the first state; render both with one workspace"}
    change, known = _measure_between(own, first, state, state["excavation"]["region_m"], out)
    if change is None:
        step["missing"] = f"only {100 * known:.0f} % of the cells of the region that is dug are known in both states"
    else:
        step |= {
            "found_m3": change.volume_m3,
            "error_m3": change.volume_m3 - true,
            "depth_m": change.depth_m,
            "known": change.known,
        }
    return step | _detect_step_change(own, first, state, out, disc_m)


def _detect_step_change(
    own: Mapping[str, _Entry], first: _Entry, state: _Entry, out: Path, disc_m: float
) -> dict[str, Any]:
    true_before, true_after = (_read_map(out, fact, fact["images"]["truth_dem"]) for fact in (first, state))
    before, after = (_read_map(out, fact, own[fact["pair"]]["images"]["dem"]) for fact in (first, state))
    found = detect_change(before, after, true_before, true_after, first["cell_m"], disc_m)
    drawn = Path(own[state["pair"]]["images"]["dem"].replace("_dem.npy", "_change.png"))
    write_png(out / drawn, draw_changes(found))
    return {**found.score(true_before - true_after), "map": drawn.as_posix()}


def _find_null_noise(
    states: Sequence[_Entry], dug: Sequence[_Entry], own: Mapping[str, _Entry], out: Path
) -> tuple[VolumeNoise | None, str]:
    """Find the noise of a volume over the dug region from null pairs; or return None, and the reason in words.

    Null pairs are the pairs of this site in which nothing was dug. Only pairs with the same cells can be compared, so
    the largest such group is used.
    """
    groups: list[list[_Entry]] = []
    for fact in dug:
        if fact["site"] == states[0]["site"] and not _is_dug(fact) and fact["pair"] in own:
            same = next((group for group in groups if _have_same_cells(group[0], fact)), None)
            if same is None:
                groups.append([fact])
            # With the same seed the noise would be the same.
            elif all(fact["render_seed"] != other["render_seed"] for other in same):
                same.append(fact)
    group = max(groups, key=len, default=[])
    region = states[-1]["excavation"]["region_m"]
    volumes = [
        change.volume_m3
        for fact in group[1:]
        if (change := _measure_between(own, group[0], fact, region, out)[0]) is not None
    ]
    if len(volumes) >= FEWEST_NULL_PAIRS:
        return find_volume_noise(volumes), ""
    there = f"{format_count(len(group), 'pair')} of this site show{'s' * (len(group) == 1)}"
    return None, (
        f"{there} it with nothing dug and independent render noise, and {len(volumes)} of them can be compared with "
        f"the first, but {FEWEST_NULL_PAIRS} are needed; render state 0 again with another Sun or camera, as "
        "datasets/excavation_nulls does, and decide on both data sets together"
    )


def _is_dug(fact: _Entry) -> bool:
    return abs(_measure_removed_from_region_m3(fact)) > _UNCHANGED_M3


def _have_same_cells(one: _Entry, other: _Entry) -> bool:
    return all(one[key] == other[key] for key in _GRID_KEYS)


def _measure_removed_from_region_m3(state: _Entry) -> float:
    """Return the decrease of the volume under the surface of the region, m3.

    It differs from the dug volume, because spoil slides in.
    """
    return -float(state["excavation"]["change_in_region_by_state_m3"][-1])


def _measure_between(
    own: Mapping[str, _Entry], first: _Entry, state: _Entry, region_m: Sequence[float], out: Path
) -> tuple[Change | None, float]:
    """Return the change from one pair to another, None if too little is known, and the known share of the region."""
    heights = [_read_map(out, fact, own[fact["pair"]]["images"]["dem"]) for fact in (first, state)]
    grid = Grid(first["cell_m"], first["rows"], first["columns"], *first["origin_m"])
    region = find_region_cells(grid, region_m)
    known = np.isfinite(heights[0] - heights[1])[region]
    return measure_change(heights[0], heights[1], region, grid.cell_m), float(known.mean()) if known.size else 0.0


def _read_map(out: Path, fact: _Entry, file: str) -> Array:
    return read_cells(out / file, (fact["rows"], fact["columns"]), "delete it and decide again")
