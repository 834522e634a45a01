"""The download size of `make demo`: the packages of the extras blender and evaluate, and the packages that pip fetched
and dropped.

    python benchmarks download_size [--extras blender,evaluate] [--python python3.11]

It installs nothing.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

from icymoon.benchmarks.common.arguments import scratch

ROOT = Path(__file__).resolve().parents[2]
#: A file that pip takes from an index, or from a folder of wheels.
_TAKEN = re.compile(r"^\s*(?:Downloading|Using cached|Processing) \S*?([^/\s]+\.(?:whl|tar\.gz))", re.MULTILINE)
_OURS = "icymoon"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--extras", default="blender,evaluate")
    parser.add_argument("--python", default=sys.executable, help="the Python of the demo (default: this one)")


def main(options: argparse.Namespace) -> None:
    """Download to a temporary folder and print the sizes."""
    extras = options.extras
    with scratch() as folder:
        done = subprocess.run(
            [
                options.python,
                "-m",
                "pip",
                "download",
                "--no-cache-dir",
                "--progress-bar",
                "off",
                "-c",
                str(ROOT / "constraints" / "blender.txt"),
                "--dest",
                str(folder),
                f"{ROOT}[{extras}]",
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            sys.exit(done.stderr)
        kept = {file.name: file.stat().st_size for file in folder.iterdir() if not file.name.startswith(_OURS)}
    taken = {name for name in _TAKEN.findall(done.stdout) if not name.startswith(_OURS)}
    for name, size in sorted(kept.items(), key=lambda item: -item[1]):
        print(f"{size / 1e6:8.1f} MB  {name}")
    print(f"{sum(kept.values()) / 1e6:8.1f} MB  {len(kept)} packages in all")
    print(f"thrown away: {', '.join(sorted(taken - kept.keys())) or 'nothing'}")
