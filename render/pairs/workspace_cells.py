"""The cells of a workspace, whose true heights are stored in a pair's folder. Imports no Blender."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...settings.topics.lander import WorkspaceSettings
from ...support.errors import IcyMoonError

#: Array of true heights of the workspace, float32 (2, rows, columns), north first, in metres of the site's frame: of
#: the top surface, and of the ground without rocks; NaN where neither exists.
WORKSPACE_FILE = "workspace.npy"
#: Array of the materials on top, float32 (4, rows, columns): albedo in the bands R, G, B, and share of salt.
MATERIALS_FILE = "workspace_materials.npy"
#: Most cells along the longer side of a map.
MAX_CELLS = 8192
#: Number of places along a side of a cell at which the height is looked up.
PLACES_PER_SIDE = 3


@dataclass(frozen=True)
class Extent:
    """Grid of a map: size and number of cells, and the outer corner of the north-west cell. Lengths are in metres."""

    cell_m: float
    rows: int
    columns: int
    west_m: float
    north_m: float


def find_workspace_extent(workspace: WorkspaceSettings) -> Extent:
    """Find the whole cells that cover the square of a workspace. Raises IcyMoonError for too many cells."""
    count = max(1, int(np.ceil(workspace.size_m / workspace.cell_m - 1e-6)))
    if PLACES_PER_SIDE * count > MAX_CELLS:
        raise IcyMoonError(
            f"workspace.cell_m is {workspace.cell_m:g}, which makes {count} cells along a side; give "
            f"{PLACES_PER_SIDE * workspace.size_m / MAX_CELLS:.3g} m or more."
        )
    half = count * workspace.cell_m / 2
    return Extent(
        float(workspace.cell_m), count, count, float(workspace.east_m - half), float(workspace.north_m + half)
    )


def list_workspace_files(workspace: WorkspaceSettings) -> tuple[str, ...]:
    """List the file names of the maps of a workspace in the folder of a pair."""
    if workspace.cell_m <= 0:
        return ()
    return (WORKSPACE_FILE, MATERIALS_FILE) if workspace.materials else (WORKSPACE_FILE,)


def describe_workspace(workspace: WorkspaceSettings) -> dict[str, Any] | None:
    """Describe a workspace for the table "workspace" of ``pair.json``: the files of its maps and their cells; None
    without a workspace."""
    if workspace.cell_m <= 0:
        return None
    extent = find_workspace_extent(workspace)
    return {
        "file": WORKSPACE_FILE,
        "cell_m": extent.cell_m,
        "origin_m": [extent.west_m, extent.north_m],
        "shape": [extent.rows, extent.columns],
        **({"materials": MATERIALS_FILE} if workspace.materials else {}),
    }
