"""Writes decisions as JSON, as CSV, and as a page with the main results, tables, ROC curves and maps."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from ...support.arrays import Array
from ...support.files import escape_cell, read_text, write_json, write_text
from ...support.foreign_bytes import parse_toml
from ...support.number_text import format_count, show_rounded
from ...support.version import version
from ..inference import typical_scene
from ..inference.risk_control import bound_risk, count_fewest_grounds
from ..inference.scene_means import FEWEST_EXACT, FEWEST_FOR_MEAN, average_by_scene, find_mean_intervals
from ..matchers.methods import describe_method
from ..measure.render_noise import BAKE, DECIDES, UNKNOWN
from ..report.charts import METHOD_COLOURS, STYLE, add_legend, make_figure, render_svg
from ..report.page_templates import read_template
from ..report.pictures import embed_picture
from ..report.table_columns import Column, format_interval, format_number
from . import pictures
from .calibrated_run import Verdicts
from .rules import SHIPPED_RULES, Rules
from .scores import ROC_FALSE_SAFE_SHARES
from .stored_maps import TRUE_DEPTH

#: Rows, facts of pairs, or entries of the summary, as ``decisions.json`` contains them.
_Entries = Sequence[Mapping[str, Any]]
FORMAT = "icymoon-decisions"
VERSION = 1
_NO_VERDICTS = Verdicts()
#: The files beside the folder ``pairs``, and the first bytes of each.
FIRST_BYTES = {
    "decisions.jsonl": b'{"pair": ',
    "decisions.csv": b"pair,method,status,",
    "decisions.json": b'{\n "format": "icymoon-decisions',
    "decisions.html": b'<!DOCTYPE html>\n<html lang="en">\n<head>\n',
}
#: Most pairs whose maps the page contains.
MAX_PAIRS = 12
#: Share of the lost sites from which on a reason is stated.
_MIN_REASON = 0.01
_MM_PER_M = 1000.0
#: Litres in a cubic metre.
_LITRES_PER_M3 = 1000.0
#: Share of cells with a height by the true depth below which the cells are too small for the images.
_MIN_KNOWN_SHARE = 0.5
#: The risk of an unsafe choice that a guarantee would limit, and one minus its confidence.
_GUARANTEED_RISK, _GUARANTEE_DOUBT = 0.05, 0.05
#: Share of filled heights above which the cells are too small for the images.
_MAX_FILLED_SHARE = 0.2
#: A pair cannot rank matchers if the true depth itself loses more than this share of the safe sites.
MAX_LOST_BY_TRUTH = 0.5
#: Reasons for which a site is not taken, by the names of ``safe_sites.RULE_NAMES``.
_REASONS = {
    "known": "too few of its cells have a height",
    "slope": "it looks too steep",
    "roughness": "it looks too rough",
    "rocks": "a rock looks too near",
    "reach": "it looks out of reach",
    "light": "it looks dark",
    "least_albedo": "its albedo looks too low",
    "most_albedo": "its albedo looks too high",
    "salts": "it shows too little salt",
}
#: Share of the safe sites from which on their loss has its main reason told.
_MUCH_LOST = 0.5
#: Share of the ground in reach below which a part of it is too small to give results.
_MIN_GROUND_SHARE = 0.005
#: The columns of the tables; the key of each is the path of a number in a row.
DEM_COLUMNS = (
    Column("dem.bias_m", "Bias", "mm", 1, "mean height error of the cells in reach that the left image shows"),
    Column("dem.rmse_m", "RMSE", "mm", 1, "root mean square height error"),
    Column("dem.nmad_m", "NMAD", "mm", 1, "1.4826 times the median distance from the median error"),
    Column("dem.le90_m", "LE90", "mm", 1, "90 % of the heights are this near to the truth"),
    Column("dem.completeness", "Known", "%", 1, "share of these cells with a measured height"),
    Column("dem.reached_completeness", "Known in reach", "%", 1, "share of all cells in reach with a measured height"),
    Column("dem.filled", "Filled", "%", 1, "share of all cells in reach in small gaps, whose heights are filled"),
    Column("dem.slope_rmse_deg", "Slope", "°", 2, "root mean square error of the slope under the footprint"),
    Column("dem.roughness_rmse_m", "Roughness", "mm", 1, "root mean square error of the roughness"),
)
SITE_COLUMNS = (
    Column("sites.taken", "Taken", "%", 1, "share of the cells in reach that are classified as safe"),
    Column("sites.false_safe", "Of these unsafe", "%", 1, "of the cells classified as safe, the unsafe ones"),
    Column("sites.safe_lost", "Safe lost", "%", 1, "of the safe cells, those that are not taken"),
    Column("sites.average_precision", "AP", "", 2, "average precision of the margin; a coin has the base rate"),
    Column("sites.roc_area", "ROC area", "", 2, "area under the ROC curve; 0.5 for a coin"),
    Column("sites.regret", "Regret", "", 2, "margin of the best site minus the margin of the chosen one; 1 if unsafe"),
    Column("sites.unsafe_choice", "Choice unsafe", "%", 0, "of the decisions, those whose chosen site is not safe"),
    Column(
        "sites.no_site",
        "None chosen",
        "%",
        0,
        "of the decisions, those without a chosen site although a safe site exists",
    ),
    Column(
        "sites.dangerous",
        "Of these dangerous",
        "%",
        1,
        "of the cells classified as safe, those that miss a limit by more than the tolerance; other unsafe ones are "
        "marginal",
    ),
    Column(
        "sites.dangerous_choice", "Choice dangerous", "%", 0, "of the decisions, those whose chosen site is dangerous"
    ),
)
OTHER_COLUMNS = (
    Column("pads.false_safe", "Pads: unsafe", "%", 1, "of the places classified as safe, the unsafe ones"),
    Column("pads.safe_lost", "Pads: lost", "%", 1, "of the places safe for a pad, those that are not taken"),
    Column("cpu_s.match", "Matching", "s", 2, "processor seconds for a decision"),
    Column("cpu_s.decide", "Decisions", "s", 3, "processor seconds for a decision"),
)
SCOOP_COLUMNS = (
    Column("scoop.error_mm", "Error (mm)", "", 1, "of the middle of the scoop, from its true place"),
    Column("scoop.error_deg", "Turn", "°", 2, "of the scoop from its true direction"),
    Column("scoop.known", "Known", "%", 1, "share of the scoop's pixels with a depth"),
    Column(
        "dem.beside_rmse_m",
        "RMSE beside",
        "mm",
        1,
        "root mean square height error that the pixels left out around the lander would have",
    ),
    Column("dem.beside_bias_m", "Bias beside", "mm", 1, "their mean height error"),
    Column(
        "dem.beside_share",
        "Lost beside",
        "%",
        1,
        "of the cells in reach that the left image shows, those that only the pixels left out know",
    ),
)
MATERIAL_COLUMNS = (
    Column("materials.albedo_bias", "Albedo: bias", "", 3, "mean error of the albedo of the footprints in reach"),
    Column("materials.albedo_rmse", "Albedo: RMSE", "", 3, "root mean square error of it"),
    Column("materials.salt_bias", "Salt: bias", "%", 1, "mean error of the share of salt"),
    Column("materials.salt_rmse", "Salt: RMSE", "%", 1, "root mean square error of it"),
)
COLUMNS = (*DEM_COLUMNS, *SITE_COLUMNS, *OTHER_COLUMNS, *SCOOP_COLUMNS, *MATERIAL_COLUMNS)
#: Numbers from 0 to 1 that are shown as they are, without %.
_PLAIN_SHARES = ("sites.average_precision", "sites.roc_area", "sites.regret")
_INTERVALS_TEXT = (
    f"of shares from 2 scenes on, of other means from {FEWEST_FOR_MEAN} scenes on, approximate below {FEWEST_EXACT}"
)
#: Numbers by which methods are compared. Less is better, except for ``_MORE_IS_BETTER``.
_COMPARED_NUMBERS = ("sites.false_safe", "sites.safe_lost", "sites.average_precision", "dem.rmse_m")
_MORE_IS_BETTER = ("sites.average_precision",)


def read_number(row: Mapping[str, Any], column: Column) -> float:
    """Read a number of a row; NaN if it is undefined."""
    table, _, key = column.key.partition(".")
    numbers = row["numbers"]
    value = None if numbers is None else numbers.get(table, {}).get(key)
    return math.nan if value is None else float(value)


def write_decisions(
    out: Path,
    rows: _Entries,
    facts: _Entries,
    labels: Sequence[str],
    rules: Rules,
    progress: _Entries,
    faults: _Entries,
    failed: _Entries,
    provenance: Mapping[str, Any],
    verdicts: Verdicts = _NO_VERDICTS,
) -> dict[str, Any]:
    """Write ``decisions.csv``, ``.json`` and ``.html``; return the content of the JSON.

    ``rows`` are of all pairs by all ``labels``, pair by pair. Pairs that contradict themselves are left out of all
    means.
    """
    summary = summarise(rows, facts, labels)
    found = compare_methods(rows, facts, labels, int(provenance["seed"]))
    head = [
        *make_head_sentences(summary, facts),
        *verdicts.sentences,
        *_make_volume_sentences(progress, _name_unit(facts)),
        *_make_fault_sentences(faults, _name_unit(facts)),
    ]
    limit = provenance.get("min_confidence")
    notes = [
        *_find_notes_on_suns(facts),
        *([f"Measurements of less confidence than {limit:g} are not used."] if limit else []),
        *find_notes(rows, facts, verdicts.guarantee is None),
        *(note for entry in progress for note in entry["notes"]),
        *dict.fromkeys(entry["note"] for entry in faults if entry["note"]),
    ]
    report = {
        "format": FORMAT,
        "version": VERSION,
        "head": head,
        "summary": summary,
        "comparisons": found,
        "progress": list(progress),
        "faults": list(faults),
        "guarantee": None if verdicts.guarantee is None else dict(verdicts.guarantee),
        "rules": rules.to_json(),
        "failed": list(failed),
        "notes": notes,
        "provenance": {
            **provenance,
            "icymoon": version(),
            "created": datetime.now(UTC).isoformat(" ", "seconds"),
            "intervals": f"95 %, over scenes: {_INTERVALS_TEXT}",
        },
        "rows": list(rows),
    }
    write_text(out / "decisions.csv", _make_csv(rows))
    write_json(out / "decisions.json", report)
    write_text(out / "decisions.html", _render_page(report, rows, facts, labels, rules, out))
    return report


def _make_number_matrix(rows: _Entries, facts: _Entries, label: str) -> tuple[Array, Array]:
    """Return the numbers (pairs, columns) of a method on the pairs without contradictions, and each pair's scene
    (pairs,).
    """
    scene_of = {fact["pair"]: fact["scene"] for fact in facts}
    own = [row for row in rows if row["method"] == label and row["status"] == "ok" and row["pair"] in scene_of]
    names = sorted({scene_of[row["pair"]] for row in own})
    values = np.array([[read_number(row, column) for column in COLUMNS] for row in own]).reshape(-1, len(COLUMNS))
    return values, np.array([names.index(scene_of[row["pair"]]) for row in own], np.intp)


def summarise(rows: _Entries, facts: _Entries, labels: Sequence[str]) -> list[dict[str, Any]]:
    """Summarise each method in a table.

    It has means over pairs by column, their 95 % ``intervals`` over scenes, ``pairs``, ``scenes``, the mean
    ``base_rate`` and the mean ``roc`` curve.
    """
    result = []
    for label in labels:
        values, scenes = _make_number_matrix(rows, facts, label)
        own = [row["numbers"]["sites"] for row in rows if row["method"] == label and row["status"] == "ok"]
        curves = [each["roc"] for each in own if each["roc"] is not None]
        rates = [each["base_rate"] for each in own if each["base_rate"] is not None]
        defined = ~np.isnan(values)
        means = np.divide(
            np.where(defined, values, 0.0).sum(axis=0),
            defined.sum(axis=0),
            out=np.full(len(COLUMNS), np.nan),
            where=defined.any(axis=0),
        )
        bounds = find_mean_intervals(values, scenes, np.array([is_share(column) for column in COLUMNS]))
        result.append(
            {
                "method": label,
                "pairs": len(values),
                "scenes": len(np.unique(scenes)),
                "base_rate": float(np.mean(rates)) if rates else None,
                "refused_by": _average_reasons([each.get("refused_by", {}) for each in own]),
                "lost_by": _average_reasons([each["lost_by"] for each in own if each.get("safe_lost") is not None]),
                "roc": np.mean(curves, axis=0).tolist() if curves else None,
                "chosen": int(sum(each["chosen"] is not None for each in own)),
                "unsafe_chosen": int(sum(each["unsafe_choice"] == 1 for each in own)),
                **{column.key: _none_if_not_finite(means[k]) for k, column in enumerate(COLUMNS)},
                "intervals": {
                    column.key: [_none_if_not_finite(bound) for bound in bounds[k]] for k, column in enumerate(COLUMNS)
                },
            }
        )
    return result


def _average_reasons(shares: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The mean share of each reason over pairs, the largest first."""
    names = {name for each in shares for name in each}
    means = {name: sum(each.get(name, 0.0) for each in shares) / len(shares) for name in names}
    return dict(sorted(means.items(), key=lambda item: (-item[1], item[0])))


