"""Hapke's law with all interreflections, compared with the path tracer of eradiate-mitsuba, an independent program.

    python benchmarks hapke_truth MITSUBA_PYTHON

Needs Blender as a module, and a second Python with ``pip install eradiate-mitsuba``. Both render a rough ground of flat
facets under a low Sun with 12 bounces. The output is the ratio to mitsuba's radiance: the mean, in sunlight and in
shadow. It also prints the RMS deviation of tiles of 8 x 8 pixels, which includes the noise of both.

At the reference level, with the law for one interreflection only, the mean was 0.4 % high on the bright set and shadows
were 1.1 % low on Europa's. The closure for the other interreflections assumes that their light comes from the whole
sky, but it comes from facing walls. With the law for three interreflections, the mean is 0.03 % low. Shadows are up to
0.5 % low; they are 6 % of the pixels, and their noise is about as large.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from icymoon.support.arrays import Array

if TYPE_CHECKING:
    from icymoon.nodes.build_scene import Built

SAMPLES, DEPTH = 256, 12
SETS = {
    "Europa": {"w": 0.964, "b": 0.429, "c": 0.113, "b_s0": 0.5, "h_s": 0.0016, "theta_bar_deg": 10.0},
    "bright": {"w": 0.99, "b": 0.39, "c": 1.0, "b_s0": 1.0, "h_s": 0.014, "theta_bar_deg": 6.0},
}
WAYS = {
    "nodes": {"backend": "NODES"},
    "OSL fast": {"backend": "OSL"},
    "OSL accurate": {"backend": "OSL", "accuracy": "ACCURATE"},
    "OSL reference": {"backend": "OSL", "accuracy": "REFERENCE"},
}


def render_with_mitsuba(folder: Path) -> None:
    """Render ``folder``'s scene with Mitsuba: all light, and sunlight alone. Runs in the other Python."""
    import mitsuba as mi

    scene = json.loads((folder / "scene.json").read_text())
    mi.set_variant("llvm_ad_rgb" if "llvm_ad_rgb" in mi.variants() else "scalar_rgb")
    described = {
        "type": "scene",
        "ground": {
            "type": "ply",
            "filename": str(folder / "ground.ply"),
            "face_normals": True,
            "bsdf": {"type": "twosided", "nested": {"type": "hapke", **scene["hapke"]}},
        },
        "sun": {"type": "directional", "direction": [-x for x in scene["sun"]], "irradiance": 50.26},
        "camera": {
            "type": "perspective",
            "fov": scene["fov_deg"],
            "fov_axis": "x",
            "near_clip": 0.01,
            "to_world": mi.ScalarTransform4f().check_lines(*scene["look_at"]),
            "film": {
                "type": "hdrfilm",
                "width": scene["width"],
                "height": scene["height"],
                "rfilter": {"type": "box"},
                "pixel_format": "luminance",
            },
            "sampler": {"type": "independent", "sample_count": SAMPLES},
        },
    }
    for name, depth in (("all", DEPTH), ("sunlight", 2)):
        image = mi.render(mi.load_dict({**described, "integrator": {"type": "path", "max_depth": depth}}), spp=SAMPLES)
        np.save(folder / f"{name}.npy", np.array(image)[..., 0])


def _flatten(built: Built) -> None:
    """Make the triangles flat, so that both programs have the same facets."""
    import bmesh

    shape = bmesh.new()
    shape.from_mesh(built.terrain.data)
    bmesh.ops.triangulate(shape, faces=shape.faces[:])
    shape.to_mesh(built.terrain.data)
    shape.free()
    built.terrain.data.polygons.foreach_set("use_smooth", np.zeros(len(built.terrain.data.polygons), bool))


