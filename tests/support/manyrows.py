"""A finished evaluation of any number of pairs, made from the rows of one real pair."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import Method
from icymoon.stereo.report.row_log import RowLog
from icymoon.stereo.report.write_results import write_results

VARIED = ("l1_m", "total_bad_1", "coverage", "epe_px")
COMMON = ("l1_m", "epe_px")


def multiply(pair: Path, methods: Sequence[Method], count: int, out: Path, report: bool = True) -> None:
    """Write the evaluation of ``count`` pairs to ``out``: ten to a scene, albedo swept, errors scattered around it."""
    random = np.random.default_rng(0)
    first = evaluate([pair], methods, out)
    rows = [RowLog(out / "results.jsonl").read(pair.name, method.label) for method in methods]
    facts = json.loads(json.dumps(first["pairs"][0]))
    names = [f"pair{k:05d}" for k in range(count)]
    with (out / "results.jsonl").open("w", encoding="utf-8") as stream:
        for k, name in enumerate(names):
            albedo = (0.2, 0.4, 0.6, 0.8, 1.0)[k % 5]
            facts["settings"]["surface"]["albedo"] = albedo
            facts["settings"]["light"]["sun_elevation_deg"] = round(float(random.uniform(10, 60)), 3)
            facts["settings"]["dataset"]["seed"] = k // 10
            folder = out / "pairs" / name
            folder.mkdir(parents=True)
            (folder / "facts.json").write_text(json.dumps(facts | {"pair": name}))
            for m, row in enumerate(rows):
                factor = (0.5 + albedo) * float(np.exp(random.normal(0, 0.3)))
                varied = {key: row[key] * factor for key in VARIED if row[key] is not None}
                varied |= {key: min(1.0, varied[key]) for key in ("total_bad_1", "coverage")}
                varied["common"] = {
                    other: numbers | {key: numbers[key] * factor for key in COMMON}
                    for other, numbers in row["common"].items()
                }
                status = "suspect" if k % 97 == 5 else "ok"
                stream.write(json.dumps(row | varied | {"pair": name, "status": status, "key": f"{k}.{m}"}) + "\n")
    if report:
        write_results(
            RowLog(out / "results.jsonl"),
            names,
            methods,
            out,
            [],
            [],
            {"source": "made up", "response_overrides": {}},
            0,
            False,
        )