def _tell_main_reason(shares: Mapping[str, float], whole: str) -> str:
    """The reason with the largest of the shares of a ``whole``, and its share; empty without a reason."""
    name, share = next(iter(shares.items()), ("", 0.0))
    return f", mainly because {_REASONS[name]} ({_format_percent(share)} of 100 {whole})" if share else ""


def is_share(column: Column) -> bool:
    """Return whether a number is a share, from 0 to 1."""
    return column.unit == "%" or column.key in _PLAIN_SHARES


def _none_if_not_finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def compare_methods(rows: _Entries, facts: _Entries, labels: Sequence[str], seed: int) -> list[dict[str, Any]]:
    """Return the significant differences between matchers in the typical scene, paired over scenes.

    For each number, all comparisons are one family (see ``inference.typical_scene``). The better matcher comes first,
    with the typical difference.
    """
    matchers = list(labels[1:])
    chosen = typical_scene.list_method_pairs(len(matchers))
    scene_of = {fact["pair"]: fact["scene"] for fact in facts}
    found: list[dict[str, Any]] = []
    if not chosen:
        return found
    for key in _COMPARED_NUMBERS:
        column = next(each for each in COLUMNS if each.key == key)
        of = {(row["pair"], row["method"]): read_number(row, column) for row in rows if row["status"] == "ok"}
        pairs = sorted(scene_of, key=lambda pair: scene_of[pair])
        scenes = np.unique([scene_of[pair] for pair in pairs], return_inverse=True)[1]
        if not pairs:
            continue
        numbers = np.array([[of.get((pair, matcher), math.nan) for matcher in matchers] for pair in pairs])
        values = np.stack([typical_scene.find_differences(numbers[:, i], numbers[:, j]) for i, j in chosen], axis=1)
        family = typical_scene.compare_in_typical_scene(average_by_scene(values, scenes), seed)
        for k, (i, j) in enumerate(chosen):
            if family.found[k]:
                first = (family.typical[k] < 0) != (key in _MORE_IS_BETTER)
                found.append(
                    {
                        "metric": key,
                        "better": matchers[i if first else j],
                        "worse": matchers[j if first else i],
                        "typical": abs(float(family.typical[k])),
                        "typical_interval": sorted(abs(float(each)) for each in (family.low[k], family.high[k])),
                        "p": float(family.p[k]),
                        "scenes": int(family.scenes[k]),
                    }
                )
    return found


