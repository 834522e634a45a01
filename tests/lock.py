"""Write the lock file that Install Evaluator installs from: one version of each package, with the hashes of its wheels.

    python tests/lock.py             write stereo/environment/evaluator.lock
    python tests/lock.py NAME==X …   the same, with these versions

pip itself resolves, for every Python and platform that Blender brings, within the bounds of ``packages.PACKAGES``;
nothing is installed. A system that has no wheel of a required package is named, and cannot use the button. ONNX
Runtime, which runs icynet, is left out on systems without a wheel of it, with the packages that only it needs.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from icymoon.stereo.environment.install import LOCK_FILE
from icymoon.stereo.environment.packages import PACKAGES, format_requirement
from icymoon.stereo.matchers.onnx import REQUIREMENT

#: Pythons of the Blenders from 4.2 on and of the systems they run on; platforms as pip names them.
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
PLATFORMS = {
    "Linux x86_64": [f"{old}_x86_64" for old in ("manylinux_2_28", "manylinux_2_27", "manylinux2014")],
    "Linux aarch64": [f"{old}_aarch64" for old in ("manylinux_2_28", "manylinux_2_27", "manylinux2014")],
    "macOS arm64": [f"macosx_{k}_0_arm64" for k in (14, 13, 12, 11)],
    "macOS x86_64": [f"macosx_{k}_x86_64" for k in ("14_0", "13_0", "12_0", "11_0", "10_15", "10_12")],
    "Windows x86_64": ["win_amd64"],
}
#: The systems without a wheel of ONNX Runtime, and the marker that leaves the package out there.
WITHOUT_RUNTIME = ("macOS x86_64",)
RUNTIME_MARKER = "sys_platform != 'darwin' or platform_machine != 'x86_64'"
#: What a package needs on some systems alone, which pip asks of the system that it runs on.
_NEEDED = re.compile(r"[A-Za-z0-9._-]+")
_HEAD = """# Written by tests/lock.py: what Install Evaluator installs, and nothing else. The hashes are those of the
# wheels for Python {pythons} on {platforms}.
"""


def resolved(requirements: Sequence[str], python: str, platforms: Sequence[str]) -> list[dict[str, Any]]:
    """What pip would install. Raises ValueError with its words if it cannot."""
    with tempfile.TemporaryDirectory() as folder:
        tags = [word for name in platforms for word in ("--platform", name)]
        done = subprocess.run(
            [
                sys.executable,
                "-I",
                "-m",
                "pip",
                "install",
                "--dry-run",
                "--quiet",
                "--report",
                "-",
                "--ignore-installed",
                "--only-binary=:all:",
                "--python-version",
                python,
                *tags,
                "--target",
                folder,
                *requirements,
            ],
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        raise ValueError((done.stderr.strip().splitlines() or ["pip says nothing"])[-1])
    return list(json.loads(done.stdout)["install"])


def dependencies(found: Sequence[dict[str, Any]]) -> set[str]:
    """Names of all that these packages need on any system, extras left out."""
    needs = [need for item in found for need in item["metadata"].get("requires_dist", ()) if "extra ==" not in need]
    return {normal(match[0]) for need in needs if (match := _NEEDED.match(need))}


def normal(name: str) -> str:
    """A package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def choose_versions(wants: Sequence[str]) -> dict[str, str]:
    """The version of each package that these requirements need on any system."""
    first = resolved(wants, PYTHONS[0], PLATFORMS["Linux x86_64"])
    while missing := dependencies(first) - {normal(item["metadata"]["name"]) for item in first}:
        first = resolved([*wants, *missing], PYTHONS[0], PLATFORMS["Linux x86_64"])
    return {normal(item["metadata"]["name"]): item["metadata"]["version"] for item in first}


def locked(given: Sequence[str]) -> tuple[dict[str, str], dict[str, set[str]], list[str], set[str]]:
    """(version of each package, hashes of its wheels, what is not to be had for which system, the packages that are
    left out on systems without ONNX Runtime)."""
    wants = [*(format_requirement(module) for module in PACKAGES), *given]
    required = choose_versions(wants)
    pins = choose_versions([*(f"{name}=={version}" for name, version in required.items()), REQUIREMENT])
    optional = pins.keys() - required.keys()
    hashes: dict[str, set[str]] = {name: set() for name in pins}
    lacking = []
    for python in PYTHONS:
        for title, platforms in PLATFORMS.items():
            try:
                here = required if title in WITHOUT_RUNTIME else pins
                found = resolved([f"{name}=={version}" for name, version in here.items()], python, platforms)
            except ValueError as error:
                lacking.append(f"Python {python} on {title}: {error}")
                continue
            for item in found:
                hashes[normal(item["metadata"]["name"])].add(item["download_info"]["archive_info"]["hashes"]["sha256"])
    return pins, hashes, lacking, optional


def main(given: Sequence[str]) -> int:
    """Write the lock file; 1 if a system lacks a package."""
    pins, hashes, lacking, optional = locked(given)
    lines = [
        " \\\n    ".join(
            [
                f"{name}=={pins[name]}{f' ; {RUNTIME_MARKER}' if name in optional else ''}",
                *(f"--hash=sha256:{value}" for value in sorted(hashes[name])),
            ]
        )
        for name in sorted(pins)
    ]
    head = _HEAD.format(pythons=", ".join(PYTHONS), platforms=", ".join(PLATFORMS))
    Path(LOCK_FILE).write_text(head + "\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    print("\n".join([f"{LOCK_FILE}: {len(pins)} packages", *lacking]))
    return int(bool(lacking))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
