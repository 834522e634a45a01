"""What threads ask Blender: nothing, since Blender frees meanwhile what they would read."""

from __future__ import annotations

import sys
import threading
from typing import Any

import bpy
import pytest


class _Watched:
    """Blender's module as our modules see it, which lists what other threads than the main one ask it."""

    def __init__(self, asked: list[str]) -> None:
        self._asked = asked

    def __getattr__(self, name: str) -> Any:
        if threading.current_thread() is not threading.main_thread():
            self._asked.append(f"bpy.{name} in {sys._getframe(1).f_code.co_qualname}")
        return getattr(bpy, name)


def list_asks_of_threads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A list to which all is added that our modules ask Blender in threads, until the test ends."""
    asked: list[str] = []
    for name, module in list(sys.modules.items()):
        if name.startswith("icymoon.") and getattr(module, "bpy", None) is bpy:
            monkeypatch.setattr(module, "bpy", _Watched(asked))
    return asked
