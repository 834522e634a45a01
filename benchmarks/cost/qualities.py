"""The cost of each quality preset and its distance from a converged render, for the presets' ``[measured]`` tables.

    python benchmarks qualities [--scale 0.25] [--reference-samples N] [--only NAME …] [--out FOLDER] [--write]

The scene is Europa's rough ice with Lambert's law and without the planet, so that light can be baked, under Suns of two
heights, seen in two headings. A preset that bakes where this saves time bakes here, as it does in a larger data set.

Each preset renders each view once, in one process for a Sun. A converged render has ``--reference-samples`` samples,
half of them in each of two renders, all bounces and no denoiser; its remaining noise is subtracted, see ``icymoon
trade``. ``bad_1`` is the share of measured pixels that are wrong by more than 1 px, and ``coverage`` the share of
pixels that both eyes see and the matcher measures. Both are differences from the converged render, mean of the
headings: a preset without error has 0. ``cpu_s`` are the processor seconds of the further pairs of a scene,
``bake_cpu_s`` those of baking their light, a pair where each bakes what it sees, and once for all where they share it.
``--write`` writes the tables to ``presets/qualities``. Renders that are in ``--out`` are not repeated. Needs Blender as
a module.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import add_out, add_scale, open_out_folder
from icymoon.render.cost.quality_variants import make_reference
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.workers.job_commands import Job, render_job
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.matchers.methods import Method, parse_methods
from icymoon.stereo.trade.measure_variants import scale_view
from icymoon.stereo.trade.quality_losses import Reference, measure_variant, read_reference

SCENE = "scenes/europa_rough_ice"
#: Settings with which the light of the scene can be baked.
LAMBERT: dict[str, Any] = {"surface": {"model": "LAMBERT"}, "light": {"planet": False}}
METHODS = "bm,sgbm,jplv"
#: Heights of the Sun, degrees, and headings, in equal steps. Under 8 degrees the site is in the shadow of the hills.
SUNS, HEADINGS = (30.0, 12.0), 2
#: The stated numbers of a matcher, with the sign of an increase in its loss.
TOLD = {"bad_1": 1.0, "coverage": -1.0}


def view(scale: float, sun_deg: float) -> Settings:
    """Complete settings of the scene under a Sun."""
    scene = description.merged(
        description.defaults(),
        preset_files.load_preset(SCENE),
        LAMBERT,
        {"light": {"sun_elevation_deg": sun_deg}, "dataset": {"headings": HEADINGS}},
    )
    return scale_view(scene, scale)


def with_quality(scene: Settings, name: str) -> Settings:
    """The scene with a quality preset, which bakes if it would bake in a larger data set."""
    settings = description.merged(scene, preset_files.load_preset(name))
    baked = settings.quality.indirect != "TRACED"
    return description.merged(settings, {"quality": {"indirect": "BAKED" if baked else "TRACED"}})


def render(settings: Settings, folder: Path, repeat: int = 0) -> list[Path]:
    """Pair folders of a scene's headings, rendered by one process."""
    return render_job(Job(folder, settings, repeat=repeat), sys.executable, lambda message: None)


def costs(folders: Sequence[Path]) -> tuple[float, float]:
    """Processor seconds per pair, without the first pair, and of baking: per pair if each pair bakes separately."""
    facts = [read_pair(folder).data for folder in folders]
    bakes = {
        light["file"]: float(light["cpu_seconds_of_bake"])
        for each in facts
        for light in each.get("indirect", {}).get("lights", {}).values()
    }
    return (
        float(np.mean([each["cpu_seconds"]["pair"] for each in facts[1:]])),
        sum(bakes.values()) / max(1, len(bakes)),
    )


