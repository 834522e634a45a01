"""Calls the functions of exports, ours or of packages that the user installed, with the data of a pair.

An export has one of three functions. ``write_pair(pair, folder)`` writes a pair into a folder; the optional
``finish(names, folder)`` then writes the files about all pairs. ``write_all(each, folder)`` calls ``each(write)``,
which calls ``write(pair)`` with every pair. ``write_folders(folders, folder, context)`` reads the folders of the pairs
by itself. An optional ``check()`` returns a sentence on why the export cannot write here, or an empty text.

Our exports receive a ``LoadedPair`` and the folder of the export. The others receive an ``ExportedPair`` and a
temporary folder, whose files are moved into the folder of the export once all of them are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...plugins.installed import Plugin, explain_failures, find_function, load_plugin
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.printer import show_controls
from .whole_folders import fill_whole_folder

if TYPE_CHECKING:  # exports of ground lack the packages that these modules need
    from ..measure.prepare_pair import LoadedPair
    from .losses import Each, Loss


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


def make_exported_pair(pair: LoadedPair) -> ExportedPair:
    """Copy a pair for a plug-in, so that its changes never reach our data."""
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


@dataclass(frozen=True)
class FoldersContext:
    """Arguments of ``write_folders`` beside the folders.

    ``blender`` is the program that can build ground. ``warn`` receives a sentence on an omission. ``progress(title)``
    is a context that yields a function for messages such as {"type": "progress", "fraction": 0.5, "message": "one"}.
    ``changes`` are the texts of ``--set``, and ``cell_m`` is for exports that take it.
    """

    blender: str
    warn: Callable[[str], None]
    progress: Callable[[str], AbstractContextManager[Callable[[dict[str, Any]], None]]]
    changes: Sequence[str] = ()
    cell_m: float | None = None


class PluginExport:
    """An export plug-in. Raises IcyMoonError if it cannot be loaded or is not complete."""

    def __init__(self, plugin: Plugin) -> None:
        self.plugin, self._loaded = plugin, load_plugin(plugin)
        self.writes_all, self.reads_folders, self.finishes = map(
            self._has_function, ("write_all", "write_folders", "finish")
        )
        if not (self.writes_all or self.reads_folders):
            self._write_pair = find_function(plugin, self._loaded, "write_pair", "pair, folder")

    def _has_function(self, function: str) -> bool:
        return callable(getattr(self._loaded, function, None))

    def check(self) -> None:
        """Raise IcyMoonError with the sentence of the plug-in's own ``check`` if it cannot write here."""
        with explain_failures(self.plugin):
            fault = self._loaded.check() if self._has_function("check") else ""
        if fault:
            where = "" if self.plugin.built_in else f"{self.plugin.title} cannot write here: "
            raise IcyMoonError(where + show_controls(str(fault)))

    def write(self, each: Each, out: Path) -> None:
        """Write the pairs that ``each`` gives to ``out``. Raises IcyMoonError if the plug-in fails."""
        self.check()
        if self.writes_all:
            if self.plugin.built_in:
                self.write_all(each, out)
            else:
                self.write_all(self._convert_pairs(each), out)
            return
        names: list[str] = []

        def write(pair: LoadedPair) -> Sequence[Loss] | None:
            name = pair.pair.folder.name
            losses = self.write_pair(pair if self.plugin.built_in else make_exported_pair(pair), name, out)
            names.append(name)
            return losses

        each(write)
        if names:
            self.finish(names, out)

    def write_all(self, each: Callable[[Callable[[Any], Any]], None], out: Path) -> None:
        """Write the pairs that ``each`` gives by the plug-in's own ``write_all``."""
        with self._open_target_folder(out) as folder:
            self._loaded.write_all(each, folder)

    def write_pair(self, pair: ExportedPair | LoadedPair, name: str, out: Path) -> Sequence[Loss] | None:
        """Write a pair to the folder ``name`` in ``out``; return the losses of a built-in export.

        Raises IcyMoonError if the plug-in fails or writes nothing.
        """
        with fill_whole_folder(out / name) as folder:
            with explain_failures(self.plugin):
                losses: Sequence[Loss] | None = self._write_pair(pair, folder)
            if not any(path.is_file() for path in folder.rglob("*")):
                raise IcyMoonError(
                    f"{self.plugin.title} wrote no file for {name}; write into the folder that write_pair is given."
                )
        return losses if self.plugin.built_in else None

    def finish(self, names: list[str], out: Path) -> None:
        """Have the plug-in write the files about all pairs, if it has any, into ``out`` itself."""
        if self.finishes:
            with self._open_target_folder(out) as folder:
                self._loaded.finish(names, folder)

    def write_folders(self, folders: Sequence[Path], out: Path, context: FoldersContext) -> None:
        """Write pairs from their folders. Raises IcyMoonError if the plug-in fails."""
        self.check()
        with self._open_target_folder(out) as folder:
            self._loaded.write_folders(folders, folder, context)

    @contextmanager
    def _open_target_folder(self, out: Path) -> Iterator[Path]:
        """Yield the folder that a built-in export gets, or a temporary folder whose files are moved there."""
        if self.plugin.built_in:
            yield out
            return
        with fill_whole_folder(out) as folder, explain_failures(self.plugin):
            yield folder

    def _convert_pairs(self, each: Each) -> Callable[[Callable[[ExportedPair], Any]], None]:
        """Return a version of ``each`` that gives a plug-in's function an ``ExportedPair``."""

        def each_pair(write: Callable[[ExportedPair], Any]) -> None:
            def write_one(pair: LoadedPair) -> None:
                with explain_failures(self.plugin):
                    write(make_exported_pair(pair))

            each(write_one)

        return each_pair
