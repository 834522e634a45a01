"""Making the evaluator's environment; runs in a Python outside Blender, on an explicit click only."""

from __future__ import annotations

import sys
from pathlib import Path

from ... import system
from ...render.workers.process import emit
from ...version import ROOT

#: What is installed: one version of each package and the hashes of its wheels, which pip checks before it unpacks one.
LOCK = Path(__file__).with_name("evaluator.lock")

#: What tells whether a Python has what the evaluator needs.
_CHECK = (str(ROOT / "__main__.py"), "stereo", "check")
#: A file of this name lies in an environment until it is whole.
_UNFINISHED = "unfinished"
#: What pip says where it could not do its work, and what that means; else its last line is told.
_REASONS = (("DO NOT MATCH THE HASHES", "a downloaded package is not the one that Icy Moon was released with (its hash "
             "differs), so nothing is installed; press Install again, and report it if that does not help."),
            ("No matching distribution", "a package has no build for this Python and system; make an environment of "
             "your own as the manual says, and give its Python in the preferences."),
            ("choose another Python", "pip did not install the packages there; look for settings of pip such as "
             "PIP_TARGET in pip.conf and in environment variables, and press Install again."))


def main(arguments: list[str]) -> int:
    """Make a virtual environment in a folder (the one argument) with what the evaluator needs.

    Says what it does in JSON messages. A folder that was not there before is gone again if that fails or is
    stopped; what a killed process has left is unfinished, see ``is_unfinished``.
    """
    (folder,) = arguments
    new, made = not Path(folder).exists() or is_unfinished(Path(folder)), False
    Path(folder).mkdir(parents=True, exist_ok=True)
    (Path(folder) / _UNFINISHED).touch()
    try:
        made = _make_environment(folder)
    finally:
        if new and not made:
            system.remove_folder(Path(folder))
        else:
            system.remove(Path(folder) / _UNFINISHED)
    return 0 if made else 1


def is_unfinished(folder: Path) -> bool:
    """Whether an environment is being made, or was left half-made: it is no evaluator."""
    return (folder / _UNFINISHED).exists()


def _make_environment(folder: str) -> bool:
    """Make it; False after an error that was told."""
    python = system.venv_python(Path(folder))
    # -I: no module of the current folder, which may be that of somebody's .blend, is taken for venv or pip.
    steps = (("Making the environment", [sys.executable, "-I", "-m", "venv", folder]),
             ("Downloading and installing packages",
              [str(python), "-I", "-m", "pip", "install", "--disable-pip-version-check", "--require-hashes",
               "--only-binary=:all:", "-r", str(LOCK)]),
             # Whatever pip was told by a file or a variable of the person's, such as to install elsewhere.
             ("Looking at what is installed", [str(python), "-I", *_CHECK]))
    for k, (text, command) in enumerate(steps):
        emit("progress", fraction=0.05 + 0.2 * k, message=text)
        done = system.run(command)
        if done.returncode:
            emit("error", message=f"{text} failed: {_failure_reason(done.stderr or done.stdout)}")
            return False
    emit("progress", fraction=1.0, message="Installed")
    emit("done")
    return True


def _failure_reason(said: str) -> str:
    """Why a step failed, and what to do."""
    known = next((meaning for words, meaning in _REASONS if words in said), None)
    last = (said.strip().splitlines() or ["no message"])[-1]
    return known or f"{last}; check network and disk and press Install again."
