"""Finding, loading and calling the plug-ins of Icy Moon and of installed packages.

A plug-in is an entry point in one of ``GROUPS``. ``entry_points.txt`` beside this file declares the plug-ins of Icy
Moon, and the metadata of a package declares the package's plug-ins. A name from a file, a scene or a command line is
only looked up among these. Modules in the current folder never count, however Python was started. Nothing of a plug-in
is imported before it is used; the facts that lists show of it are literals of its module, which are read without an
import.
"""

from __future__ import annotations

import ast
import importlib.metadata
import importlib.util
import os
import re
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from ..support.errors import DiskError, IcyMoonError
from ..support.printer import show_controls
from ..support.version import ROOT, version

#: The group of the entry points for each kind of plug-in.
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
    """One plug-in. ``kind`` is a key of GROUPS. ``package`` and ``version`` are the package's name and version for pip.

    A ``built_in`` plug-in is part of Icy Moon.
    """

    kind: str
    name: str
    package: str
    version: str
    entry: importlib.metadata.EntryPoint
    licence: str = ""
    built_in: bool = False

    @property
    def title(self) -> str:
        """Name of the plug-in in sentences."""
        return f"The {self.kind} {self.name} of the package {self.package} {self.version}"

    @property
    def release(self) -> str:
        """Package and version, as results contain them."""
        return f"{self.package} {self.version}"


@dataclass(frozen=True)
class Found:
    """The usable plug-ins of a kind by name, Icy Moon's first. Each refused plug-in has a sentence, by its name."""

    usable: Mapping[str, Plugin]
    refused: Mapping[str, str]

    @property
    def added(self) -> dict[str, Plugin]:
        """The usable plug-ins of packages that the user installed."""
        return {name: plugin for name, plugin in self.usable.items() if not plugin.built_in}


def find_installed(kind: str, taken: Collection[str] = ()) -> Found:
    """Find the plug-ins of a kind. Installed plug-ins are refused if they have the same name as another, as a plug-in
    of Icy Moon, or as an entry of ``taken``."""
    ours = {plugin.name: plugin for plugin in _list_built_in() if plugin.kind == kind}
    by_name: dict[str, list[Plugin]] = {}
    plugins, damaged = _scan_packages(tuple(sys.path))
    for plugin in plugins:
        if plugin.kind == kind:
            by_name.setdefault(plugin.name, []).append(plugin)
    usable, refused = {}, {package: fault for package, (groups, fault) in damaged.items() if GROUPS[kind] in groups}
    for name, plugins in sorted(by_name.items()):
        first, *others = sorted(plugins, key=lambda plugin: plugin.release)
        if not NAME.fullmatch(name):
            refused[name] = (
                f"{first.title} is refused: a name has small letters, digits and _, begins with a letter "
                "and has at most 30 characters; rename its entry point."
            )
        elif name in ours or name in taken:
            refused[name] = (
                f"{first.title} is refused: Icy Moon has a {kind} of this name, which is used; rename "
                "the entry point, or uninstall the package."
            )
        elif others:
            packages = " and ".join(plugin.release for plugin in (first, *others))
            refused[name] = f"The {kind} {name} is refused: {packages} both add it; uninstall one of them."
        else:
            usable[name] = first
    return Found({**ours, **usable}, refused)


@cache
def _list_built_in() -> tuple[Plugin, ...]:
    """List the plug-ins of Icy Moon, in the order of their declaration."""
    root, kinds = __package__.rpartition(".")[0], {group: kind for kind, group in GROUPS.items()}
    return tuple(
        Plugin(
            kinds[entry.group],
            entry.name,
            "icymoon",
            version(),
            importlib.metadata.EntryPoint(entry.name, f"{root}.{entry.value}", entry.group),
            built_in=True,
        )
        for entry in importlib.metadata.Distribution.at(Path(__file__).parent).entry_points
    )


@lru_cache(maxsize=8)
def _scan_packages(path: tuple[str, ...]) -> tuple[list[Plugin], dict[str, tuple[str, str]]]:
    """List all plug-ins of the packages on a search path, each package once. Also return, by name, a sentence on each
    entry point of an unreadable package."""
    kinds = {group: kind for kind, group in GROUPS.items()}
    folders = [folder for folder in path if folder and os.path.realpath(folder) != _STARTED_IN]
    seen: set[str] = set()
    found, damaged = [], {}
    for package in importlib.metadata.distributions(path=folders):
        text = ""
        try:
            text = package.read_text("entry_points.txt") or ""
            if "icymoon." not in text:
                continue  # without reading its metadata, which takes a hundred times as long
            name, version = str(package.metadata["Name"]), str(package.version)
            entries = [entry for entry in package.entry_points if entry.group in kinds and entry.module]
            licence = next(
                (str(package.metadata[key]) for key in ("License-Expression", "License") if key in package.metadata), ""
            )
        except Exception as error:
            if text:  # other damaged packages need no report here
                named = show_controls(Path(str(getattr(package, "_path", "unknown"))).name)
                fault = (
                    f"The package {named} cannot be read ({type(error).__name__}); install it again, or uninstall it."
                )
                damaged[named] = text, fault
            continue
        key = re.sub(r"[-_.]+", "-", name).lower()
        if key not in seen:
            seen.add(key)
            found += [Plugin(kinds[entry.group], entry.name, name, version, entry, licence) for entry in entries]
    return found, damaged


