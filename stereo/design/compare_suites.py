"""Compares sensor suites by their rows: risk and cost with intervals, a front, and the stability of the ranking.

Grounds are the scenes. All suites decide on the same grounds, so differences are paired. The loss of a ground is 1 for
an unsafe site, ``abstain_loss`` if no site is chosen although a safe one exists, and 0 otherwise. The risk is the mean
loss.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ...physics.random_numbers.seeds import make_generator
from ...support.arrays import Array
from ..inference.bounded_means import bound_mean_difference
from ..inference.kendall_tau import compute_kendall_tau_b
from ..inference.risk_control import bound_risk
from ..inference.scene_means import find_mean_intervals, find_simultaneous_intervals
from .read_design import Costs, Design, Suite

#: One minus the confidence of all paired differences of one quantity together, and of a single bound of a share.
DOUBT = 0.05
#: The quantities of a front; less is better.
RISK, ENERGY, TIME = "risk", "energy_j", "cpu_s"
QUANTITIES = (RISK, ENERGY, TIME)
#: The parts of the energy, see ``compute_energy``.
PARTS = ("camera", "processor", "lidar", "lamp")
#: Places of a suite: no other suite is as good in everything; another suite has less risk at no more cost; or the
#: grounds do not decide it.
FRONT, BEATEN, OPEN = "front", "beaten", "open"
#: Least Kendall's tau of a stable ranking, and the verdicts on it.
STABLE_TAU = 0.8
HOLDS, FAILS = "holds", "does not hold"
#: Number of resamples of grounds, number of random halvings, and decimals to which mean losses are rounded.
_RESAMPLES, _HALVINGS, _DECIMALS = 2000, 500, 12

_Rows = Mapping[str, Mapping[str, Mapping[str, Any]]]


@dataclass(frozen=True)
class Measured:
    """Numbers (grounds, suites) from the grounds on which no suite failed."""

    grounds: tuple[str, ...]
    loss: Array
    parts_j: Mapping[str, Array]
    cpu_s: Array
    acted: Array
    unsafe: Array
    dangerous: Array
    lost: Array  # share of the safe cells that is not taken, NaN without a safe cell
    left_out: int  # grounds on which a suite failed

    @property
    def energy_j(self) -> Array:
        """Energy, J, of each decision."""
        return np.asarray(sum(self.parts_j.values()))

    def read(self, quantity: str) -> Array:
        """Return the numbers of one of ``QUANTITIES``."""
        return {RISK: self.loss, ENERGY: self.energy_j, TIME: self.cpu_s}[quantity]


def compute_loss(numbers: Mapping[str, Any], abstain_loss: float) -> float:
    """Return the loss of a decision on a ground."""
    if numbers["unsafe_choice"] == 1:
        return 1.0
    return abstain_loss if numbers["no_site"] == 1 else 0.0


def compute_energy(numbers: Mapping[str, Any], suite: Suite, costs: Costs) -> dict[str, float]:
    """Compute the energy, J, of a decision by consumer."""
    pixels = numbers["frames"] * suite.settings.rig.width_px * suite.settings.rig.height_px
    points = numbers["points"]
    return {
        "camera": 2 * costs.camera_w * (numbers["exposure_s"] + pixels / costs.readout_px_s),
        "processor": costs.processor_w * costs.processor_slowdown * numbers["cpu_s"],
        "lidar": costs.lidar_w * (costs.lidar_ready_s + points / costs.lidar_points_s) if points else 0.0,
        "lamp": suite.lamp.power_w * numbers["lamp_s"] if suite.lamp else 0.0,
    }


def collect_numbers(design: Design, rows: _Rows) -> Measured:
    """Collect the numbers of rows by ground and suite."""
    names = [suite.name for suite in design.suites]
    whole = [ground for ground, own in rows.items() if all(own[name]["status"] == "ok" for name in names)]
    numbers = [[rows[ground][name]["numbers"] for name in names] for ground in whole]
    shape = len(whole), len(names)

    def tabulate(compute: Any) -> Array:
        return np.array([[compute(each) for each in own] for own in numbers], float).reshape(shape)

    energy = [
        [compute_energy(each, suite, design.costs) for each, suite in zip(own, design.suites, strict=True)]
        for own in numbers
    ]
    return Measured(
        tuple(whole),
        tabulate(lambda each: compute_loss(each, design.abstain_loss)),
        {part: np.array([[each[part] for each in own] for own in energy], float).reshape(shape) for part in PARTS},
        tabulate(lambda each: each["cpu_s"]),
        tabulate(lambda each: each["unsafe_choice"] is not None),
        tabulate(lambda each: each["unsafe_choice"] == 1),
        tabulate(lambda each: each["dangerous_choice"] == 1),
        tabulate(lambda each: 1 - each["cells"][3] / each["cells"][1] if each["cells"][1] else np.nan),
        len(rows) - len(whole),
    )


def summarise(design: Design, measured: Measured) -> list[dict[str, Any]]:
    """Return for each suite its counts, and its means with 95 % intervals over grounds."""
    grounds = len(measured.grounds)
    tables = {RISK: measured.loss, "lost": measured.lost, ENERGY: measured.energy_j, TIME: measured.cpu_s}
    found = []
    for k, suite in enumerate(design.suites):
        columns = np.stack([table[:, k] for table in tables.values()], axis=1)
        bounds = find_mean_intervals(columns, np.arange(grounds), np.array([True, True, False, False]))
        unsafe, acted = int(measured.unsafe[:, k].sum()), int(measured.acted[:, k].sum())
        found.append(
            {
                "suite": suite.name,
                "grounds": grounds,
                "acted": acted,
                "unsafe": unsafe,
                "unsafe_bound": bound_risk(unsafe, grounds, DOUBT),
                "dangerous": int(measured.dangerous[:, k].sum()),
                **{
                    key: {"mean": _average(columns[:, at]), "interval": [_none_if_nan(each) for each in bounds[at]]}
                    for at, key in enumerate(tables)
                },
                "energy_parts_j": {part: _average(table[:, k]) for part, table in measured.parts_j.items()},
            }
        )
    return found


def _average(values: Array) -> float | None:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else None


def _none_if_nan(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def compare(measured: Measured) -> dict[str, Array]:
    """Return for each of ``QUANTITIES`` the bounds (suites, suites, 2) of the difference of two suites' means.

    The difference is a row's suite minus a column's suite. All bounds of one quantity hold together with 95 %
    confidence. The bounds of the risk hold for any distribution, see ``bounded_means``; they share the doubt
    (Bonferroni). The bounds of the other quantities are approximate, and NaN with fewer grounds than
    ``find_simultaneous_intervals`` needs.
    """
    suites = measured.loss.shape[1]
    pairs = list(combinations(range(suites), 2))
    found = {quantity: np.zeros((suites, suites, 2)) for quantity in QUANTITIES}
    if not pairs:
        return found
    doubt = DOUBT / (2 * len(pairs))
    for quantity in QUANTITIES:
        table = measured.read(quantity)
        if quantity == RISK:
            bounds = np.array([bound_mean_difference(table[:, i], table[:, k], doubt) for i, k in pairs])
        else:
            bounds = find_simultaneous_intervals(np.stack([table[:, i] - table[:, k] for i, k in pairs], axis=1), 0)
        for (i, k), (low, high) in zip(pairs, bounds, strict=True):
            found[quantity][i, k] = low, high
            found[quantity][k, i] = -high, -low
    return found


def find_front(bounds: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Return for each suite its ``place`` and the indices of two groups of other suites.

    ``by`` are the suites that beat it, ``against`` the suites that may be as good in everything. A suite is beaten if
    another has less risk and no more energy and time. It is on the front if it has less of something than each other
    suite. Both must hold by the ``bounds`` of ``compare``. The bounds of each quantity hold together with 95 %
    confidence, so all places are right with about 85 % or more.
    """
    with np.errstate(invalid="ignore"):
        less = {quantity: bounds[quantity][..., 1] < 0 for quantity in QUANTITIES}
        no_more = {quantity: bounds[quantity][..., 1] <= 0 for quantity in QUANTITIES}
    beats = less[RISK] & no_more[ENERGY] & no_more[TIME]
    apart = np.logical_or.reduce(list(less.values()))
    found: list[dict[str, Any]] = []
    for k in range(len(beats)):
        by = np.flatnonzero(beats[:, k]).tolist()
        against = [i for i in np.flatnonzero(~apart[k]).tolist() if i != k]
        found.append(
            {
                "place": BEATEN if by else OPEN if against else FRONT,
                "by": by,
                "against": [] if by else against,
            }
        )
    return found


