"""Measure the required accuracy of a calibration: matchers run on pairs that are rectified with one calibration error
at a time.

A pair is read once. For each error it is developed again with the same noise, matched and compared with the truth.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from ..physics.camera.calibration_error import make_assumed_camera
from ..physics.camera.stereo_camera import StereoCamera
from ..settings.description import check, merged, override
from ..settings.table import TOPICS
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import shorten, write_atomically
from .fusion.match_prepared import find_search_ranges, match_prepared
from .images.develop import develop
from .matchers.methods import Method
from .matchers.search_range import SearchRange
from .measure.metrics import is_usable
from .measure.prepare_pair import LoadedPair, PreparedPair, list_distinct_pairs, load_pair, prepare_loaded
from .measure.row_metrics import disparity_to_depth
from .report.charts import METHOD_COLOURS, METHOD_MARKS, STYLE, add_legend, make_figure
from .report.sweep_charts import ON_WHITE

TOPIC = "calibration_error"
#: Magnitudes by setting, measured with both signs unless the user states others.
MAGNITUDES: dict[str, tuple[float, ...]] = {
    "right_yaw_deg": (0.02, 0.05, 0.1, 0.2, 0.5),
    "right_pitch_deg": (0.05, 0.1, 0.2, 0.3, 0.5),
    "right_roll_deg": (0.1, 0.2, 0.5, 1.0, 1.5),
    "right_column_px": (0.1, 0.2, 0.5, 1.0, 2.0),
    "right_row_px": (0.2, 0.4, 0.7, 1.0, 2.0),
    "right_focal_percent": (0.1, 0.2, 0.5, 1.0, 2.0),
    "focal_percent": (0.3, 1.0, 3.0),
    "baseline_percent": (0.3, 1.0, 3.0),
    "right_k1": (0.002, 0.005, 0.01, 0.02, 0.05),
    "k1": (0.005, 0.01, 0.03, 0.05, 0.1),
}
#: Numbers of a method on a pair that the curves and the file show: key, factor and axis label.
SHOWN_NUMBERS = (
    ("median_relative_error", 100.0, "Median depth error (%)"),
    ("coverage", 100.0, "Coverage (%)"),
)
#: The tolerance of a setting is the error at which the median depth error, or the coverage, is this multiple of its
#: value without an error.
TOLERATED_DEPTH_FACTOR, TOLERATED_COVERAGE_FACTOR = 2.0, 0.9
_CSV_COLUMNS = ("rig", "pair", "method", "setting", "error", *(key for key, _, _ in SHOWN_NUMBERS))


@dataclass(frozen=True)
class MeasuredError:
    """The result of a method on a pair with one calibration error. The last two numbers are shares, NaN if nothing was
    measured.
    """

    rig: str
    pair: str
    method: str
    setting: str  # a setting of the topic ``calibration_error``
    error: float
    median_relative_error: float
    coverage: float


def parse_errors(stated: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Parse ``KEY=NUMBER,NUMBER…`` to the sorted errors of each setting, and add 0. Without a text, return both signs
    of ``MAGNITUDES``.

    Raises IcyMoonError for a setting that does not exist or a number out of its range.
    """
    if not stated:
        return {key: tuple(sorted({0.0, *sizes, *(-size for size in sizes)})) for key, sizes in MAGNITUDES.items()}
    found: dict[str, tuple[float, ...]] = {}
    for text in stated:
        key, _, numbers = text.partition("=")
        values = [
            override(f"{TOPIC}.{key.strip()}={number}", f"--errors {shorten(text)}") for number in numbers.split(",")
        ]
        name = next(iter(values[0][TOPIC]))
        found[name] = tuple(sorted({0.0, *(float(value[TOPIC][name]) for value in values)}))
    return found


def name_rig(camera: StereoCamera) -> str:
    """Make a name for the rig of a pair from its size, focal length and baseline; rigs that share these have
    one name.
    """
    return (
        f"{camera.width_px} x {camera.height_px} px, focal length {camera.focal_px:.4g} px, "
        f"baseline {camera.baseline_m:.3g} m"
    )