def make_head_sentences(summary: _Entries, facts: _Entries) -> list[str]:
    """Describe the main results, one sentence per method, limited to claims that the numbers support."""
    heights = sorted({round(float(fact["sun_elevation_deg"])) for fact in facts})
    suns = f"under {_describe_suns(facts)}, the last" if _has_suns(facts) else "with the Sun"
    sun = f", {suns} at {_format_range(heights)}°" if heights else ""
    return [sentence for entry in summary if (sentence := _make_head_sentence(entry, sun, _name_unit(facts)))]


def _has_suns(facts: _Entries) -> bool:
    """Return whether a site is decided on by several Suns."""
    return any("suns" in fact for fact in facts)


def _name_unit(facts: _Entries) -> str:
    """Return the noun for the subject of a decision: a pair, or a site whose Suns are fused."""
    return "site" if _has_suns(facts) else "pair"


def _describe_suns(facts: _Entries) -> str:
    """Describe how many Suns the sites have."""
    numbers = sorted({len(fact.get("suns", [fact])) for fact in facts})
    return f"{_format_range(numbers)} Suns"


def _format_range(values: Sequence[int]) -> str:
    """Format the first and the last of sorted values in words."""
    return f"{values[0]}" if len(values) == 1 else f"{values[0]} to {values[-1]}"


