"""Run the tests in every Blender that this machine has, and say what came of each.

    python tests/lanes.py                  all lanes
    python tests/lanes.py 4.2 gui-5.2      some

4.2, 4.5 and 5.2 are Blender as a Python module, each in an environment of its own (made in .venvs
when it is first needed); 5.2 has another Python and runs all rooms. real-4.3, real-5.2 and real-named
are real Blenders without their window, gui-… with it. first-… is the beginning of gui-…, from the opened
tab to a measured pair; it runs only when it is named, as CI does. 'named' is the Blender whose path
ICYMOON_BLENDER holds; the others are installed by ../shared/blender. A lane that cannot run says why.
What a lane printed is in out/lanes.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "gui"))
from blenders import (
    ADD_ON,
    ROOT,
    SHARED,
    CannotRunError,
    build_store,
    evaluator,
    find,
    install,
    install_packages,
    requirements,
    run,
)
from run import drive

ENVIRONMENTS = ROOT / ".venvs"
LOGS = ROOT / "out" / "lanes"
# The networks know no Blender, and torch is large: they are tested in the main environment only.
PYTEST = (
    "-m",
    "pytest",
    "-m",
    "not slow and not heavy and not long",
    "-p",
    "no:cacheprovider",
    "--numprocesses",
    "auto",
    "--maxprocesses",
    "4",
    "--dist",
    "worksteal",
    "--ignore=tests/stereo/networks/test_networks.py",
    *(f"--ignore=tests/stereo/learning/test_{what}.py" for what in ("sample_stream", "train", "trainable")),
)
#: What knows Blender; the rest has been tested in this Python, in the main environment.
WITH_BLENDER = (
    "tests/nodes",
    "tests/operators",
    "tests/panels",
    "tests/whole_program",
    *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests" / "render").glob("test_*.py")),
)
PYTEST_S = 7200.0
#: After which a real Blender's command is taken for stuck; each takes some seconds.
STUCK_S = 900.0


def checkout_on_path() -> str:
    """A folder from which Python imports this checkout as ``icymoon``."""
    folder = ENVIRONMENTS / "path"
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        (folder / "icymoon").symlink_to(Path("..", ".."))
    return str(folder)


def needs() -> list[str]:
    """What the tests need beside Blender."""
    return [need for need in requirements("evaluate", "onnx", "develop") if not need.startswith(("ruff", "mypy"))]


def finished(name: str, command: list[str], timeout_s: float, environment: dict[str, str]) -> str:
    """Run a command, keep what it prints and return its last line. Raises AssertionError if it fails."""
    done = run(command, timeout_s, environment)
    LOGS.mkdir(parents=True, exist_ok=True)
    with (LOGS / f"{name}.log").open("a") as log:
        log.write(f"$ {' '.join(command)}\n{done.stdout}\n")
    last = (done.stdout.strip().splitlines() or ["it said nothing"])[-1]
    assert done.returncode == 0, f"status {done.returncode}: {last}"
    return last


def wheel(version: str) -> str:
    """Test the rooms that know Blender in a Python 3.11 that has bpy of a version."""
    python = shutil.which("python3.11")
    if python is None:
        raise CannotRunError("there is no python3.11, which that bpy needs")
    folder = ENVIRONMENTS / f"bpy{version}"
    mark, wanted = folder / ".packages", [f"bpy=={version}.*", *needs()]
    if not mark.is_file() or mark.read_text() != "\n".join(wanted):
        shutil.rmtree(folder, ignore_errors=True)
        finished(version, [python, "-m", "venv", str(folder)], STUCK_S, {})
        finished(
            version,
            [str(folder / "bin" / "python"), "-m", "pip", "install", "-q", "--disable-pip-version-check", *wanted],
            1800.0,
            {},
        )
        mark.write_text("\n".join(wanted))
    return finished(
        version, [str(folder / "bin" / "python"), *PYTEST, *WITH_BLENDER], PYTEST_S, {"PYTHONPATH": checkout_on_path()}
    )


def wheel_52() -> str:
    """Test in the Python 3.13 with bpy 5.2 that ../shared/blender installs."""
    python = SHARED / "python52"
    if not python.is_file() or os.geteuid() != 0:
        raise CannotRunError(f"{python} is not there, or this is not root")
    packages = ENVIRONMENTS / "packages-3.13"
    install_packages(packages, "3.13", needs())
    # The evaluator is started without PYTHONPATH, so it gets a Python that brings its own.
    return finished(
        "5.2",
        [str(python), *PYTEST, "--ignore=tests/docs"],  # the manual knows no Blender, and that Python has no git
        PYTEST_S,
        {"PYTHONPATH": f"{checkout_on_path()}:{packages}", "ICYMOON_EVALUATOR": str(evaluator(find("4.3")))},
    )


def real(which: str) -> str:
    """Use the zip with everything inside in a real Blender without its window, and as the command line's worker."""
    name, blender = f"real-{which}", find(which)
    with tempfile.TemporaryDirectory(prefix="icymoon-lane-") as folder:
        archive, out = Path(folder, "icymoon.zip"), Path(folder, "dataset")
        build_store(blender, archive)
        installed = install(blender, archive)
        environment = {**blender.environment, **installed.environment}
        start = [blender.executable, "-b", "--factory-startup", "--addons", ADD_ON, "--python-exit-code", "1"]
        finished(name, [*start, "--python", "tests/gui/smoke.py", "--", str(out)], STUCK_S, environment)
        finished(name, [*start, "--python", "tests/gui/console.py", "--", f"{folder}/console"], STUCK_S, environment)
        failing = run(
            [
                *start,
                "--python-expr",
                f"import bpy; bpy.context.scene.icymoon.dataset.folder = {folder!r}; bpy.ops.icymoon.evaluate()",
            ],
            STUCK_S,
            environment,
        )
        assert failing.returncode == 1, f"evaluating nothing ends with status {failing.returncode}"
        command = [
            sys.executable,
            "-m",
            "icymoon",
            "render",
            "--preset",
            "europa_rough_ice",
            "--blender",
            blender.executable,
            "--set",
            "terrain.resolution=129",
            "--set",
            "quality.samples=2",
            "--set",
            "rig.width_px=160",
            "--set",
            "rig.height_px=120",
            "--out",
        ]
        environment["PYTHONPATH"] = checkout_on_path()
        finished(name, [*command, f"{folder}/by-command"], STUCK_S, environment)
        assert list(Path(folder).glob("by-command/pairs/*/pair.json")), "the command line left no pair"
        failing = run([*command, str(archive)], STUCK_S, environment)
        assert failing.returncode == 1, f"rendering into a file ends with status {failing.returncode}"
        assert "Traceback" not in failing.stdout, failing.stdout
        installed.uninstall()
        installed.remove()
    return (
        "installed, built, rendered, evaluated, used as a library, uninstalled without a trace; failures have status 1"
    )


