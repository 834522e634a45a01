"""Settings that many descriptions share, stored once to keep files with many descriptions small."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from .topics.declaration import Parts

#: Tables of settings by topic: the settings that all descriptions share, or the other settings of one description.
Tables = dict[str, dict[str, Any]]


def find_shared(descriptions: Iterable[Parts]) -> Tables:
    """Find the settings that have the same value in all of these descriptions."""
    first: Parts = {}
    shared: Tables = {}
    for k, settings in enumerate(descriptions):
        if k == 0:
            first, shared = settings, {topic: dict(table) for topic, table in settings.items()}
        for topic, table in shared.items():
            other = settings.get(topic, {})
            if other is not first[topic]:  # pairs of a plan share most of their tables
                shared[topic] = {key: value for key, value in table.items() if _is_same(other, key, value)}
    return {topic: table for topic, table in shared.items() if table}


def _is_same(table: Mapping[str, Any], key: str, value: object) -> bool:
    # 0.0 and -0.0 are equal, but give different ids.
    return key in table and repr(table[key]) == repr(value)


def remove_shared(settings: Parts, shared: Parts) -> Tables:
    """Return the settings of a description without the shared ones."""
    own = {
        topic: {key: value for key, value in table.items() if key not in shared.get(topic, {})}
        for topic, table in settings.items()
    }
    return {topic: table for topic, table in own.items() if table}


def add_shared(own: Parts, shared: Parts) -> Tables:
    """Join the shared settings with a description's own, which override them."""
    return {topic: {**shared.get(topic, {}), **own.get(topic, {})} for topic in {**shared, **own}}
