"""The cost of a pair of snow in Icy Moon and with the settings of the GUISS paper's public code, in one run.

    python benchmarks/guiss_cost.py [--ground gentle] [--scale 0.25] [--pairs N] [--reference-samples N]
        [--converged N] [--baked-pairs N] [--out FOLDER]

The snow of the paper (Ramchander Bhaskara et al., "Icy Moon Surface Simulation and Stereo Depth Estimation for Sampling
Autonomy", IEEE Aerospace Conference 2024) on ground of its terrain function, seen by its camera at 640 x 480 px. The
first row has the settings of its public code: a separate render for each eye, 16 samples, 100 bounces, subsurface
scattering, and a denoiser that cleans all its guides. Each row below changes one more setting. All rows have the same
ground and material, unless the name of a row tells otherwise. JPLV measures almost none of this ground. ``--ground
gentle`` has less than half its relief, finer triangles, and the Sun 30 degrees high at the side; there JPLV measures
two thirds.

Cost is processor seconds of all threads: ``first`` for a process that renders one pair (start, build, pair), ``more``
for each further pair of the same process. Baked light is in ``first`` whole and not in ``more``. Ratios are those of
``more``, to which baked light is added divided by each number of ``--images`` that have the ground and the Sun in
common, but not divided if it is baked only where a pair sees the ground. With ``--baked-pairs`` rows of baked light
have more headings than others, and errors are those of the headings that all rows have.

The first row renders only its two images and one depth. All others also render exact depth, normals and labels of both
eyes. SGBM, StereoBM and JPLV are compared with the exact disparity where both eyes see: coverage, mean error, share
wrong by more than 1 px, share wrong or missing. A row with more coverage includes harder pixels. So each row also shows
its increase over the first, ± a standard error (jackknife over tiles): of the mean error of the pixels that both rows
measure, and of the share wrong or missing. Radiance is compared with a render of many samples with all bounces and
subsurface scattering: the mean, and the root mean square of the difference of a pixel over the mean. With
``--converged`` the increases are not over the first row, but over Lambert snow of that many samples without a denoiser.
Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from icymoon.render.cost.variants import reference
from icymoon.render.workers import job
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.rendering import QualitySettings
from icymoon.settings.topics.scene import Settings, typed
from icymoon.stereo.trade.measure_variants import scaled_view
from icymoon.support.arrays import Array

if TYPE_CHECKING:  # a process that renders pays for no evaluator
    from icymoon.stereo.matchers.methods import Method

METHODS = "sgbm,bm,jplv"
PRESETS = ("rigs/guiss", "sensors/default", "qualities/guiss", "lights/guiss_enceladus")
#: The paper's snow: lamp, ground and material of its public code. It states no mean free path: that of millimetre snow.
SNOW: dict[str, Any] = {
    "light": {"sun_irradiance_wm2": 10.0, "sun_elevation_deg": 24.0, "sun_azimuth_deg": 0.0},
    "terrain": {
        "size_m": 20.0,
        "resolution": 258,
        "rms_slope_deg": 0.0,
        "layers": [
            {
                "basis": "VORONOI_F2",
                "fractal": "HETERO",
                "amplitude_m": 0.45,
                "scale_m": 2.0,
                "octaves": 8,
                "lacunarity": 2.0,
                "roughness": 0.574,
            }
        ],
    },
    "mesh": {"kind": "GRID"},
    "surface": {
        "model": "PRINCIPLED",
        "albedo": 0.8,
        "roughness": 0.5,
        "specular": 0.5,
        "subsurface_weight": 1.0,
        "subsurface_radius_m": 0.005,
        "grain_size_m": 0.5,
        "grain_amplitude_m": 0.02,
    },
}
#: Changes of the paper's scene by name, of ground on which SGBM, StereoBM and JPLV all measure most of the pixels.
GROUNDS: dict[str, Parts] = {
    "paper": {},
    "gentle": {
        "light": {"sun_elevation_deg": 30.0, "sun_azimuth_deg": 90.0},
        "terrain": {"layers": [SNOW["terrain"]["layers"][0] | {"amplitude_m": 0.2}]},
        "mesh": {"kind": "GRADED", "error_px": 2.0, "edge_px": 12.0},
    },
}
#: Of Cycles, where the public code differs from what Icy Moon sets; the last four are Blender's defaults.
PAPER: dict[str, Any] = {
    "max_bounces": 100,
    "glossy_bounces": 4,
    "transmission_bounces": 4,
    "transparent_max_bounces": 64,
    "sample_clamp_indirect": 5.0,
    "blur_glossy": 5.0,
    "light_sampling_threshold": 0.01,
    "use_light_tree": True,
    "denoising_prefilter": "ACCURATE",
    "sampling_pattern": "TABULATED_SOBOL",
}
CLEANED = {key: PAPER[key] for key in ("denoising_prefilter", "sampling_pattern")}
#: The row that all rows below it start from.
LAMBERT = "relief for the camera alone"
CLASSIC = {"sampling_pattern": PAPER["sampling_pattern"]}


@dataclass(frozen=True)
class Rung:
    """A row: what is changed in the settings and, for what they do not have, in Cycles."""

    name: str
    settings: Parts = field(default_factory=dict)
    cycles: Mapping[str, Any] = field(default_factory=dict)
    apart: bool = False  # each eye a render of its own, nothing kept


def ladder() -> list[Rung]:
    """The rows, each with all changes of those above it."""
    both: Parts = {"quality": {"truth_by": "CYCLES"}}
    bounces: Parts = {"quality": {**both["quality"], "diffuse_bounces": 3, "noise_threshold": 0.0}}
    solid: Parts = {**bounces, "surface": {"subsurface_weight": 0.0}}
    few: Parts = {**solid, "quality": {**bounces["quality"], "samples": 9}}
    rays: Parts = {**few, "quality": {**few["quality"], "truth_by": "RAYS"}}
    plain: Parts = {**rays, "surface": {"model": "LAMBERT"}}
    camera: Parts = {**plain, "quality": {**rays["quality"], "fine_relief": "CAMERA"}}
    return [
        Rung("paper's settings, two renders", {}, PAPER, apart=True),
        Rung("both eyes in one render, geometry kept", both, PAPER),
        Rung("3 bounces, no clamp", bounces, CLEANED),
        Rung("no subsurface scattering, same albedo", solid, CLEANED),
        Rung("the denoiser's guides not cleaned", solid, CLASSIC),
        Rung("blue noise", solid),
        Rung("9 samples", few),
        Rung("truth by rays", rays),
        Rung("Lambert, same albedo", plain),
        Rung(LAMBERT, camera),
        Rung("7 samples", _with_quality(camera, {"samples": 7})),
        *(
            Rung(
                f"light {how} by {most}, {n} direct samples",
                _with_quality(
                    camera,
                    {
                        "indirect": "BAKED",
                        "bake_area": area,
                        "bake_samples": most,
                        "bake_noise": 0.0,
                        "direct_samples": n,
                    },
                ),
            )
            for how, area, numbers in (
                ("baked", "GROUND", ((64, 2), (64, 4), (256, 2), (256, 4))),
                ("baked where seen", "VIEW", ((64, 2), (64, 4), (128, 2), (256, 2))),
            )
            for most, n in numbers
        ),
        Rung(
            "graded mesh of 4 px: finer ground",
            {**camera, "mesh": {"kind": "GRADED", "error_px": 4.0, "edge_px": 24.0}},
        ),
    ]


def _with_quality(parts: Parts, quality: dict[str, Any]) -> Parts:
    return {**parts, "quality": {**parts["quality"], **quality}}


def snow(scale: float, ground: str = "paper") -> Settings:
    """Complete settings of the scene with the paper's quality, on one of ``GROUNDS``."""
    made = description.merged(
        description.defaults(),
        *(preset_files.load_preset(p) for p in PRESETS),
        *(description.check(dict(part), "benchmark") for part in (SNOW, GROUNDS[ground])),
    )
    return scaled_view(made, scale)


