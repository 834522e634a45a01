"""The difference of baked light from traced light in the mean of images, toward the Sun and away from it.

    python benchmarks baked_light [--scale 0.25] [--bake-samples 16] [--samples 32] [--headings 0 180]
        [--rocks 0.1] [--planet]

The scene comes from ``guiss_cost``, with relief for the camera alone and a Lambert surface. A row is a pair: the share
of its light that is baked, the difference of this light from traced indirect light, and the difference over all light
of the pair, with ``--rocks`` also over the pixels of rocks alone, with ``--planet`` over each light group. Needs
Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import add_scale, scratch
from icymoon.benchmarks.common.guiss_scene import make_lambert_snow, planned
from icymoon.benchmarks.common.renders import render_planned, start_blender
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.stereo.images.exr import read_view
from icymoon.support.labels import ROCK

#: A full planet behind the camera that looks toward the Sun.
PLANET: dict[str, Any] = {"planet_elevation_deg": 40.0, "planet_azimuth_deg": 180.0}


def average_radiance(pair: PlannedPair, dataset: Path) -> dict[str, float]:
    """The mean radiance of both eyes, W/(m² sr): of all light, of the pixels of rocks and of each light group."""
    found = read_pair(pair.folder(dataset))
    views = [read_view(found.image(eye)) for eye in ("left", "right")]
    means = {
        "all": np.mean([view.radiance.mean() for view in views]),
        **{group: np.mean([view.groups[group].mean() for view in views]) for group in views[0].groups},
    }
    of_rocks = [view.radiance[np.asarray(view.semantic) == ROCK] for view in views]
    if all(map(len, of_rocks)):
        means["rocks"] = np.mean([each.mean() for each in of_rocks])
    return {name: float(value) for name, value in means.items()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scale(parser, 0.25)
    parser.add_argument("--bake-samples", type=int, default=16, help="samples of baked light")
    parser.add_argument("--samples", type=int, default=32, help="samples of direct and of traced light")
    parser.add_argument("--headings", type=float, nargs="*", default=[0.0, 180.0], help="degrees; the Sun is at 0")
    parser.add_argument("--rocks", type=float, default=0.0, help="share of the ground under rocks")
    parser.add_argument("--planet", action="store_true", help="light of a planet too")


def main(options: argparse.Namespace) -> None:
    """Render and print the table."""
    start_blender()
    with scratch() as dataset:
        print_table(options, dataset)


def print_table(options: argparse.Namespace, dataset: Path) -> None:
    """Render below ``dataset`` and print the table."""
    scene = make_lambert_snow(
        options.scale,
        {
            "rocks": {"coverage": options.rocks},
            "light": {"planet": options.planet} | (PLANET if options.planet else {}),
        },
    )
    traced, baked = (
        {"indirect": "TRACED", "samples": options.samples, "denoiser": "NONE"},
        {"indirect": "BAKED", "bake_samples": options.bake_samples, "direct_samples": options.samples},
    )
    pairs = [[planned(scene, each, heading) for each in (traced, baked)] for heading in options.headings]
    render_planned([pair for both in pairs for pair in both], dataset)
    for heading, both in zip(options.headings, pairs, strict=True):
        of_traced, of_baked = (average_radiance(each, dataset) for each in both)
        true, made = of_traced["all"], of_baked["all"]
        stated = json.loads((both[1].folder(dataset) / "pair.json").read_text())["indirect"]
        off = made - true
        print(
            f"heading {heading:5.0f}°: {100 * stated['share']:.1f} % of the light is baked; it is "
            f"{100 * off / (stated['share'] * made - off):+.1f} % off, which is {100 * off / true:+.1f} % of all "
            f"light; noise {100 * stated['noise']:.1f} %"
            + "".join(
                f"; {name} {100 * (of_baked[name] / of_traced[name] - 1):+.1f} %" for name in of_traced if name != "all"
            ),
            file=sys.stderr,
            flush=True,
        )
