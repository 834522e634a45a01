"""Measure one pair by all methods of an evaluation, in this process or in another process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from ..formats.map_frame import MapFrame
from ..support.arrays import Array
from ..support.errors import DiskError, IcyMoonError, describe_error
from ..support.files import write_json
from .datasets.predictions import PREDICTION
from .evaluated_pairs import Source
from .evaluation_files import write_method_pictures, write_pair_pictures
from .export.points import add_points, find_left_pose
from .fusion.match_prepared import find_search_ranges, find_shared_disparity, match_prepared
from .images.disparity_files import read_disparity
from .map_results import find_map_frame, name_maps, write_maps
from .matchers.black_box_confidence import RUNS, compute_black_box_confidence
from .matchers.methods import Method, describe_method
from .matchers.search_range import SearchRange
from .measure.common_pixels import measure_common_pixels
from .measure.confidence_metrics import MEASURES, OWN
from .measure.prepare_pair import PreparedPair
from .report.row_log import Row
from .report.schema import Failure
from .result_row import make_failed_row, make_result_row


@dataclass(frozen=True)
class MeasureRun:
    """The settings of an evaluation that hold for every pair."""

    methods: Sequence[Method]
    out: Path
    response: Mapping[str, Mapping[str, Any]]
    points: bool
    maps: float | None = None  # the size of the cells of maps in metres, 0 for a suitable one; None for no maps
    confidence: Sequence[str] = (OWN,)  # the confidence_metrics.MEASURES to measure


@dataclass(frozen=True)
class MeasureTask:
    """A pair with a missing result. It has JSON values only, so that another process can measure it."""

    pair: str
    content: str  # digest of everything that its numbers depend on
    keys: Mapping[str, str]  # keys of its rows, by the label of the method
    rows: Mapping[str, Row]  # the rows of an earlier run, by the label of the method


def measure_pair(source: Source, run: MeasureRun, task: MeasureTask) -> Iterator[dict[str, Any]]:
    """Do a task. The pictures and facts of the pair are written here; the caller writes the rows from the events that
    this yields:

    * {"type": "row", "row"} for each method, also for a method that failed and for one that an earlier run measured;
    * {"type": "update", "row"} for a row that has changed since;
    * {"type": "failed", "failure"} and {"type": "warning", "message"};
    * {"type": "facts", "facts"} if the pair can be used.

    Raises DiskError if a file cannot be written.
    """
    try:
        prepared = source.prepare(run.response)
    except Exception as error:
        why = describe_error(error, source.folder)
        yield _make_failed_event({"pair": source.name, "message": why})
        for method in run.methods:
            yield _make_row_event(
                task.rows.get(method.label) or make_failed_row(task.pair, method, task.keys[method.label], why)
            )
        return
    facts = prepared.facts | {"key": task.content, "images": write_pair_pictures(prepared, run.out)}
    write_json(run.out / "pairs" / source.name / "facts.json", facts)
    yield from _measure_methods(prepared, run, task)
    yield {"type": "facts", "facts": facts}


def _make_failed_event(failure: Failure) -> dict[str, Any]:
    return {"type": "failed", "failure": failure}


def _make_row_event(row: Row, kind: str = "row") -> dict[str, Any]:
    return {"type": kind, "row": row}


def _warn_of_files_left_out(
    prepared: PreparedPair, run: MeasureRun, points: bool, maps: bool
) -> Iterator[dict[str, Any]]:
    """Yield a warning if a run asks for points or maps that the pair cannot have."""
    record = prepared.pair.folder / "pair.json"
    if run.points and not points:
        yield {
            "type": "warning",
            "message": f"{record} does not contain the position of the camera, so no points are written; render the "
            "pair again.",
        }
    if run.maps is not None and not maps:
        yield {
            "type": "warning",
            "message": f"{record} states no map with a coordinate system, so no maps are written; give the ground as a "
            "GeoTIFF that has one, and render the pair again.",
        }


def _measure_methods(prepared: PreparedPair, run: MeasureRun, task: MeasureTask) -> Iterator[dict[str, Any]]:
    """Make the missing rows of a pair, and the numbers that depend on two of its methods."""
    disparities: dict[str, Array] = {}
    rows: dict[str, Row] = dict(task.rows)
    shared = find_shared_disparity(prepared)
    ranges = cache(partial(find_search_ranges, prepared))
    for method in run.methods:
        label = method.label
        stored = _read_stored_disparity(rows.get(label), prepared, run.out)
        if stored is not None:
            disparities[label] = stored
            yield _make_row_event(rows[label])
            continue
        try:
            disparity, info = match_prepared(method, prepared, ranges)
            info["search"] = info["search"] and info["search"].to_json(shared)
            confidences, warnings = _find_confidences(method, prepared, ranges, disparity, info, run.confidence)
            row = make_result_row(prepared, method, task.keys[label], disparity, info, confidences)
            pictures = write_method_pictures(prepared, method, disparity, info, run.out, confidences)
            rows[label] = row | {"images": pictures}
            yield from warnings
        except DiskError:
            raise
        except Exception as error:
            why = describe_error(error, f"{prepared.pair.folder} by {describe_method(label)}")
            yield _make_failed_event({"pair": prepared.pair.name, "method": label, "message": why})
            yield _make_row_event(make_failed_row(task.pair, method, task.keys[method.label], why))
            continue
        disparities[label] = disparity
        yield _make_row_event(rows[label])
    yield from _compare_and_map(prepared, run, task, rows, disparities)


def _compare_and_map(
    prepared: PreparedPair,
    run: MeasureRun,
    task: MeasureTask,
    rows: Mapping[str, Row],
    disparities: Mapping[str, Array],
) -> Iterator[dict[str, Any]]:
    """Yield the rows that change when pairs of methods are compared and when points and maps are written."""
    common = measure_common_pixels(prepared, disparities)
    points = run.points and find_left_pose(prepared) is not None
    frame = find_map_frame(prepared) if run.maps is not None else None
    yield from _warn_of_files_left_out(prepared, run, points, frame is not None)
    for method in (method for method in run.methods if method.label in disparities):
        label, disparity = method.label, disparities[method.label]
        beside = {other: numbers | {"key": task.keys[other]} for other, numbers in common[label].items()}
        row = rows[label] | {"common": rows[label]["common"] | beside}
        if points:
            row["images"] = add_points(row["images"], run.out, prepared, disparity)
        if frame is not None:
            row["images"] = _add_ground_maps(row["images"], run, prepared, frame, method, disparity)
        if row != rows[label]:
            yield _make_row_event(row, "update")


def _find_confidences(
    method: Method,
    prepared: PreparedPair,
    ranges: Callable[[], Mapping[str, SearchRange]],
    disparity: Array,
    info: Mapping[str, Any],
    measures: Sequence[str],
) -> tuple[dict[str, Array], list[dict[str, Any]]]:
    """Find the confidences (H, W) of a disparity map by measure, and a warning about each measure that failed.

    Not every matcher states a confidence. A prediction and a map with range points cannot be matched again.
    """
    own = info["confidence"]
    found = {OWN: own} if own is not None and OWN in measures else {}
    warnings: list[dict[str, Any]] = []
    if method.name == PREDICTION or method.lidar is not None:
        return found, warnings
    for measure in (measure for measure in RUNS if measure in measures):
        try:
            found[measure] = compute_black_box_confidence(
                measure,
                method.name,
                prepared.left,
                prepared.right,
                disparity,
                method.options,
                prepared.depth_camera,
                ranges(),
            )
        except IcyMoonError as error:
            where = f"{prepared.pair.folder} by {describe_method(method.label)}"
            message = f"{where} has no confidence by {MEASURES[measure]}: {error}"
            warnings.append({"type": "warning", "message": message})
    return found, warnings


def _add_ground_maps(
    images: dict[str, Any], run: MeasureRun, prepared: PreparedPair, frame: MapFrame, method: Method, disparity: Array
) -> dict[str, Any]:
    """Return the ``images`` of a row with its maps added. The maps are written beside the disparity unless they
    exist.
    """
    if has_maps(images, method, run.maps):
        return images
    folder = (run.out / images["disparity"]).parent
    files = {kind: folder / name for kind, name in name_maps(method, run.maps or 0.0).items()}
    write_maps(prepared, frame, disparity, files, run.maps or 0.0)
    return images | {kind: path.relative_to(run.out).as_posix() for kind, path in files.items()}


def has_maps(images: Mapping[str, str], method: Method, cell_m: float | None) -> bool:
    """Return whether a row has the requested maps; True if no maps are requested."""
    wanted = {} if cell_m is None else name_maps(method, cell_m)
    return all(kind in images and Path(images[kind]).name == name for kind, name in wanted.items())


def _read_stored_disparity(row: Row | None, prepared: PreparedPair, out: Path) -> Array | None:
    return read_disparity(out / row["images"]["disparity"], prepared.truth.shape) if row else None
