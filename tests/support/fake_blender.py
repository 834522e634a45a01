#!/usr/bin/env python3
"""Stands for Blender in tests: does the jobs of a worker without rendering, and fails as it is told.

``behave.json`` beside this file says, by pair or for "all", "crash", "crash once", "refuse", "lie", "hang" or "sleep";
for all of them "fatal", "mute", "babble" or "hang at the end".
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path


def say(kind: str, **facts: object) -> None:
    print(json.dumps({"type": kind, **facts}), flush=True)


def camera(rig: dict[str, float]) -> dict[str, float]:
    """The calibration of a rig without margins and toe-in."""
    width, height = rig["width_px"], rig["height_px"]
    return {
        "width_px": width,
        "height_px": height,
        "baseline_m": rig["baseline_m"],
        "focal_px": rig["focal_length_mm"] / rig["sensor_width_mm"] * width,
        "cx_px": width / 2 + rig["principal_x_px"],
        "cy_px": height / 2 + rig["principal_y_px"],
    }


def main() -> None:
    here = Path(__file__).resolve().parent
    behave = json.loads((here / "behave.json").read_text())
    job = json.loads(Path(sys.argv[-1]).read_text())
    dataset = Path(job["dataset"])
    with (here / "cards").open("a") as log:
        log.write(f"{os.environ.get('ICYMOON_CARDS', 'all')}\n")
    if "mute" in behave:
        os._exit(3)
    say("progress", fraction=0.0, message="Building the scene")
    if "fatal" in behave:
        say("error", message="The disk is full.")
        os._exit(1)
    if "babble" in behave:
        for line in (
            '{"type": "pair"}',
            '{"type": ["pair"]}',
            '{"type": "pair", "id": "../x"}',
            '{"type": 7}',
            '{"type": "progress", "pair": "x", "of_pair": 1}',
            '{"type": "error", "pair": 3}',
            "{" * 9999,
        ):
            print(line, flush=True)
    for pair in job["pairs"]:
        own, shared = pair["settings"], job["shared"]
        settings = {topic: {**shared.get(topic, {}), **own.get(topic, {})} for topic in {**shared, **own}}
        name, what = pair["id"], behave.get(pair["id"], behave.get("all", ""))
        with (here / "log").open("a") as log:
            log.write(f"{name}\n")
        folder, part = dataset / "pairs" / name, dataset / "pairs" / f"{name}.fake-{os.getpid()}-1.part"
        if (folder / "pair.json").exists():
            say("pair", id=name, folder=str(folder), rendered=False, seconds=0.0)
            continue
        say("progress", fraction=0.0, message="Pair", pair=name, of_pair=0.5)
        part.mkdir(parents=True)
        if what == "crash" or (what == "crash once" and not (here / name).exists()):
            (here / name).write_text("")
            os._exit(139)
        time.sleep(1.0 if what == "sleep" else 0.0)
        while what == "hang":
            time.sleep(0.1)
        if what == "refuse":
            part.rmdir()
            say("error", message="The ground cannot be built.", pair=name)
            continue
        for eye in ("left", "right"):
            (part / f"{eye}.exr").write_bytes(b"image")
        size = 5 + (what == "lie")
        (part / "pair.json").write_text(
            json.dumps(
                {
                    "format": "icymoon-pair",
                    "version": 1,
                    "id": name,
                    "settings": settings,
                    "device": "CPU",
                    "camera": camera(settings["rig"]),
                    "seconds": {"render": 0.1},
                    "versions": {},
                    "platform": "none",
                    "peak_memory_mib": None,
                    "files": {f"{eye}.exr": {"bytes": size, "sha256": "0" * 64} for eye in ("left", "right")},
                }
            )
        )
        os.rename(part, folder)
        say("pair", id=name, folder=str(folder), rendered=True, seconds=0.1)
    say("done", folders=[])
    while "hang at the end" in behave:
        time.sleep(0.1)
    os._exit(0)


if __name__ == "__main__":
    main()
