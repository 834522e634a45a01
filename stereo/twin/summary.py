"""The numbers of all pairs beside each other: means of both sides, and the typical difference with its interval."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.files import escape_cell
from ..inference.scene_means import find_mean_intervals
from ..inference.typical_scene import compare_in_typical_scene
from ..matchers.methods import Method
from .compare_twin import MATCHED, SIDES, STATISTICS, Quantity
from .plan import Twin

_BOOTSTRAP_SEED = 0
#: The text for a missing number.
_NO_NUMBER = "–"


@dataclass(frozen=True)
class SummaryRow:
    """A quantity of the images, or of a method on them; ``method`` is its label, else "".

    ``means`` and ``intervals`` (low, high) are by side. ``difference`` is the typical difference, photograph minus
    twin, with its ``difference_interval``. Unknown numbers are NaN.
    """

    quantity: Quantity
    method: str
    means: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    difference: float
    difference_interval: tuple[float, float]

    def text(self, side: str) -> str:
        """Format the mean of a ``side``, photograph or twin, for the page."""
        return format_number(self.quantity, self.means[side])

    def interval_text(self, side: str) -> str:
        """Format the interval of a side's mean; "" without an interval."""
        return _format_interval(self.quantity, self.intervals[side])

    @property
    def difference_text(self) -> str:
        """The typical difference as text, with its sign."""
        return format_number(self.quantity, self.difference, "+")

    @property
    def difference_interval_text(self) -> str:
        """The interval of the typical difference as text; "" without an interval."""
        return _format_interval(self.quantity, self.difference_interval, "+")


def format_number(quantity: Quantity, value: float, sign: str = "") -> str:
    """Format a ``value`` with the digits of its quantity; shares are in per cent."""
    if not math.isfinite(value):
        return _NO_NUMBER
    return f"{value * (100 if quantity.share else 1):{sign}.{quantity.digits}f}"


def _format_interval(quantity: Quantity, ends: tuple[float, float], sign: str = "") -> str:
    if not all(map(math.isfinite, ends)):
        return ""
    return " to ".join(format_number(quantity, end, sign) for end in ends)


def summarise(records: Sequence[Mapping[str, Any]], methods: Sequence[Method]) -> tuple[list[SummaryRow], int]:
    """Summarise all quantities in rows. Also return the smallest number of pairs for an interval of the typical
    difference.

    All differences are one family. ``records`` are from ``compare_twin.read_or_measure``.
    """
    columns = [(quantity, "") for quantity in STATISTICS]
    columns += [(quantity, method.label) for method in methods for quantity in MATCHED]
    values = {
        side: np.array([[_find_quantity(record[side], *column) for column in columns] for record in records])
        for side in SIDES
    }
    shares = np.array([quantity.share for quantity, _ in columns])
    pairs = np.arange(len(records))
    bounds = {side: find_mean_intervals(values[side], pairs, shares) for side in SIDES}
    differences = values["photograph"] - values["twin"]
    family = compare_in_typical_scene(differences, _BOOTSTRAP_SEED)
    rows = [
        SummaryRow(
            *column,
            {side: _compute_mean(values[side][:, k]) for side in SIDES},
            {side: (float(bounds[side][k, 0]), float(bounds[side][k, 1])) for side in SIDES},
            float(family.typical[k]),
            (float(family.low[k]), float(family.high[k])),
        )
        for k, column in enumerate(columns)
    ]
    return rows, family.needed


def _find_quantity(side: Mapping[str, Any], quantity: Quantity, method: str) -> float:
    value = (side["matched"][method] if method else side["statistics"])[quantity.key]
    return float("nan") if value is None else float(value)


def _compute_mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def make_csv(twins: Sequence[Twin], records: Sequence[Mapping[str, Any]], methods: Sequence[Method]) -> str:
    """Make a row for each side of each pair, with all its numbers; shares are from 0 to 1, and unknown numbers are
    empty.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    heads = [quantity.key for quantity in STATISTICS]
    heads += [escape_cell(f"{method.label} {quantity.key}") for method in methods for quantity in MATCHED]
    writer.writerow(["pair", "side", "twin", *heads])
    for twin, record in zip(twins, records, strict=True):
        for side in SIDES:
            found = record[side]
            numbers = [found["statistics"][quantity.key] for quantity in STATISTICS]
            numbers += [found["matched"][method.label][quantity.key] for method in methods for quantity in MATCHED]
            cells = ["" if number is None else repr(float(number)) for number in numbers]
            writer.writerow([escape_cell(twin.photographs.name), side, record["rendered"], *cells])
    return stream.getvalue()
