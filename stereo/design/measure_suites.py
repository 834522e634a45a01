"""Measures the choices of sensor suites on the same grounds, one row for each suite and ground."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import DiskError, describe_error
from ...support.file_schemas import COUNT, NUMBER, TEXT, Each, Maybe, Shape
from ...support.files import make_json_digest
from ..decisions.dem import Grid
from ..decisions.rules import Rules
from ..decisions.workspace import Workspace, decide_from_depth, make_workspace
from ..fusion.match_prepared import list_method_inputs
from ..fusion.suns import join_disparities
from ..learning.grounds import Ground, Recipe, Variety, build_ground, make_split_generator, release_ground
from ..learning.made_pairs import draw_light
from ..learning.radiance import Lighting
from ..matchers.resident_process import stop_residents
from ..measure.prepare_pair import PreparedPair
from ..measure.row_metrics import disparity_to_depth
from ..report.row_log import Row, RowLog
from .lamps import SuiteLamp, light_night
from .made_workspaces import (
    draw_recipes,
    match_disparity,
    measure_true_heights,
    name_pair,
    prepare_made_pair,
    prepare_pair_again,
    summarise_decisions,
)
from .read_design import MAX_SUNS, Design, Suite

Event = Callable[[dict[str, Any]], None]
#: The splits of the grounds: terrains of the design, and landforms that are held out.
OWN, LANDFORM = "ground", "landform"
#: Increased when the same input gives other numbers.
DESIGN_VERSION = 1
#: The index of the light among a ground's random streams, and the lamp's index among the lights, after all Suns.
_LIGHT, _NIGHT = 5, MAX_SUNS
#: The numbers of a row. Each number of the choice is 0 or 1, or null if undefined. ``cells`` counts all cells, the
#: safe, the taken, and the safe and taken ones. The others determine the cost; only suites with a lamp have ``lamp_s``.
_NUMBERS_SHAPE: dict[str, Shape] = {
    "unsafe_choice": Maybe(NUMBER, null=True),
    "dangerous_choice": Maybe(NUMBER, null=True),
    "no_site": Maybe(NUMBER, null=True),
    "fails": Maybe(TEXT, null=True),
    "cells": Each(COUNT),
    "cpu_s": NUMBER,
    "exposure_s": NUMBER,
    "lamp_s": Maybe(NUMBER),
    "frames": COUNT,
    "points": COUNT,
}
ROW_SHAPE: dict[str, Shape] = {"status": TEXT, "error": TEXT, "numbers": Maybe(_NUMBERS_SHAPE, null=True)}


@dataclass(frozen=True)
class Study:
    """A design with the rules of its decisions. ``basis`` lists everything else that determines its rows, such as
    versions.
    """

    design: Design
    rules: Rules
    basis: Sequence[Any]

    def make_key(self, suite: Suite) -> str:
        """Hash everything except the ground that determines the rows of a suite. The suite's name is left out."""
        design = self.design
        lamp = [asdict(suite.lamp)] if suite.lamp else []  # so that rows of suites without a lamp keep their keys
        return make_json_digest(
            [
                DESIGN_VERSION,
                *self.basis,
                self.rules.to_json(),
                list(design.variety.terrains),
                list(design.variety.suns_deg),
                design.rays_per_pixel,
                suite.settings,
                suite.suns,
                list_method_inputs(suite.method),
                dict(suite.method.lidar or {}),
                *lamp,
            ]
        )


def draw_grounds(design: Design, seed: int, grounds: int, landforms: int) -> list[Recipe]:
    """Draw the recipes of the grounds of the design's terrains, then of the held-out landforms."""
    return [
        recipe
        for split, count in ((OWN, grounds), (LANDFORM, landforms))
        for recipe in draw_recipes(seed, split, count, design.variety)
    ]


def measure_suites(study: Study, recipes: Sequence[Recipe], log: RowLog, on_event: Event) -> list[Row]:
    """Return the rows of all suites on all grounds, ground by ground. Missing rows are measured and logged at once."""
    rows: list[Row] = []
    warm: set[str] = set()
    total = len(recipes) * len(study.design.suites)
    try:
        for recipe in recipes:
            for row in _measure_ground(study, recipe, log, warm):
                rows.append(row)
                if row["error"]:
                    on_event({"type": "error", "message": row["error"]})
                on_event(
                    {
                        "type": "progress",
                        "fraction": len(rows) / total,
                        "done": len(rows),
                        "total": total,
                        "message": f"{row['pair']} {row['method']}",
                    }
                )
    finally:
        stop_residents()
    return rows


def _measure_ground(study: Study, recipe: Recipe, log: RowLog, warm: set[str]) -> Iterator[Row]:
    """Yield the rows of a ground, suite by suite. Suites that differ only in their names share their numbers.

    ``warm`` has the labels of the methods that have run in this process.
    """
    name = name_pair(recipe)
    keys = {suite: study.make_key(suite) for suite in study.design.suites}
    there = {suite: row for suite, key in keys.items() if (row := log.find(name, suite.name, key))}
    known = {row["key"]: row for row in there.values()}
    opened = None
    try:
        for suite, key in keys.items():
            if key not in known:
                opened = opened or _OpenGround(study, recipe, warm)
                known[key] = _make_row(opened, suite, name, key)
            if suite not in there:
                there[suite] = known[key] | {"method": suite.name}
                log.append(there[suite])
            yield there[suite]
    finally:
        if opened is not None:
            opened.close()