# In a process of its own, with Blender.


def render(job: dict[str, Any]) -> list[dict[str, Any]]:
    """Render the pairs of a row: of each its folder, its processor seconds, and those of the process before it."""
    import icymoon
    from icymoon.render import cycles_settings, render_pair
    from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
    from icymoon.render.scene_source import ScenesFromSettings
    from icymoon.render.worker import render_from

    icymoon.register()
    rung = Rung(**job["rung"])
    apply = cycles_settings.apply

    def applied(scene: Any, quality: QualitySettings, seed: int, blurred: bool = False, through: bool = False) -> None:
        apply(scene, quality, seed, blurred, through)
        for name, value in rung.cycles.items():
            setattr(scene.cycles, name, value)

    cycles_settings.apply = applied
    apart = _Apart()
    if rung.apart:
        render_pair._render_radiance = apart.radiance
    # Each pair is built anew, so nothing has to be rotated.
    pairs = [PlannedPair(pair.id, pair.settings, 0.0) for pair in expand_headings(typed(job["settings"]))]
    with ScenesFromSettings(lambda warning: print(warning, file=sys.stderr)) as stage:
        render_from(stage, pairs, Path(job["dataset"]), lambda kind, **_: None)
    made = []
    for k, pair in enumerate(pairs):
        folder = pair.folder(Path(job["dataset"]))
        stated = json.loads((folder / "pair.json").read_text())
        cost, indirect = stated["cpu_seconds"], stated.get("indirect", {})
        # The paper's code writes neither truth nor these files.
        bake = sum(light["cpu_seconds_of_bake"] for light in indirect.get("lights", {}).values())
        made.append(
            {
                "folder": str(folder),
                "before": cost["before"],
                "bake": bake,
                "shared": pair.settings.quality.bake_area == "GROUND",
                "noise": indirect.get("noise", 0.0),
                "share": indirect.get("share", 0.0),
                "pair": apart.costs[k] if rung.apart else cost["pair"],
            }
        )
    return made


