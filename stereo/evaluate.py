"""Running matchers on pairs and measuring the results, continuing where an earlier run stopped.

A row is the result of one method on one pair. It is written to the disk at once and is not computed again, so a run
that is stopped loses only the row that it was working on. A pair that cannot be used is reported, recorded as failed,
and does not stop the others. A pair whose eyes contradict each other or the truth is measured and marked as suspect,
and counts in no average. One pair at a time is in memory; of the others only the numbers that averages need are, about
a kilobyte per row.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DiskError, describe_error
from ..files import write_json
from ..version import version
from .artefacts import check_output_folder, files_exist, write_method_pictures, write_pair_pictures
from .environment import packages
from .export.points import add_points, pose_of
from .images.disparity_files import read_disparity
from .matchers import complete_options, files_of, match
from .matchers.methods import Method
from .matchers.resident_process import stop_residents
from .matchers.search_range import known_ranges
from .measure.costs import COSTS
from .measure.prepare import Prepared, distinct_pairs, prepare
from .measure.result_row import COMMON_NUMBERS, NUMBERS, common_numbers, own_numbers
from .report.results import ROW, find_facts, write_results
from .report.row_log import Row, RowLog

Event = Callable[[dict[str, Any]], None]

#: Version of the measurement: increased when the same input gives other numbers, so that old rows are not reused.
MEASURE = 3


def evaluate(paths: Sequence[Path], methods: Sequence[Method], out: Path,
             response: Mapping[str, Mapping[str, Any]] | None = None, on_event: Event = lambda event: None,
             seed: int = 0, guiss: bool = False, points: bool = False) -> dict[str, Any]:
    """Evaluate pairs and all pairs of data sets; return what is in ``report.json``.

    ``response`` overrides settings that need no new render. ``seed`` is the seed of the confidence intervals. With
    ``guiss`` the HTML report shows the numbers of the reference code, which are always in the rows. With ``points``
    the measured surfaces are written too.

    Writes to ``out``: ``results.jsonl`` (each row at once), then ``results.csv``, ``report.json``, ``summary.json``
    (the same without rows and pairs) and ``report.html``; for each pair, in ``pairs/<pair>/``, ``facts.json``,
    pictures, disparities and points. Rows of an earlier run with the same pair, method, options, response and versions
    are kept and not computed again.

    ``on_event`` gets {"type": "progress", "fraction", "done", "total", "message"}, {"type": "error", "message"} for
    each failure and {"type": "warning", "message"} for each suspect pair and each kind of blur in the images. Raises
    IcyMoonError if there is no pair, if ``out`` cannot be written, or if it contains files that no evaluation wrote.

    The report is {"format", "version", "summary", "differences", "rows", "pairs", "failed", "suspect", "notes",
    "provenance"}; ``notes`` are sentences on what limits the comparison;
    an undefined value is null. ``rows`` and ``pairs`` are read from the disk on demand.

    * ``summary``: one entry per method, see ``summary.summarise_method``; ``differences``: see
      ``summary.differences``.
    * ``rows``: ``pair``, ``method``, ``status`` ("ok", "suspect" or "failed"), the numbers of ``row.NUMBERS``,
      ``error_curve``, ``sparsification``, ``strata``, the complete ``options``, ``search`` (the disparities that were
      searched, where they come from, and the share of true ones outside), ``counts`` of pixels per outcome and
      ``facts`` on what it ran on (if the method has them), ``error`` (why it failed), ``key`` (a hash of everything
      that the row depends on) and ``images``: paths, relative to ``out``, of the pictures ``depth`` and ``error``, of
      ``disparity`` (npz, with the other arrays of the method) and, if asked for, of ``points`` (ply).
    * ``pairs``: the facts of each usable pair, and its ``images`` ``left``, ``right`` and ``true_depth``.
    * ``failed``: ``pair``, ``message`` and, if only one method failed, ``method``; ``suspect``: ``pair`` and
      ``message``.
    """
    folders = distinct_pairs(paths)
    check_output_folder(out, (folder.name for folder in folders))
    run = _Run(methods, out, dict(response or {}), on_event, len(folders) * len(methods), points)
    try:
        for folder in folders:
            run.evaluate_pair(folder)
    finally:
        stop_residents()
    run.log.compact((folder.name, method.label) for folder in folders for method in methods)
    return write_results(run.log, [folder.name for folder in folders], methods, out, run.failed, run.suspect,
                         _source(paths, response or {}), seed, guiss)


class _Run:
    """One run of ``evaluate``: what it runs, where it writes, and what has failed so far."""

    def __init__(self, methods: Sequence[Method], out: Path, response: dict[str, Any], on_event: Event,
                 total: int, points: bool) -> None:
        self.methods, self.out, self.response, self.points = methods, out, response, points
        self.log = RowLog(out / "results.jsonl", ROW)
        self.failed: list[dict[str, Any]] = []
        self.suspect: list[dict[str, Any]] = []
        self._tell, self._total, self._done = on_event, total, 0
        self._warned: set[str] = set()
        self._setups = {method.label: _method_inputs(method) for method in methods}

    def evaluate_pair(self, folder: Path) -> None:
        """Run all methods on one pair."""
        name = folder.name
        content = _digest([_read_checksum(folder / "pair.json"), self.response, MEASURE, version()])
        keys = {method.label: _digest([content, self._setups[method.label]]) for method in self.methods}
        rows = {label: row for label, key in keys.items() if (row := self._find_row(name, label, key))}
        facts = _read_facts(self.out, name, content)
        if facts is None or len(rows) < len(keys) or not all(self._is_finished(row, keys) for row in rows.values()):
            try:
                prepared = prepare(folder, self.response)
            except Exception as error:
                why = describe_error(error, folder)
                self._tell_failure(why, pair=name)
                for method in self.methods:
                    self._add_row(rows.get(method.label) or _failed_row(name, method, keys[method.label], why))
                return
            facts = prepared.facts | {"key": content, "images": write_pair_pictures(prepared, self.out)}
            write_json(self.out / "pairs" / name / "facts.json", facts)
            self._measure(prepared, keys, rows)
        else:
            for method in self.methods:
                self._tell_progress(rows[method.label])
        for message in facts.get("warnings", ()):
            if message not in self._warned:
                self._warned.add(message)
                self._tell({"type": "warning", "message": f"{folder}: {message}"})
        if not facts["self_check"]["ok"]:
            message = f"{folder} is left out of the averages: {'; '.join(facts['self_check']['problems'])}."
            self.suspect.append({"pair": name, "message": message})
            self._tell({"type": "warning", "message": message})

    def _is_finished(self, row: Row, keys: Mapping[str, str]) -> bool:
        return row["common"] == _digest(keys) and (not self.points or "points" in row["images"])

    def _find_row(self, pair: str, label: str, key: str) -> Row | None:
        row = self.log.find(pair, label, key)
        return row if row and row["status"] != "failed" and files_exist(row, self.out, pair) else None

    def _measure(self, prepared: Prepared, keys: Mapping[str, str], rows: dict[str, Row]) -> None:
        """Add the missing ``rows`` of a pair, and update the numbers that depend on all of its methods."""
        disparities: dict[str, np.ndarray] = {}
        shared = np.where(prepared.visible, prepared.pair.camera.disparity(prepared.truth), np.nan)
        ranges = known_ranges(prepared.pair.settings.rig, shared)
        for method in self.methods:
            label = method.label
            stored = self._read_stored(rows.get(label), prepared)
            if stored is not None:
                disparities[label] = stored
                self._tell_progress(rows[label])
                continue
            try:
                disparities[label], _, info = match(method.name, prepared.left, prepared.right, method.options,
                                                     prepared.pair.camera, ranges)
                searched = info["search"] and info["search"].to_json(shared)
                rows[label] = self._make_row(prepared, method, keys[label], disparities[label],
                                             info | {"search": searched})
            except DiskError:
                raise
            except Exception as error:
                why = describe_error(error, f"{prepared.pair.folder} by {label}")
                disparities.pop(label, None)
                self._tell_failure(why, pair=prepared.pair.folder.name, method=label)
                self._add_row(_failed_row(prepared.pair.folder.name, method, keys[label], why))
                continue
            self._add_row(rows[label])
        common = np.logical_and.reduce([np.ones_like(prepared.visible), *map(np.isfinite, disparities.values())])
        points = self.points and pose_of(prepared) is not None
        if self.points and not points:
            self._tell({"type": "warning", "message": f"{prepared.pair.folder / 'pair.json'} does not contain the "
                        "position of the camera, so no points are written; render the pair again."})
        for label, disparity in disparities.items():
            row = rows[label] | common_numbers(prepared, disparity, common) | {"common": _digest(keys)}
            if points:
                row["images"] = add_points(row["images"], self.out, prepared, disparity)
            if row != rows[label]:
                self.log.append(row)

    def _read_stored(self, row: Row | None, prepared: Prepared) -> np.ndarray | None:
        return read_disparity(self.out / row["images"]["disparity"], prepared.truth.shape) if row else None

    def _make_row(self, prepared: Prepared, method: Method, key: str, disparity: np.ndarray,
                  info: dict[str, Any]) -> Row:
        return {"pair": prepared.pair.folder.name, "method": method.label, "key": key,
                "status": "ok" if prepared.check.ok else "suspect",
                **own_numbers(prepared, disparity, info["options"]["min_disparity"] if method.name == "bm" else None),
                **dict.fromkeys(COMMON_NUMBERS), "common": "", **{key: info[key] for key in COSTS},
                "options": info["options"], "search": info["search"], "counts": info["counts"], "facts": info["facts"],
                "error": "",
                "images": write_method_pictures(prepared, method, disparity, info, self.out)}

    def _add_row(self, row: Row) -> None:
        self.log.append(row)
        self._tell_progress(row)

    def _tell_progress(self, row: Row) -> None:
        self._done += 1
        self._tell({"type": "progress", "fraction": self._done / self._total, "done": self._done,
                    "total": self._total, "message": f"{row['pair']} {row['method']}"})

    def _tell_failure(self, message: str, **what: str) -> None:
        self.failed.append({**what, "message": message})
        self._tell({"type": "error", "message": message})


def _failed_row(pair: str, method: Method, key: str, message: str) -> Row:
    return {"pair": pair, "method": method.label, "key": key, "status": "failed", **dict.fromkeys(NUMBERS),
            "error_curve": [], "sparsification": {}, "strata": {}, "common": "",
            "options": complete_options(method.name, method.options), "search": None, "counts": {}, "facts": {},
            "error": message, "images": {}}


def _read_facts(out: Path, pair: str, content: str) -> dict[str, Any] | None:
    """The facts that an earlier run wrote of a pair, if its content is the same and its pictures are there."""
    facts = find_facts(out, pair)
    return facts if facts and facts["key"] == content and files_exist(facts, out, pair) else None


def _method_inputs(method: Method) -> list[Any]:
    """Everything besides the images that a method's disparity depends on: its options, the files that they name, and
    versions."""
    options = complete_options(method.name, method.options)
    files = {key: _read_checksum(Path(value)) for key, value in options.items()
             if isinstance(value, str) and os.path.isfile(value)}
    files |= {text: _read_checksum(Path(text)) for text in files_of(method.name, options) if os.path.isfile(text)}
    versions = packages.find_versions()
    return [method.name, options, files, {name: versions[name] for name in ("numpy", "cv2", "torch")}]


def _read_checksum(path: Path) -> str:
    """Checksum of a file; empty if it cannot be read, which is reported where the file is used."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def _digest(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def _source(paths: Sequence[Path], response: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {"source": ", ".join(str(path.resolve()) for path in paths),
            "response_overrides": {f"{topic}.{key}": value for topic, values in response.items()
                                   for key, value in values.items()}}
