"""The cost of a mesh and its distance from the ground that it approximates: graded, uniform grid, Cycles' dicing.

    python benchmarks graded [PRESET]

One pair of the GUISS paper's camera at one sample, with ground of the preset (terrains/rough). Each mesh is measured in
a separate process: triangles, processor seconds to build and to render (both eyes, beauty and truth), peak memory, and
the error of the left eye's depth. The error is measured on a sixteenth of the pixels, on the 20 m patch only. One
column is the distance in pixels from the hit point to the ground of the height function. The other is the error in
disparity, compared with the first crossing of ray and ground; this is found in steps of a third of a pixel, within a
tenth of the depth on both sides. Dicing displaces a 65 x 65 grid by an image of the heights with 4.9 mm per pixel; the
time to make this image is not counted. Needs Blender 5.0 or later as a module.
"""

from __future__ import annotations

import argparse
from typing import Any

import bpy
import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.own_process import call
from icymoon.benchmarks.common.processor import Stopwatch, peak_mib
from icymoon.benchmarks.common.renders import render, settings_of, start_blender
from icymoon.nodes import build_scene as scenes
from icymoon.physics.mesh.ground_interface import Surface
from icymoon.render.pairs.pair_folder import Pair, read_pair
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array

WAYS: dict[str, tuple[str, dict[str, Any]]] = {
    "graded 4 px": ("mesh", {"error_px": 4.0, "edge_px": 24.0}),
    "graded 2 px": ("mesh", {"error_px": 2.0, "edge_px": 12.0}),
    "graded 1 px": ("mesh", {"error_px": 1.0}),
    "graded 0.5 px": ("mesh", {"error_px": 0.5}),
    "grid 513": ("terrain", {"resolution": 513}),
    "grid 1025": ("terrain", {"resolution": 1025}),
    "grid 2049": ("terrain", {"resolution": 2049}),
    "dicing 4 px": ("dice", {"px": 4.0}),
    "dicing 2 px": ("dice", {"px": 2.0}),
    "dicing 1 px": ("dice", {"px": 1.0}),
}
PIXELS, IMAGE = 4, 4096


def _dice(terrain: bpy.types.Object, heights: Array, size_m: float, px: float) -> None:
    """Make Cycles dice a coarse grid and displace it by an image of heights."""
    n = len(heights)
    image = bpy.data.images.new("Heights", n, n, float_buffer=True, is_data=True)
    values = np.ones((n, n, 4), np.float32)
    values[..., :3] = heights[..., None]
    image.pixels.foreach_set(values.ravel())
    material = terrain.data.materials[0]
    nodes, links = material.node_tree.nodes, material.node_tree.links
    place, scale, lookup, push = (
        nodes.new(f"ShaderNode{k}") for k in ("NewGeometry", "VectorMath", "TexImage", "Displacement")
    )
    scale.operation = "MULTIPLY_ADD"
    scale.inputs[1].default_value, scale.inputs[2].default_value = [1 / size_m] * 3, [0.5] * 3
    lookup.image, lookup.interpolation = image, "Cubic"
    push.inputs["Midlevel"].default_value, push.inputs["Scale"].default_value = 0.0, 1.0
    links.new(place.outputs["Position"], scale.inputs[0])
    links.new(scale.outputs[0], lookup.inputs["Vector"])
    links.new(lookup.outputs["Color"], push.inputs["Height"])
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    links.new(push.outputs[0], output.inputs["Displacement"])
    material.displacement_method = "DISPLACEMENT"
    modifier = terrain.modifiers.new("Dicing", "SUBSURF")
    modifier.subdivision_type, modifier.use_adaptive_subdivision = "SIMPLE", True
    modifier.adaptive_space, modifier.adaptive_pixel_size = "PIXEL", px


def _flattened(terrain: bpy.types.Object) -> None:
    positions = np.empty(3 * len(terrain.data.vertices), np.float32)
    terrain.data.vertices.foreach_get("co", positions)
    positions[2::3] = 0.0
    terrain.data.vertices.foreach_set("co", positions)
    terrain.data.update()


