"""What announces changes must not keep Blender alive."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType

from icymoon.settings import change_announcements


def reachable(function: Callable[..., object]) -> set[str]:
    """Names of the modules that a function leads to by the names of its own module, and theirs."""
    seen: set[str] = set()
    waiting = [function.__module__]
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if name.startswith("icymoon"):
            waiting += [
                value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None) or ""
                for value in vars(sys.modules[name]).values()
            ]
    return seen - {""}


def test_an_update_of_a_property_leads_to_no_blender():
    """Blender as a module keeps such functions, and 4.2 crashes at the end of Python if they keep it."""
    found = reachable(change_announcements.make_update_callback("light"))
    assert "icymoon.settings.change_announcements" in found
    assert not {name for name in found if name.split(".")[0] in ("bpy", "_bpy", "bpy_types", "bl_operators")}
