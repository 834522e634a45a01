"""Build the extension as extensions.blender.org takes it: a zip a Python and platform, with the wheels inside.

    python tests/store_zip.py --website URL                     all of them, into dist/store
    python tests/store_zip.py --python 3.11 --platform linux-x64 --website URL
    python tests/store_zip.py --python 3.13 --platform linux-x64 --any-blender      to try in a Blender of another build

Each wheel is the one of ``stereo/environment/evaluator.lock``: pip checks its hash. Blender's own tool builds and
validates the zip, and ``faults`` checks what a reviewer of the platform would.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from extension_zip import ROOT, blender_ext, shipped
from lock import PLATFORMS, RUNTIME_MARKER, normal

LOCK = ROOT / "stereo" / "environment" / "evaluator.lock"
WHEELS = ROOT / "dist" / "wheels"
#: Python -> the Blenders that bring it: the first version, and the first that brings a later Python.
BLENDERS = {"3.11": ("4.2.0", "5.1.0"), "3.13": ("5.1.0", None), "3.14": (None, None)}
#: Names of platforms: Blender's -> that of the lock file. Blender for macOS on Intel ended with Python 3.11.
SYSTEMS = {
    "linux-x64": "Linux x86_64",
    "windows-x64": "Windows x86_64",
    "macos-arm64": "macOS arm64",
    "macos-x64": "macOS x86_64",
}
#: The zips that a release has.
RELEASE = [
    (python, platform)
    for python in ("3.11", "3.13")
    for platform in SYSTEMS
    if (python, platform) != ("3.13", "macos-x64")
]
#: What is not put in, since Blender has it.
NOT_BUNDLED = ("numpy",)
#: What installs packages from the Internet, which the platform refuses.
LEFT_OUT = ("operators/install_evaluator.py", "stereo/environment/install.py", "stereo/environment/evaluator.lock")
#: Whose work is inside, as each licence says it; the manifest must name them.
COPYRIGHT = {
    "contourpy": "2021-2025 ContourPy Developers",
    "cycler": "2015 matplotlib project",
    "fonttools": "2017 Just van Rossum",
    "jinja2": "2007 Pallets",
    "kiwisolver": "2013-2026 Nucleic Development Team",
    "markdown-it-py": "2020 ExecutableBookProject",
    "markupsafe": "2010 Pallets",
    "matplotlib": "2012-2026 Matplotlib Development Team",
    "mdurl": "2021 Taneli Hukkinen",
    "opencv-contrib-python-headless": "2000-2025 OpenCV team and contributors",
    "openexr": "2002-2026 Contributors to the OpenEXR Project",
    "packaging": "2014-2026 Donald Stufft and individual contributors",
    "pillow": "1995-2026 Fredrik Lundh, Jeffrey A. Clark and contributors",
    "pygments": "2006-2022 Pygments authors",
    "pyparsing": "2003-2025 Paul McGuire",
    "python-dateutil": "2003-2026 Gustavo Niemeyer, Paul Ganssle and contributors",
    "rich": "2020 Will McGugan",
    "tzdata": "2020-2026 Python Software Foundation",
}


@dataclass(frozen=True)
class Store:
    """One zip: for a Python and a platform; ``any_blender`` leaves out which Blenders it is for."""

    python: str
    platform: str
    website: str = ""
    any_blender: bool = False

    @property
    def file_name(self) -> str:
        """Name of the zip."""
        version = manifest_of(ROOT)["version"]
        return f"icymoon-{version}-python{self.python}-{self.platform}.zip"


def manifest_of(folder: Path) -> dict[str, Any]:
    """What the manifest in a folder says."""
    return dict(tomllib.loads((folder / "blender_manifest.toml").read_text(encoding="utf-8")))


def locked() -> str:
    """The lock file without the packages that are not put in. ONNX Runtime and what only it needs, which have its
    marker, stay out too: the zip would grow by a quarter for one matcher."""
    left_out = "#", *(f"{name}==" for name in NOT_BUNDLED)
    blocks = re.split(r"\n(?=\S)", LOCK.read_text(encoding="utf-8"))
    return "\n".join(block for block in blocks if not block.startswith(left_out) and RUNTIME_MARKER not in block)


def download(store: Store) -> list[Path]:
    """The wheels of a zip, from the package index or from what an earlier call has brought."""
    folder = WHEELS / f"{store.python}-{store.platform}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "locked.txt").write_text(locked(), encoding="utf-8")
    tags = [word for tag in PLATFORMS[SYSTEMS[store.platform]] for word in ("--platform", tag)]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pip",
            "download",
            "--quiet",
            "--disable-pip-version-check",
            "--no-deps",
            "--require-hashes",
            "--only-binary=:all:",
            "--python-version",
            store.python,
            "--implementation",
            "cp",
            *tags,
            "--dest",
            str(folder),
            "-r",
            str(folder / "locked.txt"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(
            f"store_zip: no wheels for Python {store.python} on {store.platform}: "
            f"{(done.stderr.strip().splitlines() or ['pip says nothing'])[-1]}"
        )
    wanted = {tuple(line.split(" ")[0].split("==")) for line in locked().splitlines() if "==" in line}
    return sorted(path for path in folder.glob("*.whl") if name_and_version(path) in wanted)


def name_and_version(wheel: Path) -> tuple[str, str]:
    """(name, version) of a wheel's file name."""
    name, version = wheel.name.split("-")[:2]
    return normal(name), version


