"""A real run over a sample of the GUISS paper's data sets, and the extrapolated cost of all their pairs.

    python benchmarks paper_run --out FOLDER [--pairs 220] [--scale 0.5] [--sets snow rocks]

Whole scenes, each with its four headings, are drawn at random from the seven sets of ``datasets/guiss_all``, with the
materials and the quality of these plans: each set has its share of ``--pairs``, but at least 16 pairs. Each set is a
data set in FOLDER that ``icymoon work`` renders, so the same command continues a stopped run, and ``icymoon verify``
checks it.

A row is a set. Processor seconds are those of ``icymoon work`` and its worker, with their start, builds and bakes, a
pair; ± is the standard error over scenes. In brackets are the seconds that the pairs state, and those that a dry run
expects for the same pairs, for this machine if ``icymoon quality --measure`` has measured it. The last lines are sums
over the sets, each by the number of its pairs. Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.benchmarks.common.arguments import add_scale
from icymoon.benchmarks.common.own_process import work
from icymoon.render.cost.estimate import estimate_plan
from icymoon.render.cost.machine_speed import recall_speed
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.baked_or_traced import make_light_key
from icymoon.render.plans.plan_file import parse_plan
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.plans.render_order import order_pairs
from icymoon.settings import description

SETS = ("reconstructions", "textures", "landforms", "generative", "terrains", "rocks", "snow")
#: The set whose ground is meshes from files; the others are made up.
FROM_FILES = "reconstructions"
LEAST = 16
#: The shipped plan as it is, but for the size of its images.
PLAN = """
[plan]
title = "Sample of datasets/guiss_{name}"
extends = "datasets/guiss_{name}"

[rig]
width_px = {width}
height_px = {height}
"""


def group_by_scene(name: str, options: argparse.Namespace) -> list[list[PlannedPair]]:
    """The scenes of a set in random order; each is the pairs of a ground under one Sun."""
    text = PLAN.format(name=name, width=round(640 * options.scale), height=round(480 * options.scale))
    found: defaultdict[str, list[PlannedPair]] = defaultdict(list)
    for pair in parse_plan(Path(f"{name}.toml"), text).pairs():
        found[make_light_key(description.merged(pair.settings, {"quality": {"bake_area": "GROUND"}}))].append(pair)
    scenes = list(found.values())
    return [scenes[k] for k in np.random.default_rng(1).permutation(len(scenes))]


def render(name: str, scenes: Sequence[Sequence[PlannedPair]], out: Path) -> None:
    """Render the missing pairs of a set, and add their cost to its log."""
    dataset = out / name
    datasets.freeze_plan(dataset, order_pairs([pair for scene in scenes for pair in scene]), name)
    if not datasets.read_frozen_plan(dataset).find_missing(dataset):
        return
    start = time.perf_counter()
    spent, status = work(dataset)
    with (out / f"{name}.log").open("a", encoding="utf-8") as log:
        log.write(json.dumps({"cpu_s": spent, "wall_s": time.perf_counter() - start, "status": status}) + "\n")


def measured(name: str, scenes: Sequence[Sequence[PlannedPair]], out: Path) -> dict[str, float]:
    """The measured cost of the pairs of a set."""
    dataset = out / name
    log = [json.loads(line) for line in (out / f"{name}.log").read_text(encoding="utf-8").splitlines()]
    of_scenes, baked, facts = [], 0.0, []
    methods: Counter[str] = Counter()
    noise, share = 0.0, []
    for scene in scenes:
        bakes: dict[str, float] = {}
        spent = 0.0
        for pair in scene:
            folder = pair.folder(dataset)
            told = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
            facts.append(sum(file.stat().st_size for file in folder.iterdir()))
            spent += told["cpu_seconds"]["pair"]
            light = told.get("indirect", {"method": "TRACED"})
            methods[light["method"]] += 1
            for kept in light.get("lights", {}).values():
                bakes[kept["file"]] = kept["cpu_seconds_of_bake"]
            if "share" in light:
                noise = max(noise, light["noise"])
                share.append(light["share"])
        baked += sum(bakes.values())
        of_scenes.append((spent + sum(bakes.values())) / len(scene))
    pairs = len(facts)
    return {
        "pairs": pairs,
        "cpu_s": sum(each["cpu_s"] for each in log) / pairs,
        "error": float(np.std(of_scenes, ddof=1)) / math.sqrt(len(of_scenes)) if len(of_scenes) > 1 else math.nan,
        "stated": float(np.mean(of_scenes)),
        "bakes": baked / pairs,
        "wall_s": sum(each["wall_s"] for each in log) / pairs,
        "mb": sum(facts) / pairs / 1e6,
        "light_mb": sum(file.stat().st_size for file in (dataset / "light").glob("*")) / pairs / 1e6,
        "baked": methods["BAKED"],
        "noise": noise,
        "share": float(np.mean(share)) if share else 0.0,
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, help="folder of the data sets")
    parser.add_argument("--pairs", type=int, default=220, help="pairs of all sets, about")
    parser.add_argument("--least", type=int, default=LEAST, help="pairs of a set at least")
    add_scale(parser, 0.5)
    parser.add_argument("--sets", nargs="*", choices=SETS, default=SETS, help="sets to render")


def main(options: argparse.Namespace) -> None:
    """Render, and print the table."""
    every = {name: group_by_scene(name, options) for name in SETS}
    sizes = {name: sum(map(len, scenes)) for name, scenes in every.items()}
    total = sum(sizes.values())
    chosen = {}
    for name in options.sets:
        wanted = max(options.least, options.pairs * sizes[name] / total)
        chosen[name] = every[name][: math.ceil(wanted / len(every[name][0]))]
    rows: dict[str, dict[str, Any]] = {}
    for name, scenes in chosen.items():
        render(name, scenes, options.out)
        rows[name] = measured(name, scenes, options.out)
        row = rows[name]
        expected = estimate_plan([pair for scene in scenes for pair in scene], None, recall_speed("CPU"))
        print(
            f"{name:16} {row['pairs']:4.0f} of {sizes[name]:4} pairs, {row['baked']:4.0f} baked: "
            f"{row['cpu_s']:6.2f} ± {row['error']:.2f} CPU s a pair "
            f"({row['stated'] - row['bakes']:.2f} pairs, {row['bakes']:.2f} bakes; expected "
            f"{expected.seconds / expected.pairs:.2f} s, {expected.left_bytes / expected.pairs / 1e6:.2f} MB), "
            f"{row['wall_s']:.1f} s, {row['mb']:.2f} MB and {row['light_mb']:.2f} of light; of the light "
            f"{100 * row['share']:.1f} % is baked, noise at most {100 * row['noise']:.2f} %",
            flush=True,
        )
    for what, names in (("made-up ground", [name for name in rows if name != FROM_FILES]), ("all", list(rows))):
        pairs = sum(sizes[name] for name in names)
        hours = sum(sizes[name] * rows[name]["cpu_s"] for name in names) / 3600
        error = math.sqrt(sum((sizes[name] * rows[name]["error"]) ** 2 for name in names)) / 3600
        print(
            f"{pairs} pairs of {what}: {hours:.2f} ± {error:.2f} processor hours, "
            f"{sum(sizes[name] * (rows[name]['mb'] + rows[name]['light_mb']) for name in names) / 1e3:.1f} GB"
        )
