"""The cost of building a trench, and the accuracy of its volume: processor seconds, and shares of the truth.

    python benchmarks excavation                 both tables
    python benchmarks excavation volumes         the second alone, without Blender

The first table builds the workspace scene as it is, with an untouched patch, and with a trench in its states, one after
the other in one process: ratios are to the scene without an excavation. The second digs random trenches in level and
rolling ground, and compares with prisms, arcs and cones. Needs Blender as a module for the first.
"""

from __future__ import annotations

import argparse
import math
from functools import partial
from typing import Any

import numpy as np
from icymoon.benchmarks.common.processor import Stopwatch, seconds_of
from icymoon.physics.excavation.dig import ExcavationSeries
from icymoon.physics.excavation.dig_grid import make_covering_grid
from icymoon.physics.excavation.dig_site import make_site
from icymoon.physics.excavation.heap import cone_size_m
from icymoon.physics.gravity.slide_to_repose import GroundLayers, relax_slopes
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings

TRENCHES, SEED = 200, 22
BASE = "scenes/europa_rough_ice"
DUG: dict[str, Any] = {"path": "LINE", "states": 4, "bite_m": 0.04, "start_y_m": 2.0}


def settings_of(excavation: dict[str, Any]) -> Settings:
    """Complete settings of Europa with an excavation."""
    return description.merged(
        description.defaults(), description.check({"excavation": excavation, "light": {"body": "EUROPA"}}, "benchmark")
    )


def dig(excavation: dict[str, Any], rolling_m: float = 0.0) -> ExcavationSeries:
    """The series of an excavation, in level ground or with waves of ``rolling_m`` metres."""
    settings = settings_of(excavation)
    site = make_site(settings)
    x, y = site.grid.east_m[None, :], site.grid.north_m[:, None]
    return ExcavationSeries(site, settings.excavation, SEED, rolling_m * (np.sin(7.0 * x + 1.0) + np.cos(5.0 * y)))


def draw_trench(random: np.random.Generator) -> dict[str, Any]:
    """Settings of a trench of any shape, strength and heap."""
    return {
        "path": str(random.choice(["LINE", "ARC"])),
        "states": 3,
        "cell_m": 0.01,
        "heading_deg": float(random.uniform(-180, 180)),
        "length_m": float(random.uniform(0.1, 0.4)),
        "width_m": float(random.uniform(0.05, 0.2)),
        "bite_m": float(random.uniform(0.01, 0.06)),
        "radius_m": float(random.uniform(0.15, 0.4)),
        "cohesion_pa": float(random.choice([0.0, 100.0])),
        "friction_deg": float(random.uniform(30, 45)),
        "bulking": float(random.uniform(1.0, 1.7)),
        "chips_m": float(random.uniform(0.0, 0.01)),
        "clods_m": float(random.choice([0.0, 0.01])),
        "heaped_share": float(random.uniform(0.2, 1.0)),
    }


def measure_volumes() -> None:
    """Print the error of mass of random trenches, and of the volume of shapes with a formula."""
    random = np.random.default_rng(SEED)
    errors = [dig(draw_trench(random), rolling_m=0.02).mass_error(2) for _ in range(TRENCHES)]
    print(
        f"mass, {TRENCHES} random trenches of 2 bites: largest error {max(errors):.1e}, median {np.median(errors):.1e}",
        flush=True,
    )
    plain: dict[str, Any] = {"path": "LINE", "states": 2, "bite_m": 0.1, "chips_m": 0.0, "cell_m": 0.0025}
    along = dig({**plain, "start_x_m": 0.0}).facts(1)["taken_m3"] / (0.08 * 0.3 * 0.1) - 1
    print(f"prism along the cells: {along:+.1e}")
    turned = [
        dig({**plain, "heading_deg": float(a)}).facts(1)["taken_m3"] / (0.08 * 0.3 * 0.1) - 1
        for a in random.uniform(0, 90, 40)
    ]
    print(f"prism turned, 40 angles: RMS {np.std(turned):.1e}, largest {np.abs(turned).max():.1e}")
    arc = dig({**plain, "path": "ARC", "length_m": 0.0, "radius_m": 0.25, "heading_deg": 30.0}).facts(1)["taken_m3"]
    half = math.acos(1 - 0.1 / 0.25)
    print(f"segment of a circle, turned: {arc / (0.08 * 0.25**2 * (half - math.sin(half) * math.cos(half))) - 1:+.1e}")
    grid = make_covering_grid(-0.3, -0.3, 0.3, 0.3, 0.005)
    spoil = np.zeros((grid.rows, grid.columns))
    spoil[50:71, 50:71] = 0.25
    layers, volume = GroundLayers(np.zeros_like(spoil), spoil.copy()), float(spoil.sum()) * grid.cell_m**2
    watch = Stopwatch()
    sweeps, rests = relax_slopes(layers, grid.cell_m, 38.0)
    spent = watch.lap()
    height, _ = cone_size_m(volume, 38.0)
    print(
        f"cone of a pile: height {layers.spoil.max() / height - 1:+.1%}, volume "
        f"{float(layers.spoil.sum()) * grid.cell_m**2 / volume - 1:+.1e}; {sweeps} sweeps, {spent:.2f} s, "
        f"{'at rest' if rests else 'not at rest'}"
    )
    steep = dig({**plain, "cell_m": 0.005, "cohesion_pa": 0.0, "states": 3, "bite_m": 0.05}, rolling_m=0.15)
    spent = seconds_of(partial(steep.at, 2))
    print(
        f"loose ground on waves of up to 46 degrees: {spent:.2f} s, "
        f"{'at rest' if steep.at(2).rests else 'not at rest'}, mass {steep.mass_error(2):.1e}"
    )


def measure_builds() -> None:
    """Print the processor seconds of builds, one after the other, and their ratios to that without an excavation."""
    # Volumes need no Blender.
    from icymoon.benchmarks.common.renders import settings_of, start_blender
    from icymoon.nodes.change_scene import open_empty_scene

    start_blender()
    scene = settings_of((BASE,))
    runs = {
        "first, not counted": {},
        "no excavation": {},
        "state 0": {**DUG, "state": 0},
        **{f"state {k}, after the one before": {**DUG, "state": k} for k in (1, 2, 3)},
        "state 3, cohesion 0, from nothing": {**DUG, "state": 3, "cohesion_pa": 0.0},
    }
    base = math.nan
    for name, excavation in runs.items():
        settings = description.merged(scene, description.check({"excavation": excavation}, "benchmark"))
        spent = seconds_of(partial(open_empty_scene, settings))
        base = spent if name == "no excavation" else base
        print(f"{name}: {spent:.2f} s, ratio {spent / base:.2f}", flush=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("table", nargs="?", choices=("both", "volumes"), default="both")


def main(options: argparse.Namespace) -> None:
    """Print the tables."""
    if options.table == "both":
        measure_builds()
    measure_volumes()
