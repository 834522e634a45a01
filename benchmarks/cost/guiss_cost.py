"""The cost of a pair of snow in Icy Moon and with the settings of the GUISS paper's public code, in one run.

    python benchmarks guiss_cost [--ground gentle] [--scale 0.25] [--pairs N] [--reference-samples N]
        [--converged N] [--baked-pairs N] [--out FOLDER]

The snow of the paper (Ramchander Bhaskara et al., "Icy Moon Surface Simulation and Stereo Depth Estimation for Sampling
Autonomy", IEEE Aerospace Conference 2024) on ground of its terrain function, seen by its camera at 640 x 480 px. The
first row has the settings of its public code: a separate render for each eye, 16 samples, 100 bounces, subsurface
scattering, and a denoiser that cleans all its guides. Each row below changes one more setting. All rows have the same
ground and material, unless the name of a row tells otherwise. JPLV measures almost none of this ground. ``--ground
gentle`` has less than half its relief, finer triangles, and the Sun 30 degrees high at the side; there JPLV measures
two thirds.

Cost is processor seconds of all threads: ``first`` for a process that renders one pair (start, build, pair), ``more``
for each further pair of the same process. ``first`` includes all baked light, ``more`` none. Ratios are of ``more`` and
a part of baked light: its seconds divided by each number of ``--images`` that have the ground and the Sun in common.
Light that is baked only where a pair sees the ground is not divided. With ``--baked-pairs`` rows of baked light have
more headings than others, and errors are over the headings that all rows have.

The first row renders only its two images and one depth. All others also render exact depth, normals and labels of both
eyes. SGBM, StereoBM and JPLV are compared with the exact disparity where both eyes see: coverage, mean error, share
wrong by more than 1 px, share wrong or missing. A row with more coverage includes harder pixels. So each row also shows
its increase over the first, ± a standard error (jackknife over tiles): of the mean error of the pixels that both rows
measure, and of the share wrong or missing. Radiance is compared with a render of many samples with all bounces and
subsurface scattering: the mean, and the root mean square of the difference of a pixel over the mean. With
``--converged`` the increases are not over the first row, but over Lambert snow of that many samples without a denoiser.
Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from icymoon.benchmarks.common.arguments import add_out, add_scale, is_asked, open_out_folder
from icymoon.benchmarks.common.guiss_rows import Errors, errors, head, measured, rendered, shown
from icymoon.benchmarks.common.guiss_scene import GROUNDS, LAMBERT, Rung, ladder, snow, with_quality
from icymoon.render.cost.quality_variants import make_reference
from icymoon.render.workers import job_commands
from icymoon.settings import description
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.trade.quality_losses import read_reference

METHODS = "sgbm,bm,jplv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scale(parser, 1.0)
    parser.add_argument("--pairs", type=int, default=2, help="pairs per row, each with its own heading")
    parser.add_argument(
        "--reference-samples",
        type=int,
        default=128,
        help="samples of the render that radiance is compared with; 0: none",
    )
    parser.add_argument(
        "--converged",
        type=int,
        default=0,
        help="samples of the render whose errors others are compared with; 0: the first row's",
    )
    parser.add_argument(
        "--images",
        type=int,
        nargs="*",
        default=[36, 4, 1],
        help="numbers of images of a ground under one Sun, which share a bake",
    )
    parser.add_argument("--ground", choices=tuple(GROUNDS), default="paper")
    parser.add_argument("--only", nargs="*", default=[], help="rows whose name contains one of these")
    add_out(parser)
    parser.add_argument("--baked-pairs", type=int, help="pairs per row of baked light, a multiple of --pairs")


def main(options: argparse.Namespace) -> None:
    """Render and print the table."""
    options.baked_pairs = options.baked_pairs or options.pairs
    if options.baked_pairs % options.pairs:
        sys.exit("--baked-pairs is not a multiple of --pairs; give one.")
    with open_out_folder(options.out) as out:
        print_table(options, out)


def print_table(options: argparse.Namespace, out: Path) -> None:
    """Render the rows below ``out`` and print them."""
    methods, scene = parse_methods(METHODS), snow(options.scale, options.ground)
    rows: dict[str, Any] = {}
    first: list[Errors] = []
    print(head(options.images), flush=True)
    best = None
    if options.reference_samples:
        many = make_reference(scene, options.reference_samples)
        folders = [
            job_commands.render_job(
                job_commands.Job(out / "many", many.settings, repeat=k), sys.executable, lambda message: None
            )[0]
            for k in range(many.repeats)
        ]
        best = read_reference(folders, methods, {})
        print(
            f"{many.name}, no denoiser: {best.noise:.2%} noise, SGBM {best.stereo['sgbm']['epe_px']:.3f} px", flush=True
        )

    def render_row(rung: Rung, folder: Path) -> tuple[list[dict[str, Any]], list[Errors]]:
        baked = rung.settings.get("quality", {}).get("indirect") == "BAKED"
        settings = description.merged(
            scene,
            description.check(dict(rung.settings), "benchmark"),
            {"dataset": {"headings": options.baked_pairs if baked else options.pairs}},
        )
        pairs = rendered(rung, settings, folder)
        return pairs, [errors(Path(pair["folder"]), methods) for pair in pairs[:: len(pairs) // options.pairs]]

    if options.converged:
        rung = next(each for each in ladder() if each.name == LAMBERT)
        pairs, first = render_row(
            Rung(
                f"{rung.name}, {options.converged} samples, no denoiser",
                with_quality(rung.settings, {"samples": options.converged, "denoiser": "NONE"}),
            ),
            out / "converged",
        )
        print(
            shown(f"converged: {options.converged} samples", measured(pairs, first, first, None), 0.0, options.images),
            flush=True,
        )
    most = 0.0
    for k, rung in enumerate(ladder()):
        if not is_asked(rung.name, options.only):
            continue
        pairs, found = render_row(rung, out / f"rung{k}")
        first = first or found
        rows[rung.name] = row = measured(pairs, found, first, best)
        most = most or row["more"]
        print(shown(rung.name, row, most, options.images), flush=True)
    (out / "rows.json").write_text(json.dumps(rows, indent=1))
