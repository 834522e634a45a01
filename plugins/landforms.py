"""Landforms of packages that the user installed: their declarations and their heights.

They are loaded once, when the settings are first needed, because each landform adds its own table of settings.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .installed import Plugin, explain_failures, find_function, find_installed, load_plugin, read_summary

#: Prefix of the name of a landform's table of settings; no table of ours begins with it.
PREFIX = "landform_"
#: The setting in such a table that states which release of the package made the landform; empty if the landform is off.
RELEASE = "made_by"
#: Units of settings, with which the names of settings end.
UNITS = {"_m": "m", "_deg": "deg", "_px": "px", "_share": "1", "_ratio": "1"}
_STATED = ("default", "minimum", "maximum", "label", "doc")


@dataclass(frozen=True)
class Number:
    """One setting of a landform. If the setting is a whole number, ``default`` is an int."""

    key: str
    default: float | int
    minimum: float
    maximum: float
    label: str
    doc: str

    @property
    def unit(self) -> str:
        """Unit that the name states."""
        return next((unit for end, unit in UNITS.items() if self.key.endswith(end)), "1")


@dataclass(frozen=True)
class PluginLandform:
    """A landform of a plug-in. Its first setting is its size; 0 turns it off."""

    plugin: Plugin
    label: str
    doc: str
    settings: tuple[Number, ...]
    height: Callable[..., Any]
    finest: Callable[..., Any] | None

    @property
    def topic(self) -> str:
        """Name of the landform's table of settings."""
        return f"{PREFIX}{self.plugin.name}"

    def heights(self, x_m: Array, y_m: Array, settings: Mapping[str, Any]) -> Array:
        """Compute heights in metres, float64, at points in metres that broadcast. Raises IcyMoonError if the plug-in
        fails or returns something else."""
        x, y = (np.array(values, np.float64) for values in np.broadcast_arrays(x_m, y_m))
        with explain_failures(self.plugin, fix="correct it, or set its first setting to 0"):
            found = self.height(x, y, settings)
        if not isinstance(found, np.ndarray) or found.shape != x.shape or found.dtype.kind != "f":
            what = f"{found.dtype} {found.shape}" if isinstance(found, np.ndarray) else type(found).__name__
            raise IcyMoonError(
                f"{self.plugin.title} returned {what} for points of the shape {x.shape}; return a float "
                "array of heights in metres of the same shape."
            )
        if not np.isfinite(found).all():
            raise IcyMoonError(
                f"{self.plugin.title} returned {np.count_nonzero(~np.isfinite(found))} heights that are "
                "NaN or infinite; return a height in metres for every point."
            )
        return found.astype(np.float64)

    def finest_m(self, settings: Mapping[str, Any]) -> float:
        """Return the landform's smallest length in metres; infinite if the plug-in declares none."""
        if self.finest is None:
            return math.inf
        with explain_failures(self.plugin, fix="correct it, or set its first setting to 0"):
            length = float(self.finest(settings))
        if not length > 0.0:
            raise IcyMoonError(f"{self.plugin.title} states a smallest length of {length:g} m; return more than 0.")
        return length

    def make_plugin_settings(self, settings: Mapping[str, Any], seed: int) -> Mapping[str, Any]:
        """Make the settings that the plug-in receives, with the ``seed`` for its random numbers."""
        return MappingProxyType({**{number.key: settings[number.key] for number in self.settings}, "seed": seed})


def describe_missing_landform(topic: str, release: str) -> str:
    """Describe why a landform cannot be made here, with the fix, but without the file that uses it."""
    _, faults = load_landform_plugins()
    if topic in faults:
        return f"{topic} cannot be used: {faults[topic]}"
    package = f", {release}," if release else ""
    return (
        f"{topic} is of a plug-in{package} that is not installed in the Python that builds scenes; install its "
        "package there, or remove the table."
    )


def hash_name(name: str) -> int:
    """Hash a name to a number of 32 bits, which makes a landform's random numbers independent of other plug-ins."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")


@cache
def load_landform_plugins() -> tuple[dict[str, PluginLandform], dict[str, str]]:
    """Load the usable landforms by the name of their table, and a sentence for each landform that cannot be used."""
    found = find_installed("landform")
    usable: dict[str, PluginLandform] = {}
    faults = {f"{PREFIX}{name}": sentence for name, sentence in found.refused.items()}
    for name, plugin in found.usable.items():
        try:
            usable[f"{PREFIX}{name}"] = read_landform(plugin)
        except IcyMoonError as error:
            faults[f"{PREFIX}{name}"] = str(error)
    return usable, faults


def read_landform(plugin: Plugin) -> PluginLandform:
    """Read the declaration of a plug-in. Raises IcyMoonError if it cannot be loaded or is incomplete."""
    loaded = load_plugin(plugin)
    height = find_function(plugin, loaded, "height", "x, y, settings")
    stated = getattr(loaded, "SETTINGS", None)
    if not isinstance(stated, Mapping) or not stated:
        raise IcyMoonError(
            f'{plugin.title} has no SETTINGS; write SETTINGS = {{"height_m": {{"default": 0.0, '
            '"minimum": 0.0, "maximum": 10.0, "label": "Height", "doc": "…"}}.'
        )
    numbers = tuple(_read_number(plugin, key, facts) for key, facts in stated.items())
    first = numbers[0]
    if first.default != 0 or first.minimum != 0:
        raise IcyMoonError(
            f"{plugin.title}: the first of SETTINGS, {first.key}, is its size, and 0 turns it off; give "
            "it the default 0 and the minimum 0."
        )
    finest = getattr(loaded, "finest_m", None)
    label = str(getattr(loaded, "LABEL", plugin.name.replace("_", " ").title()))
    return PluginLandform(
        plugin, label, read_summary(loaded).rstrip(".") or label, numbers, height, finest if callable(finest) else None
    )


def _read_number(plugin: Plugin, key: object, facts: object) -> Number:
    where = f"{plugin.title}: SETTINGS[{key!r}]"
    if not (isinstance(key, str) and key.isidentifier() and key.islower()) or key in (RELEASE, "seed"):
        raise IcyMoonError(f"{where} has a name that cannot be used; choose small letters, digits and _.")
    if not isinstance(facts, Mapping) or (unknown := [name for name in facts if name not in _STATED]):
        said = f"has {unknown[0]!r}" if isinstance(facts, Mapping) else "is not a dictionary"
        raise IcyMoonError(f"{where} {said}; a setting has {', '.join(_STATED)}.")
    if missing := [name for name in _STATED if name not in facts]:
        raise IcyMoonError(f"{where} has no {missing[0]}; a setting has {', '.join(_STATED)}.")
    default, low, high = (facts[name] for name in _STATED[:3])
    numbers = [
        value
        for value in (default, low, high)
        if isinstance(value, (int, float)) and math.isfinite(value) and not isinstance(value, bool)
    ]
    if len(numbers) < 3 or not low <= default <= high or low == high:
        raise IcyMoonError(
            f"{where} has the default {default!r} from {low!r} to {high!r}; give three numbers, the "
            "default between the others."
        )
    if not all(isinstance(facts[name], str) and facts[name].strip() for name in ("label", "doc")):
        raise IcyMoonError(f"{where} has an empty label or doc; write the texts for the window.")
    return Number(key, default, low, high, facts["label"], facts["doc"].rstrip("."))
