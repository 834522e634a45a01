"""The time of renders on a graphics card, and whether its images equal the processor's.

    python benchmarks graphics_card --out FOLDER [--devices CUDA processor OPTIX] [--scale 1] [--seconds 3600]

Each step is a process that renders on one device: the processor, or the first card by the interface that is named. A
step that is refused, fails or takes more than a quarter of an hour costs no other one, and FOLDER/results.json is
written after each. The study ends after ``--seconds``. The scenes at 640 x 480 px:

* first use: one small pair, for which the driver may have to compile
* snow: the paper's, with the settings of its public code (``guiss_cost``), four headings of one ground
* baked: Europa's rough ice by Lambert's law without the planet, recipe Few Headings, two headings
* many samples: the same ground traced with 256 samples
* scenes: each scene preset at a quarter of the size with 16 samples

Seconds are those of a clock: of the first pair of a process, with its build, and of each further pair; in brackets the
seconds of the renders alone. ``bake`` has the seconds of a pair's bakes. Images of the same settings and seed are
compared by the mean of all, the root mean square over a 6 x 8 grid of regions of the difference of means over the mean,
the median pixel, and the share of pixels that differ by more than 1 %. Two seeds on one device show how much of this is
noise. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from icymoon.benchmarks.common.arguments import add_scale, scratch
from icymoon.benchmarks.common.guiss_scene import snow
from icymoon.benchmarks.common.own_process import command
from icymoon.formats.exr_parts import read_pieces
from icymoon.formats.exr_pixels import Pixels
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.workers.assign_cards import BACKENDS, ENVIRONMENT
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.rendering import QualitySettings
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.trade.measure_variants import scale_view
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import IMAGE_PASS, TRUTH
from icymoon.support.system import count_processors

if TYPE_CHECKING:
    import bpy

PROCESSOR = "processor"
#: Number of headings of the snow, of the baked scene and of the scene with many samples; samples of this scene.
SNOW_HEADINGS, BAKED_HEADINGS, MANY_HEADINGS, MANY = 4, 2, 2, 256
#: Size of the scenes' images as a share of the other images' size, and their samples.
SMALL, FEW = 0.25, 16
REGIONS = (6, 8)
#: Seconds of a step: a driver took 443 for the kernels of an H200.
MAX_S = 900.0
#: Ways to render: each pair as if it were the first of its ground, and with the denoiser on the card, too.
UNKEPT, DENOISED_THERE = "nothing kept", "denoiser on the card"
ALL_IN_32_BITS: Parts = {"quality": {"files": "FULL", "half_floats": "NONE"}}


@dataclass(frozen=True)
class Step:
    """Renders in one process: a name, the device, and the settings of its pairs with their headings. ``repeat`` is
    another seed of the light paths; ``way`` one of the ways above. It is compared with the steps ``like`` and with the
    same step on other devices."""

    name: str
    device: str
    settings: Sequence[Settings]
    repeat: int = 0
    way: str = ""
    like: Sequence[str] = field(default_factory=tuple)

    @property
    def key(self) -> str:
        """The unique key of the step."""
        return ", ".join(
            each for each in (self.name, self.way, self.device, f"seed {self.repeat}" * bool(self.repeat)) if each
        )

    @property
    def folder(self) -> str:
        """The name of its data set's folder."""
        return "".join(letter if letter.isalnum() else "_" for letter in self.key)


def rough_ice(scale: float, quality: str, headings: int, *changes: Parts) -> Settings:
    """Europa's rough ice with the settings of the quality measurements, see ``qualities.py``."""
    made = description.merged(
        description.defaults(),
        preset_files.load_preset("scenes/europa_rough_ice"),
        {
            "surface": {"model": "LAMBERT"},
            "light": {"planet": False, "sun_elevation_deg": 30.0},
            "dataset": {"headings": headings},
        },
        preset_files.load_preset(f"qualities/{quality}"),
        *changes,
    )
    return scale_view(made, scale)


def scene(name: str, scale: float) -> Settings:
    """A scene preset with few samples, and Hapke's law as nodes, which graphics cards need."""
    made = description.merged(
        description.defaults(),
        preset_files.load_preset(name),
        {
            "hapke": {"backend": "NODES", "accuracy": "FAST"},
            "dataset": {"headings": 1},
            "quality": {"samples": FEW, "denoiser": "NONE", "noise_threshold": 0.0, "indirect": "TRACED"},
        },
    )
    return scale_view(made, SMALL * scale)