def _make_head_sentence(entry: Mapping[str, Any], sun: str, unit: str) -> str:
    # Without a completeness, no image shows ground in reach.
    if not entry["pairs"] or entry["dem.completeness"] is None:
        return ""
    name = "the true depth" if entry["method"] == TRUE_DEPTH else describe_method(entry["method"])
    scenes = format_count(entry["scenes"], "scene")
    lost = entry["sites.safe_lost"]
    unsafe = entry["sites.false_safe"]
    if unsafe is None or entry["sites.taken"] < _MIN_GROUND_SHARE:
        much = "no" if unsafe is None else "hardly any"
        base_rate, why = entry["base_rate"], _tell_main_reason(entry["refused_by"], "sites")
        if base_rate == 0:
            return f"No site is safe by the rules; with {name}{sun}, {much} site looks safe{why} ({scenes})."
        but = "although" if base_rate and base_rate >= _MIN_GROUND_SHARE else "and"
        safe = "" if base_rate is None else f", {but} {_format_percent(base_rate)} of 100 are safe"
        return f"With {name}{sun}, {much} site looks safe{why}{safe} ({scenes})."
    why = _tell_main_reason(entry["lost_by"], "safe ones") if lost is not None and lost >= _MUCH_LOST else ""
    between = _format_interval(entry, "sites.false_safe")
    chosen = "place" if unit == "site" else "site"  # "site" already names the pairs
    return (
        f"With {name}{sun}, {_format_percent(unsafe)} of 100 sites that look safe are not{between}"
        f"{'' if lost is None else f', and {_format_percent(lost)} of 100 safe ones are lost{why}'}; it would choose a "
        f"{chosen} in "
        f"{entry['chosen']} of {format_count(entry['pairs'], unit)}, an unsafe one in "
        f"{entry['unsafe_chosen']} ({scenes})."
    )


