"""The size of a pair on disk, pass by pass. The coefficients in ``render/cost/estimate.py`` come from here.

    python benchmarks disk              all
    python benchmarks disk gallery …    those whose name contains a word

``disk.txt`` beside it contains the last result.

Each row is a pair: the bytes of each pass per pixel of both eyes, with margins, those of the whole pair, and the
estimate. The last line shows the error of the estimates. Needs Blender 5 as a module, whose files have a
part for each pass.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import is_asked, scratch
from icymoon.benchmarks.common.renders import open_empty_file, render, start_blender
from icymoon.formats.exr_parts import read_pieces
from icymoon.nodes.build_scene import build_scene
from icymoon.render.cost import estimate
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.images.exr import read_truth

SMALL: dict[str, Any] = {
    "rig": {"width_px": 160, "height_px": 120},
    "quality": {"samples": 16, "noise_threshold": 0.0, "denoiser": "NONE"},
}
#: Changes of ``SMALL`` with the default scene, each measured alone.
ROWS: dict[str, dict[str, Any]] = {
    **{f"{n} samples": {"quality": {"samples": n}} for n in (1, 4, 16, 64)},
    **{
        f"{w} x {h}": {"rig": {"width_px": w, "height_px": h}, "quality": {"samples": 1}}
        for w, h in ((320, 240), (640, 480), (1280, 960))
    },
    "mesh of 4 px": {"mesh": {"error_px": 2.0, "edge_px": 4.0}},
    "mesh of 24 px": {"mesh": {"error_px": 4.0, "edge_px": 24.0}},
    "grid": {"mesh": {"kind": "GRID"}, "terrain": {"resolution": 513}},
    "denoised": {"quality": {"denoiser": "OIDN"}},
    "depth alone": {"quality": {"truth": "DEPTH"}},
    "planet": {"light": {"planet": True, "planet_elevation_deg": 40.0}},
    "toe-in": {"rig": {"toe_in_deg": 1.0}},
    "overscan": {"rig": {"overscan": 0.1}},
    "depth of field": {"rig": {"focus_distance_m": 3.0}},
    "no relief": {"surface": {"grain_amplitude_m": 0.0}},
    "blocks": {"rocks": {"coverage": 0.2}},
    "images": {"textures": {"set": "FROST"}},
    **{f"pitch {pitch:g}": {"rig": {"pitch_deg": pitch}} for pitch in (-60.0, -20.0, 0.0, 10.0)},
}


def measured(settings: Settings, folder: Path) -> tuple[Counter[str], float, float]:
    """Bytes of a pair by pass and in total, and its share of sky."""
    scene = open_empty_file()
    pair = expand_headings(description.merged(settings, {"dataset": {"headings": 1}}))[0]
    render(build_scene(scene, settings), description.merged(settings, {"dataset": {"headings": 1}}), folder)
    sizes: Counter[str] = Counter()
    total = 0.0
    for file in pair.folder(folder).glob("*.exr"):
        data = file.read_bytes()
        total += len(data)
        for piece in read_pieces(data):
            sizes[piece.name.split("-")[0]] += sum(map(len, piece.chunks))
    return sizes, total, _sky(pair.folder(folder))


def _sky(folder: Path) -> float:
    pair = read_pair(folder)
    return float(np.mean([np.isnan(read_truth(pair.truth_of_image(eye)).depth).mean() for eye in ("left", "right")]))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", nargs="*", help="rows whose name contains one of these; all by default")


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    start_blender()
    ratios = []
    rows: dict[str, tuple[Parts, ...]] = {name: (changes,) for name, changes in ROWS.items()}
    for preset in (*preset_files.preset_names("gallery"), *preset_files.preset_names("scenes")):
        rows[preset] = (preset_files.load_preset(preset), SMALL)  # its own scene, seen small
    for name, parts in rows.items():
        if not is_asked(name, options.words):
            continue
        first = () if len(parts) > 1 else (SMALL,)
        settings = description.merged(
            description.defaults(), *first, *(description.check(part, "benchmark") for part in parts)
        )
        with scratch() as folder:
            sizes, total, sky = measured(settings, folder)
        pixels, expected = estimate.estimate_work(settings).pixels, estimate.estimate_bytes(settings)
        passes = " ".join(
            f"{name.split('.')[-1].replace(' ', '')} {size / pixels:.2f}" for name, size in sorted(sizes.items())
        )
        ratios.append(expected / total)
        print(
            f"{name:34} {total / pixels:6.2f} {expected / pixels:6.2f} {ratios[-1]:5.2f} "
            f"sky {sky:.2f} ({estimate.compute_sky_fraction(settings):.2f}) {passes}",
            flush=True,
        )
    print(f"expected over measured: {min(ratios):.2f} to {max(ratios):.2f}, mean {np.mean(ratios):.3f}")
