"""Starts, reads and stops another process. Imports no Blender.

A worker reports its progress in JSON lines on its standard output. The last of its other lines are kept for the error
after a crash. It may be killed at any moment, because unfinished files never have a final name.
"""

from __future__ import annotations

import os
import queue
import re
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO, Any, Protocol

from ...support import system
from ...support.errors import IcyMoonError
from ...support.file_schemas import TEXT, find_fault
from ...support.foreign_bytes import parse_json
from ...support.printer import emit

Message = dict[str, Any]
_STOP_GRACE_S = 3.0
_TRACEBACK_START = "Traceback (most recent call last):"
#: Lines that Blender prints at every end.
_END_LINES = re.compile(r"Blender (quit|\d+\.\d+.*)|Error: script failed, .*, exiting\.")

#: Exit statuses of a process that was killed: by signal 9, and as a shell states it.
_KILLED = (-9, 137)


class Ended(Protocol):
    """A process that has ended."""

    @property
    def returncode(self) -> int | None:
        """Exit status."""

    @property
    def cause(self) -> str:
        """The line that best explains why the process ended."""


def describe_end(process: Ended) -> str:
    """Describe how a process ended that reported neither a result nor an error, in words to append to its name. If it
    was killed, they contain a remedy."""
    if process.returncode in _KILLED:
        return "was killed, often for lack of memory; close other programs or choose a smaller scene, then try again"
    return f"ended without a result (status {process.returncode}): {process.cause}"


class ProcessOutput:
    """Sorts the output of a process into messages and other lines. It keeps the last of the other lines.

    ``cancelled`` is whether the process was told to stop, ``left`` whether it was left running.
    """

    def __init__(self) -> None:
        self._tail: deque[str] = deque(maxlen=30)
        self.cancelled = self.left = False

    def _read_line(self, line: str) -> Message | None:
        """Parse the message in a line; None for other lines, which are stored."""
        message = _parse_message(line)
        if message is None:
            self._tail.append(line.rstrip())
        return message

    @property
    def cause(self) -> str:
        """The line that best explains why the process ended, for errors that it could not report.

        The line is the error of the last traceback, or else the last line that is neither a message nor printed at
        every end.
        """
        lines = [line for line in self._tail if line.strip()]
        of_traceback = None
        for position, line in enumerate(lines):
            if _TRACEBACK_START in line:
                of_traceback = next((each for each in lines[position + 1 :] if not each[0].isspace()), None)
        return of_traceback or next(
            (line for line in reversed(lines) if not _END_LINES.fullmatch(line)),
            lines[-1] if lines else "it printed nothing",
        )


@contextmanager
def report_errors(as_json: bool) -> Iterator[None]:
    """Print the error that ends the program, also as a JSON line if ``as_json``."""
    try:
        yield
    except IcyMoonError as error:
        if as_json:
            emit("error", message=str(error))
        raise


class Process(ProcessOutput):
    """A running worker. ``poll`` never waits, so a modal operator can call it on a timer."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
        """Start ``command`` (a list, never a shell line). Raises IcyMoonError if it cannot start."""
        super().__init__()
        try:
            self._process = system.start_dependent(command, environment)
        except OSError as error:
            raise IcyMoonError(f"Cannot start {command[0]}: {error.strerror or error}; check its path.") from None
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._queue_lines, args=(self._process.stdout,), daemon=True)
        self._reader.start()
        self._ended = False

    def _queue_lines(self, stream: IO[bytes]) -> None:
        for line in stream:
            self._lines.put(line.decode("utf-8", "replace"))
        self._lines.put(None)

    def poll(self) -> list[Message]:
        """Return the process's messages since the last call."""
        messages = []
        while not self._lines.empty():
            line = self._lines.get()
            if line is None:
                self._ended = True
                self._process.wait()
            elif (message := self._read_line(line)) is not None:
                messages.append(message)
        return messages

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether more messages may follow."""
        return not self._ended

    @property
    def returncode(self) -> int:
        """Exit status after the end; negative for a signal."""
        return self._process.wait()

    def wait_for_messages(self) -> Iterator[Message]:
        """Wait for all messages until the end, and yield them."""
        while self.running:
            yield from self.poll()
            time.sleep(0.05)
        yield from self.poll()

    def cancel(self) -> None:
        """Ask the process to stop, and kill it if it runs on for a few seconds."""
        self.cancelled = True
        system.interrupt(self._process)
        threading.Thread(target=self._kill_if_running, daemon=True).start()

    def _kill_if_running(self) -> None:
        try:
            self._process.wait(_STOP_GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def stop(self) -> None:
        """End the process at once, if it runs, and wait until it is gone."""
        if self._process.poll() is None:
            self.cancelled = True
            self._process.kill()
        self._process.wait()


def _parse_message(line: str) -> Message | None:
    if not line.startswith("{"):
        return None
    try:
        message = parse_json(line)
    except ValueError:
        return None
    return None if find_fault(message, {"type": TEXT}) else dict(message)


def clean_environment() -> dict[str, str]:
    """Return our environment without the variables that make another Python load Blender's modules."""
    return {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP")}
