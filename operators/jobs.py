"""Jobs: long work in another process or thread, which is polled so that the window stays usable."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import bpy

from ..render.cost.estimate import format_duration
from ..render.graphics_cards import find_selected_cards
from ..render.workers.assign_cards import ENVIRONMENT, add_cards
from ..render.workers.detached_process import DetachedProcess
from ..render.workers.process import Message, Process, clean_environment, describe_end
from ..render.workers.watched_thread import Calculation
from ..support.errors import IcyMoonError
from .work_in_pieces import WorkInPieces

#: Seconds between two checks of a job.
INTERVAL_S = 0.1
#: The remaining time is shown from this finished share on, or after this number of seconds.
_MIN_SHARE, _MIN_SECONDS = 0.1, 600.0
#: Seconds within which a second Esc stops a job.
ESCAPE_S = 2.0
#: Seconds from which on a text states how long a job without progress has run.
_LONG_S = 5


def make_environment_with_cards(device: str, environment: Mapping[str, str] | None = None) -> Mapping[str, str] | None:
    """Return the environment of a process that renders on ``device`` (None for the environment of this process).

    For a GPU, it names the graphics cards that are ticked in Blender's preferences, unless this process's environment
    already names cards.
    """
    if device != "GPU" or ENVIRONMENT in os.environ:
        return environment
    return add_cards(environment, find_selected_cards())


def find_this_blender() -> str:
    """Find the program that starts another Blender like this one: Blender, or Python if Blender is its module."""
    return str(bpy.app.binary_path or sys.executable)


@dataclass(frozen=True)
class Expectation:
    """An estimate of a job's duration, made before the job: ``seconds`` by the clock. In 19 of 20 cases the job takes
    at most ``factor`` times as long."""

    seconds: float
    factor: float

    def describe(self, past_s: float) -> str:
        """Describe the remaining time by the estimate, ``past_s`` seconds after the start, or how the estimate
        failed."""
        if past_s < self.seconds:
            return f"About {format_duration(self.seconds - past_s)} left, by estimate"
        if past_s < self.seconds * self.factor:
            longest = format_duration(self.seconds * self.factor)
            return f"Estimate {format_duration(self.seconds)}; may take {longest}"
        return f"Longer than the estimate of {format_duration(self.seconds)}"


def _find_scene_uid() -> int:
    """Return the ``session_uid`` of the window's scene; 0 without a scene."""
    scene = bpy.context.scene
    return scene.session_uid if scene is not None else 0


