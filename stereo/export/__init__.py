"""Exports pairs in the layouts of other data sets.

An export is a plug-in, ours or of a package that the user installed; ``plugins/entry_points.txt`` declares ours. It is
a module, or an ``Export``, with one of the functions that ``plug_in`` calls. A module with ``NEEDS = "Blender"`` builds
ground. ``PACKAGES`` states the packages that it needs in place of ``IMAGES``. ``TITLES`` states for each export a title
and, after a colon, the content; ``TAKES`` the keys of the ``OPTIONS`` that it takes; ``HEADINGS`` the heading above it
in the window's list.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...plugins.installed import Found, find_installed, read_fact

#: The packages that an export needs to read pairs and to show its progress.
IMAGES = ("numpy", "cv2", "OpenEXR", "rich")


@dataclass(frozen=True)
class Export:
    """One of several exports of a module. An entry point names it in place of the module. Exactly one function is
    given.
    """

    write_pair: Callable[..., Any] | None = None
    write_all: Callable[..., Any] | None = None
    write_folders: Callable[..., Any] | None = None


@dataclass(frozen=True)
class Option:
    """A number above 0 that only some exports take, as the command line and the window ask for it.

    If it is not given, ``default`` is used.
    """

    key: str
    label: str
    metavar: str
    description: str
    default: str

    @property
    def flag(self) -> str:
        """The option of the command line."""
        return f"--{self.key.replace('_', '-')}"

    @property
    def tooltip(self) -> str:
        """The description in the window, where 0 means the default."""
        return f"{self.description[:1].upper()}{self.description[1:]}; 0 for {self.default}"


OPTIONS = (Option("cell_m", "Cell", "METRES", "side of a cell of the maps", "a 1024th of the ground"),)


def find_plugins() -> Found:
    """Find the exports that are installed for this Python."""
    return find_installed("export")


def exports_with_blender() -> list[str]:
    """List the exports for which Blender builds ground."""
    return [name for name, plugin in find_plugins().usable.items() if read_fact(plugin, "NEEDS") == "Blender"]


def list_titles() -> dict[str, tuple[str, str]]:
    """List title and content of Icy Moon's exports by name, without an import of any."""
    found = find_plugins().usable.items()
    stated = {name: read_fact(plugin, "TITLES")[name].partition(": ") for name, plugin in found if plugin.built_in}
    return {name: (title, content) for name, (title, _, content) in stated.items()}


def list_headings() -> dict[str, str]:
    """List the headings in the window's list of exports, by the name of the export below each."""
    stated = [read_fact(plugin, "HEADINGS") for plugin in find_plugins().usable.values() if plugin.built_in]
    return {name: heading for each in stated if each for name, heading in each.items()}


def list_options(name: str) -> list[Option]:
    """List the options of an export; empty for an unknown export."""
    plugin = find_plugins().usable.get(name)
    stated = read_fact(plugin, "TAKES") if plugin else None
    keys = stated.get(name, ()) if isinstance(stated, dict) else ()
    return [option for option in OPTIONS if option.key in keys]


def list_packages(name: str) -> tuple[str, ...]:
    """List the packages that an export needs."""
    return read_fact(find_plugins().usable[name], "PACKAGES") or IMAGES