class _Apart:
    """Renders of one eye each, as the public code makes them: nothing shared, depth of the left."""

    def __init__(self) -> None:
        self.costs: list[float] = []  # processor seconds of each pair

    def radiance(self, scene: Any, built: Any, lights: Any, stem: Path, planned: Any) -> dict[str, Path]:
        """Stands in for what Icy Moon renders radiance with."""
        import bpy
        from icymoon.render import passes
        from icymoon.support.labels import BEAUTY
        from mathutils import Matrix

        start = time.process_time()
        passes.choose_layer(scene, BEAUTY, stem, "FULL")
        pose, kept = scene.camera.matrix_world.copy(), scene.render.use_persistent_data
        scene.render.use_multiview = scene.render.use_persistent_data = False
        files = {}
        for eye, shift in (("left", 0.0), ("right", scene.camera.data.stereo.interocular_distance)):
            scene.camera.matrix_world = pose @ Matrix.Translation((shift, 0.0, 0.0))
            scene.view_layers[0].use_pass_z = eye == "left"
            scene.render.filepath = str(stem.with_name(f"{stem.name}_{eye}"))
            bpy.ops.render.render(write_still=True, scene=scene.name)
            files[eye] = Path(scene.render.filepath + ".exr")
        self.costs.append(time.process_time() - start)
        scene.camera.matrix_world = pose
        scene.render.use_multiview, scene.render.use_persistent_data = True, kept
        return files


# In the evaluator's process.


def rendered(rung: Rung, settings: Settings, folder: Path) -> list[dict[str, Any]]:
    """Render a row in a process of its own."""
    with tempfile.TemporaryDirectory() as place:
        job, told = Path(place) / "job.json", Path(place) / "told.json"
        job.write_text(json.dumps({"rung": asdict(rung), "settings": settings, "dataset": str(folder)}))
        subprocess.run(
            [sys.executable, __file__, "--render", str(job), str(told)], check=True, stdout=subprocess.DEVNULL
        )
        return list(json.loads(told.read_text()))


@dataclass(frozen=True)
class Errors:
    """What matchers make of a pair: by matcher the disparity error (H, W), px, NaN where nothing is measured, and its
    sums ``stereo.trade.tally``; where both eyes see, bool (H, W)."""

    off: dict[str, Array]
    tallies: dict[str, Array]
    seen: Array


