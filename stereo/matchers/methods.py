"""The methods to run, from the user's texts: ``bm,sgbm:window=7``, ``--option bm.window=21`` and ``--method
mynet=resident:command=PROGRAM``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...settings.description import defaults
from ...settings.topics.trust_boundary import OWN_NAME, OWN_PREFIX, split_lidar, split_methods, split_option
from ...support.errors import IcyMoonError
from ...support.suggestions import suggest_nearest
from . import check_options, get_matcher_title, list_matcher_names, list_option_keys
from .lidar_options import LIDAR, RETURNS, complete_lidar_options

#: The matcher that is added to the default matchers where its library is installed.
_LEARNED = "icynet"
#: Separator of the options in a label.
_NEXT_OPTION = re.compile(r":(?=[A-Za-z0-9_]+=)")
_SLASHES = "/\\"
_PATH_PARTS = re.compile(r"[/\\]")


@dataclass(frozen=True)
class Method:
    """A matcher (``name``) with all of its options, checked. ``label`` is its name in the report.

    ``lidar`` are all options of the range points that help the matcher, see ``lidar_options``. The name LIDAR means
    range points without a matcher.
    """

    label: str
    name: str
    options: Mapping[str, Any]
    lidar: Mapping[str, Any] | None = None

    @property
    def file_name(self) -> str:
        """The label, with only characters that every file system allows."""
        return re.sub(r"[^A-Za-z0-9._-]+", "_", self.label)


@dataclass(frozen=True)
class UncheckedMethod:
    """A method as the user states it: the options are texts, and may be only some of the matcher's options."""

    label: str
    name: str
    options: dict[str, str] = field(default_factory=dict)
    lidar: dict[str, str] | None = None

    def parsed(self) -> Method:
        """Return the checked method. Raises IcyMoonError for an unknown option, a bad value, and a missing file or
        program.
        """
        options = {} if self.name == LIDAR else check_options(self.name, self.options)
        lidar = None if self.lidar is None else complete_lidar_options(self.name, self.lidar)
        return Method(self.label, self.name, options, lidar)


def list_default_methods() -> str:
    """List the methods that are compared if the user names none: those from the default settings, and ``icynet`` where
    PyTorch or ONNX Runtime is installed.
    """
    named = str(defaults().dataset.methods)
    try:
        check_options(_LEARNED, {})
    except IcyMoonError:
        return named
    return f"{named},{_LEARNED}"


def parse_key_value(text: str, where: str) -> tuple[str, str]:
    """Parse 'a=b' to ('a', 'b'). Raises IcyMoonError, naming ``where``, for any other text."""
    key, equals, value = split_option(text)
    if not (key and equals and value):
        raise IcyMoonError(f"{where} {text}: write it as key=value, as in window=21.")
    return key, value


def names_method(text: str, name: str) -> bool:
    """Return whether a comma-separated list of methods contains a matcher, with or without options. ``name`` may be
    own:NAME.
    """
    return any(_names_matcher(entry, name) for entry in text.split(","))


def describe_method(label: str) -> str:
    """Describe a method as readers know it, such as ``StereoBM window=7`` for bm:window=7. A name that the user gave is
    unchanged. The folder of a scan is shortened to its last part.

    Files keep the label, by which programs find a method.
    """
    matcher, lidar = split_lidar(label)
    name, *options = _NEXT_OPTION.split(matcher)
    stereo = " ".join((get_matcher_title(name), *options))
    if lidar is None:
        return stereo
    stated = (_shorten_folder(option) for option in _NEXT_OPTION.split(lidar))
    return " ".join(filter(None, (f"{stereo} + LiDAR" if matcher else "LiDAR", *stated)))


def _shorten_folder(option: str) -> str:
    """Return an option of range points, with the folder of a scan shortened to its last part: ``scan=NAME``."""
    key, _, value = option.partition("=")
    return f"scan={_PATH_PARTS.split(value.rstrip(_SLASHES))[-1]}" if key == RETURNS else option


def toggle_method(text: str, name: str) -> str:
    """Remove a matcher from a list of methods that contains it, or else append it. Other methods keep their options."""
    entries = [entry.strip() for entry in text.split(",") if entry.strip()]
    kept = [entry for entry in entries if not _names_matcher(entry, name)]
    return ",".join(kept if len(kept) < len(entries) else [*entries, name])


def _names_matcher(entry: str, name: str) -> bool:
    return f"{entry.strip()}:".startswith(f"{name}:")


def parse_own_matchers(texts: Sequence[str]) -> dict[str, UncheckedMethod]:
    """Parse the user's own matchers, by name, from ``NAME:METHOD:KEY=VALUE`` for each option, or ``NAME:METHOD``.

    Raises IcyMoonError for any other text, and for a name with two methods.
    """
    found: dict[str, UncheckedMethod] = {}
    for text in texts:
        name, method, option = (*text.split(":", 2), "", "")[:3]
        if not (OWN_NAME.fullmatch(name) and method in list_matcher_names()):
            raise IcyMoonError(
                f"--own {text}: write it as NAME:METHOD:KEY=VALUE, as in "
                "mine:external:command=PROGRAM; a name has letters, digits, - and _."
            )
        known = found.setdefault(name, UncheckedMethod(f"{OWN_PREFIX}:{name}", method))
        if known.name != method:
            raise IcyMoonError(f"--own {text}: {name} is already {known.name}; give it one method.")
        if option:
            key, value = parse_key_value(option, f"--own {name}:{method}:")
            known.options[key] = value
    return found


