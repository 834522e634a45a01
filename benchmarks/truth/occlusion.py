"""The hidden pixels that are found, the false ones, and the cost, compared with an independent ray caster.

    python benchmarks occlusion [PRESET [QUALITY [WIDTH [MORE_PRESETS...]]]]

From the left eye's true depth a ray goes from the right eye to the point of each pixel, through Blender's own
bounding-volume hierarchy and not through Cycles: a point is hidden if that ray meets something whose disparity is
larger by 0.01 px. "> 0.25 px" and "> 1 px" are points whose occluder is nearer by more than that. Both eyes are
compared. The first row is of pairs as they are rendered by default, with a ray to the point of each pixel; the others
are found between Cycles' rays. Cost is the processor time of these as a ratio to the rest of a pair's processor time.
Fine relief is bump, since Blender's tree does not know where Cycles moves vertices.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import product
from typing import Any

import bpy
import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.processor import Stopwatch, seconds_of
from icymoon.benchmarks.common.renders import render, settings_of, start_blender
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.physics.camera import occlusion as columns
from icymoon.physics.camera.occlusion import find_hidden, find_matching_column, is_in_frame, sample_at_columns
from icymoon.render import cycles_occlusion, render_pair
from icymoon.render.pairs.pair_folder import EYES, Pair, find_pairs
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings, typed
from icymoon.stereo.images.exr import read_depth, read_truth
from icymoon.support.arrays import Array
from other_rays import cast_from_other_eye, tree_of_scene

TOLERANCES_PX = (0.1, 0.25, 0.5)
_NEARER_PX = 0.01
_OTHERS = dict(zip(EYES, reversed(EYES), strict=True))

Masks = dict[str, Array]


def find_hidden_by_both_columns(disparity: Array, other: Array, eye: str) -> Array:
    """Hidden pixels by the method before 0.1: both columns around the point show something nearer by half a pixel."""
    column, filled = find_matching_column(disparity, eye), np.nan_to_num(other)
    nearest = np.minimum(*(sample_at_columns(filled, side(np.nan_to_num(column))) for side in (np.floor, np.ceil)))
    with np.errstate(invalid="ignore"):
        return is_in_frame(column) & (nearest > disparity + 0.5)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("preset", nargs="?", default="europa_rough_ice")
    parser.add_argument("quality", nargs="?", default="draft")
    parser.add_argument("width", nargs="?", type=int, default=640)
    parser.add_argument("more", nargs="*", help="presets on top")


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    scene, quality, width = start_blender(), options.quality, options.width
    presets = (options.preset, *options.more)
    settings = settings_of(
        (options.preset, f"qualities/{quality}", *options.more),
        {
            "rig": {"width_px": width, "height_px": width * 3 // 4},
            "surface": {"relief": "BUMP"},
            "quality": {"threads": 1, "truth_by": "CYCLES"},
        },
    )
    built = build_scene(scene, settings)
    by_rays = _find_by_rays(built, settings)
    pair, own, between, cost = _render(built, settings)
    rays = {
        number: {
            eye: np.stack([own[eye], *between[eye]][:: 4 // number], axis=-1).reshape(len(own[eye]), -1) for eye in EYES
        }
        for number in (1, 2, 4)
    }
    tree = tree_of_scene(pair)
    met = {eye: cast_from_other_eye(tree, pair, eye, own[eye]) for eye in EYES}
    truth: Masks = {}
    quarter: Masks = {}
    far: Masks = {}
    for eye in EYES:
        inside = is_in_frame(find_matching_column(own[eye], eye))
        with np.errstate(invalid="ignore"):
            truth[eye] = inside & (met[eye] > own[eye] + _NEARER_PX)
            quarter[eye] = inside & (met[eye] > own[eye] + 0.25)
            far[eye] = inside & (met[eye] > own[eye] + 1.0)
    print(
        f"{' '.join(presets)}, {quality}, {width} px: hidden {_percent(truth, None):.3f} %, "
        f"by more than 1 px {_percent(far, None):.3f} %"
    )
    print(f"{'rays a pixel':14}{'nearer by':>10}{'found':>9}{'> 0.25 px':>11}{'> 1 px':>9}{'false':>9}{'CPU':>7}")

    def line(name: str, tolerance: str, masks: Masks, cost: float | None = None) -> None:
        wrong = {eye: masks[eye] & ~truth[eye] for eye in EYES}
        print(
            f"{name:14}{tolerance:>10}{_percent(masks, truth):9.2f}{_percent(masks, quarter):11.2f}"
            f"{_percent(masks, far):9.2f}"
            f"{_percent(wrong, None):9.4f}{'' if cost is None else f'{cost:7.3f}'}",
            flush=True,
        )

    line("to each point", "0.25", by_rays)
    line(
        "both columns",
        "0.5",
        {eye: find_hidden_by_both_columns(own[eye], own[other], eye) for eye, other in _OTHERS.items()},
    )
    for number, tolerance in product(rays, TOLERANCES_PX):
        columns._MIN_GAP_PX = tolerance
        line(
            str(number),
            f"{tolerance:g}",
            {eye: find_hidden(own[eye], rays[number][other], eye) for eye, other in _OTHERS.items()},
            cost if number == 4 else None,
        )


def _percent(masks: Masks, of: Masks | None) -> float:
    """The share in ``masks`` of the pixels of both eyes, or of those in ``of``, %."""
    among = {eye: np.ones_like(mask) for eye, mask in masks.items()} if of is None else of
    return float(100 * sum((masks[eye] & among[eye]).sum() for eye in EYES) / sum(among[eye].sum() for eye in EYES))


def _find_by_rays(built: Built, settings: Settings) -> Masks:
    """Find the hidden pixels of a pair whose truth is traced by rays."""
    made = description.merged(settings, {"quality": {"truth_by": "RAYS"}})
    with scratch() as folder:
        render(built, typed(made), folder)
        pair = find_pairs(folder)[0]
        found = {eye: read_truth(pair.truth(eye), eye).hidden for eye in EYES}
    return {eye: mask for eye, mask in found.items() if mask is not None}


def _render(built: Built, settings: Settings) -> tuple[Pair, Masks, dict[str, list[Array]], float]:
    """A pair, the disparity of its pixels and of the rays between them, and the processor time of these rays over that
    of the rest, the smaller of two runs."""
    found: dict[str, list[Array]] = {}
    spent = 0.0
    add_hidden, shift_frame = cycles_occlusion.add_hidden_pass, render_pair.shift_frame

    def add(truth: Any, between: Any, camera: Any) -> None:
        nonlocal spent
        found.update(between)
        spent += seconds_of(partial(add_hidden, truth, between, camera))

    @contextmanager
    def shift(scene: bpy.types.Scene, columns: float) -> Iterator[None]:
        nonlocal spent
        watch = Stopwatch()
        with shift_frame(scene, columns):
            yield
        spent += watch.lap()

    cycles_occlusion.add_hidden_pass, render_pair.shift_frame = add, shift
    ratios = []
    for _ in range(2):
        spent, watch = 0.0, Stopwatch()
        with scratch() as folder:
            render(built, settings, folder)
            ratios.append(spent / (watch.lap() - spent))
            pair = find_pairs(folder)[0]
            own = {eye: pair.camera.disparity(read_depth(pair.truth(eye), eye).depth) for eye in EYES}
    return pair, own, found, min(ratios)
