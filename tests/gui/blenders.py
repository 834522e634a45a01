"""Real Blenders on this machine: finding them, running them, giving them the extension and an evaluator."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "blender"
SUITES = {"4.3": "trixie", "5.2": "sid"}
ADD_ON = "bl_ext.user_default.icymoon"
#: Wheels for Linux, oldest C library first.
PLATFORMS = ("manylinux2014_x86_64", "manylinux_2_17_x86_64", "manylinux_2_28_x86_64")


class CannotRunError(Exception):
    """Why something cannot be run on this machine."""


@dataclass(frozen=True)
class Blender:
    """A real Blender: how it is started without and with its window."""

    name: str
    executable: str
    windowed: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)

    def run(
        self,
        *arguments: str,
        window: bool = False,
        timeout_s: float = 900.0,
        environment: Mapping[str, str] | None = None,
    ) -> subprocess.CompletedProcess[str]:
        """Run it to its end; status 124 if it had to be killed."""
        command = [*(self.windowed if window else (self.executable,)), *arguments]
        return run(command, timeout_s, {**self.environment, **(environment or {})})


def run(
    command: list[str], timeout_s: float, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command in the repository, with its children killed when the time is up (status 124)."""
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **(environment or {})},
        text=True,
        errors="replace",
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=timeout_s)
        status = process.returncode
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        output, _ = process.communicate()
        output, status = f"{output}\nkilled after {timeout_s:.0f} s", 124
    return subprocess.CompletedProcess(command, status, output)


def find(which: str) -> Blender:
    """The Blender called '4.3' or '5.2' of ../shared/blender, or 'named' by ICYMOON_BLENDER.

    Raises CannotRunError if this machine has it not.
    """
    display = f":{100 + os.getpid() % 800}"
    if which == "named":
        executable = shutil.which(os.environ.get("ICYMOON_BLENDER", ""))
        if executable is None:
            raise CannotRunError("no Blender is named by ICYMOON_BLENDER")
        window = [executable, "--window-geometry", "0", "0", "1600", "1000"]
        if not os.environ.get("DISPLAY"):
            window = ["xvfb-run", "-a", "-s", "-screen 0 1600x1000x24", *window]
        return Blender("named", executable, tuple(window))
    script = SHARED / "blender"
    if not script.is_file():
        raise CannotRunError(f"there is no {script}, which installs it")
    if os.geteuid() != 0:
        raise CannotRunError(f"{script} needs root")
    return Blender(
        f"{which}-{SUITES[which]}",
        str(script),
        (str(script), "--window"),
        {"BLENDER_SUITE": SUITES[which], "XVFB_DISPLAY": display},
    )


def requirements(*extras: str) -> list[str]:
    """What pyproject.toml says that the package and these extras of it need."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*project["dependencies"], *(need for extra in extras for need in project["optional-dependencies"][extra])]


def install_packages(target: Path, python: str, packages: list[str]) -> None:
    """Unpack packages for Python ``python`` ('3.13') into a folder, once; a changed list does it anew."""
    mark, wanted = target / ".packages", "\n".join(packages)
    if mark.is_file() and mark.read_text() == wanted:
        return
    shutil.rmtree(target, ignore_errors=True)
    platforms = [word for platform in PLATFORMS for word in ("--platform", platform)]
    done = run(
        [
            sys.executable,
            "-m",
            "pip",
            "install",
            "-q",
            "--disable-pip-version-check",
            "--target",
            str(target),
            "--python-version",
            python,
            "--implementation",
            "cp",
            "--only-binary=:all:",
            *platforms,
            *packages,
        ],
        900.0,
    )
    if done.returncode:
        raise AssertionError(f"pip could not install for Python {python}: {done.stdout.strip()[-500:]}")
    mark.write_text(wanted)


def python_of(blender: Blender) -> tuple[str, str]:
    """(version such as '3.13', program) of a Blender's Python."""
    asked = blender.run(
        "-b",
        "--factory-startup",
        "--python-expr",
        "import sys; print('PYTHON', sys.version_info[0], sys.version_info[1], sys.executable)",
    )
    words = next((line.split() for line in asked.stdout.splitlines() if line.startswith("PYTHON ")), None)
    if words is None:
        raise AssertionError(f"Blender {blender.name} does not start: {asked.stdout.strip()[-500:]}")
    return ".".join(words[1:3]), " ".join(words[3:])


def build_store(blender: Blender, archive: Path) -> None:
    """Build the zip with the evaluator's packages inside for a Blender on Linux."""
    from store_zip import Store, build

    build(Store(python_of(blender)[0], "linux-x64", any_blender=True), archive)


def evaluator(blender: Blender) -> Path:
    """A Python for the evaluator that can be run where that Blender runs: Blender's own, with packages beside it."""
    version, program = python_of(blender)
    target = ROOT / ".venvs" / f"evaluator-{version}"
    install_packages(target, version, requirements("evaluate"))
    script = target / f"python-{blender.name}"
    script.write_text(f'#!/bin/sh\nPYTHONPATH="{target}" exec "{program}" "$@"\n')
    script.chmod(0o755)
    return script


@dataclass(frozen=True)
class Installed:
    """A Blender that has the extension, enabled, in settings of its own."""

    blender: Blender
    environment: Mapping[str, str]

    def run(self, *arguments: str, window: bool = False, timeout_s: float = 900.0) -> subprocess.CompletedProcess[str]:
        """Run that Blender with those settings."""
        return self.blender.run(*arguments, window=window, timeout_s=timeout_s, environment=self.environment)

    def uninstall(self) -> None:
        """Remove the extension as a person does. Raises AssertionError if a file or a preference of it is left."""
        folder = Path(self.environment["BLENDER_USER_RESOURCES"])
        done = self.run("--command", "extension", "remove", "icymoon")
        left = [path for path in folder.rglob("*") if "icymoon" in path.name]
        asked = self.run(
            "-b",
            "--python-expr",
            "import bpy; print('LEFT', 'icymoon' in "
            "str(bpy.context.preferences.addons.keys()) or hasattr(bpy.types.Scene, 'icymoon'))",
        )
        if done.returncode or left or "LEFT False" not in asked.stdout:
            raise AssertionError(f"uninstalling leaves {left or asked.stdout.strip()[-300:]}: {done.stdout[-500:]}")

    def remove(self) -> None:
        """Delete those settings, and the extension with them."""
        shutil.rmtree(self.environment["BLENDER_USER_RESOURCES"], ignore_errors=True)


def install(blender: Blender, archive: Path) -> Installed:
    """Install the zip into a fresh settings folder, with Blender offline. Raises AssertionError if Blender refuses.

    It evaluates by the packages in the zip, whatever this machine has; a zip without them gets an evaluator.
    """
    folder = Path(tempfile.mkdtemp(prefix="icymoon-blender-"))
    with zipfile.ZipFile(archive) as opened:
        complete = any(name.startswith("wheels/") for name in opened.namelist())
    environment = {
        "BLENDER_USER_RESOURCES": str(folder),
        "ICYMOON_EVALUATOR": "" if complete else str(evaluator(blender)),
    }
    done = blender.run(
        "--offline-mode",
        "--command",
        "extension",
        "install-file",
        "--repo",
        "user_default",
        "--enable",
        str(archive),
        environment=environment,
    )
    if done.returncode or not list(folder.glob("**/user_default/icymoon/blender_manifest.toml")):
        shutil.rmtree(folder, ignore_errors=True)
        raise AssertionError(f"The zip could not be installed in {blender.name}:\n{done.stdout}")
    return Installed(blender, environment)
