"""The sheet of the terrain presets in the README: a small image of each.

    python benchmarks contact_sheet [SHEET.png] [PRESET ...]

Each preset is built and rendered as by a worker, under a Sun at 25 degrees, and shown at the exposure
that the evaluator would choose. Without arguments it writes docs/images/terrains.png. With PRESETs the other cells of
a SHEET that exists stay.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.renders import open_empty_file, render, settings_of, start_blender
from icymoon.nodes.build_scene import build_scene
from icymoon.settings import preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.stereo.images.develop import average_bands
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array

SHEET = Path(__file__).resolve().parents[2] / "docs" / "images" / "terrains.png"
WIDTH_PX, HEIGHT_PX, COLUMNS, LABEL_PX = 320, 200, 4, 18
#: A camera that looks from the edge of the patch over all of it.
VIEW: Parts = {
    "rig": {"width_px": WIDTH_PX, "height_px": HEIGHT_PX, "y_m": -9.0, "height_m": 2.6, "pitch_deg": 20.0},
    "terrain": {"resolution": 641},
    "mesh": {"seen": "FINE"},
    "quality": {"samples": 8, "denoiser": "OIDN", "truth": "DEPTH"},
    "light": {"sun_elevation_deg": 25.0, "sun_azimuth_deg": 300.0},
}


def picture(preset: str, folder: Path) -> Array:
    """The left image (rows, columns) of a preset as 8-bit grey values, with its name below."""
    settings = settings_of(("surfaces/fresh_snow", preset), VIEW)
    built = build_scene(open_empty_file(), settings)
    pair = render(built, settings, folder)[0]
    light = average_bands(read_view(pair / "left.exr").radiance)
    full = np.quantile(light, settings.sensor.auto_percentile) / settings.sensor.auto_target
    # A sensor is linear; a screen is not.
    image = np.rint(255 * np.clip(light / full, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    label = np.zeros((LABEL_PX, image.shape[1]), np.uint8)
    found = built.statistics
    asked, made = (found[key]["rms_slope_deg"] for key in ("asked", "made"))
    base = "" if round(asked) == round(made) else f" (base {asked:.0f})"
    text = f"{preset.split('/')[1]}: {made:.0f} deg{base}"
    cv2.putText(label, text, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255,), 1, cv2.LINE_AA)
    return np.vstack([image, label])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sheet", nargs="?", type=Path, default=SHEET, help="docs/images/terrains.png by default")
    parser.add_argument("presets", nargs="*", help="terrain presets; all by default")


def main(options: argparse.Namespace) -> None:
    """Render and write the sheet."""
    start_blender()
    sheet = options.sheet
    every = preset_files.preset_names("terrains")
    shown = cv2.imread(str(sheet), cv2.IMREAD_GRAYSCALE)
    high = HEIGHT_PX + LABEL_PX
    shape = (-(-len(every) // COLUMNS) * high, COLUMNS * WIDTH_PX)
    if shown is None or shown.shape != shape or not options.presets:
        shown = np.zeros(shape, np.uint8)
    with scratch() as folder:
        for preset in options.presets or every:
            row, column = divmod(every.index(preset), COLUMNS)
            left, top = column * WIDTH_PX, row * high
            shown[top : top + high, left : left + WIDTH_PX] = picture(preset, folder)
            print(preset, flush=True)
    sheet.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(sheet), shown, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(sheet)
