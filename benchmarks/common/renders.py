"""Scenes and pairs in this process; needs Blender as a module."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import icymoon
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.processor import seconds_of
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from, render_pairs
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings


def start_blender() -> bpy.types.Scene:
    """The scene of a new, empty file, with Icy Moon registered."""
    icymoon.register()
    return open_empty_file()


def open_empty_file() -> bpy.types.Scene:
    """The scene of a new, empty file."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def settings_of(presets: Iterable[str], *parts: Parts) -> Settings:
    """Complete settings: the defaults with presets and then changes, which are checked."""
    return description.merged(
        description.defaults(),
        *map(preset_files.load_preset, presets),
        *(description.check(dict(part), "benchmark") for part in parts),
    )


def render(built: Built, settings: Settings, folder: Path) -> list[Path]:
    """Render the pairs of a built scene into a data set's folder; return their folders."""
    return render_pairs(built, expand_headings(settings), folder, 1, 0.0, _unheard)


def measure_render_seconds(settings: Settings) -> float:
    """Processor seconds of rendering a scene's pairs in a new file, without building it."""
    built = build_scene(open_empty_file(), settings)
    with scratch() as folder:
        return seconds_of(lambda: render(built, settings, folder))


def render_planned(
    pairs: list[PlannedPair],
    folder: Path,
    hear: Callable[..., None] | None = None,
    warn: Callable[[str], None] | None = None,
) -> None:
    """Build and render planned pairs into a data set's folder, as a worker does.

    ``hear`` gets the worker's events, ``warn`` the warnings of builds.
    """
    with ScenesFromSettings(warn or (lambda warning: None)) as stage:
        render_from(stage, pairs, folder, hear or _unheard)


def _unheard(*arguments: object, **facts: object) -> None:
    pass


@contextmanager
def hide_cycles_output(to_errors: bool = False) -> Iterator[None]:
    """Hide Cycles' messages on standard output until the end of the ``with`` block; only Python's output is shown.

    ``to_errors`` shows the rest on standard error instead of dropping it.
    """
    sys.stdout.flush()
    shown, printed = os.dup(1), sys.stdout
    target = os.dup(2) if to_errors else os.open(os.devnull, os.O_WRONLY)
    os.dup2(target, 1)
    os.close(target)
    try:
        with os.fdopen(os.dup(shown), "w", encoding="utf-8") as sys.stdout:
            yield
    finally:
        sys.stdout = printed
        os.dup2(shown, 1)
        os.close(shown)