def _errors(pair: Pair, ground: Surface) -> dict[str, float]:
    """Error percentiles in pixels of a pair's left depth, against the height function."""
    depth = read_view(pair.image("left")).depth[PIXELS // 2 :: PIXELS, PIXELS // 2 :: PIXELS]
    camera, pose = pair.camera, np.array(pair.data["poses_camera_to_world"]["left"])
    v, u = (np.arange(n)[PIXELS // 2 :: PIXELS] for n in (camera.height_px, camera.width_px))
    tangent = np.stack(
        np.broadcast_arrays(
            ((u + 0.5 - camera.cx_px) / camera.focal_px)[None, :],
            ((v + 0.5 - camera.cy_px) / camera.focal_px)[:, None],
            1.0,
        ),
        -1,
    )
    ray = tangent @ pose[:3, :3].T
    place = pose[:3, 3] + ray * depth[..., None]
    half = ground.size_m / 2
    seen = np.isfinite(depth) & (np.abs(place[..., :2]).max(axis=-1) < half)
    depth, ray, place, stretch = depth[seen], ray[seen], place[seen], (tangent[seen] ** 2).sum(axis=1)
    step = 1e-4
    height = ground.heights(place[:, 0], place[:, 1])
    slope = [(ground.heights(place[:, 0] + dx, place[:, 1] + dy) - height) / step for dx, dy in ((step, 0), (0, step))]
    away = np.abs(place[:, 2] - height) / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    off = away * camera.focal_px * np.sqrt(stretch) / depth
    # First crossing of the ray with the ground between 0.9 and 1.1 of the depth.
    count = int(0.2 * 3 * camera.focal_px)
    share = np.linspace(0.9, 1.1, count)
    truth = np.full(len(depth), np.nan)
    for start in range(0, len(depth), 512):
        some = slice(start, start + 512)
        z = depth[some, None] * share
        at = pose[:3, 3] + ray[some, None, :] * z[..., None]
        over = at[..., 2] - ground.heights(at[..., 0], at[..., 1])
        first = np.argmax(over < 0, axis=1)
        row = np.arange(len(z))
        ok = first > 0
        before, after = over[row, first - 1], over[row, first]
        part = np.where(ok, before / np.where(ok, before - after, 1), np.nan)
        truth[some] = z[row, first - 1] + part * (z[row, first] - z[row, first - 1])
    disparity = np.abs(camera.focal_px * camera.baseline_m * (1 / depth - 1 / truth))
    return {
        "off_p50": float(np.median(off)),
        "off_p95": float(np.quantile(off, 0.95)),
        "disp_p50": float(np.nanmedian(disparity)),
        "disp_p95": float(np.nanquantile(disparity, 0.95)),
        "missed": float(np.isnan(disparity).mean()),
    }


def measure(way: str, preset: str) -> dict[str, Any]:
    """Build and render in one way, in this process."""
    scene = start_blender()
    kind, changes = WAYS[way]
    settings = settings_of(
        (preset,),
        {"quality": {"samples": 1}},
        {"mesh": {"kind": "GRADED" if kind == "mesh" else "GRID"}},
        {kind: changes} if kind != "dice" else {"terrain": {"resolution": 65}},
    )
    ground = scenes.make_ground(settings)
    pixels = (np.arange(IMAGE) + 0.5) / IMAGE * ground.size_m - ground.size_m / 2
    baked = ground.heights(pixels[None, :], pixels[:, None], 2 * ground.size_m / IMAGE) if kind == "dice" else None
    watch = Stopwatch()
    built = scenes.build_scene(scene, settings)
    if baked is not None:
        _flattened(built.terrain)
        _dice(built.terrain, baked, ground.size_m, changes["px"])
        rig = settings.rig
        built.camera.matrix_world.translation.z = float(ground.heights(rig.x_m, rig.y_m)) + rig.height_m
    build_s = watch.lap()
    with scratch() as folder:
        made = render(built, settings, folder)
        render_s, peak = watch.lap(), peak_mib()
        mesh = built.terrain.data
        triangles = len(mesh.loops) - 2 * len(mesh.polygons)
        errors = _errors(read_pair(made[0]), ground)
    return {
        "triangles": 0 if baked is not None else triangles,
        "build": build_s,
        "render": render_s,
        "peak": peak,
        **errors,
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("preset", nargs="?", default="terrains/rough")


def main(options: argparse.Namespace) -> None:
    """Measure each variant in a separate process and print a table."""
    print(
        f"{'':>15}{'triangles':>11}{'build s':>9}{'render s':>10}{'peak MiB':>10}   surface px: 50, 95 %"
        "   disparity px: 50, 95 %, share without"
    )
    for way in WAYS:
        try:
            row = call(measure, way, options.preset)
        except RuntimeError as error:
            print(f"{way:>15}  failed: {error}")
            continue
        triangles = f"{row['triangles']:>11}" if row["triangles"] else f"{'':>11}"
        print(
            f"{way:>15}{triangles}{row['build']:>9.2f}{row['render']:>10.2f}{row['peak']:>10.0f}"
            f"{row['off_p50']:>10.3f}{row['off_p95']:>8.3f}{row['disp_p50']:>10.4f}{row['disp_p95']:>8.4f}"
            f"{row['missed']:>8.3f}",
            flush=True,
        )
