"""The numbers of the GUISS paper's tables, measured again, read from an evaluation, and grouped as in the paper."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...render.pairs.pair_folder import read_complete
from ...render.plans.planned_pair import PlannedPair
from ...support.arrays import Array
from ..measure.render_noise import DECIDES
from ..report.by_setting import name_scene
from ..report.row_log import RowLog
from ..report.schema import ROW
from ..report.summary import ResultTable, summarise_method
from ..report.write_results import read_facts
from .printed import PAIRS_BY_GROUP


@dataclass(frozen=True)
class PaperResults:
    """An evaluation: the numbers of its methods, the facts of its pairs, and its folder."""

    table: ResultTable
    facts: Sequence[Mapping[str, Any]]
    out: Path

    def group(self, name: str) -> Array:
        """Return the mask (pairs,) of the pairs in a group of the paper's table. Reconstructed ground is a mesh
        file."""
        from_file = np.array([pair["settings"]["source"]["kind"] != "PROCEDURAL" for pair in self.facts], bool)
        return {"All": np.ones(len(from_file), bool), "Reconstructed": from_file, "Synthetic": ~from_file}[name]

    def summary(self, matcher: str, group: str) -> dict[str, Any] | None:
        """Return the means of a matcher over a group, see ``summarise_method``; None if it was not run or failed."""
        if matcher not in self.table.methods:
            return None
        found = summarise_method(self.table.where(self.group(group)), self.table.methods.index(matcher))
        return found if found["pairs"] else None

    def row(self, pair: str, matcher: str) -> dict[str, Any]:
        """Return the whole row of a matcher on a pair."""
        return RowLog(self.out / "results.jsonl", ROW).read(pair, matcher)


def read_measured(out: Path, names: Iterable[str], matchers: Sequence[str]) -> PaperResults:
    """Read the evaluation of pairs by matchers from the folder ``out``. Raises IcyMoonError if it cannot be read."""
    facts = [read_facts(out, name) for name in names]
    log, table = RowLog(out / "results.jsonl", ROW), ResultTable(matchers, [pair["pair"] for pair in facts])
    scenes: dict[str, int] = {}
    for k, pair in enumerate(facts):
        table.by_noise[k] = (pair.get("noise") or {}).get("verdict") == DECIDES
        table.scenes[k] = scenes.setdefault(name_scene(pair), len(scenes))
        for matcher in matchers:
            table.add(k, log.read(pair["pair"], matcher))
    return PaperResults(table, facts, out)


def measure_rendering_seconds(dataset: Path, pairs: Iterable[PlannedPair]) -> dict[str, tuple[float, int]]:
    """Return the mean processor seconds of rendering a pair with its share of bakes, and the number of pairs, by group
    of the paper's table. Groups without a rendered pair are left out.
    """
    seconds: dict[str, list[float]] = {}
    bakes: dict[str, dict[str, float]] = {}
    for pair in pairs:
        told = read_complete(pair.folder(dataset))
        if not told:
            continue
        group = "Synthetic" if pair.settings.source.kind == "PROCEDURAL" else "Reconstructed"
        seconds.setdefault(group, []).append(float(told["cpu_seconds"]["pair"]))
        for light in told.get("indirect", {}).get("lights", {}).values():
            bakes.setdefault(group, {})[light["file"]] = float(light["cpu_seconds_of_bake"])
    return {
        group: ((sum(own) + sum(bakes.get(group, {}).values())) / len(own), len(own))
        for group in PAIRS_BY_GROUP
        if (own := seconds.get(group))
    }