def steps(devices: Sequence[str], scale: float) -> list[Step]:
    """All steps on these devices, the most informative first."""
    paper = description.merged(snow(scale), {"dataset": {"headings": SNOW_HEADINGS}})
    one = description.merged(paper, {"dataset": {"headings": 1}})
    baked = rough_ice(scale, "few_headings", BAKED_HEADINGS, {"quality": {"indirect": "BAKED"}})
    many = rough_ice(scale, "standard", MANY_HEADINGS, {"quality": {"samples": MANY}})
    by_cycles = rough_ice(scale, "draft", 1, {"quality": {"truth_by": "CYCLES"}})
    needs_osl = description.merged(scene("scenes/europa_ridged_plain_hapke", scale), {"hapke": {"backend": "OSL"}})
    scenes = [scene(name, scale) for name in preset_files.preset_names("scenes")]
    first_use = rough_ice(SMALL * scale, "draft", 1)
    cards = [device for device in devices if device != PROCESSOR]
    processor = [PROCESSOR] * (PROCESSOR in devices)
    main, others = [*cards[:1], *processor], cards[1:]
    return [
        *(Step("first use", card, [first_use]) for card in cards[:1]),
        *(Step("law that needs OSL", card, [needs_osl]) for card in cards[:1]),
        *(Step("snow", device, [paper]) for device in main),
        *(Step("snow", device, [one], repeat=1, like=[f"snow, {device}"]) for device in main),
        *(Step("many samples", device, [many]) for device in main),
        *(Step("baked", device, [baked]) for device in main),
        *(Step("scenes", device, scenes) for device in main),
        *(
            Step(name, card, [settings])
            for card in others
            for name, settings in (("first use", first_use), ("snow", paper), ("many samples", many), ("baked", baked))
        ),
        *(
            Step("snow", card, [paper], way=way, like=[f"snow, {card}"])
            for card in cards[:1]
            for way in (UNKEPT, DENOISED_THERE)
        ),
        *(Step("truth by Cycles", device, [by_cycles]) for device in main),
    ]


# In a separate process, with Blender.


def render(job: dict[str, Any], told_at: str) -> None:
    """Render the pairs of a step and write the result to the file ``told_at``, pair by pair."""
    told = Path(told_at)
    start = time.perf_counter()
    import icymoon
    from icymoon.render import cycles_settings, render_pair, worker

    icymoon.register()
    if job["way"] == UNKEPT:
        render_pair.MAX_KEPT_TRIANGLES = -1
    if job["way"] == DENOISED_THERE:
        apply = cycles_settings.apply_quality

        def applied(
            scene: bpy.types.Scene, quality: QualitySettings, seed: int, blurred: bool = False, through: bool = False
        ) -> None:
            apply(scene, quality, seed, blurred, through)
            scene.cycles.denoising_use_gpu = True

        cycles_settings.apply_quality = applied
    found: dict[str, Any] = {"start_s": round(time.perf_counter() - start, 2), "pairs": [], "errors": []}

    def hear(kind: str, **facts: Any) -> None:
        if kind == "pair":
            found["pairs"].append({key: facts[key] for key in ("folder", "seconds")})
        if kind in ("error", "warning"):
            found["errors"].append(facts["message"])
        told.write_text(json.dumps(found))

    try:
        worker.run_job(job, hear)
    except IcyMoonError as error:
        hear("error", message=str(error))
    told.write_text(json.dumps(found))


# In the process that measures.


def make_step_job(step: Step, out: Path) -> dict[str, Any]:
    """The job of a step, as a worker takes it."""
    device: Parts = {"quality": {"device": "CPU" if step.device == PROCESSOR else "GPU"}}
    settings = [description.merged(each, device, ALL_IN_32_BITS) for each in step.settings]
    made: dict[str, Any] = {"dataset": str(out / step.folder), "repeat": step.repeat, "way": step.way, "again": True}
    if len(settings) == 1:
        return made | {"settings": settings[0]}
    return made | {"pairs": [{"id": expand_headings(each)[0].id, "settings": each} for each in settings]}


