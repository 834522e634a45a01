"""Numbers as the user reads them."""

from __future__ import annotations

import ast
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.support.number_text import format_count, show_place, show_rounded
from sources import IDS, SOURCES, tree_of

#: Where a count of pairs, scenes or methods is two or more whenever it is printed.
SEVERAL = {
    "commands/sources.py",
    "library/rendered_pair.py",
    "library/scene.py",
    "panels/error_table.py",
    "render/plans/setting_sweeps.py",
    "render/plans/vary_scene.py",
    "render/workers/verify_dataset.py",
    "stereo/decisions/report.py",
    "stereo/design/read_design.py",
    "stereo/report/notes.py",
    "stereo/report/rare_failures.py",
    "stereo/report/verdict_text.py",
}


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (99.7, "100"),
        (100, "100"),
        (149, "150"),
        (1249, "1 200"),
        (27.3, "27"),
        (0.00123, "0.0012"),
        (0, "0"),
        (-3.14, "-3.1"),
    ],
)
def test_two_digits_have_no_exponent(value, text):
    assert show_rounded(value) == text


@given(st.floats(1e-3, 1e9))
def test_it_is_the_number_within_half_of_its_second_digit(value):
    text = show_rounded(value)
    assert "e" not in text
    assert float(text.replace(" ", "")) == pytest.approx(value, rel=0.0501)


@pytest.mark.parametrize(
    ("number", "thing", "things", "text"),
    [
        (1, "pair", "", "1 pair"),
        (0, "pair", "", "0 pairs"),
        (12, "pair", "", "12 pairs"),
        (1, "vertex", "vertices", "1 vertex"),
        (2, "vertex", "vertices", "2 vertices"),
        (1, "more pair", "", "1 more pair"),
    ],
)
def test_one_is_singular(number, thing, things, text):
    assert format_count(number, thing, things) == text


def test_what_is_counted_is_singular_where_it_is_one():
    """Every count of pairs, scenes and methods in a message is one of ``format_count``, unless it is two or more."""
    plural = re.compile(r" (?:more )?(?:pairs|scenes|methods)\b")
    bare = {
        name
        for name, path in zip(IDS, SOURCES, strict=True)
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.JoinedStr)
        for part, after in zip(node.values, node.values[1:], strict=False)
        if isinstance(part, ast.FormattedValue) and isinstance(after, ast.Constant) and plural.match(str(after.value))
    }
    assert bare == SEVERAL


@pytest.mark.parametrize(
    ("place", "text"),
    [((-80.0, 29.0), "80° S, 29° E"), ((10.0, 331.0), "10° N, 331° E"), ((0.0, -0.5), "0° N, 0.5° W")],
)
def test_a_place_has_no_negative_numbers(place, text):
    assert show_place(*place) == text
