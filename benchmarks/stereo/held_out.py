"""icynet beside other matchers on pairs that its training never showed, by classes of scenes.

    python -m icymoon batch datasets/held_out --out PAIRS
    python -m icymoon evaluate PAIRS --methods bm,sgbm,sgbm_wls,jplv,icynet --confidence own,left-right --out REPORT
    python benchmarks held_out PAIRS REPORT [--sheet FILE.jpg]

Of each scene: the share of the pixels with a true depth that are missing or wrong by more than 1 px, and in brackets
the share of SGBM's own pixels that are wrong so. "filled" is SGBM whose holes are filled smoothly from their edges.
Ratios are of the means over scenes, with the 2.5th and 97.5th percentile of 10,000 resamples of the scenes.
"""

from __future__ import annotations

import argparse
import json
import tomllib
from pathlib import Path

import cv2
import numpy as np
from icymoon.render.plans.frozen_plan import read_frozen_plan
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.ground_errors import read_depth_errors
from icymoon.stereo.images.disparity_files import read_disparity
from icymoon.stereo.measure.confidence_metrics import CONFIDENCE_METRICS
from icymoon.stereo.measure.metrics import find_wrong_share, is_usable
from icymoon.support.arrays import Array
from icymoon.support.version import ROOT

#: The classes of the plan ``datasets/held_out``, which come by turns.
CLASSES = ("ground", "landform", "body", "sun")
#: The judged matcher, and the one whose pixels are the common ones and whose holes are filled.
JUDGED, PLAIN, FILLED = "icynet", "sgbm", "filled"
#: Width in px around a hole from which it is filled.
_FILL_RADIUS_PX = 3
#: Width and height in px of a picture in the sheet.
_SHEET_PX = 320, 240


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path, help="pairs of the plan datasets/held_out")
    parser.add_argument("report", type=Path, help="folder of their evaluation")
    parser.add_argument("--sheet", type=Path, help="picture of one scene of each class, to write")


def fill_holes(disparity: Array) -> Array:
    """Fill the holes (NaN) of a disparity (H, W), px, smoothly."""
    holes = np.isnan(disparity)
    known = np.where(holes, np.float32(0), disparity)
    return np.asarray(cv2.inpaint(known, holes.astype(np.uint8), _FILL_RADIUS_PX, cv2.INPAINT_NS))


def measure_scene(pair: Path, folder: Path, methods: list[str]) -> dict[str, tuple[float, float]]:
    """The shares that are wrong or missing, and wrong on SGBM's pixels, by the matcher."""
    seen = read_depth_errors(pair, folder / f"{PLAIN}.npz")
    truth = seen.camera.focal_baseline_px_m / seen.truth
    disparities = {}
    for method in methods:
        found = read_disparity(folder / f"{method}.npz", truth.shape)
        assert found is not None, f"the disparity of {method} in {folder} is damaged"
        disparities[method] = np.where(is_usable(found), found, np.float32(np.nan))
    disparities[FILLED] = fill_holes(disparities[PLAIN])
    known = np.isfinite(truth)
    common = known & np.isfinite(disparities[PLAIN])
    return {
        method: (find_wrong_share(each, truth, known), find_wrong_share(each, truth, common))
        for method, each in disparities.items()
    }


def bound_ratio(one: Array, other: Array) -> tuple[float, float, float]:
    """The ratio of the means of two columns (scenes,), and its bounds by resampling scenes."""
    drawn = np.random.default_rng(0).integers(0, len(one), (10_000, len(one)))
    low, high = np.percentile(one[drawn].mean(axis=1) / other[drawn].mean(axis=1), (2.5, 97.5))
    return float(one.mean() / other.mean()), float(low), float(high)


def name_scenes(dataset: Path) -> list[tuple[str, str, str]]:
    """The pair's name, class and description of each scene, in the order of the plan."""
    plan = tomllib.loads((ROOT / "presets" / "datasets" / "held_out.toml").read_text("utf-8"))
    cases = plan["sweep"][0]["case"]
    found = []
    for k, (case, pair) in enumerate(zip(cases, read_frozen_plan(dataset).pairs, strict=True)):
        sun_deg = case["light"]["sun_elevation_deg"]
        assert pair.settings.light.sun_elevation_deg == sun_deg, "the data set is of another plan"
        ground = case["preset"][-1].partition("/")[2].replace("_", " ")
        found.append((pair.folder(dataset).name, CLASSES[k % len(CLASSES)], f"{ground}, {sun_deg:g}°"))
    return found


