"""The measured numbers of a view: the errors of each matcher on each recipe, in light and in shadow, and the noise.

All recipes of a view show the same ground. All are compared with the truth and the shadows of its converged render, the
mean of two halves. Each recipe has its own exposure, as in practice. The numbers of a view are kept beside its pairs,
and are measured again only if the pairs or the methods change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...render.pairs.pair_folder import is_complete
from ...support.arrays import Array
from ...support.file_schemas import COUNT, NUMBER, TEXT, Each, Maybe, read_record
from ...support.files import write_json
from ..images.develop import average_bands, develop
from ..matchers import match
from ..matchers.methods import Method
from ..matchers.search_range import find_known_ranges
from ..measure.by_pixel_class import find_shadow
from ..measure.metrics import is_usable
from ..measure.prepare_pair import LoadedPair, compute_noise_free_level, find_baked_error_level, load_pair
from ..measure.render_noise import judge_render_noise, measure_hidden_share
from ..trade.quality_losses import average_light, read_bake_seconds
from .design import CONVERGED, Study, StudyView

#: Version of the measured numbers; files of another version are measured again.
VERSION = 2
#: Classes of pixels, in the order of a tally.
LIGHTS = ("lit", "shadow")
_TALLY_SHAPE = Each(Each(Each(COUNT)), keys=TEXT)
_CELL_SHAPE = {
    "version": COUNT,
    "pairs": Each(TEXT, keys=TEXT),
    "methods": Each(TEXT),
    "tallies": Each(_TALLY_SHAPE, keys=TEXT),
    "noise": Each(
        {
            "verdict": Maybe(TEXT, null=True),
            "hidden": Maybe(NUMBER, null=True),
            "truly_hidden": Maybe(NUMBER, null=True),
            "distance": NUMBER,
            "bias": NUMBER,
        },
        keys=TEXT,
    ),
    "reference_noise": NUMBER,
    "cpu_s": Each({"pair": NUMBER, "bake": NUMBER}, keys=TEXT),
}


@dataclass(frozen=True)
class Cell:
    """The numbers of a view.

    ``tallies``: by recipe, ``converged`` among them, and by method, int (2, 2). For each of LIGHTS, it has the number
    of pixels that both eyes see, and the number of these that are missing or wrong by more than 1 px.

    ``noise``: by recipe. It has the verdict, the share of pixels that the verdict takes for ``hidden``, and the share
    that the difference from the converged render hides (``truly_hidden``). ``distance`` is the root mean square
    difference of the light from that render over its mean, without the noise of the converged render, and ``bias`` the
    relative difference of the means.

    ``reference_noise``: the standard deviation of the converged render over its mean.
    """

    view: StudyView
    pairs: Mapping[str, str]
    tallies: Mapping[str, Mapping[str, Array]]
    noise: Mapping[str, Mapping[str, Any]]
    reference_noise: float
    cpu_s: Mapping[str, Mapping[str, float]]

    def error(self, recipe: str, method: str, light: str | None = None) -> float:
        """Return the share of pixels that are missing or wrong, among all pixels or in one of LIGHTS; NaN if there are
        too few.
        """
        tally = self.tallies.get(recipe, {}).get(method)
        if tally is None:
            return float("nan")
        known, wrong = tally.sum(axis=0) if light is None else tally[LIGHTS.index(light)]
        return float(wrong / known) if known >= _MIN_SHARE * tally[:, 0].sum() else float("nan")


#: Least share of the image that a light needs for a separate error.
_MIN_SHARE = 0.05


def read_or_measure_cell(study: Study, view: StudyView, out: Path, methods: Sequence[Method]) -> Cell | None:
    """Read or measure the numbers of a view; None until both halves of its converged render are complete."""
    planned = study.pairs_of(view)
    folders = {name: pair.folder(out) for name, pair in planned.items() if is_complete(pair.folder(out))}
    if not set(study.reference) <= set(folders):
        return None
    labels, pairs = [method.label for method in methods], {name: planned[name].id for name in folders}
    file = out / "cells" / f"{view.name}.json"
    data: dict[str, Any] | None = None
    if file.exists():
        data = read_record(file, _CELL_SHAPE, "remove it")
    if data is None or (data["version"], data["pairs"], data["methods"]) != (VERSION, pairs, labels):
        data = {"version": VERSION, "pairs": pairs, "methods": labels, **_measure_view(study, folders, methods)}
        file.parent.mkdir(exist_ok=True)
        write_json(file, data)
    tallies = {
        recipe: {label: np.array(rows, int) for label, rows in by_method.items()}
        for recipe, by_method in data["tallies"].items()
    }
    return Cell(view, pairs, tallies, data["noise"], data["reference_noise"], data["cpu_s"])


def _measure_view(study: Study, folders: Mapping[str, Path], methods: Sequence[Method]) -> dict[str, Any]:
    loaded = {name: load_pair(folder, {}) for name, folder in folders.items()}
    halves = [loaded[name] for name in study.reference]
    first, light = halves[0], average_light(halves)
    true = np.where(first.visible["left"], first.pair.camera.disparity(first.depth["left"]), np.nan)
    view = first.views["left"]
    assert view.normal is not None
    assert view.semantic is not None
    assert first.pair.sun is not None
    converged = average_bands(light["left"].radiance)
    shadow = find_shadow(converged, view.normal, first.pair.sun.direction.tolist(), view.semantic)
    images = {name: each.images for name, each in loaded.items()}
    images[CONVERGED] = develop(first.pair, light["left"], light["right"], first.settings)
    ranges = find_known_ranges(first.pair.settings, true, bool(first.pair.data.get("edited_by_hand")))
    tallies = {
        name: {
            method.label: _tally_errors(
                match(method.name, *image.for_matchers(), method.options, first.pair.camera, ranges)[0], true, shadow
            )
            for method in methods
        }
        for name, image in images.items()
    }
    spread = float(np.var([average_bands(half.light["left"].radiance) for half in halves], axis=0, ddof=1).mean()) / 2
    return {
        "tallies": tallies,
        "noise": {name: _judge_noise(loaded[name], converged, spread) for name in study.noise if name in loaded},
        "reference_noise": spread**0.5 / float(converged.mean()),
        "cpu_s": {name: _measure_cost(each) for name, each in loaded.items()},
    }


def _tally_errors(disparity: Array, true: Array, shadow: Array) -> list[list[int]]:
    """Tally the errors as in ``Cell.tallies``. All arrays are (H, W); ``true`` is NaN where only one eye sees the
    point.
    """
    known = np.isfinite(true)
    wrong = known & ~(is_usable(disparity) & (np.abs(disparity - true) <= 1))
    return [[int((known & part).sum()), int((wrong & part).sum())] for part in (~shadow, shadow)]


def _judge_noise(loaded: LoadedPair, converged: Array, spread: float) -> dict[str, Any]:
    """Judge a pair's noise, and measure its distance from the converged radiance (H, W), whose variance is
    ``spread``.
    """
    own = average_bands(loaded.light["left"].radiance)
    left, best = compute_noise_free_level(loaded, "left"), compute_noise_free_level(loaded, "left", converged - own)
    noise = judge_render_noise(
        left,
        compute_noise_free_level(loaded, "right"),
        loaded.pair.camera.disparity(loaded.depth["left"]),
        loaded.visible["left"],
        find_baked_error_level(loaded),
    )
    square = float(np.mean((own - converged) ** 2)) - spread
    mean = float(converged.mean())
    return {
        "verdict": noise.verdict,
        "hidden": noise.hidden,
        "truly_hidden": measure_hidden_share(left - best, best, loaded.visible["left"]),
        "distance": max(square, 0.0) ** 0.5 / mean,
        "bias": float(own.mean()) / mean - 1,
    }


def _measure_cost(loaded: LoadedPair) -> dict[str, float]:
    """Return the processor seconds of a pair and of the bake of its light."""
    return {"pair": float(loaded.pair.data["cpu_seconds"]["pair"]), "bake": read_bake_seconds(loaded.pair)}
