"""Exports of packages that the user installed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...plugins.installed import Found, Plugin, explained, find, function_of, load
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..measure.prepare import Loaded
from . import EXPORTS
from .whole_folders import filled


def find_plugins() -> Found:
    """The exports of packages that are installed in this Python."""
    return find("export", EXPORTS)


@dataclass(frozen=True)
class ExportedPair:
    """The data of a pair for an export of a plug-in; arrays are (H, W) of the rectified eyes.

    ``left`` and ``right`` are uint16 numbers of ``bits`` bits, (H, W), or R, G, B (H, W, 3) of a colour camera.
    ``radiance_left`` and ``radiance_right`` are the rendered radiance, float32 (H, W, 3), W/(m² sr). Depths (planar)
    and disparities are float64, NaN for sky. ``visible_left`` is true where the right eye sees the point too.
    ``semantic_left`` and ``instance_left`` are labels, None if the pair has no labels. The principal point counts from
    the outer corner of the first pixel. ``settings`` are the pair's settings, by topic and key.
    """

    name: str
    left: Array
    right: Array
    bits: int
    radiance_left: Array
    radiance_right: Array
    depth_left_m: Array
    depth_right_m: Array
    disparity_left_px: Array
    disparity_right_px: Array
    visible_left: Array
    visible_right: Array
    semantic_left: Array | None
    instance_left: Array | None
    focal_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    settings: Mapping[str, Mapping[str, Any]]


def pair_for_plugins(pair: Loaded) -> ExportedPair:
    """A pair as plug-ins get it: copies, so that nothing that they do reaches ours."""
    camera = pair.pair.camera
    arrays: dict[str, Any] = {}
    for eye in ("left", "right"):
        arrays |= {
            f"radiance_{eye}": np.array(pair.views[eye].radiance),
            f"depth_{eye}_m": np.array(pair.depth[eye]),
            f"disparity_{eye}_px": np.array(camera.disparity(pair.depth[eye])),
            f"visible_{eye}": np.array(pair.visible[eye]),
        }
    for name in ("semantic", "instance"):
        labels = getattr(pair.views["left"], name)
        arrays[f"{name}_left"] = None if labels is None else np.array(labels)
    return ExportedPair(
        pair.pair.folder.name,
        np.array(pair.images.seen("left")),
        np.array(pair.images.seen("right")),
        pair.images.bits,
        **arrays,
        focal_px=camera.focal_px,
        cx_px=camera.cx_px,
        cy_px=camera.cy_px,
        baseline_m=camera.baseline_m,
        settings={topic: dict(values) for topic, values in pair.settings.items()},
    )


class PluginExport:
    """The export of a plug-in. Raises IcyMoonError if the plug-in cannot be loaded or is not complete."""

    def __init__(self, plugin: Plugin) -> None:
        self.plugin = plugin
        loaded = load(plugin)
        self._write = function_of(plugin, loaded, "write_pair", "pair, folder")
        self._finish = getattr(loaded, "finish", None)
        self.finishes = callable(self._finish)

    def write_pair(self, pair: ExportedPair, out: Path) -> list[Path]:
        """Write a pair to its folder in ``out``; the files. Raises IcyMoonError if the plug-in fails or writes none."""
        with filled(out / pair.name) as folder:
            with explained(self.plugin):
                self._write(pair, folder)
            if not any(path.is_file() for path in folder.rglob("*")):
                raise IcyMoonError(
                    f"{self.plugin.title} wrote no file for {pair.name}; write into the folder that "
                    "write_pair is given."
                )
        return sorted(path for path in (out / pair.name).rglob("*") if path.is_file())

    def finish(self, names: list[str], out: Path) -> None:
        """Let the plug-in write what belongs to all pairs, if it does, into ``out`` itself."""
        if callable(self._finish):
            with filled(out) as folder, explained(self.plugin):
                self._finish(names, folder)
