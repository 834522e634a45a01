"""A real render under the layer that behaves as Windows does, by the command line and by a plan."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from icymoon.support.version import ROOT
from windows import Windows

sys.path.pop(0)
SMALL = (
    "terrain.size_m=4",
    "terrain.resolution=33",
    "mesh.kind=GRID",
    "rig.width_px=64",
    "rig.height_px=48",
    "quality.samples=2",
)


@pytest.fixture
def drive(tmp_path, monkeypatch):
    (tmp_path / "C" / "temp").mkdir(parents=True)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "C" / "temp"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "C" / "temp"))
    layer = Windows(tmp_path / "C", tmp_path / "processes")
    layer.install()
    yield Path(layer.drive)
    faults = layer.all_faults()
    layer.remove()
    assert not faults


def icymoon(*words: object) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, str(ROOT / "__main__.py"), *map(str, words)],
        capture_output=True,
        encoding="utf-8",
        check=False,
        stdin=subprocess.DEVNULL,
        timeout=300,
    )


def files_in(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


@pytest.mark.long
def test_a_pair_is_rendered_again_and_evaluated(drive):
    words = (
        "render",
        "--out",
        drive / "Daten Ω",
        "--blender",
        sys.executable,
        *(word for text in SMALL for word in ("--set", text)),
    )
    for more in ((), ("--again",)):
        done = icymoon(*words, *more)
        assert done.returncode == 0, done.stdout + done.stderr
    names = files_in(drive / "Daten Ω")
    assert [name.split("/")[-1] for name in names] == ["left.exr", "pair.json", "right.exr"]
    data = json.loads((drive / "Daten Ω" / names[1]).read_text(encoding="utf-8"))
    assert data["peak_memory_mib"] is None
    assert files_in(drive / "temp") == []
    done = icymoon("stereo", "evaluate", drive / "Daten Ω", "--methods", "bm", "--out", drive / "out")
    assert done.returncode == 0, done.stderr
