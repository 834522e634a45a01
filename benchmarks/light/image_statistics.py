"""Spectral slope, saturation and shadow of the images of scene presets, for the table in docs/theory/surfaces.md.

    python benchmarks image_statistics [PRESET ...]      scene presets; all by default, some minutes

For each: the slope of the power spectrum of the light, over the largest square of the left image that shows ground; and
the shares of ground pixels that are saturated and darker than 2 % of the full scale, at the Sun of the preset and at a
Sun 8 degrees high. The image is the preset's, 512 pixels wide, exposed by its own camera response.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.commands.render_scenes import render_settings
from icymoon.render.pairs.pair_folder import EYES, read_pair
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.stereo.images.develop import average_bands, develop
from icymoon.stereo.images.image_statistics import find_largest_square, measure_shares, measure_spectral_slope
from icymoon.stereo.images.views import read_eye
from icymoon.support.labels import ROCK, TERRAIN

WIDTH_PX, LOW_SUN_DEG = 512, 8.0


def measure(name: str, folder: Path, changes: Parts) -> tuple[float, int, float, float]:
    """Slope, side in pixels of the square on which it is measured, and the saturated and the dark share."""
    described = description.merged(description.defaults(), preset_files.load_preset(name), changes)
    rig = described.rig
    described["rig"] = rig | {"width_px": WIDTH_PX, "height_px": WIDTH_PX * rig.height_px // rig.width_px}
    render_settings(described, folder, sys.executable)
    pair = read_pair(next(folder.glob("pairs/*/")))
    (light, view), (right, _) = (read_eye(pair, eye) for eye in EYES)
    assert view.semantic is not None
    ground = np.isin(view.semantic, (TERRAIN, ROCK))
    rows, columns = find_largest_square(ground)
    images = develop(pair, light, right, pair.settings)
    saturated, dark = measure_shares(images.left / (2.0**images.bits - 1), ground)
    return measure_spectral_slope(average_bands(light.radiance)[rows, columns]), rows.stop - rows.start, saturated, dark


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("presets", nargs="*", help="scene presets; all by default")


def main(options: argparse.Namespace) -> None:
    """Render, measure and print the table."""
    print("| scene | slope (px) | saturated, dark, % | Sun at 8°: slope | saturated, dark, % |")
    print("|---|---|---|---|---|")
    for name in options.presets or preset_files.preset_names("scenes"):
        with scratch() as folder:
            slope, side, saturated, dark = measure(name, folder / "own", {})
            low, _, low_saturated, low_dark = measure(
                name, folder / "low", {"light": {"sun_elevation_deg": LOW_SUN_DEG}}
            )
        print(
            f"| `{name.split('/')[1]}` | {slope:.2f} ({side}) | {100 * saturated:.1f}, {100 * dark:.0f} | {low:.2f} "
            f"| {100 * low_saturated:.1f}, {100 * low_dark:.0f} |",
            flush=True,
        )
