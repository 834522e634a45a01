"""Search by typed words: one ranking for settings and for other things with words. Imports no Blender."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import NamedTuple

from .table import TOPICS, list_all_settings

#: Words that users type, and the words of settings or buttons that they mean.
SYNONYMS = {
    "aperture": "f-number",
    "color": "colour",
    "dataset": "data",
    "fov": "focal",
    "gray": "grey",
    "lamps": "lamp",
    "rover": "lander",
    "spp": "samples",
    "stones": "rocks",
    "boulders": "rocks",
    "sunlight": "sun",
    "sweep": "vary",
    "resolution": "width",
}
_WORD = re.compile(r"[^\W_]+")
#: Distance of a word that contains the typed word but does not begin with it.
_INSIDE = 0.5


class Entry(NamedTuple):
    """A searchable entry: the names that mean only it, and its search words, the nearest first."""

    names: tuple[str, ...]
    words: tuple[frozenset[str], ...]


class Match(NamedTuple):
    """The number of an entry that has all typed words, and the tier of the farthest of these words."""

    number: int
    tier: int


def split_words(text: str) -> list[str]:
    """Split a text into its words in small letters, separated by "_" and punctuation."""
    return _WORD.findall(text.lower())


def make_entry(names: Sequence[str], *texts: str) -> Entry:
    """Make an entry with the words of some texts, the nearest first."""
    return Entry(tuple(names), tuple(frozenset(split_words(text)) for text in texts))


class WordIndex:
    """Finds entries by typed words."""

    def __init__(self, entries: Sequence[Entry]) -> None:
        """Index ``entries``, which keep their order where they match equally well."""
        self._entries = tuple(entries)
        self._words = frozenset(word for entry in self._entries for words in entry.words for word in words)
        self._find_words = lru_cache(maxsize=256)(self._match_words)
        self.rank = lru_cache(maxsize=64)(self._rank)

    def _match_words(self, typed: str) -> tuple[tuple[float, frozenset[str]], ...]:
        """Find the words of entries that match a typed word, with a distance: the word itself, words that begin with
        it, and words that contain it. The latter count only for four typed letters or more, because 'own' is in 'known'
        by chance."""
        beginning = frozenset(word for word in self._words if word.startswith(typed))
        inside = frozenset(word for word in self._words if typed in word) if len(typed) > 3 else frozenset()
        return (0.0, frozenset({typed})), (_INSIDE / 2, beginning), (_INSIDE, inside)

    def _measure(self, entry: Entry, typed: str) -> float | None:
        """Measure the distance of a match from the nearest words, 0 for a whole word; None without a match."""
        for tier, words in enumerate(entry.words):
            for distance, found in self._find_words(typed):
                if not words.isdisjoint(found):
                    return tier + distance
        return None

    def _measure_word(self, entry: Entry, typed: str) -> float | None:
        """Measure the distance of one typed word, or of the words that it stands for; None without a match."""
        direct = self._measure(entry, typed)
        if direct is not None or typed not in SYNONYMS:
            return direct
        distances = [self._measure(entry, word) for word in split_words(SYNONYMS[typed])]
        return None if None in distances else max(filter(None, distances), default=0.0)

    def _rank(self, typed: str) -> tuple[Match, ...]:
        """Rank the entries that have all of the typed words, the nearest first; empty without words."""
        words = split_words(typed)
        found = []
        for order, entry in enumerate(self._entries if words else ()):
            distances = [self._measure_word(entry, word) for word in words]
            if None not in distances:
                known = [distance for distance in distances if distance is not None]
                exact = typed.strip().lower() in entry.names
                found.append((not exact, sum(known), len(entry.words[0]), order, int(max(known))))
        return tuple(Match(order, tier) for *_, order, tier in sorted(found))


@cache
def _index_settings() -> WordIndex:
    return WordIndex(
        [
            make_entry(
                (setting.key, f"{topic}.{setting.key}"),
                setting.label,
                f"{topic} {setting.key}",
                f"{TOPICS[topic].label} {setting.section.label if setting.section else ''}",
                " ".join(label for _, label, _ in setting.choices),
                setting.description,
            )
            for topic, setting in list_all_settings()
        ]
    )


def find_settings(typed: str) -> tuple[tuple[str, str], ...]:
    """Find the settings (topic, key) that have all of the typed words, the nearest first. A name such as
    ``rig.baseline_m`` finds its setting first. Empty without words."""
    settings = list_all_settings()
    return tuple((settings[found.number][0], settings[found.number][1].key) for found in _index_settings().rank(typed))


#: Index of the farthest search words of a setting: the words of its description.
_DESCRIPTION = 4


def find_near_settings(typed: str) -> frozenset[tuple[str, str]]:
    """Find the settings of ``find_settings`` that have the typed words in more than their description."""
    settings = list_all_settings()
    return frozenset(
        (settings[found.number][0], settings[found.number][1].key)
        for found in _index_settings().rank(typed)
        if found.tier < _DESCRIPTION
    )
