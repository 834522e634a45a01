"""Rows of costs and matcher errors: pairs of a scene, rendered in a separate process and then matched."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from icymoon.benchmarks.common.guiss_scene import Rung
from icymoon.benchmarks.common.own_process import call
from icymoon.settings.topics.rendering import QualitySettings
from icymoon.settings.topics.scene import Settings, typed
from icymoon.support.arrays import Array

if TYPE_CHECKING:  # a process that renders pays for no evaluator
    import bpy
    from icymoon.stereo.matchers.methods import Method

# In a separate process, with Blender.


def render(job: dict[str, Any]) -> list[dict[str, Any]]:
    """Render the pairs of a row: for each its folder, its processor seconds, and the seconds of the process before
    it."""
    from icymoon.benchmarks.common.renders import render_planned, start_blender
    from icymoon.render import cycles_settings, render_pair
    from icymoon.render.plans.planned_pair import PlannedPair, expand_headings

    start_blender()
    rung = Rung(**job["rung"])
    apply = cycles_settings.apply_quality

    def applied(
        scene: bpy.types.Scene, quality: QualitySettings, seed: int, blurred: bool = False, through: bool = False
    ) -> None:
        apply(scene, quality, seed, blurred, through)
        for name, value in rung.cycles.items():
            setattr(scene.cycles, name, value)

    cycles_settings.apply_quality = applied
    apart = _SeparateRenders()
    if rung.apart:
        render_pair._render_radiance = apart.radiance
    # Each pair is built anew, so nothing has to be rotated.
    pairs = [PlannedPair(pair.id, pair.settings, 0.0) for pair in expand_headings(typed(job["settings"]))]
    render_planned(pairs, Path(job["dataset"]), warn=lambda warning: print(warning, file=sys.stderr))
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


class _SeparateRenders:
    """Separate renders of each eye, as in the paper's public code: nothing is shared, and only the left eye has
    depth."""

    def __init__(self) -> None:
        self.costs: list[float] = []  # processor seconds of each pair

    def radiance(
        self, scene: bpy.types.Scene, built: object, lights: object, stem: Path, planned: object
    ) -> dict[str, Path]:
        """Replaces the function by which Icy Moon renders radiance."""
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
    """Render a row in a separate process; see ``render``."""
    return list(call(render, {"rung": asdict(rung), "settings": settings, "dataset": str(folder)}))


@dataclass(frozen=True)
class Errors:
    """The errors of matchers on a pair: by matcher the disparity error (H, W), px, NaN where nothing is measured, and
    its sums ``stereo.trade.quality_losses``; and the pixels that both eyes see, bool (H, W)."""

    off: dict[str, Array]
    tallies: dict[str, Array]
    seen: Array


def errors(folder: Path, methods: Sequence[Method]) -> Errors:
    """The errors on a rendered pair, with the exposure of its own camera."""
    from icymoon.stereo.matchers import match
    from icymoon.stereo.measure.metrics import is_usable
    from icymoon.stereo.measure.prepare_pair import load_pair
    from icymoon.stereo.trade.quality_losses import tally_errors

    pair = load_pair(folder, {})
    camera = pair.pair.camera
    left, right = pair.images.for_matchers()
    true = np.where(pair.visible["left"], camera.disparity(pair.depth["left"]), np.nan)
    found = {method.label: match(method.name, left, right, method.options, camera)[0] for method in methods}
    return Errors(
        {label: np.where(is_usable(each), np.abs(each - true), np.nan) for label, each in found.items()},
        {label: tally_errors(each, true) for label, each in found.items()},
        np.isfinite(true),
    )


def against(pairs: Sequence[Errors], first: Sequence[Errors], label: str) -> dict[str, list[float]]:
    """The increase of a row's errors over the first row, with standard errors: on the pixels that both measure, px, and
    of the share that is wrong or missing."""
    from icymoon.stereo.measure.jackknife import jackknife, sum_over_tiles

    tiles = []
    for one, other in zip(pairs, first, strict=True):
        ours, theirs, seen = one.off[label], other.off[label], one.seen & other.seen
        both = seen & np.isfinite(ours) & np.isfinite(theirs)
        tiles.append(
            sum_over_tiles(np.where(both, ours - theirs, 0.0), both, seen & ~(ours <= 1), seen & ~(theirs <= 1), seen)
        )
    value, doubt = jackknife(
        lambda sums: np.stack([sums[..., 0] / sums[..., 1], (sums[..., 2] - sums[..., 3]) / sums[..., 4]], axis=-1),
        np.concatenate(tiles),
    )
    return {key: [float(value[k]), float(doubt[k])] for k, key in enumerate(("epe_px", "wrong_or_missing"))}


def measured(
    pairs: Sequence[Mapping[str, Any]], found: Sequence[Errors], first: Sequence[Errors], best: Any
) -> dict[str, Any]:
    """Costs and errors of a row; ``best`` is the converged render of its first pair."""
    from icymoon.stereo.trade.quality_losses import STEREO_KEYS, compute_stereo_numbers, measure_variant

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
                    STEREO_KEYS,
                    np.mean(
                        [compute_stereo_numbers(each.tallies[label].sum(axis=0)) for each in found], axis=0
                    ).tolist(),
                    strict=True,
                )
            )
            for label in found[0].off
        },
        "against": {label: against(found, first, label) for label in found[0].off} if found is not first else {},
    }
    if best is not None:
        light = measure_variant([Path(pairs[0]["folder"])], best, ())
        row |= {key: light[key] for key in ("bias", "rmse")}
    return row


def head(images: Sequence[int] = (1,)) -> str:
    """The header line above ``shown``."""
    ratios = "".join(f"{'ratio' if len(images) == 1 else f'of {n}':>8}" for n in images)
    return (
        f"{'':44}{'first':>7}{'bake':>7}{'more':>7}{ratios}{'':8}{'cover':>7}{'EPE':>7}{'bad 1':>7}{'wrong':>7}"
        f"{'more EPE of both':>19}{'more wrong':>16}{'mean':>9}{'RMS':>7}"
    )


def shown(name: str, row: Mapping[str, Any], most: float, images: Sequence[int] = (1,)) -> str:
    """The lines of a row, one per matcher; ``most`` is the cost of the first row, CPU-s per pair."""
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
