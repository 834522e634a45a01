"""The plans in the documentation are plans, of as many pairs as they say."""

from __future__ import annotations

import re

import pytest
from icymoon.render.plans import plan_file, pose_sweeps, setting_sweeps
from icymoon.support.version import ROOT

TEXT = (ROOT / "docs" / "datasets.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```toml\n(# .*?)```", TEXT, re.DOTALL)


@pytest.mark.ci_takes(5)
@pytest.mark.parametrize("text", EXAMPLES, ids=[re.search('title = "(.*)"', text)[1] for text in EXAMPLES])
def test_an_example_has_as_many_pairs_as_it_says(text, tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(text, encoding="utf-8")
    plan = plan_file.read_plan(file)
    count = re.match(r"# (\d+) pairs", text)
    if count:
        assert len(plan.pairs()) == int(count[1])
    else:
        assert "needs the files" in text


def test_every_example_is_tried():
    assert len(EXAMPLES) == TEXT.count("```toml") > 5


def test_every_kind_and_key_of_plans_is_documented():
    named = set(re.findall(r"`([a-z_]+)", TEXT))
    keys = {
        "count",
        "case",
        "preset",
        "uniform",
        "log_uniform",
        "normal",
        "within",
        "choice",
        "name",
        "replaces",
        "headings",
        "pitches_deg",
        "elevations_deg",
        "azimuths_deg",
        "distances_m",
        "target_height_m",
        "clearance_m",
        "margin_m",
        "apart_m",
        "random_headings",
    }
    inside = {key for example in EXAMPLES for key in re.findall(r"[a-z_]+", example)}
    assert set(setting_sweeps.KINDS) | set(pose_sweeps.KINDS) | set(plan_file.HEADER) | keys <= named | inside
    assert set(setting_sweeps.KINDS) | set(pose_sweeps.KINDS) <= named