def compare_rankings(own: Array, other: Array, seed: int) -> dict[str, Any]:
    """Compare the rankings by mean loss on two sets of grounds, losses (grounds, suites) each.

    ``tau`` is Kendall's tau-b of the rankings, None if all suites of a set have one risk. ``interval`` contains 95 % of
    2000 resamples of the grounds of both sets. ``halves`` is the median tau of random halves of the ``own`` grounds,
    which noise alone keeps below 1. ``verdict`` states whether tau is at least ``STABLE_TAU``. It holds if the whole
    interval is, and does not hold if the whole interval is below while ``halves`` is not. A resample has more noise
    than the grounds, so the interval tends to be too low.
    """
    random = make_generator(seed, "statistics", 3)
    taus = np.array(
        [
            _rank_alike(*(each[random.integers(0, len(each), len(each))] for each in (own, other)))
            for _ in range(_RESAMPLES)
        ]
    )
    low = float(np.quantile(np.where(np.isnan(taus), -1.0, taus), DOUBT / 2))
    high = float(np.quantile(np.where(np.isnan(taus), 1.0, taus), 1 - DOUBT / 2))
    tau, halves = _rank_alike(own, other), _rank_halves(own, random)
    fails = high < STABLE_TAU <= halves
    verdict = OPEN if np.isnan(tau) else HOLDS if low >= STABLE_TAU else FAILS if fails else OPEN
    return {"tau": _none_if_nan(tau), "interval": [low, high], "halves": _none_if_nan(halves), "verdict": verdict}


def _rank_halves(own: Array, random: np.random.Generator) -> float:
    """Return the median tau of random halves of losses (grounds, suites); NaN if no halves have a tau."""
    if len(own) < 2:
        return float("nan")
    orders = [random.permutation(len(own)) for _ in range(_HALVINGS)]
    middle = len(own) // 2
    taus = np.array([_rank_alike(own[order[:middle]], own[order[middle:]]) for order in orders])
    known = taus[~np.isnan(taus)]
    return float(np.median(known)) if known.size else float("nan")


def _rank_alike(own: Array, other: Array) -> float:
    means: Sequence[list[float]] = [np.round(each.mean(axis=0), _DECIMALS).tolist() for each in (own, other)]
    return compute_kendall_tau_b(means[0], means[1])
