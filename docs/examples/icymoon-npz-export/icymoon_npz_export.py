"""A compressed file of NumPy for each pair, and a list of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

ICYMOON_API = 1


def write_pair(pair: Any, folder: Path) -> None:
    """Write ``pair.npz``: both images, and disparity, px, and depth, m, of the left one, NaN for sky."""
    np.savez_compressed(
        folder / "pair.npz",
        left=pair.left,
        right=pair.right,
        disparity_px=pair.disparity_left_px.astype(np.float32),
        depth_m=pair.depth_left_m.astype(np.float32),
        visible=pair.visible_left,
        camera=np.array([pair.focal_px, pair.cx_px, pair.cy_px, pair.baseline_m]),
    )


def finish(names: list[str], folder: Path) -> None:
    """Write ``pairs.json``, the names of all pairs that were written."""
    (folder / "pairs.json").write_text(json.dumps(names, indent=1) + "\n", encoding="utf-8")
