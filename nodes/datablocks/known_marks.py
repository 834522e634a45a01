"""Marks of meshes that were read before and whose meshes Blender has not announced as changed since.

The first step of a slider asks whether the ground was edited by hand. To read the arrays of a ground of 1.4 million
vertices would hold the window for 0.1 s, so their marks are read before, while the window rests. Only a window that
follows Blender's announcements keeps marks. A script that writes into arrays must announce that by ``Mesh.update``, as
Blender asks of it for the drawing.
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
    """The marks that are kept, for ``BlockHasher.mesh_marks``."""
    return {mesh: _known[mesh.session_uid] for mesh in meshes if mesh.session_uid in _known}


def has_known_marks() -> bool:
    """Whether marks of any mesh are kept."""
    return bool(_known)


def forget_marks(mesh_uid: int | None = None) -> None:
    """Forget the marks of the mesh with this ``session_uid``, which has changed, or of all meshes."""
    if mesh_uid is None:
        _known.clear()
    else:
        _known.pop(mesh_uid, None)
