"""Renders scenes one after another in this process; each scene reuses parts of the one before."""

from __future__ import annotations

import atexit
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..nodes.build_scene import make_build_facts
from ..settings.blender import scene_properties
from ..settings.description import check, defaults, merged
from ..settings.topics.scene import Settings
from ..support.blender import compat
from ..support.errors import IcyMoonError
from .pairs.pair_folder import is_complete
from .plans.planned_pair import expand_headings
from .scene_source import ScenesFromSettings
from .worker import render_from


class ResidentScenes:
    """Renders the pairs of settings, any number of times; ``close`` it at the end."""

    def __init__(self) -> None:
        self._send: Callable[..., None] = lambda *args, **facts: None
        self._source = self._open_source()

    def _open_source(self) -> ScenesFromSettings:
        return ScenesFromSettings(lambda warning: self._send("warning", message=warning))

    def render(self, settings: Settings, dataset: Path, again: bool, send: Callable[..., None]) -> list[Path]:
        """Render the pairs of a description and return their folders, see ``worker.render_from``.

        Raises IcyMoonError at the first failure; finished pairs stay.
        """
        self._send = send
        complete = merged(defaults(), check(settings, "settings"))
        pairs = expand_headings(complete, make_build_facts(complete))
        send("progress", fraction=0.0, message="Building the scene")
        try:
            render_from(self._source, pairs, dataset, send, again)
        except ReferenceError:  # another .blend file was opened in this Blender meanwhile
            self._source = self._open_source()
            render_from(self._source, pairs, dataset, send, again)
        folders = [pair.folder(dataset) for pair in pairs]
        if missing := [folder for folder in folders if not is_complete(folder)]:
            raise IcyMoonError(f"{missing[0]} is incomplete after its render; render it again.")
        return folders

    def close(self) -> None:
        """Remove the scene of the renders, and free the data that Cycles keeps for it."""
        self._source.__exit__(None, None, None)


class RendererInThisProcess:
    """Renders in this process, which is Blender in the background, or has Blender as a module."""

    def __init__(self) -> None:
        """Open the renderer. Raises IcyMoonError in a Blender with a window, whose open file would be lost."""
        if not bpy.app.background:
            raise IcyMoonError(
                "This Blender has a window, and rendering here would close your file; render with icymoon.Worker, "
                "which starts another Blender."
            )
        if not hasattr(bpy.types.Scene, "icymoon"):
            scene_properties.register()
            if compat.is_module():
                atexit.register(scene_properties.unregister)  # see ``register`` of the package
        self._scenes = ResidentScenes()

    def render(
        self, settings: Settings, dataset: Path, again: bool, hear: Callable[[dict[str, Any]], None]
    ) -> list[Path]:
        """Render the pairs of complete settings and return their folders; ``hear`` receives every message."""
        return self._scenes.render(settings, dataset, again, lambda kind, **facts: hear({"type": kind, **facts}))

    def close(self) -> None:
        """Close the renderer as ``ResidentScenes.close`` does."""
        self._scenes.close()
