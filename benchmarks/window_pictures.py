"""The pictures of the window in the manual, of the screenshots that driving a real Blender leaves.

    ICYMOON_GUI_ALL=1 python tests/gui/run.py 4.3
    python benchmarks/window_pictures.py out/gui/4.3-trixie

Cut to the 3D View with its sidebar, and made small; written to docs/images.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2

TARGET = Path(__file__).resolve().parents[1] / "docs" / "images"
#: Picture -> the screenshot that it is made of.
PICTURES = {"window_sidebar": "sidebar", "window_built": "built", "window_evaluated": "evaluated",
            "window_surface": "measured_surface"}
#: Part of the screen that the 3D View takes with drive.py's window, and the width of a picture, px.
RIGHT, BOTTOM, WIDTH_PX = 0.826, 0.905, 1000


def main(folder: Path) -> None:
    """Cut and write."""
    for name, shot in PICTURES.items():
        (path,) = folder.glob(f"*_{shot}.png")
        screen = cv2.imread(str(path))
        view = screen[:round(BOTTOM * screen.shape[0]), :round(RIGHT * screen.shape[1])]
        size = WIDTH_PX, round(WIDTH_PX * view.shape[0] / view.shape[1])
        target = TARGET / f"{name}.jpg"
        cv2.imwrite(str(target), cv2.resize(view, size, interpolation=cv2.INTER_AREA), [cv2.IMWRITE_JPEG_QUALITY, 82])
        print(target)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
