"""The estimated costs of plans by a dry run, beside the measured costs of their renders on this machine.

    python benchmarks plan_accuracy [--only NAME …] [--out FOLDER]

First this machine is measured, as ``icymoon quality --measure`` does. Then each plan is estimated and rendered by one
worker of ``icymoon work``. A row has the expected and the taken processor seconds of all processes, with their start,
builds and bakes, and the bytes of pairs and baked light; below it are the measured parts, as the pairs state them.
Stand-ins for the paper's files, which are kept in the cache folder, are made before, in a run that is repeated.
Processor seconds depend less on other work of the machine than the time on the clock. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from icymoon.benchmarks.common.arguments import add_out, is_asked, open_out_folder
from icymoon.benchmarks.common.own_process import work
from icymoon.render.cost.estimate import estimate_plan
from icymoon.render.cost.measure_speed import measure_speed
from icymoon.render.plans import frozen_plan
from icymoon.render.plans.plan_file import parse_plan
from icymoon.render.plans.render_order import order_pairs
from icymoon.support.system import count_processors

_RIG = "[rig]\nwidth_px = {}\nheight_px = {}\n"
#: Name, the plan that is extended or the presets that are included, further lines, and the size of the images.
PLANS = {
    "paper's reconstructions": ('extends = "datasets/guiss_reconstructions"\nat_most = 8', "", (320, 240)),
    "paper's snow": ('extends = "datasets/guiss_snow"\nat_most = 8', "", (320, 240)),
    "rough ice to train on": ('include = ["scenes/europa_rough_ice", "qualities/training"]\nseeds = 8', "", (160, 120)),
    "paper's textures": ('extends = "datasets/guiss_textures"\nat_most = 8', "", (320, 240)),
    "paper's textures, glossy": (
        'extends = "datasets/guiss_textures"\ninclude = ["qualities/guiss"]\nat_most = 8',
        '[surface]\nmodel = "PRINCIPLED"\n',
        (160, 120),
    ),
    "rough ice, many headings": (
        'include = ["scenes/europa_rough_ice", "qualities/many_headings"]',
        '[surface]\nmodel = "LAMBERT"\n\n[light]\nplanet = false\n\n[[sweep]]\nkind = "panorama"\nheadings = 16\n',
        (160, 120),
    ),
}


def plan_text(name: str) -> str:
    """The text of one of ``PLANS``."""
    header, rest, size = PLANS[name]
    tables, _, sweeps = rest.partition("[[sweep]]")
    return (
        f'[plan]\ntitle = "{name}"\n{header}\n\n'
        + tables
        + "\n"
        + _RIG.format(*size)
        + (f"\n[[sweep]]{sweeps}" if sweeps else "")
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", nargs="*", default=[], help="plans whose name contains one of these")
    add_out(parser)


def main(options: argparse.Namespace) -> None:
    """Render, and print the table."""
    with open_out_folder(options.out) as out:
        print_table(out, options.only)


def print_table(out: Path, words: list[str]) -> None:
    """Render the requested plans below ``out``, and print the table."""
    speed = measure_speed(sys.executable, "CPU", out / "speed", lambda message: None)
    print(
        f"this machine: {speed.factor:.2f} of the processor seconds that are expected without a measurement, "
        f"{speed.busy:.0%} of {count_processors()} processors at work"
    )
    for name in PLANS:
        if not is_asked(name, words):
            continue
        pairs = parse_plan(out / f"{name}.toml", plan_text(name)).pairs()
        expected = estimate_plan(pairs, None, speed)
        dataset = out / "".join(letter for letter in name.replace(" ", "_") if letter.isalnum() or letter == "_")
        frozen_plan.freeze_plan(dataset, order_pairs(pairs), name)
        taken_s, status = work(dataset)
        if status:
            raise RuntimeError(f"the work on {dataset} ended with status {status}")
        folders = [pair.folder(dataset) for pair in pairs]
        taken_bytes = sum(file.stat().st_size for folder in (*folders, dataset / "light") for file in folder.glob("*"))
        facts = [json.loads((folder / "pair.json").read_text(encoding="utf-8")) for folder in folders]
        bakes = {
            light["file"]: light["cpu_seconds_of_bake"]
            for each in facts
            for light in each.get("indirect", {}).get("lights", {}).values()
        }
        pair_s = sum(each["cpu_seconds"]["pair"] for each in facts)
        print(
            f"{name:40} {len(pairs):3} pairs: {expected.seconds:7.1f} CPU s expected, {taken_s:7.1f} taken "
            f"({expected.seconds / taken_s:.2f}); {expected.left_bytes / 1e6:6.2f} MB expected, "
            f"{taken_bytes / 1e6:6.2f} taken ({expected.left_bytes / taken_bytes:.2f})\n"
            f"{'':40} pairs {pair_s:.1f} s, {len(bakes)} bakes {sum(bakes.values()):.1f} s, {expected.scenes} scenes",
            flush=True,
        )
