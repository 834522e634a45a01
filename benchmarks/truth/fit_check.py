"""The rate of false alarms on sound pairs of the check of truth against images, and its detection rate of each fault.

    python benchmarks fit_check DATASET [DATASET ...]
    python benchmarks fit_check DATASET --render 128

``--render`` renders this number of grounds of eight scenes into the data set first, in four headings each at 192 x 144
px, with Suns of 2 to 80°, views from 5 to 85° down, baselines of 5 to 60 cm and cameras 0.5 to 4 m high. Of each 32
grounds the last eight have eyes that are toed in by up to 5°. Each pair of the data sets is checked as it is, then with
its depth or disparity changed in each way that is listed. The table counts, for each kind, the pairs whose fault is
named, those for which the check only states that nothing fits, those on which the images do not decide, those that
pass, and those in which another fault is named. The right eye's truth and the mask of what it sees too are held against
the left eye's truth in the same way.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from icymoon.benchmarks.common.processor import Stopwatch
from icymoon.stereo.datasets.visibility import find_better_reading, find_fault_of_right
from icymoon.stereo.evaluated_pairs import RenderedPair, find_sources
from icymoon.stereo.images.image_values import to_grey
from icymoon.stereo.measure.fit_check import READINGS, find_common_places, find_fault, find_misfit
from icymoon.stereo.measure.prepare_pair import LoadedPair, PreparedPair, load_pair
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

SCENES = (
    "europa_rough_ice",
    "enceladus_fresh_snow",
    "europa_chaos",
    "europa_penitentes",
    "europa_ridged_plain",
    "enceladus_suncups",
    "europa_brash_ice",
    "enceladus_block_field",
)
#: Of each fault: the map that a careless writer makes of a pair, its kind, and the names that the check gives it.
Made = Callable[[PreparedPair], Array]


def _depth(pair: PreparedPair) -> Array:
    return pair.truth


def _disparity(pair: PreparedPair) -> Array:
    return pair.pair.camera.disparity(pair.truth)


def _along_ray(pair: PreparedPair) -> Array:
    camera = pair.pair.camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    return pair.truth * np.sqrt(1 + ((u - camera.cx_px) ** 2 + (v - camera.cy_px) ** 2) / camera.focal_px**2)


def _noise(pair: PreparedPair) -> Array:
    """The third component of a normal, misread as a depth."""
    slope = np.gradient(np.nan_to_num(pair.truth))[0]
    return np.where(np.isfinite(pair.truth), 1 / np.sqrt(1 + slope**2), np.nan)


FAULTS: dict[str, tuple[Made, str, str]] = {
    "sound depth": (_depth, "depth", ""),
    "sound disparity": (_disparity, "disparity", ""),
    "distance along the ray": (_along_ray, "depth", "ray"),
    "upside down": (lambda p: _depth(p)[::-1], "depth", "upside_down"),
    "mirrored": (lambda p: _depth(p)[:, ::-1], "depth", "mirrored"),
    "millimetres": (lambda p: 1000 * _depth(p), "depth", "factor"),
    "6.25 % too small": (lambda p: _depth(p) * 80 / 85.333, "depth", "factor|scale"),
    "5 % too large": (lambda p: 1.05 * _depth(p), "depth", "factor|scale"),
    "10 % too small": (lambda p: 0.9 * _depth(p), "depth", "factor|scale"),
    "16 steps per px": (lambda p: 16 * _disparity(p), "disparity", "factor"),
    "1 / depth": (lambda p: 1 / _depth(p), "depth", "inverse"),
    "disparity as depth": (_disparity, "depth", "disparity"),
    "depth as disparity": (_depth, "disparity", "depth"),
    "a normal as depth": (_noise, "depth", "nothing"),
}


#: The same of maps of the right eye, made of its depth, and of masks, made of what both eyes see.
RIGHT_FAULTS: dict[str, tuple[Callable[[LoadedPair], Array], str, str]] = {
    "sound depth": (lambda p: p.depth["right"], "depth", ""),
    "sound disparity": (lambda p: p.pair.camera.disparity(p.depth["right"]), "disparity", ""),
    "upside down": (lambda p: p.depth["right"][::-1], "depth", "upside_down"),
    "millimetres": (lambda p: 1000 * p.depth["right"], "depth", "factor"),
    "the left eye's map": (lambda p: p.depth["left"], "depth", "right_eye"),
}
MASK_FAULTS: dict[str, tuple[Callable[[Array], Array], str]] = {
    "sound": (lambda seen: seen, ""),
    "exchanged": (lambda seen: ~seen, "with seen and hidden exchanged"),
    "upside down": (lambda seen: seen[::-1], READINGS["upside_down"]),
    "mirrored": (lambda seen: seen[:, ::-1], READINGS["mirrored"]),
}


def judge_visibility(folder: Path, counts: dict[str, Counter[str]]) -> None:
    """Count the faults found in the right eye's truth and in the mask of a pair."""
    loaded = load_pair(folder, {})
    if not loaded.visible["left"].any():
        print(f"{folder.name}: the right eye sees nothing of what the left one does")
        return
    camera = loaded.pair.camera.rectified
    disparity = camera.disparity(loaded.depth["left"])
    for name, (make, kind, wanted) in RIGHT_FAULTS.items():
        fault = find_fault_of_right(make(loaded), kind, camera, disparity)
        counts[f"right eye: {name}"][_judge(fault.kind if fault else "", wanted, True)] += 1
        if not wanted and fault is not None:
            print(f"{folder.name}: right eye: {name}: {fault}")
    for name, (change, words) in MASK_FAULTS.items():
        found = find_better_reading(change(loaded.visible["left"]), disparity) or ""
        counts[f"mask: {name}"][_judge(found, words, True)] += 1
        if not words and found:
            print(f"{folder.name}: mask: {name}: {found}")