def run(step: Step, out: Path, most_s: float) -> dict[str, Any]:
    """Run a step for at most ``most_s`` seconds: its messages, its run time and, after a failure, the end of its
    output."""
    with scratch() as place:
        told, log, ended = (place / name for name in ("told.json", "log.txt", "ended.json"))
        environment = {key: value for key, value in os.environ.items() if key != ENVIRONMENT}
        if step.device != PROCESSOR:
            environment[ENVIRONMENT] = f"{step.device}:0"
        start = time.perf_counter()
        with log.open("wb") as stream:
            process = subprocess.Popen(
                command(render, ended, make_step_job(step, out), str(told)),
                env=environment,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                status = str(process.wait(most_s))
            except subprocess.TimeoutExpired:
                status = f"stopped after {most_s:.0f} s"
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        found: dict[str, Any] = json.loads(told.read_text()) if told.is_file() else {"pairs": [], "errors": []}
        found |= {"seconds": round(time.perf_counter() - start, 2), "status": status}
        if status != "0" or found["errors"]:
            found["log"] = log.read_text(errors="replace")[-3000:]
        for pair in found["pairs"]:
            pair |= read_time_and_device(Path(pair["folder"]), pair["seconds"])
        return found


def read_time_and_device(folder: Path, seconds: float) -> dict[str, Any]:
    """The entries of ``pair.json`` on time and device, and the wall seconds of the pair's bakes."""
    stated = json.loads((folder / "pair.json").read_text())
    took = stated["seconds"]
    bakes = {
        light["file"]: light["cpu_seconds_of_bake"] for light in stated.get("indirect", {}).get("lights", {}).values()
    }
    return {
        "took": took,
        "cpu_s": stated["cpu_seconds"]["pair"],
        "bake_cpu_s": round(sum(bakes.values()), 2),
        "bake_s": round(seconds - took["build"] - took["render"] - took["write"], 2) if bakes else 0.0,
        "device": stated["device"],
        "cards": stated.get("cards", []),
        "truth": stated.get("truth", {}),
        "indirect": {
            key: stated["indirect"][key] for key in ("method", "share", "noise", "why") if key in stated["indirect"]
        }
        if "indirect" in stated
        else {},
    }


def read_passes(folder: Path) -> dict[str, Array]:
    """All passes of a pair's left eye by name, float32 (height, channels, width)."""
    return {piece.name: Pixels(piece).decode() for piece in read_pieces((folder / "left.exr").read_bytes())}


def compare(one: Path, other: Path) -> dict[str, Any]:
    """The differences of a pair's image and truth from the same pair on another device or with another seed."""
    here, there = read_passes(one), read_passes(other)
    grey, base = (each[IMAGE_PASS][:, -3:].mean(axis=1, dtype=np.float64) for each in (here, there))
    rows, columns = (np.arange(size) * parts // size for size, parts in zip(base.shape, REGIONS, strict=True))
    region = rows[:, None] * REGIONS[1] + columns
    mean, true = (np.bincount(region.ravel(), each.ravel()) for each in (grey, base))
    lit = true > 0.01 * true.mean()
    off = np.abs(grey - base) / np.maximum(base, 0.05 * base.mean())
    truth = {
        name: float(np.mean(here[name].view(np.uint32) != there[name].view(np.uint32)))
        for name in here
        if name.startswith(f"{TRUTH}.") and name in there
    }
    depth = f"{TRUTH}.Depth"
    far = np.isfinite(there[depth]) & (there[depth] < 1e9) if depth in there else np.zeros(0, bool)
    return {
        "mean": float(grey.sum() / base.sum() - 1),
        "regions": float(np.sqrt(np.mean((mean / true - 1)[lit] ** 2))),
        "median_pixel": float(np.median(off)),
        "off_by_1_percent": float(np.mean(off > 0.01)),
        "rms": float(np.sqrt(np.mean((grey - base) ** 2)) / base.mean()),
        "same_bytes": bool((grey == base).all()),
        "truth_values_that_differ": {name: share for name, share in truth.items() if share},
        "depth_off": float(np.quantile(np.abs(here[depth] / there[depth] - 1)[far], 0.999)) if far.any() else 0.0,
    }


def compared(step: Step, done: Mapping[str, Mapping[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Comparisons of the pairs of a step with earlier steps, by the keys of these."""
    alike = [f"{step.name}, {device}" for device in (*BACKENDS, PROCESSOR) if not (step.way or step.repeat)]
    keys = [key for key in done if key != step.key and key in (*step.like, *alike)]
    made: dict[str, list[dict[str, Any]]] = {}
    for key in keys:
        there = {describe_content(pair): pair["folder"] for pair in done[key]["pairs"]}
        made[key] = [
            {"scene": describe_content(pair), **compare(Path(pair["folder"]), Path(there[describe_content(pair)]))}
            for pair in done[step.key]["pairs"]
            if describe_content(pair) in there
        ]
    return made


def describe_content(pair: Mapping[str, Any]) -> str:
    """The content of a pair, independent of its renderer: its ground, its place and its heading."""
    stated = json.loads((Path(pair["folder"]) / "pair.json").read_text())
    settings = stated["settings"]
    return json.dumps(
        [
            settings["terrain"],
            settings["surface"],
            settings["rocks"],
            settings["light"],
            settings["rig"],
            stated["poses_camera_to_world"],
        ],
        sort_keys=True,
    )


def machine() -> dict[str, Any]:
    """The processor, and the report of an NVIDIA card's driver."""
    try:
        card = subprocess.run(
            ["nvidia-smi", "--query-gpu=name,driver_version,memory.total,memory.used", "--format=csv,noheader"],
            capture_output=True,
            text=True,
            timeout=30,
            check=True,
        ).stdout
    except (OSError, subprocess.SubprocessError) as error:
        card = f"none known ({error})"
    model = next(
        (
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        platform.processor(),
    )
    return {"processor": model, "processors": count_processors(), "card": card.strip()}


def format_row(step: Step, found: Mapping[str, Any]) -> str:
    """A line of the table."""
    pairs = found["pairs"]
    if not pairs:
        why = (found["errors"] or [f"status {found['status']}, see results.json"])[-1]
        return f"{step.key:40} {why}"

    def told(some: Sequence[Mapping[str, Any]]) -> str:
        return (
            (
                f"{np.mean([pair['seconds'] for pair in some]):7.2f} s "
                f"({np.mean([pair['took']['render'] for pair in some]):6.2f})"
            )
            if some
            else f"{'':18}"
        )

    bake, cpu = (np.mean([pair[key] for pair in pairs]) for key in ("bake_s", "cpu_s"))
    return (
        f"{step.key:40} {len(pairs):2} pairs: first {told(pairs[:1])}, further {told(pairs[1:])}, "
        f"bake {bake:6.2f} s, {cpu:6.1f} CPU s; process {found['seconds']:.1f} s"
        + (f", {found['status']}" if found["status"] != "0" else "")
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument(
        "--devices", nargs="*", default=["CUDA", PROCESSOR, "OPTIX"], help="interfaces of cards, and the processor"
    )
    add_scale(parser, 1.0)
    parser.add_argument("--seconds", type=float, default=3600.0, help="time for all steps")
    parser.add_argument("--only", nargs="*", default=[], help="names of steps, such as snow")


def main(options: argparse.Namespace) -> None:
    """Do the steps and print the table."""
    begin = time.perf_counter()
    out = options.out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {"machine": machine(), "scale": options.scale, "steps": {}, "compared": {}}
    print(json.dumps(results["machine"]), flush=True)
    for step in steps(options.devices, options.scale):
        left = options.seconds - (time.perf_counter() - begin)
        if options.only and step.name not in options.only:
            continue
        if left < 5.0:
            print(f"{step.key}: no time left", flush=True)
            continue
        results["steps"][step.key] = run(step, out, min(left, MAX_S))
        print(format_row(step, results["steps"][step.key]), flush=True)
        (out / "results.json").write_text(json.dumps(results, indent=1))
        results["compared"][step.key] = compared(step, results["steps"])
        for key, each in results["compared"][step.key].items():
            if each:
                print(
                    f"    against {key}: "
                    + ", ".join(
                        f"{name.replace('_', ' ')} {100 * max((one[name] for one in each), key=abs):.4f} %"
                        for name in ("mean", "regions", "median_pixel", "off_by_1_percent", "rms", "depth_off")
                    )
                    + f", {sum(one['same_bytes'] for one in each)} of {len(each)} with the same bytes, truth that "
                    f"differs: {[one['truth_values_that_differ'] for one in each if one['truth_values_that_differ']]}",
                    flush=True,
                )
        (out / "results.json").write_text(json.dumps(results, indent=1))
