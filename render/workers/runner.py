"""Renders the pairs of a data set with several worker processes, and retries the pairs of a crashed worker. Imports no
Blender.

This process holds nothing that could be lost. The data set contains its plan, the disk shows which pairs are complete,
and a pair in progress belongs to the holder of its claim.
"""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...settings.description import Restorer
from ...support.errors import IcyMoonError
from ...support.file_schemas import FLAG, NUMBER, TABLE, TEXT, Maybe, Shape, find_fault
from ...support.number_text import format_count
from ..pairs.baked_file import LIGHT
from ..pairs.dataset_file_names import check_no_link, folder_of_pair, pairs_folder
from ..pairs.pair_folder import has_response, is_complete, read_complete, update_response
from ..plans.planned_pair import PlannedPair
from ..plans.render_order import DEFAULT_MAX_SCENES, cut_into_jobs
from .assign_cards import ALL_CARDS, Cards, add_cards, choose_worker_cards
from .job_commands import Job, blender_command
from .pair_claims import CLAIMS_FOLDER, Claims
from .process import Message, Process, describe_end

Send = Callable[..., None]
#: Number of crashes of its worker after which a pair is set aside.
MAX_CRASHES = 3
#: Seconds after which a worker that has reported its end is killed, since the Blender module may hang when it ends.
_MAX_EXIT_S = 10.0
#: Seconds without a message after which a worker may hang, so its other pairs are given to idle workers.
_SUSPECT_AFTER_S = 300.0
#: Seconds between steps of the runner, and between looks at pairs that other processes render.
_STEP_S, _WAIT_S = 0.05, 1.0
#: Seconds between looks on the disk for the pairs of a silent worker: each look reads all their pair.json.
_POLL_PAIRS_S = 5.0
#: The messages of workers that are read here.
_MESSAGE_SHAPES: dict[str, Shape] = {
    "progress": {"pair": Maybe(TEXT), "of_pair": Maybe(NUMBER)},
    "pair": {"id": TEXT},
    "warning": {"message": TEXT},
    "error": {"message": TEXT, "pair": Maybe(TEXT), "crash": Maybe(FLAG)},
    "done": {},
}


@dataclass(frozen=True)
class WorkerOptions:
    """Options of the worker processes.

    ``count`` processes render with ``threads`` threads each (0: all) in the Blender ``blender``. A process renders at
    most ``most_scenes`` scenes before another process replaces it. A process that sends nothing for ``silence_s``
    seconds is ended. For ``cards`` see ``choose_worker_cards``.
    """

    count: int
    threads: int
    blender: str
    most_scenes: int = DEFAULT_MAX_SCENES
    silence_s: float = 3600.0
    cards: Cards = ALL_CARDS


@dataclass
class _Worker:
    """A process with its pairs."""

    job: Job
    process: Process
    pairs: list[PlannedPair]
    place: int = 0  # number among the workers that run at the same time
    heard: float = field(default_factory=time.monotonic)
    looked: float = -math.inf  # time of the last search on the disk for its pairs
    left: list[PlannedPair] = field(default_factory=list)  # its pairs that were missing then
    current: str = ""  # the pair in progress
    fraction: float = 0.0  # the finished fraction of that pair
    error: str = ""  # the error that the worker reported
    fatal: bool = False
    spoke: bool = False
    done: bool = False

    def close(self) -> None:
        """End the process and remove its leftovers."""
        self.process.stop()
        self.job.discard()


