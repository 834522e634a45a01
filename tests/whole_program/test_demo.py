"""The demo: a report that a newcomer can trust."""

import json
import subprocess
import sys

import pytest
from icymoon.stereo.measure.render_noise import CLEAN
from icymoon.support.version import ROOT


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_first_report_warns_of_nothing_and_names_its_scenes(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "__main__.py", "demo", "--out", tmp_path / "demo"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "demo" / "evaluation"
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert [pair["noise"]["verdict"] for pair in report["pairs"]] == [CLEAN, CLEAN]
    assert report["doubts"] == []
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "2 scenes: Enceladus fresh snow, Europa rough ice" in page
    assert '<section class="failed">' not in page
    assert "varies together" not in page
