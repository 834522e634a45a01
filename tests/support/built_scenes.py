"""What is in a built scene."""

from __future__ import annotations

import bpy
import numpy as np
from icymoon.support.arrays import Array


def positions(item: bpy.types.Object) -> Array:
    """Vertex positions (n, 3) of an object's mesh."""
    out = np.empty(len(item.data.vertices) * 3, np.float32)
    item.data.vertices.foreach_get("co", out)
    return out.reshape(-1, 3)


def everything() -> dict[str, int]:
    """Number of data-blocks of every kind."""
    return {
        kind: len(getattr(bpy.data, kind))
        for kind in (
            "objects",
            "meshes",
            "materials",
            "lights",
            "cameras",
            "worlds",
            "collections",
            "scenes",
            "node_groups",
        )
    }
