"""Keeps the marks of meshes until Blender announces that the meshes have changed.

The first step of a slider asks whether the ground was edited by hand. To read the arrays of a ground of 1.4 million
vertices would hold the window for 0.1 s, so their marks are read earlier, while the window rests. Only a window that
follows Blender's announcements keeps marks. A script that writes into arrays must announce it by ``Mesh.update``, as
Blender requires for drawing.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy

_known: dict[int, list[Any]] = {}  # by ``session_uid``


def keep_marks(mesh_uid: int, marks: list[Any]) -> None:
    """Keep the marks of the arrays of the mesh with this ``session_uid``."""
    _known[mesh_uid] = marks


def find_known_marks(meshes: Collection[bpy.types.Mesh]) -> dict[bpy.types.Mesh, list[Any]]:
    """Find the kept marks of these meshes, by mesh, for ``BlockHasher.mesh_marks``."""
    return {mesh: _known[mesh.session_uid] for mesh in meshes if mesh.session_uid in _known}


def has_known_marks() -> bool:
    """Return whether marks of any mesh are kept."""
    return bool(_known)


def forget_marks(mesh_uid: int | None = None) -> None:
    """Forget the marks of the mesh with this ``session_uid``, which has changed, or of all meshes."""
    if mesh_uid is None:
        _known.clear()
    else:
        _known.pop(mesh_uid, None)