def errors(folder: Path, methods: Sequence[Method]) -> Errors:
    """Of a rendered pair, on images as its own camera exposes and reads them."""
    from icymoon.stereo.matchers import match
    from icymoon.stereo.measure.metrics import usable
    from icymoon.stereo.measure.prepare import load
    from icymoon.stereo.trade.losses import tally

    pair = load(folder, {})
    camera = pair.pair.camera
    left, right = pair.images.for_matchers()
    true = np.where(pair.visible["left"], camera.disparity(pair.depth["left"]), np.nan)
    found = {method.label: match(method.name, left, right, method.options, camera)[0] for method in methods}
    return Errors(
        {label: np.where(usable(each), np.abs(each - true), np.nan) for label, each in found.items()},
        {label: tally(each, true) for label, each in found.items()},
        np.isfinite(true),
    )


def against(pairs: Sequence[Errors], first: Sequence[Errors], label: str) -> dict[str, list[float]]:
    """How much more error a row has than the first, and its standard error: of the pixels that both measure, px, and
    of the share that is off or missing."""
    from icymoon.stereo.measure.jackknife import jackknife, tile_sums

    tiles = []
    for one, other in zip(pairs, first, strict=True):
        ours, theirs, seen = one.off[label], other.off[label], one.seen & other.seen
        both = seen & np.isfinite(ours) & np.isfinite(theirs)
        tiles.append(
            tile_sums(np.where(both, ours - theirs, 0.0), both, seen & ~(ours <= 1), seen & ~(theirs <= 1), seen)
        )
    value, doubt = jackknife(
        lambda sums: np.stack([sums[..., 0] / sums[..., 1], (sums[..., 2] - sums[..., 3]) / sums[..., 4]], axis=-1),
        np.concatenate(tiles),
    )
    return {key: [float(value[k]), float(doubt[k])] for k, key in enumerate(("epe_px", "wrong_or_missing"))}


def measured(
    pairs: Sequence[Mapping[str, Any]], found: Sequence[Errors], first: Sequence[Errors], best: Any
) -> dict[str, Any]:
    """Costs and errors of a row; ``best`` is the render of many samples of its first pair."""
    from icymoon.stereo.trade.losses import STEREO, measure, stereo_numbers

    costs = [pair["pair"] for pair in pairs]
    bake = pairs[0]["bake"]
    row: dict[str, Any] = {
        "first": pairs[0]["before"] + bake + costs[0],
        "bake": bake,
        "shared": pairs[0]["shared"],
        "more": float(np.mean(costs[1:] or costs)),
        "stereo": {
            label: dict(
                zip(
                    STEREO,
                    np.mean([stereo_numbers(each.tallies[label].sum(axis=0)) for each in found], axis=0).tolist(),
                    strict=True,
                )
            )
            for label in found[0].off
        },
        "against": {label: against(found, first, label) for label in found[0].off} if found is not first else {},
    }
    if best is not None:
        light = measure([Path(pairs[0]["folder"])], best, ())
        row |= {key: light[key] for key in ("bias", "rmse")}
    return row


def head(images: Sequence[int] = (1,)) -> str:
    """The line over ``shown``."""
    ratios = "".join(f"{'ratio' if len(images) == 1 else f'of {n}':>8}" for n in images)
    return (
        f"{'':44}{'first':>7}{'bake':>7}{'more':>7}{ratios}{'':8}{'cover':>7}{'EPE':>7}{'bad 1':>7}{'wrong':>7}"
        f"{'more EPE of both':>19}{'more wrong':>16}{'mean':>9}{'RMS':>7}"
    )


def shown(name: str, row: Mapping[str, Any], most: float, images: Sequence[int] = (1,)) -> str:
    """The lines of a row, one of each matcher; ``most`` is the cost of the first row, CPU-s a pair."""
    cost = f"{name:44}{row['first']:7.1f}{row['bake']:7.1f}{row['more']:7.2f}" + "".join(
        f"{most / (row['more'] + row['bake'] / (n if row['shared'] else 1)):8.1f}" for n in images
    )
    light = f"{100 * row['bias']:+8.2f}%{100 * row['rmse']:6.2f}%" if "bias" in row else ""
    lines = []
    for k, (label, numbers) in enumerate(row["stereo"].items()):
        text = (
            f"{cost if k == 0 else ' ' * len(cost)}{label:>8}"
            f"{100 * numbers['coverage']:6.1f}%{numbers['epe_px']:7.3f}"
            + "".join(f"{100 * numbers[key]:6.2f}%" for key in ("bad_1", "wrong_or_missing"))
        )
        if row["against"]:
            (epe, about), (wrong, give) = (row["against"][label][key] for key in ("epe_px", "wrong_or_missing"))
            text += f"{epe:+12.3f} ±{about:5.3f}{100 * wrong:+9.2f} ±{100 * give:4.2f}%"
        elif light and k == 0:
            text += f"{'':35}"
        lines.append(text + (light if k == 0 else ""))
    return "\n".join(lines)


