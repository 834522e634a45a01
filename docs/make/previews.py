"""Make the small pictures of the shipped scenes and of the gallery that the sidebar shows: presets/previews/NAME.jpg.

    python docs/make/previews.py [KIND/NAME ...]      all by default; takes some minutes

Each is what the left camera gives of the scene preset, exposed by its own response. choose.jpg, which is shown while
none of them is chosen, is the gallery side by side.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from icymoon.commands.cli import render_settings
from icymoon.render.workers.job import python_command
from icymoon.settings import description, preset_files

#: Pixels of a preview, and light paths per pixel: it is shown at about a third of this width.
WIDTH, HEIGHT, SAMPLES = 256, 192, 32
JPEG_QUALITY = 82


def make(name: str, folder: Path) -> Path:
    """Render a preset such as scenes/europa_chaos into a folder and write its preview; returns the preview."""
    described = description.merged(description.defaults(), preset_files.load_preset(name), {
        "rig": {"width_px": WIDTH, "height_px": HEIGHT}, "quality": {"samples": SAMPLES}})
    render_settings(described, folder / name, sys.executable)
    (pair,) = (folder / name).glob("pairs/*/")
    shown = folder / "shown" / name
    subprocess.run(python_command(sys.executable, "stereo", "develop", str(pair), "--out", str(shown)), check=True,
                   stdout=subprocess.DEVNULL)
    image = cv2.imread(str(next(shown.rglob("left.png"))))
    target = preset_files.preview_path(name)
    _write(target, image)
    return target


def _write(target: Path, image: np.ndarray) -> None:
    target.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(target), image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def make_choice(columns: int = 4) -> None:
    """Write the picture of the gallery, as large as one of them."""
    images = [cv2.imread(str(preset_files.preview_path(name))) for name in preset_files.preset_names("gallery")]
    size = WIDTH // columns, HEIGHT // columns
    small = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    rows = [np.hstack(small[k:k + columns]) for k in range(0, len(small) - columns + 1, columns)]
    _write(preset_files.preview_path("choose"), np.vstack(rows))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="icymoon-previews-") as made:
        for wanted in sys.argv[1:] or [*preset_files.preset_names("scenes"), *preset_files.preset_names("gallery")]:
            print(make(wanted, Path(made)), flush=True)
    make_choice()
