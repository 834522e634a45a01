"""The cost of a data set besides sampling: memory over many scenes, other processor time, processes.

    python benchmarks/dataset.py            all three
    python benchmarks/dataset.py memory     resident memory of a process over 50 scenes with different ground and rocks
    python benchmarks/dataset.py overhead   processor time of a 64-sample pair of the GUISS paper's camera, by stage
    python benchmarks/dataset.py fresh      a data set in one worker, compared with a new Blender for each pair

Prints processor seconds of one run, on one thread. Needs Blender as a module.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.order import ordered
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.settings import description

SCENES, WARM_UP = 50, 5
SAMPLES = 64
FRESH_SCENES, FRESH_HEADINGS, FRESH_SAMPLES = 2, 4, 16


def planned(*parts: dict[str, Any]) -> PlannedPair:
    """A pair with changes, on one thread."""
    settings = description.merged(
        description.defaults(), {"quality": {"threads": 1}}, *(description.check(part, "benchmark") for part in parts)
    )
    return PlannedPair(description.digest(settings), settings, 0.0)


def resident_mib() -> float:
    """Memory of this process now."""
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError("VmRSS is missing")


def rendered(pairs: list[PlannedPair], folder: Path, after: Any = lambda: None) -> list[float]:
    """Render pairs in this process as a worker does, calling ``after`` after each; processor seconds of each."""
    from icymoon.render.scene_source import ScenesFromSettings
    from icymoon.render.worker import render_from

    taken = [time.process_time()]

    def say(kind: str, **facts: Any) -> None:
        if kind == "pair":
            taken.append(time.process_time())
            after()

    with ScenesFromSettings(lambda warning: None) as stage:
        render_from(stage, pairs, folder, say)
    return np.diff(taken).tolist()


def memory(folder: Path) -> None:
    """Slope of the resident memory over scenes, each with a pair."""
    small = {
        "rig": {"width_px": 64, "height_px": 48},
        "quality": {"samples": 1},
        "rocks": {"coverage": 0.05},
        "mesh": {"kind": "GRID"},
        "terrain": {"resolution": 257},
    }
    laws: tuple[dict[str, Any], ...] = ({}, {"surface": {"model": "HAPKE"}}, {"textures": {"set": "FROST"}})
    pairs = [planned(small, laws[k % len(laws)], {"dataset": {"seed": k}}) for k in range(SCENES)]
    resident: list[float] = []
    rendered(pairs, folder, lambda: resident.append(resident_mib()))
    slope = np.polyfit(np.arange(WARM_UP, SCENES), resident[WARM_UP:], 1)[0]
    print(
        f"memory   {SCENES} scenes: {resident[WARM_UP]:.0f} MiB after {WARM_UP}, {resident[-1]:.0f} MiB at the end, "
        f"{slope:+.2f} MiB per scene"
    )


class Ledger:
    """Processor seconds by what Cycles was last heard to do, since the last call of ``taken``."""

    #: What a status line says, by what it stands for; whatever follows the saving is this extension's own.
    LINES = (
        ("sampling", r"Sample \d+/(?!1\b)"),
        ("truth's sample", "Sample"),
        ("writing files", "Finished"),
        ("own code", "Saving"),
    )

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._now, self._since = "own code", time.process_time()

    def hear(self, status: str) -> None:
        """Take in a status line."""
        now = time.process_time()
        self._seconds[self._now] = self._seconds.get(self._now, 0.0) + now - self._since
        self._now = next((name for name, line in self.LINES if re.search(line, status)), "preparing Cycles")
        self._since = now

    def taken(self) -> dict[str, float]:
        """What was spent on what, and begin anew."""
        self.hear("Saving")
        seconds, self._seconds = self._seconds, {}
        return seconds


def overhead(folder: Path) -> None:
    """Share of the processor time of pairs that is not sampling their light: the first of a scene, and the next."""
    import bpy

    ledger, spent = Ledger(), []
    # Persistent, since every scene is built in a new file.
    bpy.app.handlers.render_stats.append(bpy.app.handlers.persistent(lambda *a: ledger.hear(str(a[0]))))
    pairs = [planned({"quality": {"samples": SAMPLES}, "rig": {"heading_deg": h}}) for h in (0.0, 90.0)]
    rendered(pairs, folder, lambda: spent.append(ledger.taken()))
    for name, seconds in zip(("first", "next"), spent, strict=True):
        total = sum(seconds.values())
        print(
            f"overhead {name:5} pair of a scene, {SAMPLES} samples: {total:.1f} CPU s, of which "
            f"{100 * (1 - seconds['sampling'] / total):.1f} % are not sampling: "
            + ", ".join(f"{part} {seconds[part]:.2f} s" for part in sorted(seconds) if part != "sampling")
        )


def fresh(folder: Path) -> None:
    """A data set in one worker, against a fresh Blender for each of its pairs; scene by scene in turn."""
    costs = {"one worker": 0.0, "fresh Blenders": 0.0}
    for seed in range(FRESH_SCENES):
        pairs = [
            planned(
                {
                    "quality": {"samples": FRESH_SAMPLES},
                    "dataset": {"seed": seed},
                    "rig": {"heading_deg": 30.0 * k, "width_px": 160, "height_px": 120},
                }
            )
            for k in range(FRESH_HEADINGS)
        ]
        for name, sets in (("one worker", [pairs]), ("fresh Blenders", [[pair] for pair in pairs])):
            before = os.times()
            for k, some in enumerate(sets):
                dataset = folder / name.split()[0] / f"{seed}_{k}"
                datasets.freeze_plan(dataset, ordered(some), "benchmark")
                subprocess.run(
                    [sys.executable, "-m", "icymoon", "work", str(dataset), "--threads-per-worker", "1", "--json"],
                    check=True,
                    stdout=subprocess.DEVNULL,
                )
            now = os.times()
            costs[name] += now.children_user + now.children_system - before.children_user - before.children_system
    for name, seconds in costs.items():
        print(
            f"fresh    {FRESH_SCENES} scenes of {FRESH_HEADINGS} pairs, 160 x 120, {FRESH_SAMPLES} samples, {name}: "
            f"{seconds:.1f} CPU s"
        )
    print(f"fresh    ratio {costs['fresh Blenders'] / costs['one worker']:.2f}")


PARTS = {"memory": memory, "overhead": overhead, "fresh": fresh}


def main() -> None:
    """Measure each part in a process of its own."""
    if len(sys.argv) < 2:
        for name in PARTS:
            subprocess.run([sys.executable, __file__, name], check=True)
        return
    if sys.argv[1] != "fresh":
        import icymoon

        icymoon.register()
    sys.stdout.flush()
    words = os.dup(1)
    with tempfile.TemporaryDirectory() as folder, open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)  # Cycles talks a lot
        sys.stdout = os.fdopen(words, "w")
        PARTS[sys.argv[1]](Path(folder))
        sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
