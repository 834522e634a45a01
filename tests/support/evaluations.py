"""Evaluations as the evaluator leaves them, for what Blender does with them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
from icymoon.operators import results
from icymoon.settings.blender import scene_properties

PAIR = "0123456789ab"
ROW = {
    "method": "bm",
    "total_bad_1": 0.35,
    "l1_m": 0.123,
    "l1_rate_10": 0.5,
    "si_rmse": None,
    "dod": 0.25,
    "coverage": 0.75,
}


def write_evaluation(
    folder: Path,
    *rows: dict[str, Any],
    shown: Sequence[dict[str, Any]] = (),
    created: str = "2038-06-01T12:34:56+00:00",
) -> None:
    """Write what the window reads of an evaluation."""
    folder.mkdir(exist_ok=True)
    (folder / "report.html").write_text("<html></html>")
    (folder / "summary.json").write_text(
        json.dumps(
            {
                "summary": rows or [ROW],
                "shown": list(shown),
                "provenance": {"created": created, "response_overrides": {}},
            }
        )
    )


def evaluated(scene: bpy.types.Scene, dataset: Path, *rows: dict[str, Any], scope: str = "SCENE", **facts: Any) -> None:
    """A scene whose pair of this data set was evaluated."""
    scene.icymoon.dataset.folder = str(dataset)
    settings = scene_properties.read_settings(scene.icymoon)
    write_evaluation(results.find_evaluation_folder(settings, scope), *rows, **facts)
    results.keep_results(scene, scope, settings, [] if scope == "DATASET" else [PAIR])