def load_plugin(plugin: Plugin) -> Any:
    """Import the module or other object that the entry point names. Raises IcyMoonError if it cannot be used."""
    with (
        explain_failures(plugin, "cannot be loaded", "correct it, or uninstall the package"),
        _import_without_current_folder(),
    ):
        loaded = plugin.entry.load()
    stated = getattr(loaded, "ICYMOON_API", None)
    if stated != API and not plugin.built_in:
        raise IcyMoonError(
            f"{plugin.title} states ICYMOON_API = {stated}, and this version of Icy Moon has {API}; "
            f"write ICYMOON_API = {API} into it, or get another version of one of the two."
        )
    return loaded


def find_function(plugin: Plugin, loaded: object, name: str, arguments: str) -> Callable[..., Any]:
    """Return a function that a plug-in must have. Raises IcyMoonError if it has none."""
    found = getattr(loaded, name, None)
    if not callable(found):
        raise IcyMoonError(f"{plugin.title} has no function {name}; write {name}({arguments}) into it.")
    called: Callable[..., Any] = found
    return called


def read_fact(plugin: Plugin, name: str) -> Any:
    """Read the literal that the module of a plug-in assigns to ``name``; None if the module assigns no literal or
    cannot be read."""
    with suppress(Exception):  # a damaged package: its import explains it
        return _read_literal(_find_source(plugin), name)
    return None


@lru_cache(maxsize=256)
def _read_literal(source: Path, name: str) -> object:
    """Read the last literal that a file assigns to ``name`` at its top level; None without a literal."""
    text, found = source.read_text(encoding="utf-8"), None
    if f"\n{name} = " in text:  # as parsing takes a hundred times as long
        for line in ast.parse(text).body:
            if isinstance(line, ast.Assign) and isinstance(to := line.targets[0], ast.Name) and to.id == name:
                found = ast.literal_eval(line.value)
    return found


@lru_cache(maxsize=64)
def _find_source(plugin: Plugin) -> Path:
    """Find the file of the module that an entry point names. Its packages are not imported."""
    first, *rest = plugin.entry.module.split(".")
    if plugin.built_in:
        return ROOT.joinpath(*plugin.entry.module.split(".")[len(__package__.split(".")) - 1 :]).with_suffix(".py")
    with _import_without_current_folder():
        spec = importlib.util.find_spec(first)
    path = Path(str(spec and spec.origin))
    path = path.parent.joinpath(*rest) if rest else path
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def read_summary(loaded: object) -> str:
    """Read the first line of a plug-in's own description."""
    stated = getattr(loaded, "__doc__", "")
    return show_controls(next(iter(stated.strip().splitlines()), "")) if isinstance(stated, str) else ""


@contextmanager
def explain_failures(plugin: Plugin, what: str = "failed", fix: str = "correct it, or leave it out") -> Iterator[None]:
    """Turn any exception of a plug-in into one sentence that names the plug-in and the line of its source."""
    try:
        yield
    except (IcyMoonError, DiskError, KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        if plugin.built_in:  # a fault of Icy Moon, which needs its traceback
            raise
        words = show_controls(" ".join(_error_text(error).split())[:300])
        raise IcyMoonError(
            f"{plugin.title} {what} ({type(error).__name__}{': ' if words else ''}{words}"
            f"{_find_failing_line(plugin, error)}); {fix}."
        ) from None


def _error_text(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:  # an error of a plug-in's own kind
        return "without words"


def _find_failing_line(plugin: Plugin, error: BaseException) -> str:
    """Find the last file and line of the plug-in through which an error passed."""
    top = plugin.entry.module.partition(".")[0]
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        path = Path(frame.filename)
        if top in (path.stem, *path.parts):
            return f", {path.name} line {frame.lineno}"
    return ""


@contextmanager
def _import_without_current_folder() -> Iterator[None]:
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


def find_source_files(loaded: object) -> list[str]:
    """Find the Python files of a plug-in. Results depend on them, even with an unchanged version."""
    module = sys.modules.get(getattr(loaded, "__name__", ""), None) or sys.modules.get(
        getattr(loaded, "__module__", ""), None
    )
    file = getattr(module, "__file__", None)
    if not file:
        return []
    path = Path(file)
    return sorted(map(str, path.parent.rglob("*.py"))) if path.name == "__init__.py" else [str(path)]
