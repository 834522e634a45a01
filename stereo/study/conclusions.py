"""The conclusions of a study from its views: typical changes of errors and of gaps, the order of methods and of noise.

A scene is a ground; its views are averaged first. A comparison is one family: the intervals for the changes of all
errors and of all gaps between methods hold simultaneously. A change against the converged render is claimed only if the
noise of that render, measured by its two halves, is below a tenth of the change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from ...support.arrays import Array
from ..inference.kendall_tau import compute_kendall_tau_b
from ..inference.scene_means import find_mean_intervals
from ..inference.typical_scene import ComparisonFamily, compare_in_typical_scene
from .design import CONVERGED, Hypothesis, Study
from .view_measurements import LIGHTS, Cell

#: Largest noise of the converged render, as a share of a change, for a claim on the change.
_MAX_NOISE_SHARE = 0.1
_SEED = 0
#: The verdicts on a hypothesis.
HOLDS, FAILS, OPEN = "holds", "fails", "open"

Number = Callable[[Cell, str], float]


def draw_conclusions(study: Study, cells: Sequence[Cell], methods: Sequence[str]) -> dict[str, Any]:
    """Draw all conclusions as JSON: errors in points of 100; ``null`` if there are too few scenes.

    ``cells`` include views whose converged render has more noise than the study allows; these do not count.
    """
    counted = [cell for cell in cells if cell.reference_noise <= study.reference_noise]
    numbers = _list_numbers(methods)
    by_light = {f"{method}, {light}": _compute_error(method, light) for method in methods for light in LIGHTS}
    noise = {name: _measure_reference_noise(study, counted, number) for name, number in (numbers | by_light).items()}
    comparisons = [
        {
            "of": of,
            "with": against,
            "changes": _find_changes(counted, of, against, numbers, noise),
            "by_light": _find_changes(counted, of, against, by_light, noise),
            "order": _compare_orders(counted, of, against, methods),
        }
        for of, against in study.comparisons
    ]
    return {
        "methods": list(methods),
        "cells": [
            _describe_view(cell, methods) | {"counts": cell.reference_noise <= study.reference_noise} for cell in cells
        ],
        "comparisons": comparisons,
        "hypotheses": [_judge_hypothesis(each, comparisons) for each in study.hypotheses],
        "noise_order": _compare_noise_orders(counted),
    }


def _compute_error(method: str, light: str | None = None) -> Number:
    return lambda cell, recipe: 100 * cell.error(recipe, method, light)


def _compute_gap(one: str, other: str) -> Number:
    return lambda cell, recipe: 100 * (cell.error(recipe, other) - cell.error(recipe, one))


def _list_numbers(methods: Sequence[str]) -> dict[str, Number]:
    """List the error of each method, and each gap ``b - a`` between two methods, by name."""
    gaps = {f"{other} - {one}": _compute_gap(one, other) for one, other in combinations(methods, 2)}
    return {method: _compute_error(method) for method in methods} | gaps


def _compute_difference(number: Number, of: str, against: str) -> Callable[[Cell], float]:
    return lambda cell: number(cell, of) - number(cell, against)


def _average_by_ground(cells: Sequence[Cell], number: Callable[[Cell], float]) -> Array:
    """Average a number over the views of each ground where it is known; NaN for grounds without such a view."""
    grounds: dict[str, list[float]] = {}
    for cell in cells:
        known = grounds.setdefault(cell.view.ground, [])
        if math.isfinite(value := number(cell)):
            known.append(value)
    return np.array([np.mean(values) if values else np.nan for values in grounds.values()])


def _measure_reference_noise(study: Study, cells: Sequence[Cell], number: Number) -> float:
    """Measure the change that noise makes to a number of the converged render, in the typical scene.

    The bias from noise falls as the noise's variance, so the mean of two halves has half the bias of each half: its
    bias equals its improvement over the halves. The scatter from noise is half of the difference of the halves, over
    the root of the number of grounds.
    """
    one, other = study.reference
    added = _average_by_ground(
        cells, lambda cell: (number(cell, one) + number(cell, other)) / 2 - number(cell, CONVERGED)
    )
    apart = _average_by_ground(cells, lambda cell: (number(cell, one) - number(cell, other)) / 2)
    known = np.isfinite(added)
    if not known.any():
        return math.nan
    typical = compare_in_typical_scene(added[:, None], _SEED).typical[0]
    return float(max(abs(typical), np.sqrt(np.mean(apart[known] ** 2) / known.sum())))


def _find_changes(
    cells: Sequence[Cell],
    of: str,
    against: str,
    numbers: dict[str, Number],
    noise: dict[str, float],
) -> dict[str, dict[str, Any]]:
    """Find the typical change of each number from one recipe to another. Their intervals hold simultaneously."""
    columns = [_average_by_ground(cells, _compute_difference(number, of, against)) for number in numbers.values()]
    family = compare_in_typical_scene(np.stack(columns, axis=1), _SEED)
    return {
        name: _describe_change(family, k, noise[name] if CONVERGED in (of, against) else 0.0, columns[k])
        for k, name in enumerate(numbers)
    }


def _describe_change(family: ComparisonFamily, k: int, noise: float, values: Array) -> dict[str, Any]:
    typical, quiet = float(family.typical[k]), abs(noise) <= _MAX_NOISE_SHARE * abs(float(family.typical[k]))
    return {
        "grounds": int(family.scenes[k]),
        "typical": _round_or_none(typical),
        "low": _round_or_none(family.low[k]),
        "high": _round_or_none(family.high[k]),
        "least": _round_or_none(np.nanmin(values)) if np.isfinite(values).any() else None,
        "most": _round_or_none(np.nanmax(values)) if np.isfinite(values).any() else None,
        "noise": _round_or_none(noise),
        "found": bool(family.found[k]),
        "claimed": bool(family.found[k]) and quiet,
    }


def _round_or_none(value: float) -> float | None:
    return round(float(value), 3) if math.isfinite(value) else None


def _compare_orders(cells: Sequence[Cell], of: str, against: str, methods: Sequence[str]) -> dict[str, Any]:
    """Compute Kendall's tau between the methods' orders by two recipes: its mean over views, and the share of views in
    which both orders are the same.
    """
    taus = {
        cell.view.name: compute_kendall_tau_b(
            *([cell.error(recipe, method) for method in methods] for recipe in (of, against))
        )
        for cell in cells
        if all(math.isfinite(cell.error(recipe, methods[0])) for recipe in (of, against))
    }
    if not taus:
        return {"views": 0, "tau": None, "same": None, "low": None, "high": None}
    same = np.array([tau == 1 for tau in taus.values()], float)
    ground = {cell.view.name: cell.view.ground for cell in cells}
    numbered = np.unique([ground[name] for name in taus], return_inverse=True)[1]
    low, high = find_mean_intervals(same[:, None], numbered, np.array([True]))[0]
    return {
        "views": len(taus),
        "tau": _round_or_none(float(np.nanmean(list(taus.values())))),
        "same": _round_or_none(same.mean()),
        "low": _round_or_none(low),
        "high": _round_or_none(high),
    }


def _judge_hypothesis(hypothesis: Hypothesis, comparisons: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Judge a hypothesis by the interval of its change."""
    change = next(
        each["changes"][hypothesis.what]
        for each in comparisons
        if (each["of"], each["with"]) == (hypothesis.of, hypothesis.against)
    )
    low, high = change["low"], change["high"]
    if low is None or high is None:
        verdict = OPEN
    elif hypothesis.low < low and high < hypothesis.high:
        verdict = HOLDS
    else:
        verdict = FAILS if high <= hypothesis.low or low >= hypothesis.high else OPEN
    loud = abs(change["noise"] or 0.0) > _MAX_NOISE_SHARE * max(
        (abs(bound) for bound in (hypothesis.low, hypothesis.high) if math.isfinite(bound) and bound),
        default=abs(change["typical"] or 0.0),
    )
    return {
        "says": hypothesis.says,
        "of": hypothesis.of,
        "with": hypothesis.against,
        "what": hypothesis.what,
        **{key: change[key] for key in ("typical", "low", "high", "noise")},
        "verdict": OPEN if loud else verdict,
        "loud": loud,
    }


