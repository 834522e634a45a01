"""Search among all settings by words of their labels, names and tooltips. Imports no Blender."""

from __future__ import annotations

import re
from functools import cache, lru_cache
from typing import NamedTuple

from .table import TOPICS, list_all_settings

#: Words that users type, and the words of settings that they mean.
SYNONYMS = {
    "aperture": "f-number",
    "color": "colour",
    "fov": "focal",
    "gray": "grey",
    "rover": "lander",
    "spp": "samples",
    "stones": "rocks",
    "boulders": "rocks",
    "sunlight": "sun",
    "resolution": "width",
}
_WORD = re.compile(r"[^\W_]+")
#: Score of a word that contains the typed word but does not begin with it.
_INSIDE = 0.5


class _Entry(NamedTuple):
    """A setting and its search words: of its label, name, panel, choices and tooltip."""

    topic: str
    key: str
    words: tuple[frozenset[str], ...]


def split_words(text: str) -> list[str]:
    """The words of a text in small letters, separated by "_" and punctuation."""
    return _WORD.findall(text.lower())


@cache
def _make_index() -> tuple[_Entry, ...]:
    return tuple(
        _Entry(
            topic,
            setting.key,
            tuple(
                frozenset(split_words(text))
                for text in (
                    setting.label,
                    f"{topic} {setting.key}",
                    f"{TOPICS[topic].label} {setting.section.label if setting.section else ''}",
                    " ".join(label for _, label, _ in setting.choices),
                    setting.description,
                )
            ),
        )
        for topic, setting in list_all_settings()
    )


@cache
def _list_words() -> frozenset[str]:
    """All words of all settings."""
    return frozenset(word for entry in _make_index() for words in entry.words for word in words)


@lru_cache(maxsize=256)
def _find_words(typed: str) -> tuple[tuple[float, frozenset[str]], ...]:
    """The words of settings that match a typed word, with a score: the word itself, words that begin with it, and for
    three letters or more words that contain it."""
    beginning = frozenset(word for word in _list_words() if word.startswith(typed))
    inside = frozenset(word for word in _list_words() if typed in word) if len(typed) > 2 else frozenset()
    return (0.0, frozenset({typed})), (_INSIDE / 2, beginning), (_INSIDE, inside)


def _score(entry: _Entry, typed: str) -> float | None:
    """Distance of a match from the label, 0 for a whole word of the label; None without a match."""
    for tier, words in enumerate(entry.words):
        for score, found in _find_words(typed):
            if not words.isdisjoint(found):
                return tier + score
    return None


def _score_word(entry: _Entry, typed: str) -> float | None:
    """The score of one typed word, or of the words that it stands for."""
    direct = _score(entry, typed)
    if direct is not None or typed not in SYNONYMS:
        return direct
    scores = [_score(entry, word) for word in split_words(SYNONYMS[typed])]
    return None if None in scores else max(filter(None, scores), default=0.0)


@lru_cache(maxsize=64)
def find_settings(typed: str) -> tuple[tuple[str, str], ...]:
    """The settings (topic, key) that have all of the typed words, the nearest first; a name such as
    ``rig.baseline_m`` finds its setting first. Empty without words."""
    words = split_words(typed)
    found = []
    for order, entry in enumerate(_make_index() if words else ()):
        scores = [_score_word(entry, word) for word in words]
        if None not in scores:
            exact = typed.strip().lower() in (entry.key, f"{entry.topic}.{entry.key}")
            found.append((not exact, sum(filter(None, scores)), len(entry.words[0]), order, entry))
    return tuple((entry.topic, entry.key) for *_, entry in sorted(found))
