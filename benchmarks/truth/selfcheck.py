"""The rate of false alarms of a pair's self-check, and the faults that it finds.

    python benchmarks selfcheck plan PLAN.toml
    python -m icymoon batch PLAN.toml --out DATASET --workers 1
    python benchmarks selfcheck table DATASET [--rows ROWS]    # the table of docs/theory/metrics-details.md

Each pair is a random draw of ground, surface, Sun, toe-in, samples, denoiser and lens. All pairs are sound. Faults are
added to the data after a pair was read, so they need no renders.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.pairs.pair_folder import EYES, find_pair_folders, read_pair, read_unchanged_pair
from icymoon.settings.topics.camera import RigSettings
from icymoon.stereo.images.views import read_eye
from icymoon.stereo.measure.prepare_pair import make_self_check_eyes
from icymoon.stereo.measure.self_check import Eye, find_visibility, run_self_check
from icymoon.support.arrays import Array

#: Kinds of ground, and how many headings from each. All of the scenes and the gallery, and the paper's terrains.
GROUNDS = {
    **{
        f"scenes/{name}": 1
        for name in (
            "enceladus_block_field",
            "enceladus_fresh_snow",
            "enceladus_tiger_stripe_flank",
            "europa_chaos",
            "europa_jupitershine",
            "europa_penitentes",
            "europa_ridged_plain",
            "europa_ridged_plain_hapke",
            "europa_rough_ice",
        )
    },
    **{
        f"gallery/{name}": 1
        for name in (
            "block_field",
            "chaos_blocks",
            "fresh_snow",
            "opposition_surge",
            "penitentes",
            "ridge",
            "rugged_1_low",
            "rugged_2_medium",
            "rugged_3_high",
            "rugged_4_very_high",
            "saturn_light",
            "subsurface_ice",
        )
    },
    **{f"terrains/{name}": 2 for name in ("low_1", "medium_2", "high_1", "smooth", "very_high", "rough")},
}
HEADINGS_DEG = (0, 130)
PAIRS_PER_VIEW = 16
#: Changes of a ground's surface; "own" changes nothing. "glossy" is the paper's snow.
SURFACES: dict[str, dict[str, Any]] = {
    "own": {},
    "glossy": {
        "surface.model": "PRINCIPLED",
        "surface.roughness": 0.5,
        "surface.specular": 0.5,
        "surface.grain_size_m": 0.5,
        "surface.grain_amplitude_m": 0.03,
        "surface.albedo": 0.8,
    },
    "mirror-like": {
        "surface.model": "PRINCIPLED",
        "surface.roughness": 0.2,
        "surface.specular": 0.5,
        "surface.grain_size_m": 0.5,
        "surface.grain_amplitude_m": 0.02,
        "surface.albedo": 0.4,
    },
    "hapke": {"preset": ["surfaces/hapke_europa_global"]},
    "lambert": {
        "surface.model": "LAMBERT",
        "surface.albedo": 0.6,
        "surface.albedo_variation": 0.2,
        "surface.albedo_patch_m": 0.1,
    },
    "dark": {"preset": ["surfaces/hapke_europa_dark_lineae"]},
}
TOE_IN_DEG = (0, 0, 0, 1, 2, 4, 6, 8, 10)
SAMPLES = (4, 4, 4, 8, 8, 8, 16, 16, 32, 64)
SUN_ELEVATION_DEG = (1, 2, 4, 8, 15, 24, 40, 75)
#: Angle from the direction of view; at 0 the camera faces the Sun.
SUN_AZIMUTH_DEG = (0, 0, 0, 45, 90, 135, 180, 270)
DENOISERS = ("NONE", "NONE", "NONE", "NONE", "OIDN")
LENSES: dict[str, dict[str, Any]] = {
    "pinhole": {},
    "depth of field": {"rig.focus_distance_m": 2.0},
    "margins": {"rig.overscan": 0.1},
}
WIDTHS_PX = (160, 160, 160, 240)


def plan(path: Path) -> None:
    """Write a plan of all sound pairs."""
    random = np.random.default_rng(0)
    cases = []
    for ground, headings in GROUNDS.items():
        for heading in HEADINGS_DEG[:headings]:
            width = int(random.choice(WIDTHS_PX))
            for _ in range(PAIRS_PER_VIEW):
                cases.append(_case(ground, heading, width, random))
    text = "\n".join(
        f"  {{ {', '.join(f'{key} = {_toml(value)}' for key, value in case.items())} }}," for case in cases
    )
    path.write_text(
        '[plan]\ntitle = "Sound pairs"\ndescription = "For the rates of the self-check"\n'
        'include = ["rigs/guiss", "sensors/default"]\n\n[mesh]\nerror_px = 4.0\nedge_px = 24.0\n\n'
        f'[[sweep]]\nkind = "cases"\ncase = [\n{text}\n]\n',
        encoding="utf-8",
    )


def _case(ground: str, heading: int, width: int, random: np.random.Generator) -> dict[str, Any]:
    surface = str(random.choice(list(SURFACES), p=[0.3, 0.2, 0.1, 0.15, 0.15, 0.1]))
    lens = str(random.choice(list(LENSES), p=[0.84, 0.08, 0.08]))
    presets = [ground, *SURFACES[surface].get("preset", ())]
    return {
        "preset": presets,
        **{key: value for key, value in SURFACES[surface].items() if key != "preset"},
        **LENSES[lens],
        "rig.width_px": width,
        "rig.height_px": width * 3 // 4,
        "rig.heading_deg": heading,
        "rig.toe_in_deg": int(random.choice(TOE_IN_DEG)),
        "quality.samples": int(random.choice(SAMPLES)),
        "quality.denoiser": str(random.choice(DENOISERS)),
        "light.sun_elevation_deg": int(random.choice(SUN_ELEVATION_DEG)),
        "light.sun_azimuth_deg": int(heading + random.choice(SUN_AZIMUTH_DEG)) % 360,
    }


def _toml(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else f"{value}"


def faults(
    left: Eye, right: Eye, camera: StereoCamera, foreign: tuple[Eye, Eye] | None, positive: bool
) -> dict[str, tuple[Eye, Eye, StereoCamera]]:
    """The changes of a pair by each fault: its eyes and the stated camera."""

    def scaled(factor: float) -> StereoCamera:
        return replace(camera, baseline_m=factor * camera.baseline_m)

    sign = 1 if positive else -1
    half, row = replace(right, grey=shifted(right.grey, 0.5 * sign)), replace(right, grey=np.roll(right.grey, sign, 0))
    found = {
        "sound": (left, right, camera),
        "f·B 1 % off": (left, right, scaled(1 + 0.01 * sign)),
        "right eye half a pixel off": (left, replace(half, depth=_between(right.depth, sign)), camera),
        "right eye a row off": (left, replace(row, depth=np.roll(right.depth, sign, 0)), camera),
        "eyes swapped": (right, left, camera),
        "sign of the baseline": (left, right, scaled(-1.0)),
        "right image half a pixel off": (left, half, camera),
        "right image a row off": (left, row, camera),
        "images swapped": (replace(left, grey=right.grey), replace(right, grey=left.grey), camera),
    }
    if foreign:
        found |= {
            "depth of another pair, one eye": (left, replace(right, depth=foreign[1].depth), camera),
            "depth of another pair, both eyes": (
                replace(left, depth=foreign[0].depth),
                replace(right, depth=foreign[1].depth),
                camera,
            ),
        }
    return found


def shifted(image: Array, columns: float) -> Array:
    """The image shifted to the right by ``columns`` pixels, by cubic interpolation."""
    height, width = image.shape
    moved = cv2.warpAffine(
        image.astype(np.float64),
        np.array([[1.0, 0.0, columns], [0.0, 1.0, 0.0]]),
        (width, height),
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.maximum(moved, 0.0)


def _between(depth: Array, sign: int) -> Array:
    """The depth half a pixel beside: linear in disparity, as on a plane; NaN beside sky."""
    return 2 / (1 / depth + 1 / np.roll(depth, sign, 1))


def read_eyes(folder: Path) -> tuple[Eye, Eye, StereoCamera, dict[str, Any]]:
    """The eyes of a pair, its camera and its settings, in the form of ``stereo.measure.prepare_pair``."""
    pair = read_unchanged_pair(folder)
    left, right = make_self_check_eyes(pair, pair.settings, {eye: read_eye(pair, eye)[1] for eye in EYES})
    return left, right, pair.camera, pair.settings


def row(folder: Path, other: Path | None, positive: bool) -> dict[str, Any]:
    """The factors of a pair and the result of its self-check, sound and with every fault."""
    left, right, camera, settings = read_eyes(folder)
    found: dict[str, Any] = {}
    foreign = read_eyes(other)[:2] if other else None
    for name, (one, two, said) in faults(left, right, camera, foreign, positive).items():
        check = run_self_check(one, two, find_visibility(one, two, said), said)
        found[name] = check.to_json()
        found[name]["tells"] = check.photometric_offset_px is not None
    apart = None
    if foreign:
        both = np.isfinite(left.depth) & np.isfinite(foreign[0].depth)
        apart = float(np.median(np.abs(camera.disparity(left.depth) - camera.disparity(foreign[0].depth))[both]))
    return {
        "pair": folder.name,
        "toe-in": settings["rig"]["toe_in_deg"],
        "samples": settings["quality"]["samples"],
        "denoiser": settings["quality"]["denoiser"],
        "Sun": settings["light"]["sun_elevation_deg"],
        "from the Sun": (settings["light"]["sun_azimuth_deg"] - settings["rig"]["heading_deg"]) % 360,
        "surface": classify_surface(settings),
        "width": camera.width_px,
        "apart_px": apart,
        "lens": next(
            (
                name
                for name, lens in LENSES.items()
                if lens and all(settings["rig"][key.split(".")[1]] == value for key, value in lens.items())
            ),
            "pinhole",
        ),
        "found": found,
    }


def classify_surface(settings: dict[str, Any]) -> str:
    """The kind of surface for the table."""
    surface = settings["surface"]
    if surface["model"] == "HAPKE":
        return "Hapke, dark" if settings["hapke"]["w"] < 0.8 else "Hapke"
    if surface["model"] == "LAMBERT":
        return "Lambert"
    return "glossy snow" if surface["grain_size_m"] == 0.5 and surface["specular"] == 0.5 else "snow and ice"


def measure(dataset: Path, log: Path) -> list[dict[str, Any]]:
    """The rows of all pairs; rows in ``log`` are not measured again."""
    folders = find_pair_folders(dataset)
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()] if log.is_file() else []
    done = {each["pair"] for each in rows}
    with log.open("a", encoding="utf-8") as stream:
        for folder in [folder for folder in folders if folder.name not in done]:
            random = np.random.default_rng(int(folder.name, 16))
            rig = read_pair(folder).settings.rig
            others = [f for f in random.permutation(np.array(folders, object)) if f != folder][:40]
            other = next((f for f in others if _fits(rig, read_pair(f).settings.rig)), None)
            rows.append(row(folder, other, bool(random.random() < 0.5)))
            stream.write(json.dumps(rows[-1]) + "\n")
            stream.flush()
    return rows


def _fits(rig: RigSettings, other: dict[str, Any]) -> bool:
    """Whether another pair has the same cameras, in another position or direction."""
    same = ("width_px", "focal_length_mm", "sensor_width_mm", "baseline_m")
    return all(rig[key] == other[key] for key in same) and any(
        rig[key] != other[key] for key in ("height_m", "pitch_deg", "heading_deg")
    )


def interval(hits: int, count: int) -> tuple[float, float]:
    """The exact 95 % interval of a rate (Clopper and Pearson 1934), by bisection of the binomial distribution."""

    def root(share: Callable[[float], float]) -> float:
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if share(middle) < 0.025 else (low, middle)
        return low

    def at_least(rate: float, hits: int) -> float:
        return math.fsum(math.comb(count, k) * rate**k * (1 - rate) ** (count - k) for k in range(hits, count + 1))

    low = root(lambda rate: at_least(rate, hits)) if hits else 0.0
    high = 1 - root(lambda rate: at_least(rate, count - hits)) if hits < count else 1.0
    return low, high


def table(rows: list[dict[str, Any]]) -> None:
    """Print the rates of every fault, and of the faults that only light reveals, by every factor."""
    print(f"{len(rows)} pairs\n\n| | alarms | of | rate, 95 % interval |\n|---|---|---|---|")
    for fault in rows[0]["found"]:
        _line(fault, [not each["found"][fault]["ok"] for each in rows if fault in each["found"]])
    light = (
        "right image half a pixel off",
        "right image a row off",
        "images swapped",
        "depth of another pair, both eyes",
    )
    print(f"\n| | pairs | false alarms | {' | '.join(light)} |\n|---|---|---|{'---|' * len(light)}")
    print(_rates("all", rows, light))
    print(_rates("light can tell", [each for each in rows if each["found"]["sound"]["tells"]], light))
    for factor in ("toe-in", "samples", "denoiser", "Sun", "from the Sun", "surface", "lens", "width"):
        for value in sorted({each[factor] for each in rows}):
            print(_rates(f"{factor} {value}", [each for each in rows if each[factor] == value], light))
    for each in rows:
        if not each["found"]["sound"]["ok"]:
            print({key: value for key, value in each.items() if key != "found"}, each["found"]["sound"])


def _line(name: str, alarms: list[bool]) -> None:
    low, high = interval(sum(alarms), len(alarms))
    print(
        f"| {name} | {sum(alarms)} | {len(alarms)} | {100 * np.mean(alarms):.1f} %, {100 * low:.1f} to "
        f"{100 * high:.1f} % |"
    )


def _rates(name: str, rows: list[dict[str, Any]], names: tuple[str, ...]) -> str:
    false = sum(not each["found"]["sound"]["ok"] for each in rows)
    cells = []
    for fault in names:
        alarms = [not each["found"][fault]["ok"] for each in rows if fault in each["found"]]
        cells.append(f"{100 * np.mean(alarms):.0f} %" if alarms else "")
    return f"| {name} | {len(rows)} | {false} | {' | '.join(cells)} |"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("plan").add_argument("path", type=Path)
    of = verbs.add_parser("table")
    of.add_argument("dataset", type=Path)
    of.add_argument("--rows", type=Path, help="file that keeps finished rows, so that an interrupted run continues")


def main(options: argparse.Namespace) -> None:
    """Write the plan, or print the table of a data set."""
    if options.verb == "plan":
        plan(options.path)
    else:
        cv2.setNumThreads(1)
        table(measure(options.dataset, options.rows or options.dataset / "selfcheck.jsonl"))