def mean_of(values: Sequence[float | None]) -> float:
    """The mean of the defined values: a matcher may measure nothing at one of the headings."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else math.nan


def distances(folders: Sequence[Path], best: Sequence[Reference], methods: Sequence[Method]) -> dict[str, Any]:
    """Means over the headings of the differences from the converged renders."""
    each = [measure_variant([folder], one, methods) for folder, one in zip(folders, best, strict=True)]

    def mean(*path: str) -> float:
        values: list[float | None] = []
        for found in each:
            value: Any = found
            for key in path:
                value = value[key]
            values.append(value)
        return mean_of(values)

    return {
        "radiance_bias": mean("bias"),
        "radiance_rms": math.hypot(*(found["rmse"] for found in each)) / len(each) ** 0.5,
        **{f"{method.label}_px": mean("loss", method.label, "epe_px") for method in methods},
        **{f"{method.label}_wrong": mean("loss", method.label, "wrong_or_missing") for method in methods},
        **{
            f"{method.label}_{key}": sign * mean("loss", method.label, key)
            for method in methods
            for key, sign in TOLD.items()
        },
    }


def table_of(by_sun: Mapping[float, Mapping[str, float]], where: str, command: str) -> str:
    """The ``[measured]`` tables of a preset: means over the Suns, and a table of each Sun."""

    def mean(key: str) -> str:
        return f"{key} = {np.mean([found[key] for found in by_sun.values()]):.4f}"

    lines = [
        "[measured]",
        f'scene = "{where}"',
        f'command = "{command}"',
        *(mean(key) for key in ("cpu_s", "bake_cpu_s", "sgbm_px", "sgbm_wrong", "radiance_bias", "radiance_rms")),
    ]
    for sun, found in by_sun.items():
        lines += [
            "",
            f"[measured.sun_{sun:g}_deg]",
            *(f"{label}_{key} = {found[f'{label}_{key}']:+.4f}" for label in METHODS.split(",") for key in TOLD),
        ]
    return "\n".join(lines) + "\n"


def write(path: Path, table: str) -> None:
    """Replace a preset's ``[measured]`` by a table."""
    text = path.read_text(encoding="utf-8").split("\n[measured]\n")[0].rstrip("\n")
    path.write_text(f"{text}\n\n{table}", encoding="utf-8")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scale(parser, 1.0)
    parser.add_argument("--reference-samples", type=int, default=1024)
    parser.add_argument("--only", nargs="*", default=[], help="presets to measure, such as training")
    add_out(parser)
    parser.add_argument("--write", action="store_true")


def main(options: argparse.Namespace) -> None:
    """Measure and print the table."""
    with open_out_folder(options.out) as out:
        measure_presets(options, out)


def measure_presets(options: argparse.Namespace, out: Path) -> None:
    """Render below ``out``, print the table and, on request, write it to the presets."""
    methods = parse_methods(METHODS)
    scenes = {sun: view(options.scale, sun) for sun in SUNS}
    rig = scenes[SUNS[0]].rig
    where = (
        f"{SCENE} at {rig.width_px} x {rig.height_px} px with Lambert's law, Suns of "
        f"{' and '.join(f'{sun:g}' for sun in SUNS)} degrees, {HEADINGS} headings, against "
        f"{options.reference_samples} samples"
    )
    command = (
        f"python benchmarks qualities --scale {options.scale:g} --reference-samples {options.reference_samples} --write"
    )
    print(f"{where}; differences from the converged render:", flush=True)
    best = {}
    for sun, scene in scenes.items():
        settings = make_reference(scene, options.reference_samples).settings
        renders = [render(settings, out / "converged", repeat) for repeat in range(2)]
        best[sun] = [read_reference(pair, methods, {}) for pair in zip(*renders, strict=True)]
        print(
            f"converged, Sun {sun:g}°: noise {np.mean([one.noise for one in best[sun]]):.2%}; "
            + ", ".join(
                f"{method.label} {key} {100 * mean_of([one.stereo[method.label][key] for one in best[sun]]):.1f} %"
                for method in methods
                for key in TOLD
            ),
            flush=True,
        )
    for name in preset_files.preset_names("qualities"):
        if options.only and name.split("/")[1] not in options.only:
            continue
        by_sun: dict[float, dict[str, float]] = {}
        for sun, scene in scenes.items():
            folders = render(with_quality(scene, name), out / name.split("/")[1])
            pair_s, bake_s = costs(folders)
            found = by_sun[sun] = {"cpu_s": pair_s, "bake_cpu_s": bake_s, **distances(folders, best[sun], methods)}
            print(
                f"{name.split('/')[1]:14} Sun {sun:2g}° {pair_s:6.2f} CPU s, bake {bake_s:6.2f};"
                + "".join(
                    f" {method.label} {found[f'{method.label}_px']:+.3f} px,"
                    f" bad-1 {100 * found[f'{method.label}_bad_1']:+.2f} %,"
                    f" coverage {100 * found[f'{method.label}_coverage']:+.2f} %;"
                    for method in methods
                )
                + f" radiance {100 * found['radiance_bias']:+.2f} %, RMS {100 * found['radiance_rms']:.1f} %",
                flush=True,
            )
        if options.write:
            write(preset_files.find_preset(name), table_of(by_sun, where, command))
