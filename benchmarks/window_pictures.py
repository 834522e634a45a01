"""The pictures of the window in the manual, made from screenshots of a real Blender.

    python tests/gui/run.py --manual 4.3
    python benchmarks/window_pictures.py out/shots/4.3-trixie

Scales them down and writes them to docs/images.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2

TARGET = Path(__file__).resolve().parents[1] / "docs" / "images"
WIDTH_PX, JPEG_QUALITY = 1000, 82


def main(folder: Path) -> None:
    """Shrink and write."""
    for path in sorted(folder.glob("window_*.png")):
        view = cv2.imread(str(path))
        size = WIDTH_PX, round(WIDTH_PX * view.shape[0] / view.shape[1])
        target = TARGET / f"{path.stem}.jpg"
        cv2.imwrite(
            str(target), cv2.resize(view, size, interpolation=cv2.INTER_AREA), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        )
        print(target)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