@dataclass
class Job:
    """A running process or thread and its reports so far, which the panel shows."""

    title: str
    process: Process | DetachedProcess | Calculation | WorkInPieces
    handle: Callable[[Message], object] = lambda message: None  # called with every message
    clean_up: Callable[[], object] = lambda: None  # called when the job ends, with or without success
    started: float = field(default_factory=time.monotonic)
    fraction: float = 0.0
    text: str = ""
    error: str = ""
    warnings: list[str] = field(default_factory=list)
    result: Message = field(default_factory=dict)  # the message of type done or result; empty until then
    if_stopped: str = "what was finished is kept"
    scene_uid: int = field(default_factory=_find_scene_uid)  # the scene in which the job was started
    escaped: float | None = None  # when Esc was pressed last
    expected: Expectation | None = None  # shown until the progress gives the remaining time

    @classmethod
    def start(
        cls,
        title: str,
        command: Sequence[str],
        handle: Callable[[Message], object] = lambda message: None,
        clean_up: Callable[[], object] = lambda: None,
        *,
        device: str = "CPU",
        clean: bool = True,
        if_stopped: str = if_stopped,
    ) -> Self:
        """Start a command that renders on ``device``, in a ``clean_environment`` or in this one.

        Raises IcyMoonError, after ``clean_up``, if it cannot start.
        """
        try:
            process = Process(command, make_environment_with_cards(device, clean_environment() if clean else None))
        except IcyMoonError:
            clean_up()
            raise
        return cls(title, process, handle, clean_up, if_stopped=if_stopped)

    @property
    def shown(self) -> tuple[str, str]:
        """The text on the bar and the line below it: the remaining time, or a hint that another Esc stops the job."""
        text = "Stopping" if self.process.cancelled else self.text or self.title
        return f"{text}{self.percent}", self._hint or self._left or ("Under way" if self.fraction > 0 else "Starting")

    @property
    def past_s(self) -> int:
        """Whole seconds since the job began."""
        return int(time.monotonic() - self.started)

    @property
    def so_far(self) -> str:
        """Text after the title of a job that reports no progress, such as ', 12 s so far'; empty at first."""
        return f", {self.past_s} s so far" if self.past_s >= _LONG_S else ""

    @property
    def percent(self) -> str:
        """The finished share as text after a title, such as '  33 %'; empty before the first report of progress."""
        return f"  {int(100 * self.fraction)} %" if self.fraction > 0 else ""

    @property
    def brief(self) -> str:
        """Text for the status bar: title, finished share, and remaining time or the hint on Esc."""
        return f"{self.title}{self.percent}  {self._hint or self._left}".rstrip()

    @property
    def _left(self) -> str:
        """The remaining time, by the progress or until then by the estimate; empty if neither is known."""
        if self.expected is None or self.process.cancelled or self.remaining_s is not None:
            return format_remaining(self.remaining_s)
        return self.expected.describe(time.monotonic() - self.started)

    @property
    def _hint(self) -> str:
        waits = self.escaped is not None and time.monotonic() < self.escaped + ESCAPE_S
        return "Press Esc again to stop" if waits and not self.process.cancelled else ""

    @property
    def remaining_s(self) -> float | None:
        """Estimate of the remaining seconds. None at first, because the process's start-up would distort the
        estimate."""
        past_s = time.monotonic() - self.started
        if self.fraction <= 0.02 or (self.fraction < _MIN_SHARE and past_s < _MIN_SECONDS):
            return None
        return past_s * (1.0 - self.fraction) / self.fraction

    def poll(self) -> bool:
        """Handle the new messages. Return False when the job has ended."""
        running = self.process.running
        for message in self.process.poll():
            self.hear(message)
            self.handle(message)
        return running

    def hear(self, message: Message) -> None:
        """Handle one message of the process."""
        kind = message["type"]
        if kind == "progress":
            self.fraction = float(message["fraction"])
            self.text = str(message["message"])
        elif kind == "warning":
            self.warnings.append(str(message["message"]))
        elif kind == "error":
            self.error = str(message["message"])
        elif kind in ("done", "result"):
            self.result = message

    @property
    def failure(self) -> str:
        """The reason why the job failed; empty if it succeeded."""
        if self.process.cancelled:
            return f"{self.title} was stopped; {self.if_stopped}."
        if self.error or self.result:
            return self.error
        return f"{self.title} {describe_end(self.process)}"

    def cancel(self) -> None:
        """Ask the job to stop; it ends within seconds."""
        self.process.cancel()

    def escape(self) -> bool:
        """Handle a press of Esc. A second press within ``ESCAPE_S`` stops the job. Returns whether the job stops.

        One press is not enough, because Esc also leaves a text field, a menu or a tool.
        """
        now = time.monotonic()
        again = self.escaped is not None and now < self.escaped + ESCAPE_S
        self.escaped = None if again else now
        if again:
            self.cancel()
        return again

    @property
    def outcome(self) -> str:
        """The way in which the job ended, in a word or two."""
        if self.process.left:
            return "goes on in the background"
        if self.process.cancelled:
            return "stopped"
        return "failed" if self.failure else "done"

    @property
    def remains(self) -> str:
        """The things that a stopped job left, as a sentence; empty if the job was not stopped."""
        was_stopped = self.process.cancelled and not self.process.left
        return f"{self.if_stopped[:1].upper()}{self.if_stopped[1:]}" if was_stopped else ""

    def close(self) -> None:
        """Stop the job at once if it has not ended, and clean up. A second call does nothing."""
        clean_up, self.clean_up = self.clean_up, lambda: None
        self.process.stop()
        clean_up()

    def run_to_end(self) -> None:
        """Wait until the job has ended. Raises IcyMoonError if it failed."""
        try:
            while self.poll():
                time.sleep(INTERVAL_S)
        finally:
            self.close()
        if self.failure:
            raise IcyMoonError(self.failure)


def format_remaining(seconds: float | None) -> str:
    """Format remaining seconds as '1:05 left', '2:03:20 left', 'Almost done' below a second, or '' for None."""
    if seconds is None:
        return ""
    if seconds < 1:
        return "Almost done"
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02d} left" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d} left"