def measure_calibration(
    paths: Sequence[Path],
    methods: Sequence[Method],
    errors: Mapping[str, Sequence[float]],
    tell: Callable[[int, int], None] = lambda done, total: None,
) -> list[MeasuredError]:
    """Measure all rendered pairs at ``paths`` by all methods, with one of the ``errors`` at a time.

    ``tell`` receives the numbers of finished pairs and of all pairs. Raises IcyMoonError if there is no pair, or if a
    pair, an error or a method cannot be used.
    """
    folders, found = list_distinct_pairs(paths), list[MeasuredError]()
    for done, folder in enumerate(folders):
        tell(done, len(folders))
        found += _measure_pair(load_pair(folder, {TOPIC: _zero_errors()}, measuring=True), methods, errors)
    tell(len(folders), len(folders))
    return found


def _zero_errors() -> dict[str, float]:
    return {setting.key: 0.0 for setting in TOPICS[TOPIC].settings}


def _measure_pair(
    loaded: LoadedPair, methods: Sequence[Method], errors: Mapping[str, Sequence[float]]
) -> Iterator[MeasuredError]:
    exact = prepare_loaded(loaded)
    ranges = find_search_ranges(exact)
    matched = {method.label: _match(exact, method, ranges) for method in methods}
    for key, values in errors.items():
        for value in values:
            prepared = _redevelop_with_error(loaded, exact, key, value)
            # An error that changes only depth needs no new match.
            alike = np.array_equal(prepared.left, exact.left) and np.array_equal(prepared.right, exact.right)
            for method in methods:
                same = alike and method.lidar is None  # range points are placed by the camera too
                disparity = matched[method.label] if same else _match(prepared, method, ranges)
                yield _measure_error(prepared, method.label, disparity, key, value)


def _match(prepared: PreparedPair, method: Method, ranges: Mapping[str, SearchRange]) -> Array:
    return match_prepared(method, prepared, lambda: ranges)[0]


def _redevelop_with_error(loaded: LoadedPair, exact: PreparedPair, key: str, value: float) -> PreparedPair:
    """Develop the pair again with one error in its calibration."""
    stated = check({TOPIC: {key: value}}, f"{TOPIC}.{key}")
    settings = merged(loaded.settings, stated)
    images = develop(loaded.pair, loaded.light["left"], loaded.light["right"], settings)
    left, right = images.for_matchers()
    assumed = make_assumed_camera(loaded.pair.camera, settings.calibration_error)
    return replace(exact, left=left, right=right, images=images, assumed_camera=assumed)


def _measure_error(prepared: PreparedPair, method: str, disparity: Array, key: str, value: float) -> MeasuredError:
    depth, known = disparity_to_depth(prepared, disparity), prepared.known
    measured = known & is_usable(depth)
    relative = np.abs(depth[measured] / prepared.truth[measured] - 1)
    return MeasuredError(
        name_rig(prepared.pair.camera),
        prepared.pair.name,
        method,
        key,
        value,
        float(np.median(relative)) if relative.size else float("nan"),
        float(measured.sum() / known.sum()) if known.any() else float("nan"),
    )


def find_tolerance(errors: Sequence[float], means: Sequence[float], times: float) -> float | None:
    """Find the smallest absolute error at which the mean is ``times`` the error-free mean, by linear interpolation.

    The mean must grow to this value if ``times`` is above 1, else fall to it. Return None if the mean never reaches the
    value. ``errors`` (n,) are in order, with 0 among them.
    """
    place = list(errors).index(0.0)
    sign = 1.0 if times > 1 else -1.0
    limit, crossings = times * means[place], []
    for step in (1, -1):
        for k in range(place + step, len(errors) if step > 0 else -1, step):
            before, here = means[k - step], means[k]
            if sign * (here - limit) > 0:
                share = (limit - before) / (here - before)
                crossings.append(abs(errors[k - step] + share * (errors[k] - errors[k - step])))
                break
    return min(crossings, default=None)


