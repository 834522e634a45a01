"""Selects a part of a data set in which each value of each varied setting keeps its share. Imports no Blender."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np

from ...physics.random_numbers.seeds import make_generator
from ...settings.table import list_all_settings
from ...support.arrays import Array
from .planned_pair import PlannedPair

_SHUFFLE_SEED = 0


def find_varied_settings(pairs: Sequence[PlannedPair]) -> list[tuple[str, str]]:
    """Find the settings, as (topic, key), that differ between pairs."""
    # Pairs share most of their tables, so each table is compared once.
    tables = {
        topic: list({id(table): table for pair in pairs if (table := pair.settings[topic]) is not None}.values())
        for topic in dict.fromkeys(topic for topic, _ in list_all_settings())
    }
    return [
        (topic, s.key)
        for topic, s in list_all_settings()
        if any(table[s.key] != tables[topic][0][s.key] for table in tables[topic])
    ]


def choose_stratified(pairs: Sequence[PlannedPair], count: int) -> list[PlannedPair]:
    """Choose ``count`` of the pairs so that each value of each varied setting has about the same share as in all pairs.

    Settings that always vary together count as one, and the seed of the ground does not count. Pairs are chosen one by
    one, each time a pair whose values are most lacking; ties are broken in a fixed random order. So a larger part of
    the same pairs contains each smaller part.
    """
    levels = _number_levels(pairs)
    share = [np.bincount(level) / len(pairs) for level in levels]
    chosen_of = [np.zeros(len(each)) for each in share]
    order = make_generator(_SHUFFLE_SEED, "plan", zlib.crc32(b"stratified")).permutation(len(pairs))
    left = np.ones(len(pairs), bool)
    chosen: list[int] = []
    for number in range(min(count, len(pairs))):
        surplus = np.zeros(len(pairs))
        for level, own, there in zip(levels, share, chosen_of, strict=True):
            surplus += (there - (number + 1) * own)[level]
        surplus[~left] = np.inf
        best = int(order[np.argmin(np.round(surplus[order], 9))])
        left[best] = False
        chosen.append(best)
        for level, there in zip(levels, chosen_of, strict=True):
            there[level[best]] += 1
    return [pairs[k] for k in sorted(chosen)]


def _number_levels(pairs: Sequence[PlannedPair]) -> list[Array]:
    """Number the values of each setting that varies independently: the value of each pair as an index from 0 on."""
    found: dict[bytes, Array] = {}
    for topic, key in find_varied_settings(pairs):
        if (topic, key) == ("dataset", "seed"):
            continue
        known: dict[str, int] = {}
        level = np.array([known.setdefault(repr(pair.settings[topic][key]), len(known)) for pair in pairs])
        found[level.tobytes()] = level
    return list(found.values())
