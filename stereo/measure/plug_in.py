"""Metrics from packages that the user installed. Every evaluation measures them beside ours."""

from __future__ import annotations

import numbers
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...plugins.installed import (
    Found,
    Plugin,
    explain_failures,
    find_function,
    find_installed,
    find_source_files,
    load_plugin,
    read_summary,
)
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import read_checksum
from .metrics import is_usable
from .prepare_pair import PreparedPair, none_if_not_finite
from .row_metrics import NUMBERS, disparity_to_depth

#: Units of a metric; % is for shares from 0 to 1.
METRIC_UNITS = ("", "%", "px", "m", "cm", "mm", "s", "deg", "1/m")


#: Columns in a table of rows that are no metrics.
_OTHER_COLUMNS = ("pair", "method", "status", "error")


def find_plugins() -> Found:
    """Find the metrics of packages that are installed in this Python."""
    return find_installed("metric", (*NUMBERS, *_OTHER_COLUMNS))


@dataclass(frozen=True)
class MeasuredMap:
    """The input of a plug-in's ``measure``; arrays are (H, W) of the left image.

    ``disparity_px`` and ``depth_m`` are the matcher's results, NaN where it found nothing. ``true_disparity_px`` and
    ``true_depth_m`` are the truth, NaN for sky. ``visible`` is true where the right eye sees the point too. ``left`` is
    the image, uint8, (H, W) or B, G, R (H, W, 3).
    """

    disparity_px: Array
    depth_m: Array
    true_disparity_px: Array
    true_depth_m: Array
    visible: Array
    left: Array
    focal_px: float
    baseline_m: float


def make_measured_map(prepared: PreparedPair, disparity: Array) -> MeasuredMap:
    """Copy a disparity map and the truth of its pair, so that a plug-in cannot change our data."""
    found, camera = np.where(is_usable(disparity), disparity, np.nan).astype(np.float64), prepared.pair.camera
    return MeasuredMap(
        found,
        disparity_to_depth(prepared, found),
        np.array(camera.disparity(prepared.truth)),
        np.array(prepared.truth),
        np.array(prepared.visible),
        np.array(prepared.left),
        camera.focal_px,
        camera.baseline_m,
    )


class PluginMetric:
    """The metric of a plug-in. Raises IcyMoonError if the plug-in cannot be loaded or is not complete."""

    def __init__(self, plugin: Plugin) -> None:
        self.plugin, self.loaded = plugin, load_plugin(plugin)
        self._measure = find_function(plugin, self.loaded, "measure", "found")
        self.heading = str(getattr(self.loaded, "TITLE", plugin.name))
        self.unit, self.decimals = getattr(self.loaded, "UNIT", None), getattr(self.loaded, "DECIMALS", 3)
        if self.unit not in METRIC_UNITS:
            raise IcyMoonError(
                f"{plugin.title} states UNIT = {self.unit!r}; state one of {METRIC_UNITS}, % for a share."
            )
        if not (isinstance(self.decimals, int) and 0 <= self.decimals <= 9):
            raise IcyMoonError(f"{plugin.title} states DECIMALS = {self.decimals!r}; give a number from 0 to 9.")

    def measure(self, found: MeasuredMap) -> float | None:
        """Measure the metric of a map; None if it is undefined. Raises IcyMoonError if the plug-in fails or returns no
        number.
        """
        with explain_failures(self.plugin), np.errstate(all="ignore"):
            value = self._measure(found)
        if isinstance(value, bool) or not isinstance(value, (numbers.Real, np.floating, np.integer)):
            raise IcyMoonError(
                f"{self.plugin.title} returned {type(value).__name__}; return a number, or NaN where "
                "the metric is undefined."
            )
        return none_if_not_finite(float(value))

    def to_json(self) -> dict[str, Any]:
        """Return the report's entry about the metric."""
        return {
            "name": self.plugin.name,
            "heading": self.heading,
            "unit": self.unit,
            "decimals": self.decimals,
            "doc": read_summary(self.loaded),
            "plug_in": self.plugin.release,
        }

    def inputs(self) -> list[Any]:
        """List everything that determines the metric's numbers besides the pair and the disparity."""
        files = find_source_files(self.loaded)
        return [self.plugin.name, self.plugin.release, [read_checksum(Path(file)) for file in files]]


def load_plugin_metrics() -> tuple[list[PluginMetric], list[str]]:
    """Load the metrics of plug-ins; return those that can be measured, and a sentence about each that cannot."""
    found = find_plugins()
    metrics, faults = [], list(found.refused.values())
    for plugin in found.usable.values():
        try:
            metrics.append(_load_metric(plugin))
        except IcyMoonError as error:
            faults.append(f"{error} It is left out.")
    return metrics, faults


@lru_cache(maxsize=64)
def _load_metric(plugin: Plugin) -> PluginMetric:
    return PluginMetric(plugin)


def measure_plugin_metrics(prepared: PreparedPair, disparity: Array) -> dict[str, Any]:
    """Measure the metrics of plug-ins for a row: ``plug_ins``, a number or None by name, and ``plug_in_faults``, a
    sentence by name for each that failed. {} without plug-ins.
    """
    measured: dict[str, float | None] = {}
    faults: dict[str, str] = {}
    metrics, _ = load_plugin_metrics()
    for metric in metrics:
        name = metric.plugin.name
        try:
            measured[name] = metric.measure(make_measured_map(prepared, disparity))
        except IcyMoonError as error:
            measured[name], faults[name] = None, str(error)
    return {"plug_ins": measured, "plug_in_faults": faults} if metrics else {}