def average_pairs(rows: Sequence[MeasuredError], rig: str, method: str, setting: str, key: str) -> tuple[Array, Array]:
    """Return the errors (n,) of a setting, in order, and the mean (n,) of the number ``key`` over pairs at each error,
    NaN without a pair.
    """
    mine = [row for row in rows if (row.rig, row.method, row.setting) == (rig, method, setting)]
    errors = np.array(sorted({row.error for row in mine}))
    numbers = [np.array([getattr(row, key) for row in mine if row.error == error]) for error in errors]
    means = [float(each[~np.isnan(each)].mean()) if (~np.isnan(each)).any() else float("nan") for each in numbers]
    return errors, np.array(means)


def tabulate(rows: Sequence[MeasuredError]) -> list[dict[str, Any]]:
    """Make an entry for each rig, method and setting: the error-free median depth error and coverage, the error that
    changes each by its factor (None if no error does), and the largest measured error.
    """
    found = []
    for rig, method, setting in dict.fromkeys((row.rig, row.method, row.setting) for row in rows):
        errors, medians = average_pairs(rows, rig, method, setting, "median_relative_error")
        _, coverages = average_pairs(rows, rig, method, setting, "coverage")
        exact = errors.tolist().index(0.0)
        found.append(
            {
                "rig": rig,
                "method": method,
                "setting": setting,
                "exact": float(medians[exact]),
                "exact_coverage": float(coverages[exact]),
                "tolerance": find_tolerance(errors.tolist(), medians.tolist(), TOLERATED_DEPTH_FACTOR),
                "coverage_tolerance": find_tolerance(errors.tolist(), coverages.tolist(), TOLERATED_COVERAGE_FACTOR),
                "largest": float(np.abs(errors).max()),
            }
        )
    return found


def write_rows(rows: Sequence[MeasuredError], path: Path) -> None:
    """Write a line for each pair, method and error as CSV."""

    def write_part(part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(_CSV_COLUMNS)
            writer.writerows([getattr(row, column) for column in _CSV_COLUMNS] for row in rows)

    write_atomically(path, write_part)


def write_curves(rows: Sequence[MeasuredError], out: Path) -> list[Path]:
    """Write a picture for each rig: the means of ``SHOWN_NUMBERS`` against each error, a line for each method. Return
    the paths. Raises IcyMoonError without a result.
    """
    rigs, methods = (list(dict.fromkeys(getattr(row, key) for row in rows)) for key in ("rig", "method"))
    if not rigs:
        raise IcyMoonError("There are no results to draw; measure a pair first.")
    return [_write_curves(rows, rig, methods, out / f"curves_{k}.png") for k, rig in enumerate(rigs, 1)]


def _write_curves(rows: Sequence[MeasuredError], rig: str, methods: Sequence[str], path: Path) -> Path:
    settings = list(dict.fromkeys(row.setting for row in rows if row.rig == rig))
    columns = min(5, len(settings))
    blocks = -(-len(settings) // columns)
    with matplotlib.rc_context({**STYLE, **ON_WHITE}):
        figure, axes = make_figure(columns, blocks * len(SHOWN_NUMBERS), width=2.5 * columns, height=2.1)
        for k in range(blocks * columns):
            for line, (key, factor, name) in enumerate(SHOWN_NUMBERS):
                axis = axes[k // columns * len(SHOWN_NUMBERS) + line, k % columns]
                if k >= len(settings):
                    axis.set_visible(False)
                    continue
                for n, method in enumerate(methods):
                    errors, means = average_pairs(rows, rig, method, settings[k], key)
                    axis.plot(
                        errors, factor * means, color=METHOD_COLOURS[n % 6], marker=METHOD_MARKS[n % 6], label=method
                    )
                axis.set_ylim(bottom=0)
                axis.locator_params(axis="x", nbins=4)
                axis.set_xlabel(settings[k] if line == len(SHOWN_NUMBERS) - 1 else "")
                axis.set_ylabel(name if k % columns == 0 else "")
        figure.suptitle(rig, x=0.99, ha="right")
        add_legend(figure, axes[0, 0], len(methods))
        write_atomically(path, partial(figure.savefig, format="png", dpi=110, facecolor="white"))
    return path