def _format_interval(entry: Mapping[str, Any], key: str) -> str:
    """Format the interval of a share over scenes, such as ' (29 to 71)'; empty without an interval."""
    low, high = entry["intervals"][key]
    if low is None or high is None:
        return ""
    return f" ({100 * low:.0f} to {100 * high:.0f})"


def _make_volume_sentences(progress: _Entries, unit: str) -> list[str]:
    """Describe the smallest volume that each method detects, if null pairs give it."""
    said = []
    for entry in progress:
        if entry["smallest_m3"] is not None and entry["method"] != TRUE_DEPTH:
            least, low, high = (
                show_rounded(_LITRES_PER_M3 * value) for value in (entry["smallest_m3"], *entry["bounds_m3"])
            )
            nulls = format_count(entry["null_pairs"], unit)
            said.append(
                f"With {describe_method(entry['method'])}, a dug volume is noticed from {least} L "
                f"on (between {low} and {high} L, from {nulls} with nothing dug)."
            )
    return said


def _make_fault_sentences(faults: _Entries, unit: str) -> list[str]:
    """Describe for each method, in one sentence, the fault of each joint from which on all faults were detected."""
    found = []
    for method in dict.fromkeys(entry["method"] for entry in faults):
        own = [entry for entry in faults if entry["method"] == method and entry["limit_mm"] is not None]
        if own and method != TRUE_DEPTH:
            joints = ", ".join(
                f"{entry['joint']} "
                + (
                    f"from {entry['noticed_from_deg']:g}°"
                    if entry["noticed_from_deg"] is not None
                    else f"not always, up to {entry['angles'][-1]['deg']:g}°"
                )
                for entry in own
            )
            found.append(
                f"With {describe_method(method)}, these faults of a joint are noticed: {joints} (limit "
                f"from {format_count(own[0]['sound'], unit)} without a fault)."
            )
    return found


def _format_percent(share: float) -> str:
    return f"{100 * share:.0f}" if share == 0 or share >= 0.005 else "fewer than 1"


def find_notes(rows: _Entries, facts: _Entries, on_choices: bool = True) -> list[str]:
    """Return sentences on the limits of the numbers.

    ``on_choices`` includes the risk of a choice without a guarantee.
    """
    advice = dict.fromkeys(said for fact in facts for said in (fact.get("excavation") or {}).get("advice", []))
    return [
        *_find_notes_on_heights(rows, facts),
        *_find_notes_on_truth(rows, _name_unit(facts)),
        *_find_notes_on_noise(facts),
        *_find_notes_on_pairs(rows, facts),
        *advice,
        *_find_notes_on_scenes(rows, facts),
        *(_find_notes_on_choices(rows, facts) if on_choices else ()),
    ]


def _find_notes_on_suns(facts: _Entries) -> Iterator[str]:
    if _has_suns(facts):
        yield (
            f"Each site is decided on once, by the joined disparities of its pairs under {_describe_suns(facts)}; "
            "light, contrast and name are of the last pair, the one of the latest date, or of the last name without "
            "dates."
        )


def _find_notes_on_heights(rows: _Entries, facts: _Entries) -> Iterator[str]:
    all_pairs = format_count(len(facts), _name_unit(facts))
    unseen = sum(not fact["exact"] for fact in facts)
    if unseen:
        yield (
            f"In {unseen} of {all_pairs} there are no true heights (workspace.cell_m is 0), so the truth is "
            "the true depth of both eyes: ground that neither eye sees is not known, and counts nowhere."
        )
    shown = [row["numbers"]["dem"]["completeness"] for row in rows if row["method"] == TRUE_DEPTH and row["numbers"]]
    hidden = shown.count(None)
    if hidden:
        yield (
            f"The left image of {hidden} of {all_pairs} shows no cell in reach, so no site is found in "
            "them, whatever the matcher; aim the camera at the workspace to judge sites."
        )
    known = [share for share in shown if share is not None]
    if known and np.mean(known) < _MIN_KNOWN_SHARE:
        yield (
            f"Cells have too few pixels of these images: even the true depth knows only "
            f"{100 * np.mean(known):.0f} % of those that the left image shows; raise workspace.cell_m, or "
            "--cell-m for pairs without true heights."
        )
    filled = [row["numbers"]["dem"].get("filled") for row in rows if row["method"] == TRUE_DEPTH and row["numbers"]]
    shares = [share for share in filled if share is not None]
    if shares and np.mean(shares) > _MAX_FILLED_SHARE:
        yield (
            f"Cells have too few pixels of these images: even with the true depth {100 * np.mean(shares):.0f} % of the "
            "heights in reach are filled from neighbours; raise workspace.cell_m, or --cell-m for pairs without true "
            "heights."
        )


