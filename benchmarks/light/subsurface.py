"""Cost and stereo error of the ways to trace light under snow: random walk, Burley's profile, none.

    python benchmarks subsurface --scale 0.5 --pairs 2

The scene and the comparison come from ``guiss_cost``: the GUISS paper's snow, each row compared with the first
one, which follows a random walk with the paper's samples and denoiser. Columns are as in ``guiss_cost``; the last
one is the mean radiance over that of the first row. Needs Blender as a module and the evaluator's packages.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import add_out, add_scale, open_out_folder
from icymoon.benchmarks.common.guiss_rows import errors, head, measured, rendered, shown
from icymoon.benchmarks.common.guiss_scene import Rung, snow
from icymoon.settings import description
from icymoon.stereo.images.exr import read_view
from icymoon.stereo.matchers.methods import parse_methods

_COMMON: dict[str, Any] = {"diffuse_bounces": 3, "noise_threshold": 0.0, "truth": "DEPTH"}


def rows(samples: list[int]) -> list[Rung]:
    """The rows: the random walk with the paper's samples, then the others with each number of ``samples``."""

    def row(name: str, count: int, surface: dict[str, Any]) -> Rung:
        return Rung(f"{name}, {count} samples", {"quality": {**_COMMON, "samples": count}, "surface": surface})

    return [
        row("random walk", 16, {}),
        *(row("Burley's profile", n, {"subsurface_method": "BURLEY"}) for n in samples),
        *(row("not followed", n, {"subsurface_weight": 0.0}) for n in samples),
    ]


def mean_radiance(folders: list[Path]) -> float:
    """The mean of both eyes of pairs, W/(m² sr)."""
    return float(
        np.mean(
            [
                read_view(folder / f"{eye}.exr").radiance.mean(dtype=np.float64)
                for folder in folders
                for eye in ("left", "right")
            ]
        )
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scale(parser, 0.5)
    parser.add_argument("--pairs", type=int, default=2, help="pairs per row, each with its own heading")
    parser.add_argument("--samples", type=int, nargs="*", default=[16, 9], help="samples of the rows after the first")
    add_out(parser)


def main(options: argparse.Namespace) -> None:
    """Render and print the table."""
    with open_out_folder(options.out) as out:
        print_table(options, out)


def print_table(options: argparse.Namespace, out: Path) -> None:
    """Render the rows below ``out`` and print them."""
    methods, scene = parse_methods("sgbm,bm"), snow(options.scale)
    first: list[Any] = []
    most = light = 0.0
    print(head(), flush=True)
    for k, rung in enumerate(rows(options.samples)):
        settings = description.merged(
            scene, description.check(dict(rung.settings), "benchmark"), {"dataset": {"headings": options.pairs}}
        )
        pairs = rendered(rung, settings, out / f"row{k}")
        found = [errors(Path(pair["folder"]), methods) for pair in pairs]
        first = first or found
        row = measured(pairs, found, first, None)
        mean = mean_radiance([Path(pair["folder"]) for pair in pairs])
        most, light = most or row["more"], light or mean
        print(f"{shown(rung.name, row, most)}\n{'':44}{mean / light - 1:+.2%} of the light", flush=True)