def _make_row(opened: _OpenGround, suite: Suite, name: str, key: str) -> Row:
    row: Row = {"pair": name, "method": suite.name, "key": key, "status": "ok", "error": "", "numbers": None}
    try:
        return row | {"numbers": opened.measure(suite)}
    except DiskError:
        raise
    except Exception as error:
        return row | {"status": "failed", "error": describe_error(error, f"suite {suite.name} on {name}")}


class _OpenGround:
    """A ground with its triangles, and the pairs that suites with the same camera share."""

    def __init__(self, study: Study, recipe: Recipe, warm: set[str]) -> None:
        self._study, self._recipe, self._warm = study, recipe, warm
        self._ground: Ground = build_ground(recipe)
        self._pairs: dict[tuple[str, int | SuiteLamp], PreparedPair] = {}
        self._workspaces: dict[str, Workspace] = {}
        self._true_heights: tuple[Grid, Array] | None = None

    def close(self) -> None:
        """Free the memory of the triangles."""
        release_ground(self._ground)

    def measure(self, suite: Suite) -> dict[str, Any]:
        """Measure the numbers of a suite, see ``_NUMBERS_SHAPE``.

        The lander chooses under the first Sun, whose image tells where light is.
        """
        workspace = self._open_workspace(suite.settings)
        disparities, seconds = [], 0.0
        pairs = [self._prepare(suite.settings, sun) for sun in range(suite.suns)]
        night = [self._prepare_night(suite.settings, suite.lamp)] if suite.lamp else []
        if suite.method.label not in self._warm:  # the first run loads libraries
            match_disparity(pairs[0], suite.method)
            self._warm.add(suite.method.label)
        for prepared in [*pairs, *night]:
            disparity, spent = match_disparity(prepared, suite.method)
            disparities.append(disparity)
            seconds += spent
        start = time.process_time()
        disparity = join_disparities(np.stack(disparities))
        seconds += time.process_time() - start
        found = decide_from_depth(workspace, disparity_to_depth(pairs[0], disparity))
        decided = summarise_decisions(workspace, found)
        by_lamp = list_exposures(night)
        frames = list_exposures(pairs) + by_lamp
        return {
            **{key: decided["sites"][key] for key in ("unsafe_choice", "dangerous_choice", "no_site", "cells")},
            "fails": decided["fails"],
            "cpu_s": seconds,
            "exposure_s": sum(frames),
            **({"lamp_s": sum(by_lamp)} if night else {}),
            "frames": len(frames),
            "points": int(suite.method.lidar["points"]) if suite.method.lidar else 0,
        }

    def _open_workspace(self, settings: Settings) -> Workspace:
        camera = make_json_digest(settings)
        if camera not in self._workspaces:
            if self._true_heights is None:  # of all suites, which share the workspace
                self._true_heights = measure_true_heights(self._ground, settings)
            self._workspaces[camera] = make_workspace(
                self._prepare(settings, 0), self._study.rules, *self._true_heights
            )
        return self._workspaces[camera]

    def _prepare(self, settings: Settings, sun: int) -> PreparedPair:
        """Make a camera's pair under one Sun of the ground, with independent noise of light and sensor."""
        where = make_json_digest(settings), sun
        if where not in self._pairs:
            light = draw_sun(self._recipe, sun, self._study.design.variety)
            if sun:
                self._pairs[where] = self._prepare_again(settings, light, sun)
            else:
                self._pairs[where] = prepare_made_pair(self._ground, settings, light, *self._start_noise(sun))
        return self._pairs[where]

    def _prepare_night(self, settings: Settings, lamp: SuiteLamp) -> PreparedPair:
        """Make a camera's pair in the light of a lamp alone."""
        where = make_json_digest(settings), lamp
        if where not in self._pairs:
            day = draw_sun(self._recipe, 0, self._study.design.variety)
            night = light_night(lamp, self._ground, day, settings)
            self._pairs[where] = self._prepare_again(settings, night, _NIGHT)
        return self._pairs[where]

    def _prepare_again(self, settings: Settings, light: Lighting, number: int) -> PreparedPair:
        """Make the pair of the first Sun again in another light, with the noise of the light's number."""
        first, seed = self._prepare(settings, 0), int(settings.sensor.noise_seed) + number
        return prepare_pair_again(first, self._ground, light, *self._start_noise(number), seed)

    def _start_noise(self, number: int) -> tuple[int, np.random.Generator]:
        """Return the rays per pixel, and their random stream for the light of this number."""
        recipe = self._recipe
        stream = make_split_generator(recipe.seed, recipe.split, recipe.number, _LIGHT, number, 1)
        return self._study.design.rays_per_pixel, stream


def list_exposures(pairs: Sequence[PreparedPair]) -> list[float]:
    """List the seconds of all exposures of pairs."""
    return [frame.seconds for each in pairs if each.images is not None for frame in each.images.frames]


def draw_sun(recipe: Recipe, sun: int, variety: Variety) -> Lighting:
    """Draw the light of a ground under one of its Suns. It differs from the first only in the direction of the Sun."""
    first, own = (
        draw_light(recipe.split, make_split_generator(recipe.seed, recipe.split, recipe.number, _LIGHT, k, 0), variety)
        for k in (0, sun)
    )
    return replace(first, sun=own.sun)


def group_split_rows(rows: Sequence[Mapping[str, Any]], split: str) -> dict[str, dict[str, Mapping[str, Any]]]:
    """Group the rows of the grounds of a split by ground and suite."""
    found: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        if row["pair"].startswith(f"{split}-"):
            found.setdefault(row["pair"], {})[row["method"]] = row
    return found
