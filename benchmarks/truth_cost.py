"""What the truth of a pair costs by rays, and by Cycles with lamps and surfaces, without lamps, and without both where
only depth is wanted.

    python benchmarks/truth_cost.py [--scale 0.5] [--pairs 3] [SCENE ...]

Each row is a process that renders as many pairs of a scene preset, or of the ``paper``'s snow (``guiss_cost.py``), with
one sample of radiance. The first has depth alone, which comes with the radiance; the others have the whole truth. In
the last row ``unlit.MOST_TRIANGLES_A_PIXEL`` does not count. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path

WAYS = ("depth alone", "by rays", "by Cycles, as it is lit", "lamps off", "depth without surfaces, too")
#: Where the ways of Cycles begin, each of which leaves out more.
_CYCLES = 2


def render(scene: str, way: int, options: argparse.Namespace) -> None:
    """Render in this process, and print processor seconds of the pairs."""
    import guiss_cost
    import icymoon
    from icymoon.render import unlit
    from icymoon.render.plans.planned_pair import expand_headings
    from icymoon.render.scene_source import ScenesFromSettings
    from icymoon.render.worker import render_from
    from icymoon.settings import description, preset_files
    from icymoon.settings.topics.scene import typed
    from icymoon.stereo.trade.measure_variants import scaled_view

    icymoon.register()
    for name in ("take_surfaces_off", "switch_lights_off")[: max(0, len(WAYS) - 1 - max(way, _CYCLES))]:
        setattr(unlit, name, lambda what: nullcontext())
    unlit.MOST_TRIANGLES_A_PIXEL = 10**9
    made = (
        guiss_cost.snow(options.scale)
        if scene == "paper"
        else scaled_view(
            description.merged(description.defaults(), preset_files.load_preset(f"scenes/{scene}")), options.scale
        )
    )
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
                    "dataset": {"headings": options.pairs},
                },
                "benchmark",
            ),
        )
    )
    pairs = expand_headings(settings)
    with tempfile.TemporaryDirectory() as place, ScenesFromSettings(lambda warning: None) as stage:
        render_from(stage, pairs, Path(place), lambda kind, **_: None)
        told = [json.loads((pair.folder(Path(place)) / "pair.json").read_text()) for pair in pairs]
    print(json.dumps([each["cpu_seconds"]["pair"] for each in told]))
    sys.stdout.flush()
    os._exit(0)


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    for scene in options.scenes:
        for way, name in enumerate(WAYS):
            told = subprocess.run(
                [
                    sys.executable,
                    __file__,
                    "--scale",
                    str(options.scale),
                    "--pairs",
                    str(options.pairs),
                    "--way",
                    str(way),
                    scene,
                ],
                check=True,
                capture_output=True,
            )
            first, *more = json.loads(told.stdout.decode().splitlines()[-1])
            print(
                f"{scene:22}{name:30} {first:6.2f} CPU s the first, {sum(more) / len(more):6.2f} each further pair",
                flush=True,
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*", default=["paper", "europa_rough_ice"])
    parser.add_argument("--scale", type=float, default=1.0, help="factor for the width and height of the image")
    parser.add_argument("--pairs", type=int, default=3, help="pairs of a scene, two or more")
    parser.add_argument("--way", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.way is None:
        main(given)
    else:
        render(given.scenes[0], given.way, given)
