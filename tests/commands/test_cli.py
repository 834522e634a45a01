"""The command line: exit codes, one sentence on stderr, nothing half-written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from icymoon.commands.cli import main
from icymoon.render.cost.quality_variants import GROUPS
from icymoon.support.version import ROOT


def run(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run ``python -m icymoon``."""
    return subprocess.run(
        [sys.executable, "-m", "icymoon", *arguments], capture_output=True, text=True, cwd=cwd, timeout=240, check=False
    )


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("render", "--preset", "nowhere"), "Unknown preset"),
        (("render", "--set", "terrain.sizem=3"), "size_m"),
        (("render", "--settings", "absent.toml"), "absent.toml"),
        (("render", "--blender", "/nowhere/blender"), "check its path"),
        (("evaluate", "/nowhere"), "/nowhere"),
        (("settings", "--set", "rig.width_px=0"), "rig.width_px"),
        (("gallery", "--only", "ridges"), "rugged_1_low"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_1(arguments, word, tmp_path):
    done = run(*arguments, *(("--out", str(tmp_path / "out")) if arguments[0] != "settings" else ()))
    assert done.returncode == 1
    assert word in done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out" / "pairs").exists()


def test_the_help_of_trade_names_each_group(capsys):
    with pytest.raises(SystemExit):
        main(["trade", "--help"])
    said = capsys.readouterr().out
    assert [group for group in GROUPS if f"{group}," not in said and f"{group} (" not in said] == []


def test_a_worker_that_dies_is_named_by_its_last_words(tmp_path):
    fake = tmp_path / "blender"
    fake.write_text("#!/bin/sh\necho 'libGL is missing'\nexit 3\n")
    fake.chmod(0o755)
    done = run("render", "--blender", str(fake), "--out", str(tmp_path / "out"))
    assert done.returncode == 1
    assert "libGL is missing" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_package_runs_by_its_path_from_a_folder_of_any_name(tmp_path):
    link = tmp_path / "some-extension"
    link.symlink_to(ROOT, target_is_directory=True)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-I", str(link / "__main__.py"), "presets"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "scenes/europa_rough_ice" in done.stdout


def test_settings_are_printed_complete_and_load_again(tmp_path):
    done = run("settings", "--preset", "europa_rough_ice", "--set", "rig.baseline_m=0.3")
    file = tmp_path / "scene.toml"
    file.write_text(done.stdout)
    again = run("settings", "--settings", str(file))
    assert again.stdout == done.stdout
    assert "baseline_m = 0.3" in done.stdout


def test_a_plan_is_listed_and_told_before_anything_starts(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(
        '[plan]\ntitle = "Two suns"\n[[sweep]]\nkind = "grid"\nlight.sun_elevation_deg = [10, 30]\n'
        '[mesh]\nkind = "GRID"\n'
    )
    listed = run("plan", str(file))
    assert [line.split("  ")[1] for line in listed.stdout.splitlines()] == [
        "light.sun_elevation_deg=10",
        "light.sun_elevation_deg=30",
    ]
    told = run("plan", str(file), "--dry-run", "--out", str(tmp_path / "none"))
    assert told.stdout.splitlines()[:3] == ["Two suns", "2 pairs", "1 ground, 1 surface, 2 lights; 1 scene to build"]
    assert not (tmp_path / "none").exists()
    assert "principal point" not in told.stdout
    (tmp_path / "small.toml").write_text(f"{file.read_text()}[rig]\nwidth_px = 160\nprincipal_x_px = 90\n")
    told = run("plan", str(tmp_path / "small.toml"), "--dry-run")
    assert told.stdout.count("The principal point is outside of the image") == 1
    facts = json.loads(run("plan", str(file), "--dry-run", "--json").stdout)
    assert (facts["type"], facts["pairs"], facts["scenes"]) == ("result", 2, 1)
    assert "datasets/guiss_rocks" in run("plan").stdout
    wrong = run("plan", "guiss_rock")
    assert wrong.returncode == 1
    assert "guiss_rocks" in wrong.stderr
