"""Build the extension's zip with Blender's own tool, which needs no Blender, and check what is in it.

python tests/extension_zip.py dist/icymoon.zip
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tomllib
import zipfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
NEEDED = (
    "blender_manifest.toml",
    "LICENSE",
    "stereo/report/report.html.j2",
    "stereo/environment/evaluator.lock",
    "stereo/networks/icynet_weights.onnx",
    "presets/scenes/europa_rough_ice.toml",
)


def blender_ext() -> Path:
    """Blender's extension tool, a plain Python script inside the bpy package."""
    found = importlib.util.find_spec("bpy")
    tools = (
        sorted(Path(found.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
        if found and found.origin
        else []
    )
    if not tools:
        sys.exit("extension_zip: this Python has no bpy, whose tool builds extensions; run it with .venv/bin/python.")
    return tools[-1]


def shipped() -> set[str]:
    """What belongs into the zip: the package's code and data, and nothing else."""
    files = [ROOT / name for name in ("blender_manifest.toml", "LICENSE")] + list(ROOT.glob("*.py"))
    for package in PYPROJECT["tool"]["setuptools"]["packages"]:
        files += ROOT.joinpath(*package.split(".")[1:]).glob("*.py")
    data = (
        "docs/**/*.md",
        "docs/*.json",
        "presets/**/*.toml",
        "presets/previews/**/*.jpg",
        "stereo/*/*.j2",
        "stereo/*/*.js",
        "stereo/*/*.css",
        "stereo/*/*.toml",
        "stereo/*/*.lock",
        "stereo/*/*.safetensors",
        "stereo/*/*.onnx",
        "nodes/*/*.osl",
        "physics/*/*.json",
        "physics/*/*.csv",
        "plugins/*.txt",
    )
    files += [path for pattern in data for path in ROOT.glob(pattern)]
    return {path.relative_to(ROOT).as_posix() for path in files}


def faults(archive: Path) -> list[str]:
    """What is wrong with a built zip; empty if nothing is."""
    with zipfile.ZipFile(archive) as opened:
        names = {name for name in opened.namelist() if not name.endswith("/")} - {"README.md"}
    found = [f"{name} is missing" for name in sorted(shipped() - names)]
    strange = Counter(name.split("/")[0] for name in names - shipped())
    found += [
        f"{name} ({count} files) does not belong into it; out/ is the place for what you make"
        for name, count in sorted(strange.items())
    ]
    found += [f"{name} is not there" for name in NEEDED if name not in names]
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    if manifest["version"] != (version := PYPROJECT["project"]["version"]):
        found.append(f"blender_manifest.toml is version {manifest['version']}, pyproject.toml {version}")
    return found


def build(archive: Path) -> None:
    """Build and validate the zip. Ends the program with what is wrong, if something is."""
    archive.parent.mkdir(parents=True, exist_ok=True)
    archive.unlink(missing_ok=True)
    steps = (["build", "--source-dir", str(ROOT), "--output-filepath", str(archive)], ["validate", str(archive)])
    for step in steps:
        done = subprocess.run([sys.executable, str(blender_ext()), *step], capture_output=True, text=True, check=False)
        if done.returncode or not archive.is_file():
            sys.exit(f"extension_zip: {step[0]} failed:\n{done.stdout}{done.stderr}")
    if wrong := faults(archive):
        sys.exit(f"extension_zip: {archive} is wrong:\n  " + "\n  ".join(wrong))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tests/extension_zip.py OUT.zip")
    target = Path(sys.argv[1]).absolute()
    build(target)
    print(f"{target} built and validated, {target.stat().st_size / 1024:.0f} KiB, {len(shipped())} files")