def _find_notes_on_truth(rows: _Entries, unit: str) -> Iterator[str]:
    """Yield the sites that the true depth loses, by reason, and the pairs that cannot rank matchers."""
    own = {row["pair"]: row["numbers"]["sites"] for row in rows if row["method"] == TRUE_DEPTH and row["numbers"]}
    lost = {pair: sites["safe_lost"] for pair, sites in own.items() if sites["safe_lost"] is not None}
    if any(lost.values()):
        shares = {
            name: sum(own[pair]["lost_by"].get(name, 0.0) for pair in lost) / sum(lost.values()) for name in _REASONS
        }
        reasons = sorted((name for name in shares if shares[name] >= _MIN_REASON), key=lambda name: -shares[name])
        yield (
            f"The true depth loses {_format_percent(sum(lost.values()) / len(lost))} of 100 safe sites: "
            + ", ".join(f"in {100 * shares[name]:.0f} % of these {_REASONS[name]}" for name in reasons)
            + ". No matcher can be expected to lose fewer."
        )
    poor = sorted(pair for pair, share in lost.items() if share > MAX_LOST_BY_TRUTH)
    empty = sorted(pair for pair, sites in own.items() if sites["cells"][0] and not sites["cells"][1])
    for pairs, reason in (
        (poor, f"even the true depth loses more than {100 * MAX_LOST_BY_TRUTH:.0f} % of the safe sites"),
        (empty, "no site is safe; try flatter ground, a longer reach or looser rules"),
    ):
        if pairs:
            cannot = f"{format_count(len(pairs), unit)} ({', '.join(pairs[:5])}) cannot rank matchers"
            yield f"{cannot}, because {reason}."


def _find_notes_on_noise(facts: _Entries) -> Iterator[str]:
    noises = [each.get("noise") or {} for fact in facts for each in fact.get("suns", [fact])]
    all_pairs = f"{format_count(len(noises), 'pair')}{' under all Suns' if _has_suns(facts) else ''}"
    by_bake = sum(noise.get("verdict") == DECIDES and noise.get("larger") == BAKE for noise in noises)
    if by_noise := sum(noise.get("verdict") == DECIDES for noise in noises) - by_bake:
        yield (
            f"Noise of the render decides the result in {by_noise} of {all_pairs}: heights are rougher "
            "than those of a camera's own noise, and sites look less safe; raise quality.samples."
        )
    if by_bake:
        yield (
            f"Noise of baked light decides the result in {by_bake} of {all_pairs}: matchers take it for "
            "texture, so heights look better than they are; raise quality.bake_samples."
        )
    if unknown := sum(noise.get("verdict") == UNKNOWN for noise in noises):
        yield (
            f"The noise of baked light is unknown in {unknown} of {all_pairs}, which an older version of Icy "
            "Moon rendered: heights may look better than they are; render them again into another data set."
        )


def _find_notes_on_pairs(rows: _Entries, facts: _Entries) -> Iterator[str]:
    unit = _name_unit(facts)
    all_pairs = format_count(len(facts), unit)
    suspect = sorted({row["pair"] for row in rows if row["status"] == "suspect"})
    if suspect:
        of_pair = " with a pair" if unit == "site" else ""
        yield (
            f"No mean contains {format_count(len(suspect), unit)}{of_pair} whose eyes contradict each other or the "
            f"truth: {', '.join(suspect[:5])}."
        )
    if not all(fact.get("arm") for fact in facts):
        yield "No arm is stated, so all ground counts as ground in reach."
    empty = {row["pair"] for row in rows if row["numbers"] and not row["numbers"]["sites"]["cells"][0]}
    if empty:
        yield (
            f"In {len(empty)} of {all_pairs} no cell of the workspace is in reach and known, so "
            "there is nothing to decide; move the workspace, the arm or the camera."
        )


