"""The time from an empty Blender to the first evaluated pair in its window: the steps of docs/tutorial/window.md.

    python benchmarks first_hour [4.3 | 5.2 | named] [--keep]

Blender has new, empty settings. All steps of a user are done with mouse and keys, see ``first_hour_window.py``.
'named' is the Blender in ICYMOON_BLENDER. It needs xdotool, ImageMagick and, without a screen, xvfb. The evaluator is
installed by its button, which needs the network; Debian's Blender also needs the package python3-venv. Screenshots stay
in out/first_hour; with --keep the settings stay too. Prints for each step the seconds of the clock, those of them in
which the user can only wait, what a user needs for the clicks and keys by the keystroke-level model, and the processor
seconds of Blender and of the processes that it starts. Much less processor time than waiting means that the machine was
busy.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from blenders import ROOT, CannotRunError, find

TIMEOUT_S = 1800.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("blender", nargs="?", default="4.3")
    parser.add_argument("--keep", action="store_true", help="keep Blender's new settings")


def main(options: argparse.Namespace) -> int:
    """Measure the time of each step; status 1 if one failed."""
    try:
        blender = find(options.blender)
    except CannotRunError as reason:
        sys.exit(f"first_hour: {reason}")
    folder, archive = ROOT / "out" / "first_hour", ROOT / "dist" / "icymoon.zip"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    user = Path(tempfile.mkdtemp(prefix="icymoon-newcomer-"))
    print(f"Blender {blender.name}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before", flush=True)
    began, cpu = time.monotonic(), sum(os.times()[2:4])
    subprocess.run(
        [sys.executable, str(ROOT / "tests" / "extension_zip.py"), str(archive)],
        cwd=ROOT,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    zipped = time.monotonic() - began
    steps: list[dict[str, Any]] = [
        {"step": "make zip", "seconds": zipped, "machine": zipped, "user": 0.0, "cpu": sum(os.times()[2:4]) - cpu}
    ]
    # An evaluator in this shell's environment would replace the one that the button installs.
    done = blender.run(
        "--python-exit-code",
        "5",
        "--python",
        str(Path(__file__).with_name("first_hour_window.py")),
        "--",
        str(folder),
        str(archive),
        str(time.time()),
        window=True,
        timeout_s=TIMEOUT_S,
        environment={"BLENDER_USER_RESOURCES": str(user), "ICYMOON_EVALUATOR": ""},
    )
    report = folder / "steps.json"
    steps += json.loads(report.read_text()) if report.is_file() else []
    columns = ("seconds", "machine", "user", "cpu")
    print(" clock s  waiting  user s  CPU s")
    for step in [*steps, {"step": "total", **{key: sum(step[key] for step in steps) for key in columns}}]:
        print(
            f"{step['seconds']:8.1f} {step['machine']:8.1f} {step['user']:7.1f} {step['cpu']:6.1f}  {step['step']}"
            f"{'  FAILED' if step.get('failed') else ''}"
        )
    print(f"Load {os.getloadavg()[0]:.1f} after; screenshots in {folder}")
    if options.keep:
        print(f"settings in {user}")
    else:
        shutil.rmtree(user, ignore_errors=True)
    if done.returncode:
        print(done.stdout[-3000:], file=sys.stderr)
    return int(done.returncode != 0)
