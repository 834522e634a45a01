"""Renderers of scenes: a worker process that is kept for the next scene, or this process."""

from __future__ import annotations

import atexit
import importlib
import importlib.util
import sys
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Protocol, Self

from ..render.workers.job_commands import Job, blender_command
from ..render.workers.process import Message, Process
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.files import write_text
from ..support.number_text import format_count
from ..support.printer import show_controls
from ..support.system import remove_folder
from ..support.temporary_folders import make_scratch_folder

#: Receives the messages of a render: ``progress`` (``fraction``, ``message``), ``pair``, ``warning``.
MessageReceiver = Callable[[Message], None]


class Renderer(Protocol):
    """Renders complete settings into the folder of a data set."""

    def render(self, settings: Settings, dataset: Path, again: bool, hear: MessageReceiver) -> list[Path]:
        """Render the pairs of the settings and return their folders. Raises IcyMoonError if one fails."""

    def close(self) -> None:
        """Free the renderer's memory and processes."""


def ignore_message(message: Message) -> None:
    """Ignore a message."""


def issue_warnings(hear: MessageReceiver) -> MessageReceiver:
    """Make a receiver that passes messages on to ``hear`` and issues their warnings as Python warnings."""

    def hear_all(message: Message) -> None:
        if message["type"] == "warning":
            warnings.warn(show_controls(message["message"]), stacklevel=2)
        hear(message)

    return hear_all


class Worker:
    """A process of Blender that is started at the first render and reused for the next ones.

    If Blender crashes, that render raises an error, and the next one starts another process. Use it in a ``with``
    statement, or ``close`` it; it ends with this process at the latest. ``blender`` is a Blender or a Python with
    Blender as a module, by default this one; ``threads`` takes the place of ``quality.threads``.
    """

    def __init__(self, blender: str | Path | None = None, threads: int | None = None) -> None:
        self.blender = str(blender or find_blender_program())
        self.threads = threads
        self._process: Process | None = None
        self._inbox: Path | None = None
        self._jobs = 0

    def __repr__(self) -> str:
        state = f"process {self._process.pid}, {format_count(self._jobs, 'render')}" if self._process else "not started"
        return f"<Worker {self.blender}: {state}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def render(
        self, settings: Settings, dataset: Path, again: bool = False, hear: MessageReceiver = ignore_message
    ) -> list[Path]:
        """Render the pairs of complete settings and return their folders; ``hear`` receives every message.

        Raises IcyMoonError with the worker's own error if it fails.
        """
        if self.threads is not None:
            settings = settings | {"quality": settings.quality | {"threads": self.threads}}
        job = Job(dataset, settings, again=again)
        try:
            process = self._start()
            self._jobs += 1
            assert self._inbox is not None
            write_text(self._inbox / str(self._jobs), str(job.file))
            for message in process.wait_for_messages():
                if message["type"] == "error":
                    if message.get("crash"):
                        self.close()
                    raise IcyMoonError(message["message"])
                if message["type"] == "done":
                    return [Path(folder) for folder in message["folders"]]
                hear(message)
            status, last = process.returncode, process.cause
            self.close()
            raise IcyMoonError(f"Blender ended without a result (status {status}): {last}")
        except IcyMoonError:
            raise
        except BaseException:  # such as Ctrl-C: its unfinished render is of no use
            self.close()
            raise
        finally:
            job.remove() if self._process is None else job.discard()

    def _start(self) -> Process:
        if self._process is None:
            self._inbox, self._jobs = make_scratch_folder(), 0
            try:
                self._process = Process(blender_command(self.blender, "resident-worker", str(self._inbox)))
            except IcyMoonError:
                self.close()
                raise
            atexit.register(self.close)
        return self._process

    def close(self) -> None:
        """End the process, if there is one."""
        process, inbox, self._process, self._inbox = self._process, self._inbox, None, None
        if process is not None:
            process.stop()
            atexit.unregister(self.close)
        if inbox is not None:
            remove_folder(inbox)


def find_blender_program() -> str:
    """Find the program that starts Blender: this process's Blender, or a Python that has it as a module."""
    bpy = sys.modules.get("bpy")
    executable = getattr(getattr(bpy, "app", None), "binary_path", "")
    if executable:
        return str(executable)
    if importlib.util.find_spec("bpy") is None:
        raise IcyMoonError(
            f"{sys.executable} has no Blender; give one as icymoon.Worker(blender=…), or run "
            'pip install "icymoon[blender]".'
        )
    return sys.executable


class InProcess:
    """Blender in this process: in the background (``blender -b``), or as a module of this Python.

    It opens a new file for each ground, so the file that is open in this Blender is lost. Use it in a ``with``
    statement, or ``close`` it. Raises IcyMoonError without Blender, and in a Blender with a window.
    """

    def __init__(self) -> None:
        if "bpy" not in sys.modules and importlib.util.find_spec("bpy") is None:
            raise IcyMoonError(f"{sys.executable} has no Blender as a module; render with icymoon.Worker(blender=…).")
        # Imported by name, since this package may not import Blender.
        module = importlib.import_module("..render.resident_scenes", __package__)
        self._scenes: Any = module.RendererInThisProcess()

    def __repr__(self) -> str:
        return "<InProcess: Blender in this process>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def render(
        self, settings: Settings, dataset: Path, again: bool = False, hear: MessageReceiver = ignore_message
    ) -> list[Path]:
        """Render the pairs of complete settings and return their folders; see ``Worker.render``."""
        return list(self._scenes.render(settings, dataset, again, hear))

    def close(self) -> None:
        """Free the scene."""
        self._scenes.close()


@cache
def default_renderer() -> Worker:
    """Return the worker that all scenes share if no renderer is given."""
    return Worker()
