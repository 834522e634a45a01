"""Pairs in the layouts of other data sets.

An export is a plug-in, ours or of a package that the user installed; ``plugins/entry_points.txt`` declares ours. It is
a module, or an ``Export``, with one of the functions that ``plug_in`` calls. A module that states ``NEEDS = "Blender"``
builds ground, and ``PACKAGES`` states the packages that it needs in place of ``IMAGES``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...plugins.installed import Found, find_installed, read_fact

#: The packages that read pairs and show their progress.
IMAGES = ("numpy", "cv2", "OpenEXR", "rich")


@dataclass(frozen=True)
class Export:
    """One of several exports of a module: what an entry point names in place of the module. One function is given.

    ``takes`` are the options of the command line that only some exports take.
    """

    write_pair: Callable[..., Any] | None = None
    write_all: Callable[..., Any] | None = None
    write_folders: Callable[..., Any] | None = None
    takes: tuple[str, ...] = ()


def find_plugins() -> Found:
    """The exports of this Python."""
    return find_installed("export")


def exports_with_blender() -> list[str]:
    """The exports for which Blender builds ground."""
    return [name for name, plugin in find_plugins().usable.items() if read_fact(plugin, "NEEDS") == "Blender"]


def list_packages(name: str) -> tuple[str, ...]:
    """The packages that an export needs."""
    return read_fact(find_plugins().usable[name], "PACKAGES") or IMAGES
