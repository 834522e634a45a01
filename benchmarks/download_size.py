"""What `make demo` downloads: the packages of the extras blender and evaluate, and those that pip tried and threw away.

    python benchmarks/download_size.py [--extras blender,evaluate]

Run it with the Python of the demo (3.11), outside of its environment; it installs nothing.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
#: A file that pip takes from an index, or from a folder of wheels.
_TAKEN = re.compile(r"^\s*(?:Downloading|Using cached|Processing) \S*?([^/\s]+\.(?:whl|tar\.gz))", re.MULTILINE)
_OURS = "icymoon"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--extras", default="blender,evaluate")
    extras = parser.parse_args().extras
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "download",
                "--no-cache-dir",
                "--progress-bar",
                "off",
                "-c",
                str(ROOT / "constraints" / "blender.txt"),
                "--dest",
                folder,
                f"{ROOT}[{extras}]",
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            sys.exit(done.stderr)
        kept = {file.name: file.stat().st_size for file in Path(folder).iterdir() if not file.name.startswith(_OURS)}
    taken = {name for name in _TAKEN.findall(done.stdout) if not name.startswith(_OURS)}
    for name, size in sorted(kept.items(), key=lambda item: -item[1]):
        print(f"{size / 1e6:8.1f} MB  {name}")
    print(f"{sum(kept.values()) / 1e6:8.1f} MB  {len(kept)} packages in all")
    print(f"thrown away: {', '.join(sorted(taken - kept.keys())) or 'nothing'}")


if __name__ == "__main__":
    main()
