"""A matcher with ``match``, ours or from an installed package, with the interface of the other modules here."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...plugins.installed import Plugin, explain_failures, find_function, find_source_files, load_plugin, read_summary
from ...settings.topics.trust_boundary import LOADING_OPTIONS
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import parse_json
from ...support.printer import show_controls
from .opencv_common import SEARCH_RANGE, resolve_range
from .options import Option, resolve_options
from .result import CONFIDENCE, CONFIDENCE_KINDS, Confidence, Result
from .search_range import SearchRange

#: Keys of an entry of OPTIONS.
_OPTION_KEYS = ("default", "doc", "minimum", "maximum", "step", "choices")
#: Options that every matcher of a plug-in has, or whose meaning Icy Moon defines.
_RESERVED_OPTIONS = {"preset", "grey", *(name for option in SEARCH_RANGE for name in (option.key, option.opencv))}


@dataclass(frozen=True)
class MatchContext:
    """The arguments of a plug-in's ``match`` besides the images.

    ``options`` are complete. Search all whole disparities from ``least_px`` to ``most_px``, both included; both are 0
    for a matcher that states ``SEARCHES = False``. The camera's values are None where the camera is not known; the
    principal point counts from the corner of the image.
    """

    options: Mapping[str, Any]
    least_px: int
    most_px: int
    focal_px: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    baseline_m: float | None = None


class PluginMatcher:
    """The matcher of a plug-in. Raises IcyMoonError if the plug-in cannot be loaded or is not complete."""

    def __init__(self, plugin: Plugin) -> None:
        self.plugin = plugin
        self.loaded = load_plugin(plugin)
        self.__doc__ = read_summary(self.loaded) + ("" if plugin.built_in else f" (plug-in, {plugin.release})")
        self._match = find_function(plugin, self.loaded, "match", "left, right, context")
        with explain_failures(plugin, "cannot be used", "correct it, or uninstall the package"):
            self.COLOUR, self.SPARSE, self._searches = (
                bool(getattr(self.loaded, name, default))
                for name, default in (("COLOUR", False), ("SPARSE", False), ("SEARCHES", True))
            )
            own = read_options(plugin, getattr(self.loaded, "OPTIONS", {}))
            self.OPTIONS = (*(SEARCH_RANGE if self._searches else ()), *own)
            self.PRESETS = read_presets(plugin, self.OPTIONS, getattr(self.loaded, "PRESETS", {}))

    def settle(
        self, options: dict[str, Any], ranges: Mapping[str, SearchRange], shape: tuple[int, ...]
    ) -> tuple[dict[str, Any], SearchRange | None]:
        """Return the options with a search range in numbers, and this range; None if the matcher has no range."""
        if not self._searches:
            return options, None
        return resolve_range(self.plugin.name, options, ranges)

    def compute(self, left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
        """Compute the disparity of uint8 images with the plug-in. Raises IcyMoonError if it fails."""
        least, most = 0, 0
        if self._searches:
            least = options["min_disparity"]
            most = least + options["disparities"] - 1
        known = (
            {}
            if camera is None
            else {key: float(getattr(camera, key)) for key in ("focal_px", "cx_px", "cy_px", "baseline_m")}
        )
        with explain_failures(self.plugin):
            found = self._match(
                left.copy(), right.copy(), MatchContext(_declared_options(options), least, most, **known)
            )
            found, facts, *stated = found if isinstance(found, tuple) else (found, {})
            facts = parse_json(json.dumps(dict(facts), allow_nan=False))
        if not self.plugin.built_in:
            facts |= {"plug_in": self.plugin.release}
        disparity = check_disparity(self.plugin, found, left.shape[:2])
        confidence = self._read_confidence(*stated) if stated else None
        return Result(disparity, facts=facts, confidence=confidence)

    def _read_confidence(self, values: object, *more: object) -> Confidence | None:
        """Read the third value that ``match`` returned, as the kind that the plug-in states as CONFIDENCE; None without
        a value. Raises IcyMoonError for more values or an unknown kind.
        """
        kind = getattr(self.loaded, "CONFIDENCE", CONFIDENCE)
        if more:
            raise IcyMoonError(
                f"{self.plugin.title} returned {3 + len(more)} values; return disparity, facts and confidence."
            )
        if kind not in CONFIDENCE_KINDS:
            raise IcyMoonError(
                f"{self.plugin.title} states CONFIDENCE = {kind!r}; state one of {', '.join(CONFIDENCE_KINDS)}."
            )
        return None if values is None else Confidence(values, kind)

    def check(self, options: dict[str, Any]) -> None:
        """Raise IcyMoonError with the sentence that the plug-in's own ``check`` returns. No sentence means that the
        plug-in can run here.
        """
        if fault := self._call_function("check", options):
            raise IcyMoonError(f"{self.plugin.title} cannot run here: {show_controls(str(fault))}")

    def load(self, options: dict[str, Any]) -> None:
        """Call the plug-in's ``load``, if it has one, before a pair is matched and timed."""
        self._call_function("load", options)

    def _call_function(self, name: str, options: dict[str, Any]) -> object:
        act = getattr(self.loaded, name, None)
        with explain_failures(self.plugin):
            return act(_declared_options(options)) if callable(act) else None

    def files(self, options: dict[str, Any]) -> list[str]:
        """List the files that determine the result: the source of an installed plug-in. A built-in one has none,
        because Icy Moon's version covers it.
        """
        return [] if self.plugin.built_in else find_source_files(self.loaded)


