"""The cost of terrain: processor seconds per million points for every basis, landform and whole built terrain.

    python benchmarks terrain

All in one run on one thread. For comparison it also measures Python loops over ``mathutils.noise``, which is
how add-ons usually make terrain (on fewer points). ``ratio`` is how many times cheaper a line is than the
loop over hetero terrain of Voronoi F2, which the code of Bhaskara et al. 2024 runs for the ground of the
preset Medium 4. The best of three. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from icymoon.benchmarks.common.processor import measure_least_seconds
from icymoon.nodes.ground.terrain_mesh import build_mesh
from icymoon.physics.terrain.fine_detail import relief_heights_m
from icymoon.physics.terrain.landforms import MAKERS
from icymoon.physics.terrain.noise.bases_and_fractals import BASES
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import Settings
from mathutils import Vector, noise

SIZE, SIDE, OCTAVES, LOOPED = 20.0, 1000, 8, 200
AXIS = np.linspace(-SIZE / 2, SIZE / 2, SIDE)
LANDFORMS = {
    "chaos": {"relief_m": 1.0, "matrix_m": 0.1},
    "ridges": {"height_m": 0.5},
    "cracks": {"depth_m": 0.3},
    "craters": {"coverage": 0.2},
    "hollows": {"depth_m": 0.05},
    "penitentes": {"height_m": 1.0},
    "pits": {"depth_m": 0.3},
}
EIGHT = {"outer_scale_m": 8.0, "inner_scale_m": 8.0 / 2 ** (OCTAVES - 1)}


def looped(function: Callable[[Vector], float]) -> float:
    """Seconds per million points of a Python loop over a noise."""

    def work() -> None:
        for k in range(LOOPED):
            for i in range(LOOPED):
                function(Vector((0.05 * i, 0.05 * k, 0.0)))

    return measure_least_seconds(work) * (1e6 / LOOPED**2)


def settings(*parts: dict[str, Any]) -> Settings:
    """The defaults on a million vertices, with changes."""
    size = {"terrain": {"size_m": SIZE, "resolution": SIDE}}
    return description.merged(description.defaults(), size, *(description.check(p, "benchmark") for p in parts))


def fractal(multifractality: float) -> Callable[[], Any]:
    """Workload: the random surface of eight octaves, on a grid."""
    ground = make_terrain(settings({"terrain": {**EIGHT, "multifractality": multifractality}}), 1)
    return lambda: ground.heights(AXIS[None, :], AXIS[:, None])


def scattered() -> Callable[[], Any]:
    """Workload: the same surface at points in random order."""
    ground = make_terrain(settings({"terrain": EIGHT}), 1)
    x, y = np.random.default_rng(0).uniform(-SIZE / 2, SIZE / 2, (2, SIDE**2))
    return lambda: ground.heights(x, y)


def one_layer(**changes: object) -> Callable[[], Any]:
    """Workload: one layer of noise, in tiles as the ground computes it."""
    ground = make_terrain(settings({"terrain": {"rms_slope_deg": 0.0, "layers": [{"octaves": 1, **changes}]}}), 1)
    return lambda: ground.heights(AXIS[None, :], AXIS[:, None])


def built(*parts: dict[str, Any]) -> Callable[[], Any]:
    """Workload: a terrain from its settings to Blender's mesh."""
    described = settings(*parts)

    def work() -> None:
        bpy.data.meshes.remove(build_mesh("benchmark", described.terrain, make_terrain(described, 1)))

    return work


def on_a_mesh() -> Callable[[], Any]:
    """Workload: fine relief on the vertices of any mesh, a tenth of a million."""
    points = np.random.default_rng(0).uniform(-5, 5, (SIDE**2 // 10, 3))
    return lambda: relief_heights_m(points, settings({"terrain": EIGHT}), 1)


def main(options: argparse.Namespace) -> None:
    """Measure and print the table."""
    loop = looped(lambda p: noise.hetero_terrain(p, 0.8, 2.0, OCTAVES, 1.0, noise_basis="VORONOI_F2"))
    print(f"{'processor seconds per million points':<48}{'s':>8}{'ratio':>8}", flush=True)

    def row(name: str, cost: float) -> None:
        print(f"{name:<48}{cost:>8.2f}{loop / cost:>8.0f}", flush=True)

    row(f"loop: hetero terrain of Voronoi F2, {OCTAVES} octaves", loop)
    row(
        f"layer: hetero terrain of Voronoi F2, {OCTAVES} octaves",
        measure_least_seconds(one_layer(basis="VORONOI_F2", fractal="HETERO", octaves=OCTAVES, scale_m=8.0)),
    )
    row(f"loop: fractal of Perlin noise, {OCTAVES} octaves", looped(lambda p: noise.fractal(p, 0.8, 2.0, OCTAVES)))
    row(f"random surface, {OCTAVES} octaves", measure_least_seconds(fractal(0.0)))
    row(f"random surface, {OCTAVES} octaves, multifractal", measure_least_seconds(fractal(1.0)))
    row(f"random surface, {OCTAVES} octaves, scattered points", measure_least_seconds(scattered()))
    row(f"relief on a mesh, {OCTAVES} octaves", 10 * measure_least_seconds(on_a_mesh()))
    for basis in BASES:
        row(f"one octave of {basis.lower()}", measure_least_seconds(one_layer(basis=basis)))
    bare = measure_least_seconds(built())
    row("built terrain, default settings", bare)
    row("of that, the flat mesh", measure_least_seconds(built({"terrain": {"rms_slope_deg": 0.0}})))
    for topic in MAKERS:
        row(f"built terrain with {topic}", measure_least_seconds(built({topic: LANDFORMS[topic]})))
    row("built terrain with a mantle", measure_least_seconds(built({"mantle": {"thickness_m": 0.2}})))
    for name in ("medium_4", "tiger_stripe_flank"):
        row(f"built terrain, preset {name}", measure_least_seconds(built(preset_files.load_preset(f"terrains/{name}"))))