def _compare_noise_orders(cells: Sequence[Cell]) -> dict[str, Any]:
    """Compute Kendall's tau between the share that noise hides by the verdict and two measures from a converged render:
    the truly hidden share, and the distance of the light. Return tau over the recipes of each view, the mean over
    views, and tau over all pairs together.
    """
    return {key: _order_by_key(cells, key) for key in ("truly_hidden", "distance")}


def _order_by_key(cells: Sequence[Cell], key: str) -> dict[str, Any]:
    views = {
        cell.view.name: [
            (each["hidden"], each[key]) for each in cell.noise.values() if None not in (each["hidden"], each[key])
        ]
        for cell in cells
    }
    taus = {name: _compute_kendall_tau(rows) for name, rows in views.items()}
    known = [tau for tau in taus.values() if tau is not None]
    together = [row for rows in views.values() for row in rows]
    return {
        "views": taus,
        "mean": _round_or_none(float(np.mean(known))) if known else None,
        "together": _compute_kendall_tau(together),
        "pairs": len(together),
    }


def _compute_kendall_tau(rows: Sequence[tuple[float, float]]) -> float | None:
    return _round_or_none(compute_kendall_tau_b([row[0] for row in rows], [row[1] for row in rows]))


def _describe_view(cell: Cell, methods: Sequence[str]) -> dict[str, Any]:
    """Return the numbers of a view, for the tables."""
    tally = cell.tallies[CONVERGED][methods[0]]
    return {
        "view": cell.view.name,
        "ground": cell.view.ground,
        "sun_deg": float(cell.view.settings.light.sun_elevation_deg),
        "width_px": int(cell.view.settings.rig.width_px),
        "shadow": _round_or_none(tally[1, 0] / tally[:, 0].sum()),
        "reference_noise": round(cell.reference_noise, 5),
        "errors": {
            recipe: {
                method: {
                    "all": _round_or_none(100 * cell.error(recipe, method)),
                    **{light: _round_or_none(100 * cell.error(recipe, method, light)) for light in LIGHTS},
                }
                for method in methods
            }
            for recipe in cell.tallies
        },
        "noise": {name: dict(each) for name, each in cell.noise.items()},
        "cpu_s": {name: dict(each) for name, each in cell.cpu_s.items()},
    }
