"""The wheel holds everything that is ours, and in a bare Python it evaluates with what it asks for and nothing else."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pairs
import pytest
from icymoon.support.version import ROOT, version
from packaging.requirements import Requirement

pytestmark = pytest.mark.slow

NOT_SHIPPED = ("tests", "benchmarks", "docs", "out", "dist", "build")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from a copy, since the builder leaves a folder behind that the next wheel would take up."""
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(
        ROOT, folder / "source", ignore=shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", *NOT_SHIPPED)
    )
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(folder / "source"))
    return next(folder.glob("*.whl"))


def pip(*arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_it_holds_every_file_of_the_extension_and_no_test(wheel):
    held = {name.removeprefix("icymoon/") for name in zipfile.ZipFile(wheel).namelist() if ".dist-info" not in name}
    ours = {
        path.relative_to(ROOT).as_posix()
        for path in ROOT.rglob("*")
        if path.suffix in (".py", ".osl", ".toml", ".json", ".csv", ".j2", ".js", ".css", ".lock", ".jpg")
        or path.suffix in (".safetensors", ".onnx")
        or path.match("plugins/*.txt")
    }
    ours = {
        name
        for name in ours
        if name.split("/")[0] not in NOT_SHIPPED
        and not name.startswith(".")
        and "__pycache__" not in name
        and ".egg-info" not in name
    }
    assert held == ours - {"pyproject.toml"}
    assert version() in wheel.name


def asked_for(requirements: list[str], extra: str) -> set[str]:
    """Distributions that requirements with an extra lead to."""
    found: set[str] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        each = waiting.pop()
        if each.marker and not any(each.marker.evaluate({"extra": name}) for name in ("", extra)):
            continue
        if each.name not in found:
            found.add(each.name)
            waiting += [
                Requirement(text) for text in importlib.metadata.requires(each.name) or [] if "extra ==" not in text
            ]
    return found


def only(distributions: set[str], folder: Path) -> None:
    """Make a folder in which nothing but these distributions is found."""
    folder.mkdir()
    for name in distributions:
        distribution = importlib.metadata.distribution(name)
        for top in {file.parts[0] for file in distribution.files or [] if file.parts[0] not in ("..", "__pycache__")}:
            if not (folder / top).exists():
                (folder / top).symlink_to(Path(str(distribution.locate_file(top))))


@pytest.mark.long
def test_it_evaluates_in_a_bare_python(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        metadata = next(name for name in archive.namelist() if name.endswith("METADATA"))
        lines = archive.read(metadata).decode().splitlines()
    asked = asked_for([line.split(": ", 1)[1] for line in lines if line.startswith("Requires-Dist: ")], "evaluate")
    assert "numpy" in asked
    assert "bpy" not in asked
    only(asked, tmp_path / "packages")
    venv.create(tmp_path / "bare", with_pip=False)
    python = tmp_path / "bare" / "bin" / "python"
    pip("--python", str(python), "install", "--no-deps", "--no-index", str(wheel))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "packages")}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(python), "-m", *arguments], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    pairs.write_pair(tmp_path / "set" / "pairs" / "a")
    done = run("icymoon.stereo", "evaluate", "set", "--methods", "bm", "--out", "report")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "report" / "report.html").is_file()
    assert run("icymoon", "--version").stdout.strip() == version()
    # Without a Blender a render says in one sentence what to do.
    refused = run("icymoon", "render", "--out", "nothing")
    assert refused.returncode == 1
    assert "icymoon[blender]" in refused.stderr
    assert "Traceback" not in refused.stderr
