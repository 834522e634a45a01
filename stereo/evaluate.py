"""Run matchers on pairs and measure the results; a new run continues where an earlier one stopped.

A row is the result of one method on one pair. It is written to the disk at once and never computed again, so a stopped
run loses only the row in progress. A pair that cannot be used is reported and recorded as failed, and the others go on.
A pair whose eyes contradict each other or the truth is measured and marked as suspect, and counts in no average. Only
one pair at a time is in memory; from the others, the numbers for averages are kept, about a kilobyte per row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..support.errors import IcyMoonError
from ..support.files import make_json_digest, read_checksum
from ..support.version import version
from .datasets.predictions import PREDICTION, find_confidence, find_prediction, parse_predictions
from .evaluated_pairs import Source, check_response, find_sources, sort_by_ground
from .evaluation_files import check_output_folder, has_named_files, remove_leftovers
from .fusion.fuse import list_lidar_inputs
from .fusion.match_prepared import list_method_inputs
from .matchers.methods import Method, describe_method
from .matchers.resident_process import stop_residents
from .measure.confidence_metrics import OWN
from .measure.plug_in import load_plugin_metrics
from .measure_pair import MeasureRun, MeasureTask, has_maps, measure_pair
from .measuring_cluster import measure_on_cluster
from .measuring_processes import MeasuringProcesses, choose_process_count
from .report.row_log import Row, RowLog
from .report.schema import ROW, Failure, Report
from .report.write_results import find_facts, write_results
from .result_row import make_failed_row

Event = Callable[[dict[str, Any]], None]

#: Increased when the same input gives other numbers, so that old rows are not used again.
MEASURE_VERSION = 5


def evaluate(
    paths: Sequence[Path],
    methods: Sequence[Method],
    out: Path,
    response: Mapping[str, Mapping[str, Any]] | None = None,
    on_event: Event = lambda event: None,
    seed: int = 0,
    guiss: bool = False,
    points: bool = False,
    predictions: Sequence[str] = (),
    jobs: int | None = None,
    dask: str | None = None,
    maps: float | None = None,
    confidence: Sequence[str] = (OWN,),
) -> Report:
    """Evaluate pairs and all pairs of data sets, including data sets in other layouts (``datasets.dataset_layouts``);
    return the content of ``report.json``.

    ``predictions`` are further methods, see ``datasets.predictions``. ``jobs`` is the number of processes that measure,
    by default one for each processor; see ``measuring_processes.choose_process_count``. ``dask`` is the address of a
    Dask cluster whose workers measure instead, see ``measuring_cluster``.

    ``response`` overrides settings that need no new render. ``seed`` is the seed of the tests' random sign flips. With
    ``guiss`` the HTML report shows the numbers of the reference code, which are always in the rows. With ``points`` the
    measured surfaces are written too. With ``maps`` their heights and errors are written on the map of the ground, see
    ``map_results``; ``maps`` is the size of a cell in metres, or 0 for a suitable one. ``confidence`` are the
    ``confidence_metrics.MEASURES`` to measure; all but the matchers' own need more runs of each matcher.

    Writes to ``out``: ``results.jsonl`` (each row at once), then ``results.csv``, ``comparisons.csv``, ``report.json``,
    ``summary.json`` (the same without rows and pairs) and ``report.html``. For each pair, ``pairs/<pair>/`` gets
    ``facts.json``, pictures, disparities, points and maps. Rows of an earlier run with the same pair, method, options,
    response and versions are kept and not computed again.

    ``on_event`` gets {"type": "progress", "fraction", "done", "total", "message"}, {"type": "error", "message"} for
    each failure, {"type": "warning", "message"} for each suspect pair and each doubt about the images of a pair, and
    {"type": "note", "message"} for facts about pairs of other data sets. Raises IcyMoonError if there is no pair, if
    ``out`` cannot be written, or if it contains files that no evaluation wrote.
    """
    sources = find_sources(paths)
    check_response(sources, response or {})
    methods = [
        *methods,
        *parse_predictions(predictions, [source.name for source in sources], [method.label for method in methods]),
    ]
    if not methods:
        raise IcyMoonError("There is no method to evaluate; name one with --methods or --predictions.")
    names = [source.name for source in sources]
    check_output_folder(out, names)
    remove_leftovers(out)
    run = MeasureRun(methods, out, dict(response or {}), points, maps, tuple(confidence))
    evaluation = Evaluation(sources, run, on_event)
    try:
        evaluation.log_results(
            _measure_tasks(evaluation, paths, run, choose_process_count(jobs, methods, len(sources)), dask)
        )
    finally:
        stop_residents()
    evaluation.log.compact((name, method.label) for name in names for method in methods)
    failed, suspect = evaluation.sort_messages()
    return write_results(
        evaluation.log,
        names,
        methods,
        out,
        failed,
        suspect,
        _describe_source(paths, response or {}),
        seed,
        guiss,
        evaluation.faults,
    )


def _measure_tasks(
    evaluation: Evaluation, paths: Sequence[Path], run: MeasureRun, count: int, dask: str | None
) -> Iterator[tuple[MeasureTask, dict[str, Any]]]:
    if dask:
        return measure_on_cluster(dask, paths, run, evaluation.tasks())
    if count > 1:
        return MeasuringProcesses(count, paths, run).measure(evaluation.tasks())
    return _measure_here(evaluation, run)


def _measure_here(evaluation: Evaluation, run: MeasureRun) -> Iterator[tuple[MeasureTask, dict[str, Any]]]:
    for task in evaluation.tasks():
        for event in measure_pair(evaluation.sources[task.pair], run, task):
            yield task, event


class Evaluation:
    """The tasks of an evaluation, its log, and its failures so far."""

    def __init__(self, sources: Sequence[Source], run: MeasureRun, on_event: Event) -> None:
        self.sources = {source.name: source for source in sources}
        self.log = RowLog(run.out / "results.jsonl", ROW)
        self._run, self._tell, self._total, self._done = run, on_event, len(sources) * len(run.methods), 0
        self._failed: list[Failure] = []
        self._suspect: list[Failure] = []
        self._warned: set[str] = set()
        metrics, self.faults = load_plugin_metrics()
        self._metrics = [metric.inputs() for metric in metrics]
        for fault in self.faults:
            self._tell({"type": "warning", "message": fault})
        self._setups = {method.label: list_method_inputs(method) for method in run.methods}

    def tasks(self) -> Iterator[MeasureTask]:
        """Yield a task for each pair with a missing result, ordered by ``sort_by_ground``, and report the progress of
        the complete pairs.
        """
        for source in sort_by_ground([*self.sources.values()]):
            name = source.name
            content = make_json_digest([*source.list_dependencies(), self._run.response, MEASURE_VERSION, version()])
            keys = {method.label: self._make_row_key(method, name, content) for method in self._run.methods}
            task = MeasureTask(
                name,
                content,
                keys,
                {label: row for label, key in keys.items() if (row := self._find_row(name, label, key))},
            )
            facts = _read_facts(self._run.out, name, content)
            if (
                facts is None
                or len(task.rows) < len(keys)
                or not all(self._is_finished(row, task) for row in task.rows.values())
            ):
                yield task
                continue
            for method in self._run.methods:
                self._tell_progress(task.rows[method.label])
            self._tell_notes(name, facts)

    def _make_row_key(self, method: Method, pair: str, content: str) -> str:
        """Make the digest of everything that determines a row."""
        inputs = self._setups[method.label]
        if method.name == PREDICTION:
            with suppress(IcyMoonError):  # reported where the file is read
                inputs = [*inputs, read_checksum(find_prediction(method, pair))]
                if stated := find_confidence(method, pair):
                    inputs = [*inputs, stated[0].name, read_checksum(stated[0])]
        inputs = [*inputs, *list_lidar_inputs(method, pair)]
        asked = list(self._run.confidence)
        measured = [*([self._metrics] if self._metrics else []), *([asked] if asked != [OWN] else [])]
        return make_json_digest([content, inputs, *measured])

    def _is_finished(self, row: Row, task: MeasureTask) -> bool:
        compared = all(
            row["common"].get(label, {}).get("key") == key for label, key in task.keys.items() if label != row["method"]
        )
        method = next(each for each in self._run.methods if each.label == row["method"])
        shown = not self._run.points or "points" in row["images"]
        return compared and shown and has_maps(row["images"], method, self._run.maps)

    def _find_row(self, pair: str, label: str, key: str) -> Row | None:
        row = self.log.find(pair, label, key)
        return row if row and row["status"] != "failed" and has_named_files(row, self._run.out, pair) else None

    def log_results(self, events: Iterator[tuple[MeasureTask, dict[str, Any]]]) -> None:
        """Write the results of the tasks to the log, and report the progress."""
        done: dict[str, set[str]] = {}
        for task, event in events:
            kind = event["type"]
            if kind in ("row", "update"):
                row = event["row"]
                if kind == "update" or row != task.rows.get(row["method"]):
                    self.log.append(row)
                if kind == "row":
                    done.setdefault(task.pair, set()).add(row["method"])
                    self._tell_progress(row)
            elif kind == "facts":
                self._tell_notes(task.pair, event["facts"])
                done.pop(task.pair, None)
            elif kind == "warning":
                self._tell(event)
            elif kind == "failed":
                self._tell_failure(event["failure"])
            else:
                self._give_up(task, event["message"], done.pop(task.pair, set()))

    def _give_up(self, task: MeasureTask, message: str, done: set[str]) -> None:
        """Record the unfinished methods of a task as failed, because its process ended."""
        why = f"{self.sources[task.pair].folder}: {message}."
        self._tell_failure({"pair": task.pair, "message": why})
        for method in self._run.methods:
            if method.label not in done:
                row = task.rows.get(method.label) or make_failed_row(task.pair, method, task.keys[method.label], why)
                self.log.append(row)
                self._tell_progress(row)

    def _tell_notes(self, pair: str, facts: Mapping[str, Any]) -> None:
        """Report each kind of note and warning once, and each pair that fails its self-check."""
        folder = self.sources[pair].folder
        for kind in ("note", "warning"):
            for message in facts.get(f"{kind}s", ()):
                if message not in self._warned:
                    self._warned.add(message)
                    self._tell({"type": kind, "message": f"{folder}: {message}"})
        if not facts["self_check"]["ok"]:
            message = f"{folder} is left out of the averages: {'; '.join(facts['self_check']['problems'])}."
            self._suspect.append({"pair": pair, "message": message})
            self._tell({"type": "warning", "message": message})

    def _tell_progress(self, row: Row) -> None:
        self._done += 1
        self._tell(
            {
                "type": "progress",
                "fraction": self._done / self._total,
                "done": self._done,
                "total": self._total,
                "message": f"{row['pair']} {describe_method(row['method'])}",
            }
        )

    def _tell_failure(self, failure: Failure) -> None:
        self._failed.append(failure)
        self._tell({"type": "error", "message": failure["message"]})

    def sort_messages(self) -> tuple[list[Failure], list[Failure]]:
        """Return the messages about failed pairs and about suspect pairs, both in the order of the pairs."""
        place = {name: k for k, name in enumerate(self.sources)}
        failed, suspect = (
            sorted(found, key=lambda entry: place[entry["pair"]]) for found in (self._failed, self._suspect)
        )
        return failed, suspect


def _read_facts(out: Path, pair: str, content: str) -> dict[str, Any] | None:
    """Read the facts of a pair from an earlier run; None if its content differs or its pictures are missing."""
    facts = find_facts(out, pair)
    return facts if facts and facts["key"] == content and has_named_files(facts, out, pair) else None


def _describe_source(paths: Sequence[Path], response: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "source": ", ".join(str(path.resolve()) for path in paths),
        "response_overrides": {
            f"{topic}.{key}": value for topic, values in response.items() for key, value in values.items()
        },
    }
