"""What was meant by a word that is not known."""

from __future__ import annotations

import pytest
from icymoon.support.suggestions import suggest_nearest


@pytest.mark.parametrize(
    ("word", "known", "said"),
    [
        ("hurzt", ("hurst", "size_m"), "did you mean 'hurst'?"),
        ("xyz", ("hurst", "size_m"), "known are hurst, size_m."),
        ("xyz", (), "known are none."),
    ],
)
def test_the_likeliest_word_is_named_or_all(word, known, said):
    assert suggest_nearest(word, known) == said


def test_the_cutoff_says_how_like_a_word_must_be():
    # Three letters of five, in order: 2 * 3 / (5 + 5) is a likeness of 0.6.
    assert suggest_nearest("abcxy", ["abcde"], 0.59) == "did you mean 'abcde'?"
    assert suggest_nearest("abcxy", ["abcde"], 0.61) == "known are abcde."
