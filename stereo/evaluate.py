"""Running matchers over pairs and measuring them: rows, pictures and the report's data.

Every row is one method on one pair. The metrics of the main table are over all pixels with a finite
true depth, a missing measurement costing coverage; those with the prefix ``visible_`` leave out
pixels that the right eye cannot see (occluded or outside its image), where no matcher can measure;
those with ``common_`` are over the pixels that every method measured, whose share of the true ones
is their coverage.
A pair that cannot be used is named, recorded as failed, and does not stop the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IcyMoonError
from ..files import write_json, write_text
from ..render.pair import pair_folders
from . import check, pictures
from .images import write_disparity, write_png
from .matchers import complete_options, match
from .methods import Method
from .metrics import ERROR_STEPS_M, depth_metrics, disparity_metrics, error_curve
from .prepare import Prepared, none_for_nan, prepare
from .report import write_report
from .rowlog import RowLog
from .summary import METRICS, REGIONS, csv_table, summary

FORMAT = "icymoon-report"
VERSION = 1

Event = Callable[[dict[str, Any]], None]


def evaluate(paths: Sequence[Path], methods: Sequence[Method], out: Path,
             response: Mapping[str, Mapping[str, Any]] | None = None,
             on_event: Event = lambda event: None) -> dict[str, Any]:
    """Evaluate pairs and all pairs of data sets; return what is in ``report.json``.

    ``response`` overrides settings that need no new render. Written to ``out``, replacing what an
    earlier run left: ``results.jsonl`` (a row as soon as it is known), then ``results.csv``,
    ``report.json`` and ``report.html``; per pair, in ``pairs/<pair>/``, pictures and disparities.

    ``on_event`` gets {"type": "progress", "fraction", "done", "total", "message"} and, per failure,
    {"type": "error", "message"}. Raises IcyMoonError if there is no pair or ``out`` cannot be written.

    The report is {"format", "version", "summary", "rows", "pairs", "failed", "provenance"}; what is
    undefined is null.

    * ``summary``: one entry per method, see ``summary``.
    * ``rows``: ``pair``, ``method``, ``status`` ("ok" or "failed"), every metric of ``metrics`` and the
      same with ``visible_`` and ``common_``, ``error_curve``, ``true_pixels``, ``seconds`` of CPU time, the complete
      ``options``, ``counts`` of pixels per outcome and ``facts`` on what it ran where a method knows them, ``error``
      (why it failed) and ``images``: paths relative to ``out`` of the pictures ``depth`` and ``error`` and of
      ``disparity`` (npz, with the method's other arrays).
    * ``pairs``: what was found about each usable pair, and its ``images`` ``left``, ``right`` and
      ``true_depth``.
    * ``failed``: ``pair``, ``message`` and, where only one method failed, ``method``.
    """
    folders = list(dict.fromkeys(folder for path in paths for folder in pair_folders(path)))
    log = RowLog(out / "results.jsonl")
    rows: list[dict[str, Any]] = []
    pairs: list[dict[str, Any]] = []
    failed: list[dict[str, Any]] = []

    def done(row: dict[str, Any]) -> None:
        log.append(row)
        rows.append(row)
        total = len(folders) * len(methods)
        on_event({"type": "progress", "fraction": len(rows) / total, "done": len(rows), "total": total,
                  "message": f"{row['pair']} {row['method']}"})

    def fail(message: str, **what: str) -> None:
        failed.append({**what, "message": message})
        on_event({"type": "error", "message": message})

    for folder in folders:
        try:
            prepared = prepare(folder, response or {})
        except IcyMoonError as error:
            fail(str(error), pair=folder.name)
            for method in methods:
                done(_failed_row(folder.name, method, str(error)))
            continue
        pairs.append(prepared.facts | {"images": _write_pair_pictures(prepared, out)})
        matched: dict[str, tuple[np.ndarray, dict[str, Any]]] = {}
        broken: dict[str, str] = {}
        for method in methods:
            try:
                disparity, _, info = match(method.name, prepared.left, prepared.right, method.options,
                                           prepared.pair.camera)
                matched[method.label] = disparity, info
            except IcyMoonError as error:
                broken[method.label] = str(error)
        masks = _masks(prepared, [disparity for disparity, _ in matched.values()])
        for method in methods:
            if method.label in broken:
                fail(broken[method.label], pair=folder.name, method=method.label)
                done(_failed_row(folder.name, method, broken[method.label]))
                continue
            disparity, info = matched[method.label]
            depth = prepared.pair.camera.focal_baseline_px_m / disparity.astype(np.float64)  # NaN stays NaN
            done({"pair": folder.name, "method": method.label, "status": "ok",
                  **_measured(prepared, masks, disparity, depth), "seconds": info["seconds"],
                  "options": info["options"], "counts": info["counts"], "facts": info["facts"],
                  "error": "",
                  "images": _write_method_pictures(prepared, method, disparity, depth, info["arrays"], out)})

    report = {"format": FORMAT, "version": VERSION, "summary": [summary(method.label, rows) for method in methods],
              "rows": rows, "pairs": pairs, "failed": failed, "provenance": _provenance(paths, methods, response or {})}
    write_text(out / "results.csv", csv_table(rows))
    write_json(out / "report.json", report)
    write_report(report, out)
    return report


def _masks(prepared: Prepared, disparities: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """The pixels of each of ``summary.REGIONS``."""
    everywhere = np.ones_like(prepared.visible)
    return {"": everywhere, "visible_": prepared.visible,
            "common_": np.logical_and.reduce([everywhere, *map(np.isfinite, disparities)])}


def _measured(prepared: Prepared, masks: Mapping[str, np.ndarray], disparity: np.ndarray,
              depth: np.ndarray) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for prefix, mask in masks.items():
        truth = np.where(mask, prepared.truth, np.nan)
        metrics = depth_metrics(depth, truth) | disparity_metrics(disparity, prepared.pair.camera.disparity(truth))
        result |= {prefix + key: none_for_nan(value) for key, value in metrics.items()}
    true_pixels = int(np.isfinite(prepared.truth).sum())
    # Of the common pixels all are covered; what tells something is how many there are.
    result["common_coverage"] = none_for_nan(result["common_n"] / true_pixels if true_pixels else math.nan)
    result["error_curve"] = [none_for_nan(share) for share in error_curve(depth, prepared.truth)]
    result["true_pixels"] = true_pixels
    return result


def _failed_row(pair: str, method: Method, message: str) -> dict[str, Any]:
    undefined = dict.fromkeys([prefix + metric for prefix in REGIONS for metric in METRICS])
    return {"pair": pair, "method": method.label, "status": "failed", **undefined, "error_curve": [],
            "true_pixels": None, "seconds": None, "options": complete_options(method.name, method.options),
            "counts": {}, "facts": {}, "error": message, "images": {}}


def _write_pair_pictures(prepared: Prepared, out: Path) -> dict[str, str]:
    depth = pictures.true_depth_picture(prepared.truth, prepared.scale)
    images = {"left": prepared.left, "right": prepared.right,
              "true_depth": pictures.with_bar(depth, prepared.scale)}
    return {key: _write_picture(prepared, out, f"{key}.png", image) for key, image in images.items()}


def _write_method_pictures(prepared: Prepared, method: Method, disparity: np.ndarray, depth: np.ndarray,
                           arrays: Mapping[str, np.ndarray], out: Path) -> dict[str, str]:
    picture = pictures.depth_picture(depth, prepared.scale)
    error = pictures.error_picture(depth, prepared.truth)
    npz = _folder(prepared, out) / f"{method.file_name}.npz"
    write_disparity(npz, disparity, arrays, focal_baseline_px_m=prepared.pair.camera.focal_baseline_px_m)
    return {"depth": _write_picture(prepared, out, f"{method.file_name}_depth.png",
                                    pictures.with_bar(picture, prepared.scale)),
            "error": _write_picture(prepared, out, f"{method.file_name}_error.png",
                                    pictures.with_bar(error, pictures.ERROR)),
            "disparity": npz.relative_to(out).as_posix()}


def _write_picture(prepared: Prepared, out: Path, name: str, image: np.ndarray) -> str:
    path = _folder(prepared, out) / name
    write_png(path, image)
    return path.relative_to(out).as_posix()


def _folder(prepared: Prepared, out: Path) -> Path:
    return out / "pairs" / prepared.pair.folder.name


def _provenance(paths: Sequence[Path], methods: Sequence[Method],
                response: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {"created": datetime.now(UTC).isoformat(timespec="seconds"),
            "source": ", ".join(str(path.resolve()) for path in paths),
            "methods": [{"label": method.label, "name": method.name,
                         "options": complete_options(method.name, method.options)} for method in methods],
            "response_overrides": {f"{topic}.{key}": value for topic, values in response.items()
                                   for key, value in values.items()},
            "versions": check.versions(), "error_curve_steps_m": list(ERROR_STEPS_M),
            "averages": "mean over pairs, each pair counting alike; pooled_* over the pixels of all pairs",
            "pixels": REGIONS,
            "seconds": "CPU seconds of matching, one thread"}