def parse_named_methods(texts: Sequence[str]) -> list[UncheckedMethod]:
    """Parse methods that the user named, from ``NAME=MATCHER`` or ``NAME=MATCHER:KEY=VALUE:KEY=VALUE`` for each.

    An option ends where a colon and the next known option follow, so a command may contain commas and colons. Raises
    IcyMoonError for any other text, for the name of a matcher, and for a name given twice.
    """
    found: list[UncheckedMethod] = []
    for text in texts:
        name, equals, rest = (part.strip() for part in text.partition("="))
        matcher, _, options = (part.strip() for part in rest.partition(":"))
        if not (equals and OWN_NAME.fullmatch(name)):
            raise IcyMoonError(
                f"--method {text}: write it as NAME=MATCHER:KEY=VALUE, as in "
                "mynet=resident:command=PROGRAM; a name has at most 40 letters, digits, - and _."
            )
        if name in (*list_matcher_names(), OWN_PREFIX, LIDAR):
            raise IcyMoonError(f"--method {text}: {name} is the name of a matcher; choose another name.")
        if name in (method.label for method in found):
            raise IcyMoonError(f"--method names {name} twice; give each method a name of its own.")
        parts = re.split(rf":(?=(?:{'|'.join(list_option_keys(matcher))})\s*=)", options) if options else []
        found.append(UncheckedMethod(name, matcher, dict(parse_key_value(part, f"--method {name}") for part in parts)))
    return found


def parse_methods(
    text: str, options: Sequence[str] = (), own: Sequence[str] = (), named: Sequence[str] = ()
) -> list[Method]:
    """Parse the methods of a comma-separated list, then the ``named`` methods, and check all before anything runs.

    A matcher may have options, ``bm:window=21:disparities=128``, so that it can be compared with itself. ``options``
    are ``matcher.key=value`` for every use of that matcher. ``own:NAME`` is one of ``own``, see ``parse_own_matchers``;
    for ``named`` see ``parse_named_methods``. Raises IcyMoonError for an unknown matcher or option, a bad value, or a
    method given twice.
    """
    shared = _parse_shared_options(options)
    owned = parse_own_matchers(own)
    methods: list[Method] = []
    own_names = [replace(each, options=shared.get(each.name, {}) | each.options) for each in parse_named_methods(named)]
    for label in (":".join((name, *given)) for name, given in split_methods(text)):
        matcher, lidar = split_lidar(label)
        name, *given = (matcher or LIDAR).split(":")
        if name == OWN_PREFIX:
            base = _find_own_matcher(given.pop(0) if given else "", owned)
        else:
            plain = UncheckedMethod(name, name, shared.get(name, {}))
            base = next((each for each in own_names if each.label == name and lidar is not None), plain)
        chosen = base.options | dict(parse_key_value(part, "--methods") for part in given)
        points = None if lidar is None else _parse_lidar_options(lidar)
        if label in (other.label for other in methods):
            raise IcyMoonError(f"--methods names {label} twice; leave one out.")
        methods.append(UncheckedMethod(label, base.name, chosen, points).parsed())
    methods += [each.parsed() for each in own_names]
    if not methods:
        raise IcyMoonError(f"--methods is empty; choose from {', '.join(list_matcher_names())}.")
    unused = sorted(set(shared) - {method.name for method in methods})
    if unused:
        raise IcyMoonError(
            f"--option is given for {unused[0]}, which no method uses; add it to --methods or remove the option."
        )
    return methods


def _parse_lidar_options(text: str) -> dict[str, str]:
    """Parse the options after ``lidar:``."""
    return dict(parse_key_value(part, "--methods lidar:") for part in text.split(":")) if text else {}


def _parse_shared_options(options: Sequence[str]) -> dict[str, dict[str, str]]:
    """Parse options for every use of a matcher, each as ``matcher.key=value``; return them by matcher."""
    shared: dict[str, dict[str, str]] = {}
    for option in options:
        name, value = parse_key_value(option, "--option")
        method, dot, key = name.partition(".")
        if not dot:
            raise IcyMoonError(f"--option {option}: name the matcher too, as in bm.{key or name}={value}.")
        if method not in list_matcher_names():
            raise IcyMoonError(
                f"--option {option}: unknown matcher {method!r}, {suggest_nearest(method, list_matcher_names())}"
            )
        shared.setdefault(method, {})[key] = value
    return shared


def _find_own_matcher(name: str, owned: Mapping[str, UncheckedMethod]) -> UncheckedMethod:
    if name not in owned:
        known = f"known are {', '.join(owned)}" if owned else "none is set up"
        raise IcyMoonError(
            f"There is no matcher {OWN_PREFIX}:{name} on this machine ({known}); add it under Own Matchers in "
            "the preferences of Icy Moon, or with --own."
        )
    return owned[name]
