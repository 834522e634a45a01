"""The cost of a pair's truth by rays, and by Cycles with lamps and surfaces, without lamps, and without both for depth
alone.

    python benchmarks truth_cost [--scale 0.5] [--pairs 3] [SCENE ...]

Each row is a process that renders as many pairs of a scene preset, or of the ``paper``'s snow (``guiss_cost``), with
one sample of radiance. The first has depth alone, which comes with the radiance; the others have the whole truth. In
the last row ``truth_without_light.MAX_TRIANGLES_PER_PIXEL`` does not count. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
from contextlib import nullcontext

from icymoon.benchmarks.common.arguments import add_scale, scratch
from icymoon.benchmarks.common.guiss_scene import snow
from icymoon.benchmarks.common.own_process import call
from icymoon.benchmarks.common.renders import render_planned, settings_of, start_blender
from icymoon.render import truth_without_light
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description
from icymoon.settings.topics.scene import typed
from icymoon.stereo.trade.measure_variants import scale_view

WAYS = ("depth alone", "by rays", "by Cycles, as it is lit", "lamps off", "depth without surfaces, too")
#: Index of the first way by Cycles; each later way leaves out more.
_CYCLES = 2


def render(scene: str, way: int, scale: float, pairs_of_scene: int) -> list[float]:
    """Render in this process; processor seconds of each pair."""
    start_blender()
    for name in ("remove_surfaces", "switch_lights_off")[: max(0, len(WAYS) - 1 - max(way, _CYCLES))]:
        setattr(truth_without_light, name, lambda what: nullcontext())
    truth_without_light.MAX_TRIANGLES_PER_PIXEL = 10**9
    made = snow(scale) if scene == "paper" else scale_view(settings_of((f"scenes/{scene}",)), scale)
    settings = typed(
        description.merged(
            made,
            description.check(
                {
                    "quality": {
                        "samples": 1,
                        "denoiser": "NONE",
                        "truth": "FULL" if way else "DEPTH",
                        "noise_threshold": 0.0,
                        "truth_by": "CYCLES" if way >= _CYCLES else "RAYS",
                    },
                    "surface": {"subsurface_weight": 0.0},
                    "dataset": {"headings": pairs_of_scene},
                },
                "benchmark",
            ),
        )
    )
    pairs = expand_headings(settings)
    with scratch() as place:
        render_planned(pairs, place)
        told = [json.loads((pair.folder(place) / "pair.json").read_text()) for pair in pairs]
    return [each["cpu_seconds"]["pair"] for each in told]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenes", nargs="*", default=["paper", "europa_rough_ice"])
    add_scale(parser, 1.0)
    parser.add_argument("--pairs", type=int, default=3, help="pairs of a scene, two or more")


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    for scene in options.scenes:
        for way, name in enumerate(WAYS):
            first, *more = call(render, scene, way, options.scale, options.pairs)
            print(
                f"{scene:22}{name:30} {first:6.2f} CPU s the first, {sum(more) / len(more):6.2f} each further pair",
                flush=True,
            )
