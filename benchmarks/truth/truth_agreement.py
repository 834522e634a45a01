"""The difference of the truth by rays from the truth by Cycles, for each scene preset.

    python benchmarks truth_agreement [--scale 0.25] [scenes/NAME ...]

Both eyes of a pair with one sample. Depth is relative: the median and the largest of 999 pixels in a thousand.
"Disparity" is the share of pixels where it differs by more than 0.01 px, "sky" where one sees the sky alone, "labels"
where the material or the number of the rock differs, "facets" where a component of the facet's normal differs by more
than 0.001, "hidden" where one alone calls a pixel hidden from the other eye. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from icymoon.benchmarks.common.arguments import add_scale, scratch
from icymoon.benchmarks.common.renders import render_planned, settings_of, start_blender
from icymoon.render.pairs.pair_folder import EYES, Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import typed
from icymoon.stereo.images.exr import read_truth
from icymoon.stereo.trade.measure_variants import scale_view

COLUMNS = ("depth, median", "of 99.9 %", "disparity", "sky", "labels", "facets", "hidden")
_PLANET = 4  # its semantic label; it has no facets of its own


def render(scene: str, scale: float, by: str, folder: Path) -> Pair:
    """The first pair of a scene, with the truth ``by`` an engine."""
    whole = settings_of((scene,))
    settings = typed(
        description.merged(
            scale_view(whole, scale),
            description.check(
                {
                    "quality": {
                        "samples": 1,
                        "denoiser": "NONE",
                        "noise_threshold": 0.0,
                        "truth_by": by,
                        "indirect": "TRACED",
                        "files": "FULL",
                    }
                },
                "benchmark",
            ),
        )
    )
    pair = expand_headings(settings)[0]
    render_planned([pair], folder / by)
    return read_pair(pair.folder(folder / by))


def compare(ours: Pair, cycles: Pair) -> list[float]:
    """The numbers of ``COLUMNS``, of both eyes."""
    figures = []
    for eye in EYES:
        mine, other = (read_truth(pair.truth(eye), eye) for pair in (ours, cycles))
        assert mine.normal is not None
        assert other.normal is not None
        known = np.stack([np.isfinite(view.depth) for view in (mine, other)])
        where = known.all(axis=0)
        relative = np.abs(mine.depth[where] / other.depth[where] - 1)
        shift = np.abs(np.subtract(*(ours.camera.disparity(view.depth[where]) for view in (mine, other))))
        ground = where & (other.semantic != _PLANET)
        facets = np.abs(mine.normal[ground] - other.normal[ground]).max(axis=-1)
        labels = np.asarray(mine.semantic != other.semantic) | np.asarray(mine.instance != other.instance)
        figures.append(
            [
                np.median(relative),
                np.quantile(relative, 0.999),
                np.mean(shift > 0.01),
                np.mean(known[0] != known[1]),
                np.mean(labels),
                np.mean(facets > 1e-3),
                np.mean(np.asarray(mine.hidden != other.hidden)),
            ]
        )
    return np.mean(figures, axis=0).tolist()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenes", nargs="*", help="all by default")
    add_scale(parser, 0.25)


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    start_blender()
    known = preset_files.preset_names("scenes")
    print("| scene | " + " | ".join(COLUMNS) + " |\n|---|" + "---|" * len(COLUMNS))
    for scene in options.scenes or known:
        with scratch() as place:
            pairs = [render(scene, options.scale, by, place) for by in ("RAYS", "CYCLES")]
            found = compare(*pairs)
        assert [pair.data["truth"]["by"] == "Cycles" for pair in pairs] == [False, True]
        print(
            f"| {scene} | "
            + " | ".join([f"{each:.1e}" for each in found[:2]] + [f"{100 * each:.3f} %" for each in found[2:]])
            + " |",
            flush=True,
        )
