"""Checks whether a later part of a plan overwrites the variations of a sweep, so that pairs would be lost. Imports no
Blender.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...formats.toml_lines import Place
from ...settings.table import TOPICS
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from . import pose_sweeps
from .setting_sweeps import Sweep, Variation


@dataclass(frozen=True)
class _Layer:
    """One of the combined sweeps: the full ``names`` of its settings, and each variation's values by these names."""

    place: Place
    name: str
    names: frozenset[str]
    variations: list[dict[str, Any]]

    def covers(self, key: str) -> bool:
        """Return whether every variation sets a setting."""
        return all(key in part for part in self.variations)


def check_overwritten(
    base: Settings,
    parts: Sequence[Variation],
    seeds: Place | None,
    made: Sequence[tuple[Sweep, list[Variation]]],
    cameras: Sequence[Sweep],
) -> None:
    """Raise IcyMoonError if the variations of a sweep would be lost, for every pair or for some.

    ``base`` is made of ``parts``; the parts of extended plans come first. Later values override earlier values: first
    ``base``, then the ``seeds`` that the plan states, then ``made``, the sweeps of settings with their variations, then
    ``cameras``, in the order of ``pose_sweeps.KINDS``.
    """
    layers = [
        _Layer(sweep.place, sweep.name, _list_named(sweep), [_list_stated(part) for part in variations])
        for sweep, variations in made
    ]
    _check_settings(parts, layers)
    for sweep in cameras:
        varied, overwritten = pose_sweeps.list_rig_settings(sweep)
        layers.append(_Layer(sweep.place, sweep.name, varied, [dict.fromkeys(overwritten)]))
    if seeds is not None:
        layers.insert(0, _Layer(seeds, "", frozenset({"dataset.seed"}), []))
    for k, earlier in enumerate(layers):
        for later in layers[k + 1 :]:
            _check_named(earlier, later)
        _check_differences(base, earlier, layers[k + 1 :])


def _list_named(sweep: Sweep) -> frozenset[str]:
    """List the settings that a sweep names itself, not by presets."""
    tables = sweep.table.get("case", ()) if sweep.kind == "cases" else (sweep.table,)
    return frozenset(
        f"{topic}.{key}"
        for table in tables
        for topic, values in table.items()
        if topic in TOPICS and isinstance(values, Mapping)
        for key in values
    )


def _list_stated(part: Variation) -> dict[str, Any]:
    """List the settings of a variation by their full names."""
    return {f"{topic}.{key}": value for topic, values in part.settings.items() for key, value in values.items()}


def _check_settings(parts: Sequence[Variation], layers: Sequence[_Layer]) -> None:
    """Raise IcyMoonError if a plan states a setting that an extended plan's sweep sets for every pair."""
    order = {part.place.file: k for k, part in enumerate(parts)}
    for k, part in enumerate(parts):
        if part.place.key:
            continue  # a preset, whose other settings may be the reason for its choice
        for key in _list_stated(part):
            for layer in layers:
                if order[layer.place.file] < k and key in layer.names and layer.covers(key):
                    raise IcyMoonError(
                        f"{part.place.at(*key.split('.'))}: {key} would change nothing, since the sweep "
                        f"'{layer.name}' of {layer.place} sets it for every pair; write without = ['{layer.name}'] "
                        f"under [plan], or a sweep with replaces = '{layer.name}'."
                    )


def _check_named(earlier: _Layer, later: _Layer) -> None:
    """Raise IcyMoonError if a sweep sets a setting that an earlier sweep names."""
    lost = sorted(key for key in earlier.names if any(key in part for part in later.variations))
    if not lost:
        return
    named = [key for key in lost if key in later.names]
    fix = (
        f"state all values of {' and '.join(named)} in one of the two"
        if named
        else "let the sweep of presets come first"
    )
    raise IcyMoonError(
        f"{later.place}: this sweep sets {', '.join(lost)}, so the values in {earlier.place} would be lost; "
        f"{fix}{_replace_hint(earlier, later)}."
    )


def _check_differences(base: Settings, earlier: _Layer, over: Sequence[_Layer]) -> None:
    """Raise IcyMoonError if two different variations of a sweep, such as two presets, are equal under later sweeps."""
    first = earlier.variations[0] if earlier.variations else {}

    def get_value(part: Mapping[str, Any], key: str) -> object:
        topic, _, name = key.partition(".")
        return part[key] if key in part else base[topic][name]

    differ = sorted(
        {
            key
            for part in earlier.variations
            for key in part.keys() | first.keys()
            if get_value(part, key) != get_value(first, key)
        }
    )
    rows = {tuple(repr(get_value(part, key)) for key in differ) for part in earlier.variations}
    known = {frozenset[str]()}
    for later in over:
        for keys in {frozenset(part).intersection(differ) for part in later.variations} - {frozenset()}:
            for lost in {keys | before for before in known} - known:
                left = {tuple(text for text, key in zip(row, differ, strict=True) if key not in lost) for row in rows}
                if len(left) < len(rows):
                    raise IcyMoonError(
                        f"{later.place}: this sweep sets {', '.join(sorted(keys))}, so some variations of the "
                        f"sweep at {earlier.place} are the same; leave one of the two "
                        f"out{_replace_hint(earlier, later)}."
                    )
                known.add(lost)


def _replace_hint(earlier: _Layer, later: _Layer) -> str:
    """Return the end of a fix, which proposes ``replaces``, if the earlier sweep is of an extended plan; else empty."""
    return f", or write replaces = '{earlier.name}'" if earlier.name and earlier.place.file != later.place.file else ""