def _find_notes_on_scenes(rows: _Entries, facts: _Entries) -> Iterator[str]:
    scenes = len({fact["scene"] for fact in facts})
    matchers = len({row["method"] for row in rows} - {TRUE_DEPTH})
    if scenes < (needed := typical_scene.count_scenes_for_methods(matchers)):
        counted = "One scene gives no interval, and" if scenes == 1 else f"With {scenes} scenes"
        between = f"{matchers} matchers" if matchers > 1 else "matchers"
        yield f"{counted} no difference between {between} can be shown; it takes {needed}."


def _find_notes_on_choices(rows: _Entries, facts: _Entries) -> Iterator[str]:
    """Yield the largest risk of an unsafe choice that the grounds leave, or the number of grounds that a statement
    needs.

    A ground counts once: as unsafe if the choice on any of its pairs is unsafe.
    """
    fewest = count_fewest_grounds(_GUARANTEED_RISK, _GUARANTEE_DOUBT)
    ground_of = {fact["pair"]: fact.get("site") or fact["scene"] for fact in facts}
    grounds = len(set(ground_of.values()))
    matchers = list(dict.fromkeys(row["method"] for row in rows if row["method"] != TRUE_DEPTH))
    if not matchers:
        return
    if grounds < fewest:
        yield (
            f"{format_count(grounds, 'ground')} cannot show that at most {100 * _GUARANTEED_RISK:g} % of the chosen "
            f"sites are unsafe, with {100 * (1 - _GUARANTEE_DOUBT):g} % confidence: it takes {fewest} grounds without "
            "an unsafe choice. Pairs and Suns of one ground count as one."
        )
        return
    for matcher in matchers:
        own = {row["pair"]: row for row in rows if row["method"] == matcher and row["status"] == "ok"}
        known = {ground_of[pair] for pair in own if pair in ground_of}
        unsafe = {
            ground_of[pair]
            for pair, row in own.items()
            if pair in ground_of and row["numbers"]["sites"]["unsafe_choice"] == 1
        }
        yield (
            f"With {describe_method(matcher)}, the choice is unsafe on {len(unsafe)} of "
            f"{format_count(len(known), 'ground')}, and with {100 * (1 - _GUARANTEE_DOUBT):g} % confidence on at most "
            f"{100 * bound_risk(len(unsafe), len(known), _GUARANTEE_DOUBT):.1f} % of grounds of this kind."
        )


def _make_csv(rows: _Entries) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    keys = (column.key for column in COLUMNS)
    writer.writerow(["pair", "method", "status", "base_rate", *keys, "chosen_margin", "guarantee", "suns"])
    for row in rows:
        rate = row["numbers"]["sites"]["base_rate"] if row["numbers"] else None
        numbers = [read_number(row, column) for column in COLUMNS]
        writer.writerow(
            [
                escape_cell(row["pair"]),
                escape_cell(row["method"]),
                row["status"],
                "" if rate is None else f"{rate:.6g}",
                *("" if math.isnan(number) else f"{number:.6g}" for number in numbers),
                *_list_guarantee_cells(row),
                row.get("suns", 1),
            ]
        )
    return stream.getvalue()


def _list_guarantee_cells(row: Mapping[str, Any]) -> tuple[str, str]:
    """Return the margin of the chosen site, and the verdict of a calibration; empty where undefined."""
    margin = row["numbers"]["sites"]["chosen_margin"] if row["numbers"] else None
    verdict = row.get("guarantee")
    return "" if margin is None else f"{margin:.6g}", verdict["verdict"] if verdict else ""


def _render_page(
    report: Mapping[str, Any],
    rows: _Entries,
    facts: _Entries,
    labels: Sequence[str],
    rules: Rules,
    out: Path,
) -> str:
    sources = parse_toml(read_text(SHIPPED_RULES))["sources"]
    shipped = {part: parse_toml(read_text(SHIPPED_RULES))[part] for part in rules.to_json()}
    stated = [
        (f"{part}.{key}", value, sources[f"{part}.{key}"] if shipped[part].get(key) == value else "Stated by --rules")
        for part, table in rules.to_json().items()
        for key, value in table.items()
    ]
    titles = {column.key: column.title for column in COLUMNS}
    return read_template("decisions.html.j2", Path(__file__).parent).render(
        report=report,
        groups=(
            ("Sites", SITE_COLUMNS),
            ("Elevation model", DEM_COLUMNS),
            ("Landing pads and cost", OTHER_COLUMNS),
            *((("The arm", SCOOP_COLUMNS),) if _has_numbers(rows, "scoop") else ()),
            *((("Albedo and salts", MATERIAL_COLUMNS),) if _has_numbers(rows, "materials") else ()),
        ),
        cell=format_cell,
        bounds=_format_bounds,
        apart=_format_difference,
        how=_INTERVALS_TEXT if any(entry["scenes"] > 1 for entry in report["summary"]) else "",
        titles=titles,
        choice_of=_describe_choice,
        unit=_name_unit(facts),
        roc=_draw_roc(report["summary"], _name_unit(facts)),
        rules=stated,
        changes=[
            {"entry": entry, "step": step, "map": embed_picture(out / step["map"], 10_000)}
            for entry in report["progress"]
            for step in entry["steps"][-1:]
            if step["map"]
        ],
        fault_angles=sorted({angle["deg"] for entry in report["faults"] for angle in entry["angles"]}),
        outcomes=pictures.OUTCOMES,
        codes=pictures.RULE_COLOURS,
        full_mm=pictures.SATURATED_ERROR_M * _MM_PER_M,
        pairs=[_make_pair_section(fact, rows, out) for fact in facts[:MAX_PAIRS]],
        more=max(0, len(facts) - MAX_PAIRS),
    )


