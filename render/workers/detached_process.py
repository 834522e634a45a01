"""A process that may outlive its starter, and that a later process can attach to. Imports no Blender.

Its output goes to a log file instead of a pipe. It inherits a locked file as its standard input, and the system
releases the lock at every kind of end. The watcher holds another lock. So a process number that the system gives again
is never mistaken for this process.
"""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from ...support import system
from ...support.errors import IcyMoonError
from ...support.file_schemas import NUMBER, PATH, PROCESS, TEXT, read_record
from ...support.files import explain_disk_errors
from .process import ProcessOutput

#: The facts that are written about a process.
_FACTS_SHAPE = {"pid": PROCESS, "started": NUMBER, "title": TEXT, "dataset": PATH}
_STOP_GRACE_S = 3.0
_POLL_S = 0.05


class DetachedProcess(ProcessOutput):
    """A running process whose output goes to ``<stem>.log``.

    With ``leave`` it continues when its watcher ends. Beside the log lie ``.lock`` (held by the process),
    ``.watch`` (held by the watcher) and ``.json`` (facts about the process).
    """

    def __init__(
        self, stem: Path, facts: Mapping[str, Any], watch: IO[bytes], process: subprocess.Popen[bytes] | None
    ) -> None:
        """Watch a process; call ``start`` or ``attach`` instead."""
        super().__init__()
        self.facts, self.leave = dict(facts), False
        self._stem, self._watch, self._process = stem, watch, process
        self._pid = int(facts["pid"])
        self._log = system.open_regular(stem.with_suffix(".log"))
        self._begun_line = b""
        self._ended = False

    @classmethod
    def start(
        cls, command: Sequence[str], stem: Path, facts: Mapping[str, Any], environment: Mapping[str, str] | None = None
    ) -> DetachedProcess:
        """Start ``command`` (a list, never a shell line).

        Raises IcyMoonError if it cannot start, or if a process of this name still runs.
        """
        with explain_disk_errors("write to", stem.parent):
            stem.parent.mkdir(parents=True, exist_ok=True)
            watch = system.lock(stem.with_suffix(".watch"))
            lock = system.lock_for_child(stem.with_suffix(".lock")) if watch is not None else None
            if watch is None or lock is None:
                raise IcyMoonError(
                    f"{facts['title']} is running already for {facts['dataset']}; wait for it, or stop it where you "
                    "started it."
                )
            with lock, stem.with_suffix(".log").open("wb") as log:
                try:
                    process = system.start_detached(command, environment, lock, log, stem.with_suffix(".stop"))
                except OSError as error:
                    watch.close()
                    raise IcyMoonError(
                        f"Cannot start {command[0]}: {error.strerror or error}; check its path."
                    ) from None
            facts = {**facts, "pid": process.pid, "started": time.time()}
            stem.with_suffix(".json").write_text(json.dumps(facts), encoding="utf-8")
        return cls(stem, facts, watch, process)

    @classmethod
    def attach(cls, stem: Path) -> DetachedProcess | None:
        """Attach to the process of this name, if it runs without a watcher; else None."""
        try:
            facts = read_record(stem.with_suffix(".json"), _FACTS_SHAPE, "delete it")
            if not system.is_lock_held(stem.with_suffix(".lock")):
                return None
            watch = system.lock(stem.with_suffix(".watch"))
            return cls(stem, facts, watch, None) if watch is not None else None
        except (OSError, IcyMoonError):
            return None

    def poll(self) -> list[dict[str, Any]]:
        """Return the messages since the last call."""
        gone = not self._is_alive()  # checked before reading, so that the file then has its last lines
        *lines, self._begun_line = (self._begun_line + self._log.read()).split(b"\n")
        if gone:
            lines, self._begun_line = [*lines, self._begun_line], b""
            self._close()
        return [message for line in lines if (message := self._read_line(line.decode("utf-8", "replace"))) is not None]

    def _is_alive(self) -> bool:
        if self._ended:
            return False
        if self._process is not None:
            return self._process.poll() is None
        return system.is_lock_held(self._stem.with_suffix(".lock"))

    def _close(self) -> None:
        if not self._ended:
            self._ended = True
            self._watch.close()

    @property
    def running(self) -> bool:
        """Whether more messages may follow."""
        return not self._ended

    @property
    def returncode(self) -> int | None:
        """Exit status of the ended process; None if this program did not start the process."""
        return self._process.wait() if self._process is not None else None

    def cancel(self) -> None:
        """Ask the process to stop, and kill it if it runs on for a few seconds."""
        self.cancelled = True
        if self._is_alive():
            system.interrupt_detached(self._pid, self._stem.with_suffix(".stop"))
        threading.Thread(target=self._kill_if_running, daemon=True).start()

    def _kill_if_running(self) -> None:
        end = time.monotonic() + _STOP_GRACE_S
        while self._is_alive() and time.monotonic() < end:
            time.sleep(_POLL_S)
        if self._is_alive():
            system.kill_detached(self._pid)

    def stop(self) -> None:
        """End the process at once and wait until it is gone; with ``leave``, only stop watching it."""
        if self.leave and self._is_alive():
            self.left = True
            self._close()
            return
        if self._is_alive():
            self.cancelled = True
            system.kill_detached(self._pid)
        while self._is_alive():
            time.sleep(_POLL_S)
        self._close()


def find_unwatched_process(folder: Path) -> DetachedProcess | None:
    """Find a process without a watcher whose files lie in ``folder``; None without such a process."""
    for file in sorted(folder.glob("*.lock")):
        found = DetachedProcess.attach(file.with_suffix(""))
        if found is not None:
            return found
    return None
