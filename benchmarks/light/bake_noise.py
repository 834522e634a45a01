"""Whether the noise verdict orders baked and traced renders by their distance from a converged render.

    python benchmarks bake_noise [--scale 0.15] [--suns 24 8] [--headings 0] [--bakes 4 16 64 256]
        [--traced 16 64] [--converged 1024]

The scene comes from ``guiss_cost``, with relief for the camera alone and a Lambert surface. A row is a pair: the
verdict with the share of the pixels that noise hides in light or shadow, whichever is more; the same share without the
error of the bake, from what differs between the eyes alone; the noise of the bake over all light, as ``pair.json``
states it; the share that the difference from the converged render truly hides; the root mean square difference of the
light over the mean, the part of it that is one factor for all pixels (bias), and the change, in points, of the share of
pixels that each matcher has wrong or missing.

Below each Sun and heading is Kendall's tau between either share and the truly hidden share, and the distance of light:
1 if the order is the same, -1 if it is the opposite. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import add_scale, scratch
from icymoon.benchmarks.common.guiss_rows import errors
from icymoon.benchmarks.common.guiss_scene import make_lambert_snow, planned
from icymoon.benchmarks.common.renders import render_planned, start_blender
from icymoon.stereo.images.develop import average_bands
from icymoon.stereo.inference.kendall_tau import compute_kendall_tau_b
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.prepare_pair import compute_noise_free_level, find_baked_error_level, load_pair
from icymoon.stereo.measure.render_noise import judge_render_noise, measure_hidden_share

#: Matchers whose errors are compared.
METHODS = "bm,sgbm,jplv"
#: Samples of direct light, so that the bake makes most of the noise of baked rows.
DIRECT = 64


def measured(folder: Path, reference: Path | None) -> dict[str, Any]:
    """The numbers of a row about a pair, with its distance from the pair of the ``reference``."""
    pair = load_pair(folder, {})
    eyes = compute_noise_free_level(pair, "left"), compute_noise_free_level(pair, "right")
    truth = pair.pair.camera.disparity(pair.depth["left"]), pair.visible["left"]
    noise, between = judge_render_noise(*eyes, *truth, find_baked_error_level(pair)), judge_render_noise(*eyes, *truth)
    found = errors(folder, parse_methods(METHODS))
    wrong = {name: float((found.seen & ~(off <= 1)).sum() / found.seen.sum()) for name, off in found.off.items()}
    light = average_bands(pair.light["left"].radiance)
    indirect = json.loads((folder / "pair.json").read_text()).get("indirect", {})
    row = {
        "verdict": noise.verdict,
        "larger": noise.larger,
        "hidden": noise.hidden,
        "between": between.hidden,
        "baked": indirect.get("noise_of_image"),
        "wrong": wrong,
        "light": light,
    }
    if reference is not None:
        true = measured(reference, None)
        best = compute_noise_free_level(pair, "left", true["light"] - light)
        row |= {
            "true": measure_hidden_share(eyes[0] - best, best, truth[1]),
            "distance": float(np.sqrt(np.mean((light - true["light"]) ** 2)) / true["light"].mean()),
            "bias": float(light.mean() / true["light"].mean() - 1),
            "changed": {name: share - true["wrong"][name] for name, share in wrong.items()},
        }
    return row


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scale(parser, 0.15)
    parser.add_argument("--suns", type=float, nargs="+", default=[24.0, 8.0], help="elevations of the Sun, degrees")
    parser.add_argument("--headings", type=float, nargs="+", default=[0.0], help="degrees; the Sun is at 0")
    parser.add_argument("--bakes", type=int, nargs="*", default=[4, 16, 64, 256], help="samples of baked light")
    parser.add_argument("--traced", type=int, nargs="*", default=[16, 64], help="samples of traced light")
    parser.add_argument("--converged", type=int, default=1024, help="samples of what all are compared with")


def main(options: argparse.Namespace) -> None:
    """Render and print the tables."""
    start_blender()
    with scratch() as dataset:
        print_tables(options, dataset)


def print_tables(options: argparse.Namespace, dataset: Path) -> None:
    """Render below ``dataset`` and print the tables."""
    traced = {
        f"traced {n}": {"indirect": "TRACED", "samples": n, "denoiser": "NONE"}
        for n in (*options.traced, options.converged)
    }
    baked = {
        f"baked {n}": {"indirect": "BAKED", "bake_area": "VIEW", "bake_samples": n, "direct_samples": DIRECT}
        for n in options.bakes
    }
    for sun_deg in options.suns:
        scene = make_lambert_snow(options.scale, {"light": {"sun_elevation_deg": sun_deg}})
        for heading in options.headings:
            pairs = {name: planned(scene, quality, heading) for name, quality in (baked | traced).items()}
            render_planned(list(pairs.values()), dataset)
            *names, best = pairs
            rows = {name: measured(pairs[name].folder(dataset), pairs[best].folder(dataset)) for name in names}
            print(f"Sun {sun_deg:g}°, heading {heading:g}°, against {best}:")
            for name, row in rows.items():
                print(
                    f"  {name:11} {row['verdict']:14} {row['larger'] or '':7} hidden {100 * row['hidden']:5.1f} %, "
                    f"between the eyes {100 * row['between']:5.1f} %, "
                    f"bake {'-' if row['baked'] is None else format(100 * row['baked'], '.1f'):>4} %, "
                    f"truly hidden {100 * row['true']:5.1f} %, "
                    f"distance {100 * row['distance']:5.1f} %, bias {100 * row['bias']:+5.1f} %, "
                    + ", ".join(f"{label} {100 * change:+5.1f}" for label, change in row["changed"].items())
                )
            for told in ("true", "distance"):
                order = [row[told] for row in rows.values()]
                print(
                    f"  tau with {'what is truly hidden' if told == 'true' else 'the distance'}: "
                    + ", ".join(
                        f"{what} {compute_kendall_tau_b([row[key] for row in rows.values()], order):+.2f}"
                        for what, key in (("hidden", "hidden"), ("between the eyes", "between"))
                    ),
                    flush=True,
                )
