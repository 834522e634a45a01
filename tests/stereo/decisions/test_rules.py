"""Rules of safe sites: shipped ones with sources, a user's file, and files that are none."""

from __future__ import annotations

import tomllib

import pytest
from icymoon.stereo.decisions.rules import FIRST_CELLS, SHIPPED_RULES, read_rules
from icymoon.support.errors import IcyMoonError


def test_every_shipped_rule_has_a_source():
    data = tomllib.loads(SHIPPED_RULES.read_text(encoding="utf-8"))
    assert {f"{part}.{key}" for part in ("site", "pad", "cells") for key in data[part]} == set(data["sources"])


def test_a_file_changes_what_it_states_and_nothing_else(tmp_path):
    (tmp_path / "mine.toml").write_text("[site]\nslope_deg = 8\n", encoding="utf-8")
    mine, shipped = read_rules(tmp_path / "mine.toml").to_json(), read_rules().to_json()
    assert mine["site"].pop("slope_deg") == 8.0
    assert shipped["site"].pop("slope_deg") == 15.0
    assert mine == shipped


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[site]\nslop_deg = 8", "slope_deg"),
        ("[place]\nslope_deg = 8", "place"),
        ("site = 3", "site"),
        ("[site]\nslope_deg = 0", "slope_deg"),
        ("[site]\nslope_deg = nan", "slope_deg"),
        ("[site]\nslope_deg = 91", "90"),
        ("[site]\nlit_share = 1.5", "at most 1"),
        ("[site]\nlit_share = -0.1", "of 0 or more and at most 1"),
        ("[site]\nslope_deg = true", "slope_deg"),
        ("[site", "TOML"),
        ("[pad]\ndisc_m = 'wide'", "disc_m"),
        ("[cells]\ngap_m = -1", "of 0 or more"),
        ("[cells]\nfewest_points = 0", "above 0"),
        ("[cells]\ndebias = 2", "at most 1"),
    ],
)
def test_what_is_no_rule_is_a_sentence(tmp_path, text, named):
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError, match=named) as error:
        read_rules(tmp_path / "mine.toml")
    assert "mine.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_first_cells_can_be_stated(tmp_path):
    (tmp_path / "first.toml").write_text("[cells]\nfewest_points = 3\ngap_m = 0\ndebias = 0\n", encoding="utf-8")
    assert read_rules(tmp_path / "first.toml").cells == FIRST_CELLS
    assert read_rules().cells != FIRST_CELLS


def test_a_file_that_is_not_there_is_a_sentence(tmp_path):
    with pytest.raises(IcyMoonError, match="nowhere"):
        read_rules(tmp_path / "nowhere.toml")
