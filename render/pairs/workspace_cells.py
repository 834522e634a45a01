"""The cells of the workspace whose true heights lie in a pair's folder. Imports no Blender."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...settings.topics.lander import WorkspaceSettings
from ...support.errors import IcyMoonError

#: True heights of the workspace, float32 (2, rows, columns), north first, in metres of the site's frame: of what lies
#: on top, and of the ground without its rocks; NaN where there is neither.
WORKSPACE_FILE = "workspace.npy"
#: What lies on top in these cells, float32 (4, rows, columns): its albedo in the bands R, G, B, and its share of salt.
MATERIALS_FILE = "workspace_materials.npy"
#: The most cells along the longer side of a map.
MOST_CELLS = 8192
#: Places along a side of a cell of a workspace where its height is looked up.
PLACES = 3


@dataclass(frozen=True)
class Extent:
    """Grid of a map: size and number of its cells, and the outer corner of the north-west cell; lengths in metres."""

    cell_m: float
    rows: int
    columns: int
    west_m: float
    north_m: float


def find_workspace_extent(workspace: WorkspaceSettings) -> Extent:
    """The cells of a workspace; whole cells that cover its square. Raises IcyMoonError for too many."""
    count = max(1, int(np.ceil(workspace.size_m / workspace.cell_m - 1e-6)))
    if PLACES * count > MOST_CELLS:
        raise IcyMoonError(
            f"workspace.cell_m is {workspace.cell_m:g}, which makes {count} cells along a side; give "
            f"{PLACES * workspace.size_m / MOST_CELLS:.3g} m or more."
        )
    half = count * workspace.cell_m / 2
    return Extent(
        float(workspace.cell_m), count, count, float(workspace.east_m - half), float(workspace.north_m + half)
    )


def workspace_files(workspace: WorkspaceSettings) -> tuple[str, ...]:
    """The names of the maps of a workspace in the folder of a pair."""
    if workspace.cell_m <= 0:
        return ()
    return (WORKSPACE_FILE, MATERIALS_FILE) if workspace.materials else (WORKSPACE_FILE,)


def describe_workspace(workspace: WorkspaceSettings) -> dict[str, Any] | None:
    """The table "workspace" of ``pair.json``: the files of its maps and their cells; None without a workspace."""
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