def write_sheet(folders: list[Path], file: Path) -> None:
    """Write the left image, the true depth, and the depth maps of SGBM and icynet of scenes, one in a row."""
    names = ("left", "true_depth", f"{PLAIN}_depth", f"{JUDGED}_depth", f"{JUDGED}_confidence")
    rows = [
        np.hstack([cv2.resize(cv2.imread(str(folder / f"{name}.png")), _SHEET_PX) for name in names])
        for folder in folders
    ]
    cv2.imwrite(str(file), np.vstack(rows))


def print_rows(table: Array, scenes: list[tuple[str, str, str]], methods: list[str]) -> None:
    """Print a Markdown table of ``table`` (scenes, methods, 2), in percent, with the mean of each class and of all."""
    print("| class | ground, Sun | " + " | ".join(methods) + " |")
    print("|---|---|" + "---|" * len(methods))
    classes = np.array([each[1] for each in scenes])
    rows = [(kind, ground, cells) for (_, kind, ground), cells in zip(scenes, table, strict=True)]
    rows.sort(key=lambda row: CLASSES.index(row[0]))
    rows += [(kind, "**mean**", table[classes == kind].mean(axis=0)) for kind in CLASSES]
    for kind, ground, cells in [*rows, ("all", "**mean**", table.mean(axis=0))]:
        print(f"| {kind} | {ground} | " + " | ".join(f"{100 * a:.1f} ({100 * b:.1f})" for a, b in cells) + " |")


def print_ratios(table: Array, methods: list[str]) -> None:
    """Print the ratios of the judged matcher to the others."""
    judged = table[:, methods.index(JUDGED)]
    for k, method in enumerate(methods):
        if method != JUDGED:
            ratio, low, high = bound_ratio(judged[:, 0], table[:, k, 0])
            print(f"{JUDGED} / {method}, wrong or missing: {ratio:.2f} ({low:.2f} to {high:.2f})")
    ratio, low, high = bound_ratio(judged[:, 1], table[:, methods.index(PLAIN), 1])
    print(f"{JUDGED} / {PLAIN} on the pixels of {PLAIN}: {ratio:.2f} ({low:.2f} to {high:.2f})")


def print_confidences(report: Path) -> None:
    """Print the means over scenes of the measures of each confidence of each matcher."""
    rows = json.loads((report / "report.json").read_text("utf-8"))["rows"]
    names = dict.fromkeys((row["method"], measure) for row in rows for measure in row["confidence"])
    for method, measure in names:
        those = [row["confidence"][measure] for row in rows if row["method"] == method and measure in row["confidence"]]
        means = []
        for key in CONFIDENCE_METRICS:
            known = [each[key] for each in those if each[key] is not None]
            means.append(f"{key} {np.mean(known):.3f} in {len(known)}" if known else f"{key} in none")
        print(f"{method} {measure}, means over scenes: {', '.join(means)}")


def main(options: argparse.Namespace) -> None:
    """Measure and print."""
    rows = json.loads((options.report / "report.json").read_text("utf-8"))["rows"]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    done = {row["pair"] for row in rows}
    scenes = [each for each in name_scenes(options.dataset) if each[0] in done]
    folders = {source.name: source.folder for source in find_sources([options.dataset])}
    measured = [measure_scene(folders[name], options.report / "pairs" / name, methods) for name, _, _ in scenes]
    shown = [*methods, FILLED]
    table = np.array([[found[method] for method in shown] for found in measured])
    print_rows(table, scenes, shown)
    print_ratios(table, shown)
    print_confidences(options.report)
    if options.sheet:
        first = [next(name for name, kind, _ in reversed(scenes) if kind == wanted) for wanted in CLASSES]
        write_sheet([options.report / "pairs" / name for name in first], options.sheet)
