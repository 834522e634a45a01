"""Installs the evaluator's environment. Runs in a Python outside Blender, after an explicit click."""

from __future__ import annotations

import sys
from pathlib import Path

from ...support import system
from ...support.printer import emit
from ...support.version import ROOT

#: The packages to install, one version of each. pip checks the hash of each wheel before it unpacks the wheel.
LOCK_FILE = Path(__file__).with_name("evaluator.lock")

#: Disk space of the installed packages, measured on Linux with Python 3.11.
DISK_MB = 450

#: The command that checks whether a Python has the packages of the evaluator.
_CHECK_COMMAND = (str(ROOT / "__main__.py"), "stereo", "check")
#: An environment contains a file of this name until it is complete.
_UNFINISHED_MARK = "unfinished"
#: Words in the output of pip, and the message for the user. Without a match, the last line of the output is reported.
_REASON_BY_OUTPUT = (
    (
        "CERTIFICATE_VERIFY_FAILED",
        "the server's certificate is not trusted here, as behind a proxy that reads "
        "what is sent; give pip the proxy's certificate (PIP_CERT=file.pem) and press Install again.",
    ),
    ("ProxyError", "the proxy did not answer; check the proxy of this system and press Install again."),
    (
        "Failed to establish a new connection",
        "the package server cannot be reached; check the network and press Install again.",
    ),
    ("No space left on device", f"the disk is full; the evaluator needs {DISK_MB} MB."),
    (
        "DO NOT MATCH THE HASHES",
        "a downloaded package is not the one that Icy Moon was released with (its hash "
        "differs), so nothing is installed; press Install again, and report it if that does not help.",
    ),
    (
        "No matching distribution",
        "a package has no build for this Python and system; make your own "
        "environment as the manual describes, and give its Python in the preferences.",
    ),
    (
        "choose another Python",
        "pip did not install the packages there; look for settings of pip such as "
        "PIP_TARGET in pip.conf and in environment variables, and press Install again.",
    ),
)


def main(arguments: list[str]) -> int:
    """Make a virtual environment with the packages of the evaluator, in the folder that is the only argument.

    Prints its progress as JSON messages, and returns the exit status. After a failure or a stop, a folder that was made
    here is removed. A killed process leaves an unfinished folder, see ``is_unfinished``.
    """
    (folder,) = arguments
    new, made = not Path(folder).exists() or is_unfinished(Path(folder)), False
    Path(folder).mkdir(parents=True, exist_ok=True)
    (Path(folder) / _UNFINISHED_MARK).touch()
    try:
        made = _make_environment(folder)
    finally:
        if new and not made:
            system.remove_folder(Path(folder))
        else:
            system.remove(Path(folder) / _UNFINISHED_MARK)
    return 0 if made else 1


def is_unfinished(folder: Path) -> bool:
    """Return whether an environment is incomplete, so that it cannot be the evaluator."""
    return (folder / _UNFINISHED_MARK).exists()


def _make_environment(folder: str) -> bool:
    """Make the environment. Return False after an error, which is reported as a message."""
    python = system.find_venv_python(Path(folder))
    # -I: Python then ignores a venv or pip in the current folder, which may belong to any .blend file.
    steps = (
        ("Making the environment", [sys.executable, "-I", "-m", "venv", folder]),
        (
            "Downloading and installing packages",
            [
                str(python),
                "-I",
                "-m",
                "pip",
                "install",
                "--disable-pip-version-check",
                "--require-hashes",
                "--only-binary=:all:",
                "-r",
                str(LOCK_FILE),
            ],
        ),
        # A file or an environment variable may have directed pip to another place.
        ("Checking the installed packages", [str(python), "-I", *_CHECK_COMMAND]),
    )
    for k, (text, command) in enumerate(steps):
        emit("progress", fraction=0.05 + 0.2 * k, message=text)
        done = system.run(command)
        if done.returncode:
            emit("error", message=f"{text} failed: {_find_failure_reason(done.stderr or done.stdout)}")
            return False
    emit("progress", fraction=1.0, message="Installed")
    emit("done")
    return True


def _find_failure_reason(output: str) -> str:
    """Find the reason why a step with this output failed, and the remedy."""
    known = next((meaning for words, meaning in _REASON_BY_OUTPUT if words in output), None)
    last = (output.strip().splitlines() or ["no message"])[-1]
    return known or f"{last}; check network and disk and press Install again."