def manifest(text: str, store: Store, wheels: Sequence[Path]) -> str:
    """The manifest of the zip, from the text of the plain extension's."""
    first, end = (None, None) if store.any_blender else BLENDERS[store.python]
    versions = [f'blender_version_min = "{first or "4.2.0"}"', *([f'blender_version_max = "{end}"'] if end else [])]
    years = [COPYRIGHT[name_and_version(wheel)[0]] for wheel in wheels]
    lines = [
        *versions,
        f'platforms = ["{store.platform}"]',
        *([f'website = "{store.website}"'] if store.website else []),
        "copyright = [",
        '  "2026 Icy Moon developers",',
        *(f'  "{each}",' for each in sorted(set(years))),
        "]",
        "wheels = [",
        *(f'  "./wheels/{wheel.name}",' for wheel in wheels),
        "]",
    ]
    text = re.sub(r"^network = .*\n", "", text, flags=re.MULTILINE)  # only the installer uses it
    return re.sub(r"^blender_version_min = .*$", lambda _: "\n".join(lines), text, flags=re.MULTILINE)


def stage(store: Store, wheels: Sequence[Path], folder: Path) -> None:
    """Put everything that belongs into the zip into a folder."""
    for name in sorted(shipped() - set(LEFT_OUT)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, folder / name)
    (folder / "wheels").mkdir()
    for wheel in wheels:
        shutil.copyfile(wheel, folder / "wheels" / wheel.name)
    text = manifest((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"), store, wheels)
    (folder / "blender_manifest.toml").write_text(text, encoding="utf-8", newline="\n")


def build(store: Store, target: Path) -> None:
    """Build and validate one zip. Ends the program with what is wrong, if something is."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="icymoon-store-") as scratch:
        stage(store, download(store), Path(scratch))
        steps = (["build", "--source-dir", scratch, "--output-filepath", str(target)], ["validate", str(target)])
        for step in steps:
            done = subprocess.run(
                [sys.executable, str(blender_ext()), *step], capture_output=True, text=True, check=False
            )
            if done.returncode or not target.is_file():
                sys.exit(f"store_zip: {step[0]} failed:\n{done.stdout}{done.stderr}")
    if wrong := faults(target):
        sys.exit(f"store_zip: {target} is wrong:\n  " + "\n  ".join(wrong))


def faults(archive: Path) -> list[str]:
    """What a reviewer would refuse in a zip; empty if nothing."""
    with zipfile.ZipFile(archive) as opened:
        names = {name for name in opened.namelist() if not name.endswith("/")}
        facts = tomllib.loads(opened.read("blender_manifest.toml").decode())
        found = [f"{name} is missing" for name in sorted(shipped() - set(LEFT_OUT) - names)]
        found += [f"{name} installs packages" for name in LEFT_OUT if name in names]
        held = {name for name in names if name.startswith("wheels/")}
        if held != {wheel.removeprefix("./") for wheel in facts["wheels"]}:
            found.append("the manifest lists other wheels than there are")
        if "network" in facts["permissions"]:
            found.append("it asks for the network and does not use it")
        for name in sorted(held):
            with zipfile.ZipFile(opened.open(name)) as wheel:
                if not any(re.search(r"\.dist-info/.*(LICEN[CS]E|COPYING|NOTICE)", each) for each in wheel.namelist()):
                    found.append(f"{name} has no text of its licence")
    return found


def main(words: Sequence[str]) -> int:
    """Build the zips that are asked for and print their sizes."""
    parser = argparse.ArgumentParser(description="Build the extension for extensions.blender.org.")
    parser.add_argument("--python", choices=BLENDERS, help="Python of the Blender; both of a release by default")
    parser.add_argument("--platform", choices=SYSTEMS, help="the platform; all by default")
    parser.add_argument("--website", default="", help="address of the project's pages, which the manifest states")
    parser.add_argument("--any-blender", action="store_true", help="for any version of Blender that has that Python")
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / "store", help="folder of the zips")
    given = parser.parse_args(words)
    pairs = [
        (python, platform)
        for python, platform in (RELEASE if not (given.python and given.platform) else [(given.python, given.platform)])
        if given.python in (None, python) and given.platform in (None, platform)
    ]
    if not pairs:
        parser.error("there is no Blender with that Python on that platform")
    for python, platform in pairs:
        store = Store(python, platform, given.website, given.any_blender)
        target = (given.out / store.file_name).absolute()
        build(store, target)
        print(f"{target}: {target.stat().st_size / 1e6:.1f} MB")
    if not given.website:
        print("The manifest states no website: give --website URL for what you upload.")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
