"""The example of docs/extend.md runs, and measures what geometry says."""

from __future__ import annotations

import re
import runpy

import numpy as np
import pytest
from icymoon.rays.embree import load_library
from sources import ROOT

PAGE = ROOT / "docs" / "extend.md"


@pytest.mark.skipif(load_library() is None, reason="there is no Embree; pip install embreex")
def test_the_laser_ranger_of_the_manual_measures_level_ground(tmp_path):
    fences = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (code,) = (fence for fence in fences if "open_tracer" in fence)
    (tmp_path / "ranger.py").write_text(code, encoding="utf-8")
    made = runpy.run_path(str(tmp_path / "ranger.py"))
    sine = np.sin(np.repeat(np.radians([10, 20, 30]), 360))
    assert made["range_m"] == pytest.approx(1.5 / sine, rel=1e-12)
    assert made["incidence"] == pytest.approx(sine, rel=1e-12)
    assert made["lit"].all()
