"""Suggests a known word for an unknown word."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggest_nearest(word: str, known: Iterable[str], cutoff: float = 0.5, otherwise: str = "") -> str:
    """Return the end of a sentence about an unknown word: the most similar known word, or all known words. ``cutoff``
    is the minimum similarity, from 0 to 1 for equal words; ``otherwise`` replaces a long list."""
    names = list(known)
    close = difflib.get_close_matches(word, names, n=1, cutoff=cutoff)
    if close:
        return f"did you mean {close[0]!r}?"
    return otherwise or f"known are {', '.join(names) or 'none'}."
