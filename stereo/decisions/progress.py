"""How far an excavation has come, by each matcher: volumes between the elevation models of a series of states."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...settings.table import TOPICS
from .change import Change, find_noise, measure_change, region_cells
from .dem import Grid

#: Settings by which the pairs of a series differ besides light and cameras: which state it is.
_STATE = ("excavation", "state")
_SHAPE = ("geometry",)


def series_of(settings: Mapping[str, Mapping[str, Any]]) -> str:
    """A name of the ground of a pair that all states of one excavation share."""
    kept = {f"{topic}.{key}": value for topic, values in settings.items() for key, value in values.items()
            if (topic, key) != _STATE and topic in TOPICS and TOPICS[topic][key].effect in _SHAPE}
    return json.dumps(kept, sort_keys=True)


def find_progress(rows: Sequence[Mapping[str, Any]], facts: Sequence[Mapping[str, Any]], labels: Sequence[str],
                  out: Path) -> list[dict[str, Any]]:
    """For each series of states and each method the ``steps``: ``state``, ``true_m3``, ``found_m3``, ``error_m3``,
    ``depth_m`` and ``known``; and from null pairs ``bias_m3``, ``sigma_m3``, ``smallest_m3`` (noticed at 95 %).

    A series starts with its state of the least number, which all others are compared with. Its null volumes are in the
    row of that state.
    """
    series: dict[str, list[Mapping[str, Any]]] = {}
    for fact in facts:
        if fact.get("excavation"):
            series.setdefault(fact["scene"], []).append(fact)
    found = []
    for states in series.values():
        ordered = sorted(states, key=lambda fact: int(fact["excavation"]["state"]))
        found += [_progress(ordered, label, rows, out) for label in labels]
    return found


def _progress(states: Sequence[Mapping[str, Any]], label: str, rows: Sequence[Mapping[str, Any]],
              out: Path) -> dict[str, Any]:
    own = {row["pair"]: row for row in rows if row["method"] == label and row["status"] == "ok"}
    first, steps = states[0], []
    before = own.get(first["pair"])
    noise = None if before is None else find_noise(before["numbers"].get("null_m3") or ())
    for state in states[1:]:
        row = own.get(state["pair"])
        if before is None or row is None:
            continue
        change = _between(before, row, first, state, out)
        true = _left_region_m3(state) - _left_region_m3(first)
        steps.append({"pair": state["pair"], "state": int(state["excavation"]["state"]), "true_m3": true,
                      "found_m3": change and change.volume_m3, "error_m3": change and change.volume_m3 - true,
                      "depth_m": change and change.depth_m, "known": change and change.known})
    return {"pair": first["pair"], "method": label, "steps": steps, "bias_m3": noise and noise.bias_m3,
            "sigma_m3": noise and noise.sigma_m3, "smallest_m3": noise and noise.smallest_m3,
            "null_pairs": noise.pairs if noise else 0}


def _left_region_m3(state: Mapping[str, Any]) -> float:
    """By how much the volume under the surface of the region has fallen: not what was dug, as spoil slides in."""
    return -float(state["excavation"]["change_in_region_by_state_m3"][-1])


def _between(before: Mapping[str, Any], after: Mapping[str, Any], first: Mapping[str, Any], state: Mapping[str, Any],
             out: Path) -> Change | None:
    if any(first[key] != state[key] for key in ("cell_m", "rows", "columns", "origin_m")):
        return None
    heights = [np.load(out / row["images"]["dem"], allow_pickle=False).astype(np.float64) for row in (before, after)]
    grid = Grid(first["cell_m"], first["rows"], first["columns"], *first["origin_m"])
    return measure_change(heights[0], heights[1], region_cells(grid, state["excavation"]["region_m"]), grid.cell_m)