def render_with_cycles(folder: Path, hapke: dict[str, Any], surface: dict[str, Any]) -> Array:
    """Radiance of the left eye by Cycles; leaves the scene's description in ``folder``."""
    import bpy
    from icymoon.benchmarks.common.renders import render
    from icymoon.nodes.build_scene import build_scene
    from icymoon.physics.surfaces.hapke import hapke_from_settings
    from icymoon.stereo.images.exr import read_view
    from rendering import complete, empty_scene

    settings = complete(
        {
            "terrain": {"resolution": 129, "size_m": 8.0, "rms_slope_deg": 28.0, "multifractality": 0.0},
            "surface": {"grain_amplitude_m": 0.0, **surface},
            "hapke": {**hapke, "h_function": "2002"},
            "light": {
                "sun_irradiance_wm2": 50.26,
                "sun_elevation_deg": 27.0,
                "sun_azimuth_deg": 300.0,
                "sun_angular_diameter_deg": 0.0,
            },
            "rig": {"width_px": 160, "height_px": 120, "y_m": -3.0, "height_m": 2.5, "pitch_deg": 50.0},
            "quality": {"samples": SAMPLES, "diffuse_bounces": DEPTH - 2},
        }
    )
    built = build_scene(empty_scene(), settings)
    _flatten(built)
    bpy.context.view_layer.update()
    (pair,) = render(built, settings, folder)
    q, camera = hapke_from_settings(settings.hapke), np.array(built.camera.matrix_world)
    (folder / "scene.json").write_text(
        json.dumps(
            {
                "hapke": {
                    "w": q.w,
                    "b": q.b,
                    "c": (1 + q.c) / 2,
                    "theta": math.degrees(q.theta_bar),
                    "B_0": q.b_s0,
                    "h": q.h_s,
                },
                "sun": list(built.sun.matrix_world.to_3x3().col[2]),
                "width": 160,
                "height": 120,
                "fov_deg": math.degrees(
                    2 * math.atan(0.5 * settings.rig.sensor_width_mm / settings.rig.focal_length_mm)
                ),
                "look_at": [camera[:3, 3].tolist(), (camera[:3, 3] - camera[:3, 2]).tolist(), camera[:3, 1].tolist()],
            }
        )
    )
    bpy.ops.object.select_all(action="DESELECT")
    built.terrain.select_set(True)
    bpy.ops.wm.ply_export(
        filepath=str(folder / "ground.ply"),
        export_selected_objects=True,
        forward_axis="Y",
        up_axis="Z",
        export_normals=False,
        export_uv=False,
        export_triangulated_mesh=True,
    )
    return np.asarray(read_view(pair / "left.exr").radiance[..., 0], np.float64)


def _blocks(image: Array) -> Array:
    return image.reshape(image.shape[0] // 8, 8, image.shape[1] // 8, 8).mean(axis=(1, 3))


def _inside(part: Array) -> Array:
    """Pixels whose neighbours within the pixel filter of Cycles belong to the same part."""
    wide = np.pad(part, 2)
    rows, columns = part.shape
    return np.all([wide[r : r + rows, c : c + columns] for r in range(5) for c in range(5)], axis=0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("python", help="the Python with eradiate-mitsuba")


def main(options: argparse.Namespace) -> None:
    """Print the ratios."""
    from icymoon.benchmarks.common.renders import start_blender
    from icymoon.physics.surfaces.surface_law import find_albedos
    from rendering import complete

    start_blender()
    for name, hapke in SETS.items():
        with tempfile.TemporaryDirectory() as path:
            folder = Path(path)
            settings = complete({"hapke": {**hapke, "h_function": "2002"}, "surface": {"model": "HAPKE"}})
            integrals = find_albedos(settings.surface, settings.hapke)
            assert integrals is not None
            images = {
                way: render_with_cycles(folder, {**hapke, **changes}, {"model": "HAPKE"})
                for way, changes in WAYS.items()
            }
            images["Lambert, same albedo"] = render_with_cycles(
                folder, hapke, {"model": "LAMBERT", "albedo": integrals.bond}
            )
            subprocess.run([options.python, __file__, str(folder)], check=True)
            truth, sunlight = (np.load(folder / f"{part}.npy") for part in ("all", "sunlight"))
        ground, lit, dark = (_inside(part) for part in (truth > 0, sunlight > 0, (truth > 0) & (sunlight == 0)))
        whole = _blocks(_inside(truth > 0).astype(float)) == 1.0
        print(
            f"{name}: light from the ground {1 - sunlight[ground].sum() / truth[ground].sum():.1%}, "
            f"in shadow {dark.mean():.1%} of the pixels"
        )
        for way, image in images.items():
            mean, sunny, shade = (image[part].sum() / truth[part].sum() for part in (ground, lit, dark))
            rms = np.sqrt(np.mean((_blocks(image)[whole] / _blocks(truth)[whole] - 1) ** 2))
            print(f"  {way:22s} mean {mean:.4f}   lit {sunny:.4f}   shadow {shade:.3f}   tiles {rms:.2%}", flush=True)


if __name__ == "__main__":  # in the other Python, which has no Icy Moon
    render_with_mitsuba(Path(sys.argv[1]))
