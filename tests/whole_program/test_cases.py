"""Inputs of kinds that users of such tools report: each gives its right result through the command line.

The files in ``tests/data/cases`` were made for these tests.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from icymoon.commands.cli import main
from icymoon.version import ROOT

CASES = ROOT / "tests" / "data" / "cases"


def case(number: int, tmp_path: Path) -> Path:
    """A copy of a case, to be written beside."""
    (source,) = CASES.glob(f"{number:02d}_*")
    return Path(shutil.copytree(source, tmp_path / source.name))


def evaluated(folder: Path, out: Path, capsys) -> tuple[int, dict, str]:
    """Exit status, report by method and what is printed."""
    status = main(["evaluate", str(folder / "data"), "--methods", "bm,sgbm", "--out", str(out)])
    captured = capsys.readouterr()
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return status, report, " ".join((captured.out + captured.err).split())


def rows_of(report: dict) -> dict[str, dict]:
    return {row["method"]: row for row in report["rows"]}


def test_03_a_sky_at_1e10_is_no_truth(tmp_path, capsys):
    status, report, shown = evaluated(case(3, tmp_path), tmp_path / "out", capsys)
    assert status == 0
    for row in rows_of(report).values():
        assert 0.05 < row["l1_m"] < 0.1
    assert "pixels of the one depth 1e+10 m" in shown


def test_07_a_distance_along_the_ray_is_found_and_read(tmp_path, capsys):
    folder = case(7, tmp_path)
    status, _, shown = evaluated(folder, tmp_path / "out", capsys)
    assert status == 1
    assert 'state truth.along = "ray" in pairs.toml' in shown
    toml = folder / "data" / "pairs.toml"
    toml.write_text(toml.read_text(encoding="utf-8").replace("[truth]", '[truth]\nalong = "ray"'), encoding="utf-8")
    status, report, _ = evaluated(folder, tmp_path / "again", capsys)
    assert status == 0
    assert rows_of(report)["sgbm"]["epe_px"] < 0.3


@pytest.mark.parametrize(("number", "names", "focal_mm"), [
    (14, ("L.LBL", "R.LBL"), 70.3125), (15, ("L.LBL", "R.LBL"), 70.3125), (22, ("left.yaml", "right.yaml"), 70.3125),
    (24, ("L.LBL", "R.LBL"), (1200.3 + 1203.8) / 2 / 1024 * 60)])
def test_two_cameras_are_a_rig(tmp_path, capsys, number, names, focal_mm):
    """14: a thumbnail in the label; 15: vectors over several lines; 22: YAML of ROS; 24: eyes that differ."""
    folder = case(number, tmp_path)
    assert main(["camera", *(str(folder / name) for name in names)]) == 0
    shown = dict(line.split(" = ") for line in capsys.readouterr().out.splitlines() if " = " in line)
    assert int(shown["width_px"]) == int(shown["height_px"]) == 1024
    assert float(shown["focal_length_mm"]) == pytest.approx(focal_mm, rel=1e-6)
    assert float(shown["baseline_m"]) == pytest.approx(0.2)
    assert (float(shown["distortion_k1"]), float(shown["distortion_k2"])) == (-0.05, 0.01)
    centre = (509.1 + 515.4) / 2 - 511.5 if number == 24 else 0.0
    assert float(shown["principal_x_px"]) == pytest.approx(centre, abs=1e-6)