class Runner:
    """Renders the missing ``pairs`` into a data set.

    ``send(type, **facts)`` receives ``progress`` (``fraction``, ``message``, ``done``, ``total``), ``pair`` and
    ``warning`` messages, and ``error`` messages of pairs that are set aside, with ``pair``.
    """

    def __init__(self, dataset: Path, pairs: Sequence[PlannedPair], workers: WorkerOptions, send: Send) -> None:
        self._dataset, self._pairs, self._options, self._send = dataset, list(pairs), workers, send
        self._claims = Claims(dataset)
        self._running: list[_Worker] = []
        self._queue: deque[list[PlannedPair]] = deque()
        self._crashes: Counter[str] = Counter()
        self._silent_ends = 0  # number of workers in a row that ended without a message
        self._complete: set[str] = set()
        self._warned: set[str] = set()
        self._known = {None, *(pair.id for pair in self._pairs)}
        self.failed: dict[str, str] = {}

    def run(self) -> dict[str, str]:
        """Render until each pair is complete or set aside. Return by id the reasons why pairs were set aside.

        Raises IcyMoonError if nothing can be rendered (the disk is full, Blender does not start). All workers have
        ended at every kind of end.
        """
        check_no_link(pairs_folder(self._dataset), self._dataset / CLAIMS_FOLDER, self._dataset / LIGHT)
        try:
            self._claims.remove_leftovers()
            restore = Restorer()
            for pair in self._pairs:
                if data := read_complete(pair.folder(self._dataset)):
                    self._update_response(pair, data, restore)
            self._report_progress()
            while missing := self._find_missing():
                self._enqueue(missing)
                while self._queue or self._running:
                    self._step_workers()
                    time.sleep(_STEP_S)
                if missing == self._find_missing():  # other runners render all missing pairs
                    self._report_progress(missing)
                    time.sleep(_WAIT_S)
        finally:
            for worker in self._running:
                worker.close()
            self._claims.remove_leftovers()
        return self.failed

    def _update_response(self, pair: PlannedPair, data: dict[str, Any], restore: Restorer) -> None:
        """Count a complete pair with this ``pair.json``, and write the camera response of this plan into it."""
        folder = pair.folder(self._dataset)
        try:
            if not has_response(folder, data, pair.settings, restore):
                update_response(folder, pair.settings)
            self._complete.add(pair.id)
        except IcyMoonError as error:
            self.failed[pair.id] = str(error)
            self._send("error", message=str(error), pair=pair.id)

    def _find_missing(self) -> list[PlannedPair]:
        """Find the pairs that are neither complete nor set aside."""
        for pair in self._pairs:
            if pair.id not in self._complete and is_complete(pair.folder(self._dataset)):
                self._report_pair(pair.id)
        return [pair for pair in self._pairs if pair.id not in self._complete and pair.id not in self.failed]

    def _enqueue(self, missing: list[PlannedPair]) -> None:
        """Cut the missing pairs that no other process renders into jobs."""
        busy = self._claims.find_claimed_elsewhere()
        jobs = cut_into_jobs(
            [pair for pair in missing if pair.id not in busy], self._options.count, self._options.most_scenes
        )
        self._queue.extend(jobs)

    def _step_workers(self) -> None:
        """Start workers, handle their messages, and finish the workers that have ended."""
        while self._queue and len(self._running) < self._options.count:
            self._start_worker(self._queue.popleft())
        for worker in list(self._running):
            for message in worker.process.poll():
                worker.heard, worker.spoke = time.monotonic(), True
                self._handle_message(worker, message)
            silent = time.monotonic() - worker.heard
            if silent > self._find_silence_limit_s(worker, silent):
                worker.error = worker.error or f"it sent nothing for {silent:.0f} s"
                worker.process.stop()
            elif silent > _SUSPECT_AFTER_S and len(self._running) < self._options.count and not self._queue:
                self._reassign(worker)
            if not worker.process.running:
                self._running.remove(worker)
                self._finish_worker(worker)

    def _find_silence_limit_s(self, worker: _Worker, silent: float) -> float:
        """Find the seconds for which a worker may be silent; they are few if all its pairs are complete, perhaps by
        other processes."""
        idle = worker.done or (silent > _MAX_EXIT_S and not self._get_pairs_left(worker))
        return _MAX_EXIT_S if idle else self._options.silence_s

    def _get_pairs_left(self, worker: _Worker) -> list[PlannedPair]:
        """Return the result of ``_find_pairs_left``, which may be some seconds old."""
        now = time.monotonic()
        if now - worker.looked > _POLL_PAIRS_S:
            worker.looked, worker.left = now, self._find_pairs_left(worker)
        return worker.left

    def _find_pairs_left(self, worker: _Worker) -> list[PlannedPair]:
        """Find those pairs of a worker that are neither complete nor set aside. A complete pair is never checked
        again."""
        for pair in worker.pairs:
            if pair.id not in self._complete and is_complete(pair.folder(self._dataset)):
                self._report_pair(pair.id)
        return [pair for pair in worker.pairs if pair.id not in self.failed and pair.id not in self._complete]

    def _reassign(self, worker: _Worker) -> None:
        """Give the pairs that a worker has not begun to another worker. If the first worker continues, it finds them
        complete or claimed.
        """
        waiting = [pair for pair in self._get_pairs_left(worker) if pair.id != worker.current]
        if waiting:
            given = {pair.id for pair in waiting}
            worker.pairs = [pair for pair in worker.pairs if pair.id not in given]
            worker.left = [pair for pair in worker.left if pair.id not in given]
            self._queue.append(waiting)

    def _start_worker(self, pairs: list[PlannedPair]) -> None:
        job = Job(self._dataset, pairs=pairs, threads=self._options.threads)
        taken = {worker.place for worker in self._running}
        place = next(place for place in range(len(taken) + 1) if place not in taken)
        try:
            process = Process(
                blender_command(self._options.blender, "worker", str(job.file)),
                add_cards(None, choose_worker_cards(self._options.cards, place, self._options.count)),
            )
        except IcyMoonError:
            job.discard()
            raise
        self._running.append(_Worker(job, process, pairs, place))

    def _handle_message(self, worker: _Worker, message: Message) -> None:
        kind = message["type"]
        named = {message.get("pair"), message.get("id")}
        if find_fault(message, _MESSAGE_SHAPES.get(kind, TABLE)) or not self._known >= named:
            return  # other code in that process printed it
        if kind == "progress" and "pair" in message:
            worker.current, worker.fraction = message["pair"], message.get("of_pair", 0.0)
            self._report_progress()
        elif kind == "pair":
            worker.current, worker.fraction = "", 0.0
            if is_complete(folder_of_pair(self._dataset, message["id"])):
                self._report_pair(message["id"], message)
            else:
                self._count_crash(message["id"], "its files differ from the written ones")
        elif kind == "warning" and message["message"] not in self._warned:
            self._warned.add(message["message"])
            self._send("warning", message=message["message"])
        elif kind == "error" and "pair" in message:
            worker.current = ""
            self._set_aside(message["pair"], message["message"])
        elif kind == "error":
            worker.error, worker.fatal = message["message"], not message.get("crash")
        elif kind == "done":
            worker.done = True

    def _finish_worker(self, worker: _Worker) -> None:
        """Find out from the disk which pairs a worker has finished, and give the others to another worker."""
        worker.close()
        self._claims.remove_leftovers_of(worker.process.pid)
        if worker.fatal:
            raise IcyMoonError(worker.error)
        self._silent_ends = 0 if worker.spoke else self._silent_ends + 1
        why = worker.error or f"Blender {describe_end(worker.process)}"
        if self._silent_ends >= MAX_CRASHES:
            raise IcyMoonError(f"The worker does not start: {why}.")
        if worker.current and not is_complete(folder_of_pair(self._dataset, worker.current)):
            self._count_crash(worker.current, why)
        left = self._find_pairs_left(worker)
        if left and not worker.done:
            self._queue.append(left)

    def _report_pair(self, name: str, message: dict[str, Any] | None = None) -> None:
        if name not in self._complete:
            self._complete.add(name)
            facts = {
                "folder": str(folder_of_pair(self._dataset, name)),
                "rendered": False,
                **(message or {}),
                "id": name,
                "done": len(self._complete),
                "total": len(self._pairs),
            }
            facts.pop("type", None)
            self._send("pair", **facts)
            self._report_progress()

    def _count_crash(self, name: str, why: str) -> None:
        self._crashes[name] += 1
        if self._crashes[name] >= MAX_CRASHES:
            self._set_aside(name, f"Pair {name} failed {MAX_CRASHES} times: {why.rstrip('.')}.")

    def _set_aside(self, name: str, why: str) -> None:
        if not is_complete(folder_of_pair(self._dataset, name)):
            self.failed[name] = why
            self._send("error", message=why, pair=name)

    def _report_progress(self, waiting: Sequence[PlannedPair] = ()) -> None:
        """Report the progress, and the pairs of other processes that the runner is ``waiting`` for."""
        total = max(1, len(self._pairs))
        fraction = (len(self._complete) + sum(w.fraction for w in self._running if w.current)) / total
        text = f"{len(self._complete)} of {format_count(len(self._pairs), 'pair')}"
        if waiting:
            holder = self._claims.describe_holder(waiting[0].id)
            text += f"; others render {len(waiting)}, such as {waiting[0].id} by {holder}"
        self._send(
            "progress",
            fraction=round(min(1.0, fraction), 6),
            done=len(self._complete),
            total=len(self._pairs),
            message=text,
        )