def render(dataset: Path, grounds: int) -> None:
    """Render sound pairs. A rig with an eye in the ground is left out."""
    from icymoon.benchmarks.common import renders
    from icymoon.nodes.build_scene import build_scene

    renders.start_blender()
    random = np.random.default_rng(5)
    for k in range(grounds):
        sun, pitch, base, height, samples, azimuth = random.random(6)
        settings = renders.settings_of(
            (f"scenes/{SCENES[k % len(SCENES)]}",),
            {
                "light": {"sun_elevation_deg": 2 + 78 * sun, "sun_azimuth_deg": 360 * azimuth},
                "rig": {
                    "pitch_deg": 5 + 80 * pitch,
                    "baseline_m": 0.05 * 12**base,
                    "height_m": 0.5 * 8**height,
                    "width_px": 192,
                    "height_px": 144,
                    "toe_in_deg": 0.5 + 4.5 * base if k // 8 % 4 == 3 else 0.0,
                },
                "dataset": {"seed": k, "headings": 4},
                "mesh": {"kind": "GRID"},
                "terrain": {"resolution": 257},
                "surface": {"model": "LAMBERT", "relief": "BUMP"},
                "quality": {"samples": int(4 * 4**samples), "truth": "DEPTH", "denoiser": "NONE"},
            },
        )
        try:
            renders.render(build_scene(renders.open_empty_file(), settings), settings, dataset)
        except IcyMoonError as error:
            print(f"ground {k}: {error}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--render", type=int, default=0, metavar="GROUNDS")


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    if options.render:
        render(options.datasets[0], options.render)
    counts: dict[str, Counter[str]] = {
        name: Counter()
        for name in (
            *FAULTS,
            "images exchanged",
            *(f"right eye: {name}" for name in RIGHT_FAULTS),
            *(f"mask: {name}" for name in MASK_FAULTS),
        )
    }
    seconds, pairs = 0.0, 0
    for source in find_sources(options.datasets):
        try:
            prepared = source.prepare({})
        except IcyMoonError as error:
            print(f"{source.name}: {error}")
            continue
        pairs += 1
        camera, left, right = prepared.pair.camera, to_grey(prepared.left), to_grey(prepared.right)
        watch = Stopwatch()
        places, exchanged = find_common_places(left, right), find_common_places(right, left)
        for name, (make, kind, wanted) in FAULTS.items():
            values = make(prepared)
            fault = find_fault(values, kind, camera, places) or find_misfit(values, kind, camera, places)
            counts[name][_judge(fault.kind if fault else "", wanted, places.are_enough())] += 1
            if not wanted and fault is not None:
                print(f"{source.name}: {name}: {fault}")
        fault = find_fault(prepared.truth, "depth", camera, exchanged)
        counts["images exchanged"][_judge(fault.kind if fault else "", "swapped", exchanged.are_enough())] += 1
        seconds += watch.lap()
        if isinstance(source, RenderedPair):
            judge_visibility(source.folder, counts)
    columns = ("named", "nothing fits", "another", "passes", "images do not tell")
    print(f"{pairs} pairs, {seconds / max(1, pairs):.3f} CPU s a pair for all {len(FAULTS) + 1} checks of the images")
    print(f"{'fault':32}" + "".join(f"{each:>20}" for each in columns))
    for name, found in counts.items():
        print(f"{name:32}" + "".join(f"{found[each]:20}" for each in columns))


def _judge(kind: str, wanted: str, told: bool) -> str:
    if not told:
        return "images do not tell"
    if not kind:
        return "passes"
    return "named" if kind in wanted.split("|") else "nothing fits" if kind == "nothing" else "another"