def _has_numbers(rows: _Entries, table: str) -> bool:
    return any(row["numbers"] and table in row["numbers"] for row in rows)


def _scale_to_unit(entry: Mapping[str, Any], column: Column) -> dict[str, Any]:
    value = entry[column.key]
    return {column.key: value * _MM_PER_M if value is not None and column.unit == "mm" else value}


def format_cell(entry: Mapping[str, Any], column: Column) -> str:
    """Format the mean of a method in the unit of its column; a dash if it is undefined."""
    return format_number(_scale_to_unit(entry, column), column)


def _format_bounds(entry: Mapping[str, Any], column: Column) -> str:
    factor = _MM_PER_M if column.unit == "mm" else 1.0
    low, high = (None if bound is None else factor * bound for bound in entry["intervals"][column.key])
    return format_interval([low, high], column)


def _format_difference(found: Mapping[str, Any]) -> str:
    """Format the typical difference of a comparison in the unit of its column, with its interval."""
    column = next(each for each in COLUMNS if each.key == found["metric"])
    factor, unit = (_MM_PER_M, " mm") if column.unit == "mm" else (1.0, " points" if column.unit == "%" else "")
    low, high = (format_number({column.key: factor * each}, column) for each in found["typical_interval"])
    return f"by {format_number({column.key: factor * found['typical']}, column)}{unit}, {low} to {high}"


def _describe_choice(sites: Mapping[str, Any]) -> str:
    """Describe the chosen site beside the truth in words."""
    if sites["chosen"] is None:
        return "no site chosen"
    if sites["dangerous_choice"]:
        return "chosen site: dangerous"
    if sites["unsafe_choice"]:
        return "chosen site: marginal"
    return f"chosen site: safe, regret {sites['regret']:.2f}"


def _make_pair_section(fact: Mapping[str, Any], rows: _Entries, out: Path) -> dict[str, Any]:
    own = [row for row in rows if row["pair"] == fact["pair"] and row["images"]]
    return {
        "fact": fact,
        "left": embed_picture(out / fact["images"]["left"], fact["height_px"], linear=True),
        "truth": embed_picture(out / fact["images"]["truth"], 10_000),
        "methods": [
            {
                "row": row,
                "sites": row["numbers"]["sites"],
                **{kind: embed_picture(out / row["images"][kind], 10_000) for kind in ("outcome", "error")},
            }
            for row in own
        ],
    }


def _draw_roc(summary: _Entries, unit: str) -> str:
    """Draw the mean ROC curves of the methods over pairs or sites, the ``unit``, as SVG."""
    with matplotlib.rc_context(STYLE):
        figure, axes = make_figure(1, width=5.2, height=4.2)
        axis = axes[0, 0]
        axis.plot([0, 1], [0, 1], color="#999999", linestyle=":", linewidth=1)
        drawn = [entry for entry in summary if entry["roc"] is not None]
        for k, entry in enumerate(drawn):
            truth = entry is summary[0]
            axis.plot(
                ROC_FALSE_SAFE_SHARES,
                entry["roc"],
                label=describe_method(entry["method"])[:24],
                linestyle="--" if truth else "-",
                color="#6f7f8f" if truth else METHOD_COLOURS[(k - 1) % len(METHOD_COLOURS)],
            )
        axis.set_xlabel("Unsafe cells classified as safe (share)")
        axis.set_ylabel("Safe cells taken (share)")
        add_legend(figure, axis, 3)
        return render_svg(figure, "roc", f"ROC curves of the margin, means over {unit}s")
