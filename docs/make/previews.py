"""Make the small pictures of shipped presets that the sidebar and the Asset Browser show: presets/previews/NAME.jpg.

    python docs/make/previews.py [KIND/NAME ...]      all by default; takes some minutes

Each is what the left camera gives of the scene preset, exposed by its own response. A preset of a part is shown in a
scene that is the same for its kind, in previews/KIND/NAME.jpg. choose.jpg, which is shown while no scene is chosen, is
the gallery side by side.
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
from icymoon.typed_settings import Parts

#: Pixels of a preview in the usual proportion, and light paths per pixel. The sidebar shows it at a third of it.
WIDTH, HEIGHT, SAMPLES = 256, 192, 32
JPEG_QUALITY = 82
#: The scene that shows presets of a part, with changes. Surfaces have the same exposure, which shows their albedos.
SAMPLES_OF: dict[str, tuple[str, Parts]] = {
    "surfaces": ("gallery/block_field", {"light": {"sun_elevation_deg": 25.0},
                                         "sensor": {"auto_exposure": False, "exposure_s": 8.0e-5}}),
    "rigs": ("gallery/block_field", {"light": {"sun_elevation_deg": 25.0}}),
    "lights": ("gallery/ridge", {}),
    "bodies": ("gallery/ridge", {}),
}


def make(name: str, folder: Path) -> Path:
    """Render a preset such as scenes/europa_chaos into a folder and write its preview; returns the preview."""
    base, changes = SAMPLES_OF.get(name.split("/")[0], (name, {}))
    described = description.merged(description.defaults(), preset_files.load_preset(base),
                                   preset_files.load_preset(name), changes, {"quality": {"samples": SAMPLES}})
    rig = described.rig
    described["rig"] = rig | {"width_px": HEIGHT * rig.width_px // rig.height_px, "height_px": HEIGHT}
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
    target.parent.mkdir(parents=True, exist_ok=True)
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
        kinds = ("scenes", "gallery", *SAMPLES_OF)
        for wanted in sys.argv[1:] or [name for kind in kinds for name in preset_files.preset_names(kind)]:
            print(make(wanted, Path(made)), flush=True)
    make_choice()
