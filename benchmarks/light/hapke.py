"""The cost of the surface models, and the error of Hapke's law in Cycles against the double-precision reference.

    python benchmarks hapke cost         processor seconds, divided by those of Lambert's law
    python benchmarks hapke error        percentiles of the relative error of direct sunlight
    python benchmarks hapke planet       how many directions represent a planet's lit disc
    python benchmarks hapke curve FILE   phase curves of the presets with their opposition surge, as SVG

Costs are of the samples only (64 minus 1). Each is the lowest of three rounds that alternate between
the models, so that a busy machine affects all equally. ``cost`` and ``error`` need Blender as a module.

``planet`` divides the lit disc into n x n pieces and represents each by a direction at its centre. It compares the
radiance of Europa's and Enceladus' ice, at random inclinations and views, with the integral: median, 95 % and largest
error.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.processor import seconds_of

HAPKE = {"model": "HAPKE"}
#: Without relief, so that what an image costs beside it is not counted.
IMAGE = {"set": "FROST", "height_m": 0.0}
MODELS: dict[str, tuple[dict[str, Any], ...]] = {
    "Lambert": ({"model": "LAMBERT"}, {}),
    "Lunar-Lambert": ({"model": "LUNAR_LAMBERT"}, {}),
    "Principled": ({"model": "PRINCIPLED"}, {}),
    "Principled, subsurface": ({"model": "PRINCIPLED", "subsurface_weight": 1.0}, {}),
    "Hapke OSL, fast": (HAPKE, {"backend": "OSL"}),
    "Hapke OSL, accurate": (HAPKE, {"backend": "OSL", "accuracy": "ACCURATE"}),
    "Hapke OSL, reference": (HAPKE, {"backend": "OSL", "accuracy": "REFERENCE"}),
    "Hapke nodes, rough": (HAPKE, {"backend": "NODES"}),
    "Hapke OSL, fast, image": (HAPKE, {"backend": "OSL"}, IMAGE),
    "Hapke OSL, fast, image roughens": (HAPKE, {"backend": "OSL", "theta_bar_range_deg": 20.0}, IMAGE),
    "Hapke nodes, rough, image": (HAPKE, {"backend": "NODES"}, IMAGE),
    "Hapke nodes, image roughens": (HAPKE, {"backend": "NODES", "theta_bar_range_deg": 20.0}, IMAGE),
    "Hapke nodes, smooth": (HAPKE, {"backend": "NODES", "theta_bar_deg": 0.0}),
    "Hapke nodes, smooth, no surge": (HAPKE, {"backend": "NODES", "theta_bar_deg": 0.0, "b_s0": 0.0}),
}


def _seconds(surface: dict[str, Any], hapke: dict[str, Any], textures: dict[str, Any] | None = None) -> float:
    """Processor seconds of 63 samples a pixel of an open ground under a low Sun."""
    import bpy
    from icymoon.nodes.build_scene import build_scene
    from icymoon.nodes.surface.sun_inputs import prepare_for_cycles
    from icymoon.render import cycles_settings
    from rendering import complete, empty_scene

    settings = complete(
        {
            "terrain": {"resolution": 257},
            "light": {"sun_elevation_deg": 30.0},
            "hapke": hapke,
            "textures": textures or {},
            "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "albedo": 0.7, **surface},
        }
    )
    scene = empty_scene()
    built = build_scene(scene, settings)
    spent = []
    for samples in (1, 64):
        cycles_settings.apply_quality(scene, settings.quality | {"samples": samples}, 1)
        prepare_for_cycles(scene, built.materials, built.sun, built.planetshine)
        scene.render.resolution_x, scene.render.resolution_y, scene.render.threads = 160, 120, 1
        spent.append(seconds_of(bpy.ops.render.render))
    return spent[1] - spent[0]


def cost() -> None:
    """Print costs."""
    least = {
        name: min(times)
        for name, times in zip(
            MODELS, zip(*([_seconds(*model) for model in MODELS.values()] for _ in range(3)), strict=True), strict=True
        )
    }
    for name, seconds in least.items():
        print(f"{name:32s} {seconds:7.2f} s   {seconds / least['Lambert']:5.2f}")


def error() -> None:
    """Print errors."""
    from test_hapke_render import ball, errors, picture

    scenes = {
        "plane": ({}, None),
        "sphere, phase 60": ({"light": {"sun_azimuth_deg": 120.0}}, ball),
        "grazing": (
            {
                "light": {"sun_azimuth_deg": 0.0, "sun_elevation_deg": 0.6},
                "rig": {"pitch_deg": 3.0, "focal_length_mm": 600.0, "height_m": 1.0},
            },
            None,
        ),
        "opposition": (
            {
                "light": {"sun_azimuth_deg": 180.0, "sun_elevation_deg": 45.0},
                "rig": {"pitch_deg": 45.0, "focal_length_mm": 5000.0, "sensor_width_mm": 5.0},
            },
            None,
        ),
    }
    for name, (changes, change) in scenes.items():
        for theta in (0.0, 10.0, 40.0):
            for backend in ("OSL", "NODES"):
                with tempfile.TemporaryDirectory() as folder:
                    pair, _ = picture(
                        Path(folder), changes, {"hapke": {"backend": backend, "theta_bar_deg": theta}}, change=change
                    )
                    found = errors(pair)
                print(
                    f"{name:18s} roughness {theta:3.0f} {backend:6s} median {np.median(found):.1e}   "
                    f"99.9 % {np.quantile(found, 0.999):.1e}   largest {found.max():.1e}",
                    flush=True,
                )


def planet() -> None:
    """Print the errors of a few directions."""
    from icymoon.physics.light.planetshine import Planet, make_light_rays
    from icymoon.physics.surfaces import surface_law
    from icymoon.settings import description, preset_files
    from test_hapke_render import angles

    random = np.random.default_rng(1)
    up = np.array([0.0, 0.0, 1.0])
    for name, preset, diameter, flattening in (
        ("Jupiter", "surfaces/hapke_europa_global", 12.23, 0.065),
        ("Saturn", "surfaces/hapke_enceladus_global", 29.33, 0.098),
    ):
        shown = description.merged(description.defaults(), preset_files.load_preset(preset))
        law = surface_law.make_law(shown.surface, shown.hapke)
        assert law is not None
        errors: dict[int, list[float]] = {}
        for _ in range(100):
            sun = random.normal(size=3)
            ray, brought = make_light_rays(
                Planet(
                    up, diameter, flattening, np.array([0.0, 1.0, 0.0]), sun / np.linalg.norm(sun), 50.0, 0.5, "LAMBERT"
                ),
                24,
            )
            ray, brought = ray[brought > 0], brought[brought > 0]
            normals, eyes = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in random.normal(size=(2, 40, 3)))
            for normal, eye in zip(normals, eyes, strict=True):
                # All of the disc at least 10 degrees high, and seen from as high.
                if len(ray) == 0 or (ray @ normal).min() < 0.17 or eye @ normal < 0.17:
                    continue
                truth = brought @ law(*angles(normal, ray, np.broadcast_to(eye, ray.shape)))
                for n in (1, 2, 3, 4):
                    low, high = ray[:, :2].min(axis=0), ray[:, :2].max(axis=0)
                    cell = np.minimum(((ray[:, :2] - low) / (high - low) * n).astype(int), n - 1) @ (1, n)
                    share = np.bincount(cell, brought, n * n)
                    middle = np.stack([np.bincount(cell, brought * axis, n * n) for axis in ray.T], axis=1)[share > 0]
                    middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
                    found = share[share > 0] @ law(*angles(normal, middle, np.broadcast_to(eye, middle.shape)))
                    errors.setdefault(n, []).append(float(abs(found / truth - 1)))
        for n, off in errors.items():
            print(
                f"{name:8s} {n * n:3d} directions   median {np.median(off):.2%}   95 % "
                f"{np.quantile(off, 0.95):.2%}   largest {max(off):.1%}   of {len(off)}",
                flush=True,
            )


def curve(path: Path) -> None:
    """Draw brightness over phase angle, with the last degrees before opposition in a separate chart."""
    from icymoon.physics.surfaces import photometry, surface_law
    from icymoon.settings import description, preset_files

    presets = [name for name in preset_files.preset_names("surfaces") if "hapke" in name]
    colours = (
        "#1b6ca8",
        "#3fa7d6",
        "#7a6fc2",
        "#c25b8f",
        "#8c2f39",
        "#2a9d5c",
        "#8ac926",
        "#777777",
        "#e76f51",
        "#264653",
        "#b5838d",
        "#000000",
    )
    top, panels = 1.6, ((70.0, 380.0, 8.0, "Opposition"), (480.0, 380.0, 160.0, "All phases"))
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1120 520" font-family="sans-serif" font-size="13">',
        '<rect width="1120" height="520" fill="white"/>',
    ]
    for left, width, last, title in panels:
        lines += [
            f'<text x="{left}" y="24" font-size="16">{title}</text>',
            f'<rect x="{left}" y="40" width="{width}" height="420" fill="none" stroke="#444"/>',
        ]
        for k in range(5):
            x, y = left + width * k / 4, 460 - 420 * k / 4
            lines += [
                f'<text x="{x}" y="480" text-anchor="middle">{last * k / 4:g}°</text>',
                f'<text x="{left - 8}" y="{y + 4}" text-anchor="end">{top * k / 4:g}</text>',
                f'<path d="M{left} {y}h{width}" stroke="#ddd"/>',
            ]
        phase = np.radians(last) * np.linspace(0, 1, 121) ** 2
        for name, colour in zip(presets, colours, strict=True):
            shown = description.merged(description.defaults(), preset_files.load_preset(name))
            law = surface_law.make_law(shown.surface, shown.hapke)
            assert law is not None
            bright = photometry.disc_brightness(law, phase)
            points = " ".join(
                f"{left + width * a / np.radians(last):.2f},{460 - 420 * value / top:.2f}"
                for a, value in zip(phase, bright, strict=True)
            )
            lines.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
    for k, (name, colour) in enumerate(zip(presets, colours, strict=True)):
        title = preset_files.read_preset_header(name)[0].removesuffix(" (Hapke)")
        lines += [
            f'<path d="M870 {70 + 24 * k}h24" stroke="{colour}" stroke-width="3"/>',
            f'<text x="900" y="{74 + 24 * k}">{title}</text>',
        ]
    lines += [
        '<text x="535" y="508" text-anchor="middle">Phase angle; brightness of the whole disc over that of a '
        "white Lambert disc that faces the Sun</text>",
        "</svg>",
    ]
    path.write_text("\n".join(lines), encoding="utf-8")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    measures = parser.add_subparsers(dest="measure", required=True)
    for name in ("cost", "error", "planet"):
        measures.add_parser(name)
    measures.add_parser("curve").add_argument("path", type=Path)


def main(options: argparse.Namespace) -> None:
    """Print or draw one of the measures."""
    if options.measure == "curve":
        curve(options.path)
        return
    from icymoon.benchmarks.common.renders import start_blender

    start_blender()
    {"cost": cost, "error": error, "planet": planet}[options.measure]()
