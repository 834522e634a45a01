"""Numbers as the user reads them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.number_text import show_rounded


@pytest.mark.parametrize(("value", "text"), [
    (99.7, "100"), (100, "100"), (149, "150"), (1249, "1 200"), (27.3, "27"), (0.00123, "0.0012"),
    (0, "0"), (-3.14, "-3.1")])
def test_two_digits_have_no_exponent(value, text):
    assert show_rounded(value) == text


@given(st.floats(1e-3, 1e9))
def test_it_is_the_number_within_half_of_its_second_digit(value):
    text = show_rounded(value)
    assert "e" not in text
    assert float(text.replace(" ", "")) == pytest.approx(value, rel=0.0501)
