"""Finding, loading and calling plug-ins.

A plug-in is an entry point of an installed package, in one of ``GROUPS``. A name from a file, a scene or a command line
is only looked up among those. What lies in the current folder is never one, however Python was started. Nothing of a
plug-in is imported before it is used.
"""

from __future__ import annotations

import importlib.metadata
import os
import re
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..support.errors import DiskError, IcyMoonError
from ..support.printer import show_controls

#: What a plug-in adds -> the group of its entry point.
GROUPS = {kind: f"icymoon.{kind}s" for kind in ("matcher", "landform", "metric", "export")}
#: The version of the interface that a plug-in states as ``ICYMOON_API``.
API = 1
NAME = re.compile(r"[a-z][a-z0-9_]{0,29}")
try:
    _STARTED_IN = os.path.realpath(os.getcwd())
except OSError:  # the folder was removed
    _STARTED_IN = ""


@dataclass(frozen=True)
class Plugin:
    """One plug-in: ``kind`` is a key of GROUPS, ``package`` and ``version`` are those that pip knows."""

    kind: str
    name: str
    package: str
    version: str
    entry: importlib.metadata.EntryPoint
    licence: str = ""

    @property
    def title(self) -> str:
        """What sentences call it."""
        return f"The {self.kind} {self.name} of the package {self.package} {self.version}"

    @property
    def release(self) -> str:
        """Package and version, as results state them."""
        return f"{self.package} {self.version}"


@dataclass(frozen=True)
class Found:
    """The usable plug-ins of a kind by name, and a sentence on each that is refused, by name."""

    usable: Mapping[str, Plugin]
    refused: Mapping[str, str]


def find(kind: str, ours: Collection[str]) -> Found:
    """The plug-ins of a kind. One that is named as one of ``ours`` is refused, and so are two of one name."""
    by_name: dict[str, list[Plugin]] = {}
    for plugin in _scan(tuple(sys.path)):
        if plugin.kind == kind:
            by_name.setdefault(plugin.name, []).append(plugin)
    usable, refused = {}, {}
    for name, plugins in sorted(by_name.items()):
        first, *others = sorted(plugins, key=lambda plugin: plugin.release)
        if not NAME.fullmatch(name):
            refused[name] = (
                f"{first.title} is refused: a name has small letters, digits and _, begins with a letter "
                "and has at most 30 characters; rename its entry point."
            )
        elif name in ours:
            refused[name] = (
                f"{first.title} is refused: Icy Moon has a {kind} of this name, which is used; rename "
                "the entry point, or uninstall the package."
            )
        elif others:
            packages = " and ".join(plugin.release for plugin in (first, *others))
            refused[name] = f"The {kind} {name} is refused: {packages} both add it; uninstall one of them."
        else:
            usable[name] = first
    return Found(usable, refused)


@lru_cache(maxsize=8)
def _scan(path: tuple[str, ...]) -> tuple[Plugin, ...]:
    """All plug-ins of the packages that are installed on a search path, each package once."""
    kinds = {group: kind for kind, group in GROUPS.items()}
    folders = [folder for folder in path if folder and os.path.realpath(folder) != _STARTED_IN]
    seen: set[str] = set()
    found = []
    for package in importlib.metadata.distributions(path=folders):
        try:
            if "icymoon." not in (package.read_text("entry_points.txt") or ""):
                continue  # without a look at its metadata, which takes a hundred times as long
            name, version = str(package.metadata["Name"]), str(package.version)
            entries = [entry for entry in package.entry_points if entry.group in kinds]
            licence = next(
                (str(package.metadata[key]) for key in ("License-Expression", "License") if key in package.metadata), ""
            )
        except Exception:  # a damaged package of whatever kind is not ours to report
            continue
        key = re.sub(r"[-_.]+", "-", name).lower()
        if key not in seen:
            seen.add(key)
            found += [Plugin(kinds[entry.group], entry.name, name, version, entry, licence) for entry in entries]
    return tuple(found)


def load(plugin: Plugin) -> Any:
    """The module, or what else the entry point names, imported. Raises IcyMoonError if it cannot be used."""
    with explained(plugin, "cannot be loaded", "correct it, or uninstall the package"), _without_current_folder():
        loaded = plugin.entry.load()
    stated = getattr(loaded, "ICYMOON_API", None)
    if stated != API:
        raise IcyMoonError(
            f"{plugin.title} states ICYMOON_API = {stated}, and this version of Icy Moon has {API}; "
            f"write ICYMOON_API = {API} into it, or get another version of one of the two."
        )
    return loaded


def function_of(plugin: Plugin, loaded: Any, name: str, arguments: str) -> Callable[..., Any]:
    """A function that a plug-in must have. Raises IcyMoonError if it has none."""
    found = getattr(loaded, name, None)
    if not callable(found):
        raise IcyMoonError(f"{plugin.title} has no function {name}; write {name}({arguments}) into it.")
    called: Callable[..., Any] = found
    return called


def summary_of(loaded: Any) -> str:
    """The first line of what a plug-in states about itself."""
    stated = getattr(loaded, "__doc__", "")
    return show_controls(next(iter(stated.strip().splitlines()), "")) if isinstance(stated, str) else ""


@contextmanager
def explained(plugin: Plugin, what: str = "failed", fix: str = "correct it, or leave it out") -> Iterator[None]:
    """Turn whatever a plug-in raises into one sentence that names it, and the line of its source."""
    try:
        yield
    except (IcyMoonError, DiskError, KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        words = show_controls(" ".join(_words_of(error).split())[:300])
        raise IcyMoonError(
            f"{plugin.title} {what} ({type(error).__name__}{': ' if words else ''}{words}"
            f"{_place(plugin, error)}); {fix}."
        ) from None


def _words_of(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:  # an error of a plug-in's own kind
        return "without words"


def _place(plugin: Plugin, error: BaseException) -> str:
    """The last file and line of the plug-in's own that an error went through."""
    top = plugin.entry.module.partition(".")[0]
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        path = Path(frame.filename)
        if top in (path.stem, *path.parts):
            return f", {path.name} line {frame.lineno}"
    return ""


@contextmanager
def _without_current_folder() -> Iterator[None]:
    """Import as ``python -P`` does: ``python -m`` puts the current folder first, where a data set may lie."""
    first = sys.path[0] if sys.path else None
    there = not sys.flags.safe_path and first is not None and os.path.realpath(first or os.curdir) == _STARTED_IN
    if there:
        del sys.path[0]
    try:
        yield
    finally:
        if there and first is not None:
            sys.path.insert(0, first)


def source_files(loaded: Any) -> list[str]:
    """The Python files of a plug-in: results depend on them, also where its version stays the same."""
    module = sys.modules.get(getattr(loaded, "__name__", ""), None) or sys.modules.get(
        getattr(loaded, "__module__", ""), None
    )
    file = getattr(module, "__file__", None)
    if not file:
        return []
    path = Path(file)
    return sorted(map(str, path.parent.rglob("*.py"))) if path.name == "__init__.py" else [str(path)]
