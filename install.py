"""Making the evaluator's environment; runs in a Python outside Blender, on an explicit click only."""

from __future__ import annotations

import sys
from pathlib import Path

from . import system
from .render.queue import emit
from .stereo.check import PACKAGES


def main(arguments: list[str]) -> int:
    """Make a virtual environment in a folder (the one argument) with what the evaluator needs.

    Says what it does in JSON messages. A folder that was not there before is gone again if that fails or is
    stopped, since half an environment would be taken for an evaluator.
    """
    (folder,) = arguments
    new, made = not Path(folder).exists(), False
    try:
        made = _made(folder)
    finally:
        if new and not made:
            system.remove_folder(Path(folder))
    return 0 if made else 1


def _made(folder: str) -> bool:
    """Make it; False after an error that was told."""
    python = system.venv_python(Path(folder))
    packages = [f"{name}>={'.'.join(map(str, oldest))}" for name, oldest in PACKAGES.values()]
    steps = (("Making the environment", [sys.executable, "-m", "venv", folder]),
             ("Downloading and installing packages",
              [str(python), "-m", "pip", "install", "--disable-pip-version-check", *packages]))
    for k, (text, command) in enumerate(steps):
        emit("progress", fraction=0.05 + 0.2 * k, message=text)
        done = system.run(command)
        if done.returncode:
            words = (done.stderr or done.stdout).strip().splitlines() or ["no message"]
            emit("error", message=f"{text} failed: {words[-1]}; check network and disk and press Install again.")
            return False
    emit("progress", fraction=1.0, message="Installed")
    emit("done")
    return True