def _declared_options(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the options that a plug-in declared itself."""
    return MappingProxyType({key: value for key, value in options.items() if key not in _RESERVED_OPTIONS})


def check_disparity(plugin: Plugin, found: object, shape: tuple[int, ...]) -> Array:
    """Check the result of a plug-in, and return it as float32. Raises IcyMoonError unless it is a disparity map of this
    shape.
    """
    if not isinstance(found, np.ndarray):
        raise IcyMoonError(
            f"{plugin.title} returned {type(found).__name__}; return a numpy array of disparities in px."
        )
    if found.shape != shape:
        raise IcyMoonError(
            f"{plugin.title} returned an array of the shape {found.shape} for images of {shape}; return "
            "a disparity for each pixel of the left image."
        )
    if found.dtype.kind != "f":
        raise IcyMoonError(
            f"{plugin.title} returned values of the type {found.dtype}; return float32 in px, with NaN "
            "where nothing was measured."
        )
    plain = np.ma.filled(found, np.nan) if isinstance(found, np.ma.MaskedArray) else np.asarray(found)
    with np.errstate(all="ignore"):  # infinity means no measurement
        return plain.astype(np.float32)


def read_presets(plugin: Plugin, options: Sequence[Option], stated: object) -> dict[str, dict[str, Any]]:
    """Read the named sets of options that a plug-in declares. Raises IcyMoonError for an invalid set."""
    if not isinstance(stated, Mapping) or not all(isinstance(chosen, Mapping) for chosen in stated.values()):
        raise IcyMoonError(
            f'{plugin.title} has PRESETS that are not dictionaries; write PRESETS = {{"fine": {{"window": 3}}}}.'
        )
    presets = {}
    for name, chosen in stated.items():
        complete = resolve_options(plugin.name, options, {}, chosen)
        presets[str(name)] = {key: complete[key] for key in chosen}
    return presets


def read_options(plugin: Plugin, stated: object) -> list[Option]:
    """Read the options that a plug-in declares. Raises IcyMoonError for an invalid declaration."""
    if not isinstance(stated, Mapping):
        raise IcyMoonError(
            f'{plugin.title} has OPTIONS that are not a dictionary; write OPTIONS = {{"window": '
            '{"default": 7, "minimum": 3, "maximum": 15, "doc": "…"}}.'
        )
    return [_read_option(plugin, key, facts) for key, facts in stated.items()]


def _read_option(plugin: Plugin, key: object, facts: object) -> Option:
    where = f"{plugin.title}: OPTIONS[{key!r}]"
    if not (isinstance(key, str) and key.isidentifier()) or key in _RESERVED_OPTIONS:
        raise IcyMoonError(f"{where} has a name that cannot be used; choose another word.")
    if not isinstance(facts, Mapping) or "default" not in facts or not isinstance(facts.get("doc"), str):
        raise IcyMoonError(f"{where} must be a dictionary with at least a default and a doc.")
    if unknown := [name for name in facts if name not in _OPTION_KEYS]:
        raise IcyMoonError(f"{where} has {unknown[0]!r}; an option has {', '.join(_OPTION_KEYS)}.")
    default = facts["default"]
    if isinstance(default, str) and not facts.get("choices") and key not in LOADING_OPTIONS:
        raise IcyMoonError(
            f"{where} is a text; state its choices. Only {', '.join(LOADING_OPTIONS)} may be any text, which no "
            "scene and no file can set."
        )
    numeric = isinstance(default, (int, float)) and not isinstance(default, bool)
    if not numeric and not isinstance(default, str):
        raise IcyMoonError(f"{where} has the default {default!r}; give a number, or one of choices that are texts.")
    try:
        if numeric and not all(math.isfinite(float(facts.get(name, 0))) for name in ("default", "minimum", "maximum")):
            raise ValueError("a number is not finite")
        if not (type(facts.get("step", 1)) is int and facts.get("step", 1) >= 1):
            raise ValueError(f"step is {facts['step']!r}, not a whole number from 1 up")
        if numeric and not facts["minimum"] <= default <= facts["maximum"]:
            raise ValueError(f"the default {default} is not between minimum and maximum")
        if facts.get("choices") and default not in facts["choices"]:
            raise ValueError(f"the default {default!r} is not one of the choices")
        return Option(
            key,
            default,
            facts["doc"],
            facts.get("minimum", 0),
            facts.get("maximum", 0),
            facts.get("step", 1),
            tuple(map(str, facts.get("choices", ()))),
        )
    except KeyError as missing:
        raise IcyMoonError(f"{where} is a number without {missing.args[0]}; state minimum and maximum.") from None
    except (ArithmeticError, TypeError, ValueError) as error:
        raise IcyMoonError(f"{where} cannot be used ({error}).") from None
