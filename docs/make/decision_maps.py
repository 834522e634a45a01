"""The pictures of the tutorial on decisions: a left image, the true map, and the maps by some matchers; or the left
images before and after a dig, and the changes that some matchers found.

    python docs/make/decision_maps.py DECISIONS PAIR docs/images/decisions.jpg bm sgbm
    python docs/make/decision_maps.py DECISIONS BEFORE,AFTER docs/images/trench.jpg true_depth sgbm

``DECISIONS`` is what ``icymoon decide`` wrote, ``PAIR``, ``BEFORE`` and ``AFTER`` are pairs in it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from icymoon.stereo.images.image_files import encode_image, read_png
from icymoon.stereo.matchers.methods import describe_method
from icymoon.support.arrays import Array

SIDE_PX, GAP_PX, STRIP_PX = 300, 12, 26
#: Of screens, for the linear values of the sensor.
GAMMA = 1 / 2.2


def column(image: Array, title: str) -> Array:
    """A square picture with its title above it; wider images are cut in the middle."""
    colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    side = min(colour.shape[:2])
    left = (colour.shape[1] - side) // 2
    enlarges = side < SIDE_PX
    square = cv2.resize(
        colour[:side, left : left + side],
        (SIDE_PX, SIDE_PX),
        interpolation=cv2.INTER_NEAREST if enlarges else cv2.INTER_AREA,
    )
    strip = np.full((STRIP_PX, SIDE_PX, 3), 255, np.uint8)
    cv2.putText(strip, title, (0, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.52, (40, 40, 40), 1, cv2.LINE_AA)
    return np.vstack([strip, square])


def left_column(folder: Path, title: str) -> Array:
    """The left image of a pair, with the gamma of a screen."""
    return column((255 * (read_png(folder / "left.png") / 255.0) ** GAMMA).astype(np.uint8), title)


def main(arguments: Sequence[str]) -> None:
    """Write the picture."""
    out, pair, target, *methods = arguments
    folders = [Path(out) / "pairs" / name for name in pair.split(",")]
    if len(folders) == 1:
        columns, kind = (
            [left_column(folders[0], "left image"), column(read_png(folders[0] / "truth_sites.png"), "truth")],
            "outcome",
        )
    else:
        columns, kind = (
            [left_column(folder, title) for folder, title in zip(folders, ("before", "after"), strict=True)],
            "change",
        )
    columns += [
        column(read_png(folders[-1] / f"{method}_{kind}.png"), f"change by {title}" if kind == "change" else title)
        for method in methods
        for title in [describe_method(method.replace("_", " "))]
    ]
    gap = np.full((SIDE_PX + STRIP_PX, GAP_PX, 3), 255, np.uint8)
    parts = [part for each in columns for part in (each, gap)][:-1]
    Path(target).write_bytes(encode_image(np.hstack(parts), ".jpg", 88))


if __name__ == "__main__":
    main(sys.argv[1:])
