"""The known word that an unknown word was probably meant to be."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggest_nearest(word: str, known: Iterable[str], cutoff: float = 0.5, otherwise: str = "") -> str:
    """The end of a sentence about an unknown word: the likeliest one that was meant, or all there are.

    ``cutoff`` is how like a word must be, from 0 to 1 for the same; ``otherwise`` is the end in place of a long list.
    """
    names = list(known)
    close = difflib.get_close_matches(word, names, n=1, cutoff=cutoff)
    if close:
        return f"did you mean {close[0]!r}?"
    return otherwise or f"known are {', '.join(names) or 'none'}."