def gui(which: str, *steps: str) -> str:
    """Drive the installed zip in a real Blender's window."""
    blender = find(which)
    with tempfile.TemporaryDirectory(prefix="icymoon-lane-") as folder:
        build_store(blender, Path(folder, "icymoon.zip"))
        return drive(blender, Path(folder, "icymoon.zip"), *steps)


LANES: dict[str, Callable[[], str]] = {
    "4.2": lambda: wheel("4.2"),
    "4.5": lambda: wheel("4.5"),
    "5.2": wheel_52,
    **{f"real-{which}": partial(real, which) for which in ("4.3", "5.2", "named")},
    **{f"gui-{which}": partial(gui, which) for which in ("4.3", "5.2", "named")},
}
#: Parts of other lanes, which run only when they are named.
PARTS: dict[str, Callable[[], str]] = {
    f"first-{which}": partial(gui, which, "first") for which in ("4.3", "5.2", "named")
}


def main(names: list[str]) -> int:
    """Run the lanes, print the table; 1 if one failed or none ran."""
    if unknown := set(names) - set(LANES | PARTS):
        sys.exit(f"lanes: unknown {', '.join(sorted(unknown))}; there are {', '.join(LANES | PARTS)}")
    rows = []
    for name in names or LANES:
        (LOGS / f"{name}.log").unlink(missing_ok=True)
        print(f"lane {name} …", flush=True)
        start = time.monotonic()
        try:
            result, said = "passed", (LANES | PARTS)[name]()
        except CannotRunError as reason:
            result, said = "skipped", str(reason)
        except AssertionError as error:
            result, said = "FAILED", str(error)
        rows.append((name, result, time.monotonic() - start, said))
        print(f"lane {name}: {result}, {said}", flush=True)
    print(f"\n{'lane':12}{'result':10}{'seconds':>8}")
    for name, result, seconds, said in rows:
        print(f"{name:12}{result:10}{seconds:8.0f}  {said.splitlines()[0] if said else ''}")
    results = [row[1] for row in rows]
    return int("FAILED" in results or "passed" not in results)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