def main(options: argparse.Namespace, out: Path) -> None:
    """Render and print the table."""
    from icymoon.stereo.matchers.methods import parse_methods
    from icymoon.stereo.trade.losses import read_reference

    methods, scene = parse_methods(METHODS), snow(options.scale, options.ground)
    rows: dict[str, Any] = {}
    first: list[Errors] = []
    print(head(options.images), flush=True)
    best = None
    if options.reference_samples:
        many = reference(scene, options.reference_samples)
        folders = [
            job.render_job(job.Job(out / "many", many.settings, repeat=k), sys.executable, lambda message: None)[0]
            for k in range(many.repeats)
        ]
        best = read_reference(folders, methods, {})
        print(
            f"{many.name}, no denoiser: {best.noise:.2%} noise, SGBM {best.stereo['sgbm']['epe_px']:.3f} px", flush=True
        )

    def render_row(rung: Rung, folder: Path) -> tuple[list[dict[str, Any]], list[Errors]]:
        baked = rung.settings.get("quality", {}).get("indirect") == "BAKED"
        settings = description.merged(
            scene,
            description.check(dict(rung.settings), "benchmark"),
            {"dataset": {"headings": options.baked_pairs if baked else options.pairs}},
        )
        pairs = rendered(rung, settings, folder)
        return pairs, [errors(Path(pair["folder"]), methods) for pair in pairs[:: len(pairs) // options.pairs]]

    if options.converged:
        rung = next(each for each in ladder() if each.name == LAMBERT)
        pairs, first = render_row(
            Rung(
                f"{rung.name}, {options.converged} samples, no denoiser",
                _with_quality(rung.settings, {"samples": options.converged, "denoiser": "NONE"}),
            ),
            out / "converged",
        )
        print(
            shown(f"converged: {options.converged} samples", measured(pairs, first, first, None), 0.0, options.images),
            flush=True,
        )
    most = 0.0
    for k, rung in enumerate(ladder()):
        if options.only and not any(word in rung.name for word in options.only):
            continue
        pairs, found = render_row(rung, out / f"rung{k}")
        first = first or found
        rows[rung.name] = row = measured(pairs, found, first, best)
        most = most or row["more"]
        print(shown(rung.name, row, most, options.images), flush=True)
    (out / "rows.json").write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--render"]:
        made = render(json.loads(Path(sys.argv[2]).read_text()))
        Path(sys.argv[3]).write_text(json.dumps(made))
        sys.stdout.flush()
        os._exit(0)
    parser = argparse.ArgumentParser()
    parser.add_argument("--scale", type=float, default=1.0, help="factor for the width and height of the image")
    parser.add_argument("--pairs", type=int, default=2, help="pairs per row, each with its own heading")
    parser.add_argument(
        "--reference-samples",
        type=int,
        default=128,
        help="samples of the render that radiance is compared with; 0: none",
    )
    parser.add_argument(
        "--converged",
        type=int,
        default=0,
        help="samples of the render whose errors others are compared with; 0: the first row's",
    )
    parser.add_argument(
        "--images",
        type=int,
        nargs="*",
        default=[36, 4, 1],
        help="numbers of images of a ground under one Sun, which share a bake",
    )
    parser.add_argument("--ground", choices=tuple(GROUNDS), default="paper")
    parser.add_argument("--only", nargs="*", default=[], help="rows whose name contains one of these")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--baked-pairs", type=int, help="pairs per row of baked light, a multiple of --pairs")
    given = parser.parse_args()
    given.baked_pairs = given.baked_pairs or given.pairs
    if given.baked_pairs % given.pairs:
        parser.error("--baked-pairs is no multiple of --pairs; give one.")
    with tempfile.TemporaryDirectory() as scratch:
        main(given, (given.out or Path(scratch)).absolute())
