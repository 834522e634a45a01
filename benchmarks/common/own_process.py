"""Runs a study's function in a new Python, with separate memory, caches and Blender state.

numbers = call(measure, "rocks", 1000)
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from icymoon.benchmarks import FOLDER
from icymoon.benchmarks.common.processor import measure_all_seconds

#: The first word of ``python benchmarks`` for a call from another process.
CALL = "--call"


def command(function: Callable[..., Any], result: Path, *arguments: object) -> list[str]:
    """The command of a process that calls a module's function and writes its value to ``result`` as JSON.

    The arguments must be JSON.
    """
    name = f"{function.__module__}:{function.__name__}"
    return [sys.executable, str(FOLDER), CALL, name, json.dumps(arguments), str(result)]


def call(function: Callable[..., Any], *arguments: object) -> Any:
    """The value of a function, called in a new Python whose standard output is hidden.

    RuntimeError if the process failed; its standard error has told why.
    """
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        done = subprocess.run(command(function, result, *arguments), stdout=subprocess.DEVNULL, check=False)
        if done.returncode:
            raise RuntimeError(f"{function.__name__}{arguments} ended with status {done.returncode}")
        return json.loads(result.read_text(encoding="utf-8"))


def work(dataset: Path, *options: str) -> tuple[float, int]:
    """Complete a data set by ``icymoon work`` with one worker: processor seconds of all processes, exit status."""
    words = [sys.executable, "-m", "icymoon", "work", str(dataset), "--workers", "1", "--json", *options]
    status = 0

    def run() -> None:
        nonlocal status
        status = subprocess.run(words, stdout=subprocess.DEVNULL, check=False).returncode

    return measure_all_seconds(run), status


def list_processes(pid: int) -> list[int]:
    """A process and its descendants, the process first. Linux only."""
    found = [pid]
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split():
            found += list_processes(int(child))
    return found


def send_signal(pids: list[int], number: signal.Signals) -> None:
    """Send a signal to those processes that still run."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def answer(name: str, arguments: str, result: str) -> None:
    """Answer a call of ``command`` in this process."""
    module, _, function = name.partition(":")
    value = getattr(import_module(module), function)(*json.loads(arguments))
    Path(result).write_text(json.dumps(value), encoding="utf-8")
