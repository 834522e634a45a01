"""Install the zip with everything inside in a real Blender, drive its window with ``drive.py`` and say what came of it.

    python tests/gui/run.py [4.3] [5.2] [named]      all that this machine has, by default
    python tests/gui/run.py 5.2 --steps=A,B          some steps of drive.py, by their names
    python tests/gui/run.py --shots [4.3] …          no test, but pictures of every panel in both themes to look at
    python tests/gui/run.py --manual [4.3]           the pictures of the tutorial
    python tests/gui/run.py --narrow [4.3]           a narrow sidebar, the menus, decisions on the ground
    python tests/gui/run.py --themes [4.3]           all panels in two widths and both themes

'named' is the Blender whose path ICYMOON_BLENDER holds. Screenshots and steps.json are left in
out/gui/<Blender>. The status is 0 if every step of every Blender succeeded, and at least one ran.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from blenders import ROOT, SUITES, Blender, CannotRunError, build_store, find, install

TIMEOUT_S = 3600.0
#: Blender 4.3 loses its list of instances where a lit view begins anew before it has read all rocks. With
#: --debug-memory, all the blocks are named "duplilist" or "dupli object".
_LOST_LIST = "Error: Not freed memory blocks:"


def drive(blender: Blender, archive: Path, *which: str) -> str:
    """Drive one Blender through all steps, or the first ones. Raises AssertionError if it fails; returns a summary."""
    tools = ("xdotool", "import", blender.windowed[0])  # ../shared/blender brings its own
    if blender.name == "named" and (missing := [tool for tool in tools if shutil.which(tool) is None]):
        raise CannotRunError(f"driving its window needs {', '.join(missing)} (xdotool, ImageMagick, xvfb)")
    folder = ROOT / "out" / "gui" / blender.name
    shutil.rmtree(folder, ignore_errors=True)
    installed = install(blender, archive)
    start = time.monotonic()
    done = installed.run(
        "--offline-mode",
        "--python-exit-code",
        "5",
        "--python",
        str(Path(__file__).with_name("drive.py")),
        "--",
        str(folder),
        *which,
        window=True,
        timeout_s=TIMEOUT_S,
    )
    installed.remove()
    report = folder / "steps.json"
    facts = json.loads(report.read_text()) if report.is_file() else {"steps": [], "finished": False}
    for step in facts["steps"]:
        print(f"  {'ok  ' if step['ok'] else 'FAIL'} {step['seconds']:6.1f} s  {step['step']}  {step['note']}")
    for line in done.stdout.splitlines():
        if line.startswith("SEQUENCE "):
            print(f"  {line}")
    if done.returncode or not facts["finished"]:
        raise AssertionError(f"Blender {blender.name} ended with status {done.returncode}:\n{done.stdout[-8000:]}")
    # Blender prints an internal error where a modal operator has changed the window under its feet: a crash may follow.
    marks = ("Traceback", "internal error:")
    errors = [
        line
        for line in done.stdout.splitlines()
        if any(map(line.__contains__, marks)) or (line.startswith("Error:") and not line.startswith(_LOST_LIST))
    ]
    if errors:
        raise AssertionError(f"Blender {blender.name} printed errors:\n{done.stdout[-4000:]}")
    pictures = len(list(folder.glob("*.png")))
    return f"{len(facts['steps'])} steps in {time.monotonic() - start:.0f} s, {pictures} screenshots in {folder}"


def shoot(blender: Blender, archive: Path, *what: str) -> str:
    """Let one Blender take its pictures with ``shots.py``. Raises AssertionError if it fails; returns a summary."""
    folder = ROOT / "out" / "shots" / blender.name
    installed = install(blender, archive)
    done = installed.run(
        "--python-exit-code",
        "5",
        "--python",
        str(Path(__file__).with_name("shots.py")),
        "--",
        str(folder),
        *what,
        window=True,
        timeout_s=TIMEOUT_S,
    )
    installed.remove()
    if done.returncode:
        raise AssertionError(f"Blender {blender.name} ended with status {done.returncode}:\n{done.stdout[-4000:]}")
    return f"{len(list(folder.glob('*.png')))} pictures in {folder}"


def shoot_only(what: str, blender: Blender, archive: Path) -> str:
    """Take the pictures of one kind, see ``shots.py``."""
    return shoot(blender, archive, what)


def drive_steps(steps: list[str], blender: Blender, archive: Path) -> str:
    """Drive some steps, or all if none is named."""
    return drive(blender, archive, *steps)


def main(words: list[str]) -> int:
    """Drive the named Blenders, or all there are; or take pictures."""
    names = [word for word in words if not word.startswith("--")]
    pictures: dict[str, Callable[[Blender, Path], str]] = {
        "--shots": shoot,
        **{f"--{what}": partial(shoot_only, what) for what in ("manual", "narrow", "themes")},
    }
    steps = [step for word in words if word.startswith("--steps=") for step in word.partition("=")[2].split(",")]
    act = pictures.get(words[0] if words else "", partial(drive_steps, steps))
    failed = ran = 0
    with tempfile.TemporaryDirectory(prefix="icymoon-zip-") as folder:
        archive = Path(folder) / "icymoon.zip"
        for name in names or [*SUITES, "named"]:
            try:
                blender = find(name)
                build_store(blender, archive)
                print(f"window of {blender.name}", flush=True)
                print(f"window of {blender.name}: {act(blender, archive)}", flush=True)
                ran += 1
            except CannotRunError as reason:
                print(f"window of {name}: SKIPPED, {reason}", flush=True)
            except AssertionError as error:
                failed += 1
                print(f"window of {name}: FAILED, {error}", flush=True)
    print(f"gui: {ran} passed, {failed} failed")
    return int(failed > 0 or ran == 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
