"""Measure pairs in several processes.

Each process is started once and measures pair after pair: it reads a line of JSON with a task, and writes a line for
each event of ``measure_pair``. Only the process that started them writes rows, so a log has one writer. The processes
end when their input ends, however the starting process ends.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

from ..render.workers.job_commands import python_command
from ..render.workers.process import clean_environment
from ..support.errors import DiskError, IcyMoonError
from ..support.file_schemas import TEXT, find_fault
from ..support.foreign_bytes import parse_json
from ..support.system import KEEPS_MEMORY, count_processors, kill_all, start
from .datasets.predictions import PREDICTION
from .evaluated_pairs import find_sources
from .evaluation_files import remove_leftovers
from .matchers import uses_one_processor
from .matchers.lidar_options import LIDAR
from .matchers.methods import Method
from .matchers.resident_process import stop_residents
from .measure_pair import MeasureRun, MeasureTask, measure_pair

#: Least number of pairs for each process: its start costs as much as measuring one or two.
_PAIRS_EACH = 4
_LOOK_S = 0.25


def choose_process_count(jobs: int | None, methods: Sequence[Method], pairs: int) -> int:
    """Choose the number of measuring processes: ``jobs``, or as many as processors and pairs allow; 1 means this
    process.
    """
    if jobs is not None:
        return jobs
    if not all(method.name in (PREDICTION, LIDAR) or uses_one_processor(method.name) for method in methods):
        return 1
    return max(1, min(count_processors(), pairs // _PAIRS_EACH))


class MeasuringProcesses:
    """Processes that measure; each is started when there is a task for it."""

    def __init__(self, count: int, paths: Sequence[Path], run: MeasureRun) -> None:
        self._count, self._out = count, run.out
        self._setup = {
            "paths": [str(path) for path in paths],
            "methods": [asdict(method) for method in run.methods],
            "out": str(run.out),
            "response": run.response,
            "points": run.points,
            "maps": run.maps,
            "confidence": list(run.confidence),
        }
        self._said: queue.SimpleQueue[tuple[_Process, dict[str, Any] | None]] = queue.SimpleQueue()

    def measure(self, tasks: Iterator[MeasureTask]) -> Iterator[tuple[MeasureTask, dict[str, Any]]]:
        """Run all tasks, and yield each event with its task. If a process ended, yield {"type": "died", "message"} with
        the reason and the fix.

        Raises DiskError if a file cannot be written.
        """
        idle: list[_Process] = []
        busy: dict[_Process, MeasureTask] = {}
        try:
            while True:
                while len(busy) < self._count and (task := next(tasks, None)) is not None:
                    process = idle.pop() if idle else _Process(self._setup, self._said)
                    busy[process] = task
                    process.send(asdict(task))
                if not busy:
                    return
                process, event = self._wait_for_event()
                task = busy[process]
                if event is None:
                    del busy[process]
                    process.kill()
                    yield (
                        task,
                        {
                            "type": "died",
                            "message": f"the process that measured it {process.end()}; there may "
                            "be too little memory, try fewer --jobs",
                        },
                    )
                elif event["type"] == "done":
                    idle.append(process)
                    del busy[process]
                elif event["type"] == "disk":
                    raise DiskError(event["message"])
                else:
                    yield task, event
        finally:
            for process in (*idle, *busy):
                process.kill()
            remove_leftovers(self._out)  # the messages that each was writing when it was ended

    def _wait_for_event(self) -> tuple[_Process, dict[str, Any] | None]:
        while True:  # Windows cannot interrupt a longer wait
            try:
                return self._said.get(timeout=_LOOK_S)
            except queue.Empty:
                continue


class _Process:
    """A process that measures pairs."""

    def __init__(self, setup: dict[str, Any], said: queue.SimpleQueue[Any]) -> None:
        try:
            self._process = start(
                python_command(sys.executable, "measure"),
                KEEPS_MEMORY | clean_environment(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
        except OSError as error:
            raise IcyMoonError(
                f"{sys.executable} cannot be started again ({error.strerror or error}); use --jobs 1."
            ) from None
        self._reader = threading.Thread(target=self._queue_events, args=(said,), daemon=True)
        self._reader.start()
        self.send(setup)

    def _queue_events(self, said: queue.SimpleQueue[Any]) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                try:
                    event = parse_json(line)
                except ValueError:  # it ended within a line, or a library wrote where only events go
                    break
                if find_fault(event, {"type": TEXT}):
                    break
                said.put((self, event))
        said.put((self, None))

    def send(self, data: dict[str, Any]) -> None:
        """Write a line to the process. Does nothing if the process has ended, which its reader notices."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.write((json.dumps(data) + "\n").encode())
            self._process.stdin.flush()

    def end(self) -> str:
        """Wait for the end of the process, and describe how it ended in words that end a sentence."""
        status = self._process.wait()
        return f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"

    def kill(self) -> None:
        """End the process at once, with all processes that it has started."""
        kill_all(self._process)
        self._reader.join()
        assert self._process.stdin is not None
        with suppress(OSError):  # input that it has not read
            self._process.stdin.close()


def main(arguments: Sequence[str]) -> int:
    """Run the program of a measuring process: do the tasks from the standard input until it ends. Return the
    exit code.
    """
    del arguments
    lines = sys.stdin.buffer
    with _take_standard_output() as out:
        first = lines.readline()
        if not first:
            return 0
        setup = json.loads(first)
        sources = {source.name: source for source in find_sources([Path(path) for path in setup["paths"]])}
        run = MeasureRun(
            [Method(**method) for method in setup["methods"]],
            Path(setup["out"]),
            setup["response"],
            setup["points"],
            setup["maps"],
            setup["confidence"],
        )
        try:
            for line in lines:
                task = MeasureTask(**json.loads(line))
                for event in measure_pair(sources[task.pair], run, task):
                    _write_event(out, event)
                _write_event(out, {"type": "done"})
        except DiskError as error:
            _write_event(out, {"type": "disk", "message": str(error)})
            return 1
        finally:
            stop_residents()
    return 0


def _take_standard_output() -> IO[bytes]:
    """Reserve the standard output for our lines; libraries print to standard error from now on."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return out


def _write_event(out: IO[bytes], event: dict[str, Any]) -> None:
    out.write((json.dumps(event, allow_nan=False) + "\n").encode())
    out.flush()
