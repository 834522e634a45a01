"""The button of Export Pair or Data Set, and the outcome of the last export."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..operators.export_pairs import find_export
from .fields import draw_lines, draw_start

#: Maximum number of sentences on an export in the sidebar; the Info editor has all sentences.
_MAX_SENTENCES = 3
#: Maximum number of names of a path in the sidebar.
_MAX_NAMES = 2


def shorten_folder(folder: str) -> str:
    """Shorten a path to its last two names, which fit into a line or two. The button below opens the folder."""
    parts = Path(folder).parts
    return folder if len(parts) <= _MAX_NAMES + 1 else str(Path("…", *parts[-_MAX_NAMES:]))


def draw_export(layout: bpy.types.UILayout, scene: bpy.types.Scene, source: str) -> None:
    """Draw the button that exports the pairs of ``source``, an option of the operator, and the outcome of their last
    export."""
    row = layout.row()
    row.operator_context = "INVOKE_DEFAULT"
    draw_start(row, "icymoon.export_pairs", "Export…", "EXPORT", source=source)
    done = find_export(scene, source)
    if done is None:
        return
    if done.folder:
        draw_lines(layout, (f"Exported {done.title} to {shorten_folder(done.folder)}",), "CHECKMARK")
        layout.operator("wm.path_open", text="Open Exported Files", icon="FILE_FOLDER").filepath = done.folder
    for sentence in done.sentences[:_MAX_SENTENCES]:
        draw_lines(layout, (sentence,), "ERROR")
    if len(done.sentences) > _MAX_SENTENCES:
        draw_lines(layout, (f"{len(done.sentences) - _MAX_SENTENCES} more in the Info editor",), "INFO")
