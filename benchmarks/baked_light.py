"""How much baked light differs from traced light in the mean of images, toward the Sun and away from it.

    python benchmarks/baked_light.py [--scale 0.25] [--bake-samples 16] [--samples 32] [--headings 0 180]
        [--rocks 0.1] [--planet]

The scene is that of guiss_cost.py, with relief for the camera alone and a Lambert surface. A row is a pair: the share
of its light that is baked, by how much that differs from traced indirect light, and the difference over all light of
the pair, with ``--rocks`` also over the pixels of rocks alone, with ``--planet`` over each light group. Needs Blender
as a module.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from guiss_cost import LAMBERT, ladder, snow
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.settings.description import check, merged
from icymoon.settings.topics.scene import Settings

#: A full planet behind the camera that looks toward the Sun.
PLANET: dict[str, Any] = {"planet_elevation_deg": 40.0, "planet_azimuth_deg": 180.0}


def planned(settings: Settings, quality: dict[str, Any], heading_deg: float) -> PlannedPair:
    """A pair with this quality and heading."""
    part = {"quality": {"bake_noise": 0.0, "truth": "SEMANTIC", **quality}, "rig": {"heading_deg": heading_deg}}
    (pair,) = expand_headings(merged(settings, check(part, "benchmark")))
    return PlannedPair(pair.id, pair.settings, 0.0)


def means_of(pair: PlannedPair, dataset: Path) -> dict[str, float]:
    """The mean radiance of both eyes, W/(m² sr): of all light, of the pixels of rocks and of each light group."""
    from icymoon.stereo.images.exr import read_view
    from icymoon.support.labels import ROCK

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


def main(options: argparse.Namespace, dataset: Path) -> None:
    """Render and print the table."""
    import icymoon
    from icymoon.render.scene_source import ScenesFromSettings
    from icymoon.render.worker import render_from

    icymoon.register()
    rung = next(each for each in ladder() if each.name == LAMBERT)
    scene = merged(
        snow(options.scale),
        check(dict(rung.settings), "benchmark"),
        check(
            {
                "rocks": {"coverage": options.rocks},
                "light": {"planet": options.planet} | (PLANET if options.planet else {}),
            },
            "benchmark",
        ),
    )
    traced, baked = (
        {"indirect": "TRACED", "samples": options.samples, "denoiser": "NONE"},
        {"indirect": "BAKED", "bake_samples": options.bake_samples, "direct_samples": options.samples},
    )
    pairs = [[planned(scene, each, heading) for each in (traced, baked)] for heading in options.headings]
    with ScenesFromSettings(lambda warning: None) as stage:
        for heading, both in zip(options.headings, pairs, strict=True):
            render_from(stage, both, dataset, lambda kind, **_: None)
            of_traced, of_baked = (means_of(each, dataset) for each in both)
            true, made = of_traced["all"], of_baked["all"]
            stated = json.loads((both[1].folder(dataset) / "pair.json").read_text())["indirect"]
            off = made - true
            print(
                f"heading {heading:5.0f}°: {100 * stated['share']:.1f} % of the light is baked; it is "
                f"{100 * off / (stated['share'] * made - off):+.1f} % off, which is {100 * off / true:+.1f} % of all "
                f"light; noise {100 * stated['noise']:.1f} %"
                + "".join(
                    f"; {name} {100 * (of_baked[name] / of_traced[name] - 1):+.1f} %"
                    for name in of_traced
                    if name != "all"
                ),
                file=sys.stderr,
                flush=True,
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--scale", type=float, default=0.25, help="factor for the width and height of the image")
    parser.add_argument("--bake-samples", type=int, default=16, help="samples of baked light")
    parser.add_argument("--samples", type=int, default=32, help="samples of direct and of traced light")
    parser.add_argument("--headings", type=float, nargs="*", default=[0.0, 180.0], help="degrees; the Sun is at 0")
    parser.add_argument("--rocks", type=float, default=0.0, help="share of the ground under rocks")
    parser.add_argument("--planet", action="store_true", help="light of a planet too")
    with tempfile.TemporaryDirectory() as folder:
        main(parser.parse_args(), Path(folder))
        sys.stdout.flush()
    os._exit(0)
