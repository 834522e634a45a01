"""The columns of the summary tables, at the terminal and in the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Column:
    """A column: the key in a row or summary, and how its number is written."""

    key: str
    heading: str
    unit: str = ""
    decimals: int = 3
    doc: str = ""

    @property
    def title(self) -> str:
        """Heading and unit."""
        return f"{self.heading} ({self.unit})" if self.unit else self.heading


SUMMARY = (
    Column("coverage", "Coverage", "%", 1, "share of the pixels with a true depth that got a valid one"),
    Column("l1_m", "L1", "m", 3, "mean absolute depth error"),
    Column("l1_rate_10", "L1-rate-10", "%", 1, "share of the measured pixels that are off by more than 10 cm"),
    Column("si_rmse", "si-RMSE", "", 4, "root of the scale-invariant mean square error of log depth"),
    Column("dod", "DOD", "%", 2, "share of all pixel pairs put in the wrong depth order, tolerance 1 %"),
    Column("epe_px", "EPE", "px", 3, "mean absolute disparity error"),
    Column("bad_1", "bad-1", "%", 1, "share of the measured pixels with a disparity off by more than 1 px"),
    Column("seconds", "CPU", "s", 3, "processor seconds of matching one pair, one thread"),
)


def shown(entry: Mapping[str, Any], column: Column, prefix: str = "") -> str:
    """The number of ``entry[prefix + key]`` without its unit; a dash where it is undefined."""
    value = entry.get(prefix + column.key)
    if value is None:
        return "–"
    return f"{100 * value if column.unit == '%' else value:.{column.decimals}f}"
