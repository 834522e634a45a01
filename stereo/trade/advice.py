"""The advice of a trade in words: the variant to use, the saving by each group, and the uncertainty from noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...render.cost.error_tolerance import Tolerance, combine_verdicts
from ...render.cost.quality_variants import SHAPES
from ..matchers.methods import describe_method
from .quality_losses import find_number, find_pareto_front, find_plain_methods
from .same_decisions import describe_decisions

#: Tolerances of extra disparity error, px, for which advice is given.
TOLERANCES_PX = (0.01, 0.02, 0.05, 0.1)
#: Tolerances of extra pixels that are wrong or missing, as a share, for a matcher that range points help.
_MORE_WRONG_SHARES = (0.0, 0.005, 0.01, 0.02)
#: Largest change of the light, as a share, that counts as none, and that advice for matchers allows.
_UNCHANGED_LIGHT_SHARE, _MAX_LIGHT_CHANGE_SHARE = 0.002, 0.01
#: Share of the pixels that a matcher may lose without a note.
_UNREPORTED_LOSS_SHARE = 0.01
#: Share of the time that a cheaper variant must save, because processor seconds vary by some per cent.
_MIN_SAVED_SHARE = 0.05

Row = Mapping[str, Any]


def make_variant_advice(rows: Sequence[Row], methods: Sequence[str]) -> list[str]:
    """Write sentences on the cheapest variant within each tolerance for each matcher, and on the savings by
    each group.
    """
    scene = next(row for row in rows if row["group"] == "scene")
    margin = _find_time_margin(rows)
    return [
        line for name, each in _list_subjects(methods) for line in _make_matcher_advice(name, each, rows, scene, margin)
    ] + _make_group_advice(rows, scene, methods, margin)


def _list_subjects(methods: Sequence[str]) -> list[tuple[str, Sequence[str]]]:
    """List the subjects of advice with their methods: all matchers if there are several, then each matcher."""
    several = [("all matchers", methods)] if len(methods) > 1 else []
    return [*several, *((describe_method(method), [method]) for method in methods)]


def make_decision_advice(rows: Sequence[Row], methods: Sequence[str], references: Sequence[Row]) -> list[str]:
    """Write a line, for all matchers and for each, on the cheapest variant that leads to the same decisions as the
    reference, or the reason why no variant is named.
    """
    alike = [row for row in rows if row["group"] not in SHAPES and row["cpu_s"] is not None and row["decisions"]]
    if not alike:
        return [reference["undecided"] for reference in references[:1] if reference["undecided"]]
    scene, margin = next(row for row in rows if row["group"] == "scene"), _find_time_margin(rows)
    return [
        _make_decision_line(name, each, alike, scene, margin, references[0]) for name, each in _list_subjects(methods)
    ]


def _make_decision_line(
    name: str, methods: Sequence[str], rows: Sequence[Row], scene: Row, margin: float, reference: Row
) -> str:
    same = {row["key"]: combine_verdicts(row["decisions"][method]["same"] for method in methods) for row in rows}
    best = _find_cheapest([row for row in rows if same[row["key"]]], margin)
    if best is not None:
        differs = describe_decisions(best["decisions"][methods[0]]) if len(methods) == 1 else ""
        idle = [describe_method(method) for method in methods if best["decisions"][method]["taken"] == 0]
        empty = f"; but {' and '.join(idle)} found no safe site on the reference, so that tells little" if idle else ""
        return (
            f"{name}, the same decisions as the reference: “{best['name']}”, {best['cpu_s']:.1f} CPU seconds a pair"
            f"{_format_ratio(scene, best, margin)}{differs and f', decides {differs}'}{empty}."
        )
    own = combine_verdicts(found["same"] for label, found in reference["own_decisions"].items() if label in methods)
    if own is False or None in same.values():
        return (
            f"{name}: noise leaves open which variant leads to the same decisions as the reference; give more "
            "reference samples, or a larger scale."
        )
    return f"{name}: no variant leads to the same decisions as the reference; give more samples."


def make_fusion_advice(rows: Sequence[Row], methods: Sequence[str]) -> list[str]:
    """Write lines for each matcher that is joined with range points: the cheapest variants on which both together are
    nearly as good as the matcher alone on an image without noise, one for each tolerance. [] unless the joined and the
    plain matcher are both among ``methods``.
    """
    shown = [row for row in rows if _shows_this_scene(row)]
    scene, margin = next(row for row in rows if row["group"] == "scene"), _find_time_margin(rows)
    return [
        line
        for fused, plain in find_plain_methods(methods).items()
        for line in _make_fusion_lines(fused, plain, shown, scene, margin)
    ]


def _make_fusion_lines(fused: str, plain: str, rows: Sequence[Row], scene: Row, margin: float) -> list[str]:
    """Write the lines of one method, judged by the pixels that are missing or wrong by more than 1 px. A matcher alone
    leaves pixels out, so means over measured pixels would compare different pixels.
    """
    start = f"{describe_method(fused)} in place of {describe_method(plain)}"
    lines: list[str] = []
    hidden, before = [], None
    for share in _MORE_WRONG_SHARES:
        within = {
            row["key"]: Tolerance(None, share).allows(row["fused"][fused]["loss"], row["fused"][fused]["doubt"])
            for row in rows
        }
        best = _find_cheapest([row for row in rows if within[row["key"]]], margin)
        if best is None:
            hidden += [f"{100 * share:g} %"] * (None in within.values())
        elif best is not before:
            before = best
            together = _format_wrong(best["fused"][fused]["loss"], best["fused"][fused]["doubt"])
            alone = _format_wrong(best["loss"][plain], best["loss_doubt"][plain])
            lines.append(
                f"{start}, at most {100 * share:g} % more pixels wrong or missing: “{best['name']}”, "
                f"{best['cpu_s']:.1f} CPU seconds a pair{_format_ratio(scene, best, margin)}, adds {together}; without "
                f"the points {alone}."
            )
    if hidden:
        lines.append(
            f"{start}: noise hides which variants are within {' or '.join(hidden)}; give a larger scale or more "
            "reference samples."
        )
    return lines or [f"{start}: no variant is within {100 * _MORE_WRONG_SHARES[-1]:g} %; give more points or samples."]


def _format_wrong(loss: Mapping[str, float | None], doubt: Mapping[str, float | None]) -> str:
    """Format the change of the share of wrong or missing pixels, such as '-3.1 ± 0.4 %'."""
    value, spread = loss["wrong_or_missing"], doubt["wrong_or_missing"]
    if value is None:
        return "an unknown share"
    return f"{100 * value:+.1f}{'' if spread is None else f' ± {100 * spread:.1f}'} %"


def find_pareto_fronts(rows: Sequence[Row], methods: Sequence[str]) -> dict[str, list[Row]]:
    """Find, for the radiance and for each matcher, the variants that no other beats in both cost and error, cheapest
    first.

    Variants of another shape are left out, because their errors are relative to another image. For matchers, variants
    with other light are left out too.
    """
    alike = [row for row in rows if row["group"] not in SHAPES]
    shown = [row for row in rows if _shows_this_scene(row)]
    return {
        "radiance": [alike[k] for k in find_pareto_front(alike, ("rmse",))],
        **{method: [shown[k] for k in find_pareto_front(shown, ("loss", method, "epe_px"))] for method in methods},
    }


def find_distinct_steps(found: Sequence[Row], label: str) -> list[Row]:
    """Find the variants of a front that are certainly better than the variants before them; the others differ only by
    noise.
    """
    kept: list[Row] = []
    for row in found:
        if not kept or _find_front_error(kept[-1], label)[0] - _find_front_error(row, label)[0] > math.hypot(
            _find_front_error(kept[-1], label)[1], _find_front_error(row, label)[1]
        ):
            kept.append(row)
    return kept


def _find_front_error(row: Row, label: str) -> tuple[float, float]:
    """Find the error of a variant on a front, and its uncertainty from noise, which is a tenth for the radiance."""
    if label == "radiance":
        return row["rmse"], 0.1 * row["rmse"]
    return row["loss"][label]["epe_px"], row["loss_doubt"][label]["epe_px"] or 0.0


def _find_time_margin(rows: Sequence[Row]) -> float:
    """Find the share of the time by which two variants must differ: twice the standard deviation of the difference
    between repeats.
    """
    spreads = [
        math.log(row["cpu_range"][1] / row["cpu_range"][0]) ** 2 / 2
        for row in rows
        if row["cpu_range"] and row["cpu_range"][0] > 0
    ]
    repeated = any(row["cpu_range"] and row["cpu_range"][1] > row["cpu_range"][0] for row in rows)
    return max(_MIN_SAVED_SHARE, 2 * (sum(spreads) / len(spreads)) ** 0.5) if repeated else 2 * _MIN_SAVED_SHARE


def _format_perhaps(row: Row, methods: Sequence[str]) -> str:
    """Write the end of a line for a cheaper variant that is possibly within the tolerance."""
    return f"; perhaps “{row['name']}”, {row['cpu_s']:.1f} s, {_format_worst_loss(row, methods)}"


def _make_matcher_advice(
    name: str, methods: Sequence[str], rows: Sequence[Row], scene: Row, margin: float
) -> list[str]:
    """Write a line for each tolerance: the cheapest variant that is certainly within it for all ``methods``, and a
    cheaper variant that is possibly within it.
    """
    lines: list[str] = []
    hidden, before = [], None
    shown = [row for row in rows if _shows_this_scene(row)]
    for px in TOLERANCES_PX:
        keeps = {
            row["key"]: combine_verdicts(
                Tolerance(px, None).allows(row["loss"][method], row["loss_doubt"][method]) for method in methods
            )
            for row in shown
        }
        best = _find_cheapest([row for row in shown if keeps[row["key"]]], margin)
        perhaps = _find_cheapest(
            [
                row
                for row in shown
                if keeps[row["key"]] is None
                and all((find_number(row, "loss", method, "epe_px") or 0.0) <= px for method in methods)
                and (best is None or _is_cheaper(row, best, margin))
            ],
            margin,
        )
        if best is None:
            hidden += [f"{px:g} px"] * (perhaps is not None)
        elif best is not before:
            before = best
            cheaper = "" if perhaps is None else _format_perhaps(perhaps, methods)
            lines.append(
                f"{name}, within {px:g} px: “{best['name']}”, {best['cpu_s']:.1f} CPU seconds a pair"
                f"{_format_ratio(scene, best, margin)}, adds {_format_worst_loss(best, methods)}{cheaper}."
            )
    if hidden:
        lines.append(
            f"{name}: noise hides here which variants are within {' or '.join(hidden)}; give a larger scale "
            "or more reference samples."
        )
    return lines or [f"{name}: no variant is within {TOLERANCES_PX[-1]:g} px; give more samples."]


def _format_worst_loss(row: Row, methods: Sequence[str]) -> str:
    """Format the loss of the matcher that loses most, with its name if there are several."""
    worst = max(methods, key=lambda method: find_number(row, "loss", method, "epe_px") or 0.0)
    loss = format_loss(row, worst)
    return f"at most {loss}, of {describe_method(worst)}" if len(methods) > 1 else loss


def _find_cheapest(rows: Sequence[Row], margin: float) -> Row | None:
    """Find the cheapest row. Among rows with the same time, within the ``margin``, it is the first: the scene as
    described comes first, then the least changed variants.
    """
    least = min(rows, key=lambda row: row["cpu_s"], default=None)
    return least and next(row for row in rows if not _is_cheaper(least, row, margin))


def _shows_this_scene(row: Row) -> bool:
    """Return whether a variant keeps the shape and the light of this scene."""
    return row["group"] not in SHAPES and row["cpu_s"] is not None and abs(row["bias"]) <= _MAX_LIGHT_CHANGE_SHARE


def format_loss(row: Row, method: str) -> str:
    """Format the loss of a matcher, such as '+0.031 ± 0.012 px', and of measured pixels if that is more than noise."""
    doubt = row["loss_doubt"][method]["epe_px"]
    return (
        f"{row['loss'][method]['epe_px']:+.3f}{f' ± {doubt:.3f}' if doubt is not None else ''} px"
        f"{format_coverage(row['loss'][method], row['loss_doubt'][method])}"
    )


def format_coverage(loss: Mapping[str, float | None], doubt: Mapping[str, float | None]) -> str:
    """Describe the pixels that a matcher no longer measures, and that its mean error therefore excludes; "" if they are
    few or noise.
    """
    missing = loss["coverage"]
    if missing is None or missing - (doubt["coverage"] or 0.0) <= _UNREPORTED_LOSS_SHARE:
        return ""
    return f" with {100 * missing:.0f} % fewer pixels measured"


def _format_ratio(scene: Row, best: Row, margin: float) -> str:
    if _is_cheaper(best, scene, margin):
        return f" ({scene['cpu_s'] / best['cpu_s']:.1f} times less than as described)"
    return f" ({best['cpu_s'] / scene['cpu_s']:.1f} times as much)" if _is_cheaper(scene, best, margin) else ""


def _make_group_advice(rows: Sequence[Row], scene: Row, methods: Sequence[str], margin: float) -> list[str]:
    """Write a line for each group except the samples: the cheapest variant that is as good as the scene, if it saves
    time.
    """
    lines = []
    for group in dict.fromkeys(row["group"] for row in rows if row["group"] not in ("scene", "samples")):
        own = [row for row in rows if row["group"] == group and row["cpu_s"] and row["bias"] is not None]
        if group == "shortcuts":
            lines += [
                f"{group}: “{row['name']}” changes {_format_light(row, scene)} and {_format_time(row, scene, margin)}."
                for row in own
            ]
            continue
        same = [
            row
            for row in own
            if abs(row["bias"]) <= max(_UNCHANGED_LIGHT_SHARE, min(row["bias_doubt"] or 0.0, _MAX_LIGHT_CHANGE_SHARE))
            and (row["depth_px"] or 0.0) <= TOLERANCES_PX[0]
            and (group in SHAPES or not any(_is_worse(row, scene, method) for method in methods))
        ]
        best = _find_cheapest(same, margin)
        if best is not None and _is_cheaper(best, scene, margin):
            added = "" if group in SHAPES else ", adds no measurable disparity error,"
            lines.append(
                f"{group}: “{best['name']}” changes {_format_light(best, None)}{added} and "
                f"{_format_time(best, scene, margin)}."
            )
        elif best is not None:
            lines.append(f"{group}: no variant is cheaper without changing the images; leave it as it is.")
        elif own:
            nearest = min(own, key=lambda row: row["rmse"])
            lines.append(
                f"{group}: every variant changes the images or the depth; “{nearest['name']}” changes them "
                f"least, {_format_light(nearest, None)}, the depth by {nearest['depth_px'] or 0.0:.3f} px."
            )
    return lines


def _is_worse(row: Row, scene: Row, method: str) -> bool:
    """Return whether a matcher certainly has larger errors, or measures less, than on the scene as described."""
    if row is scene:
        return False
    for key in ("epe_px", "wrong_or_missing"):
        own, other = (find_number(each, "loss", method, key) for each in (row, scene))
        doubts = [find_number(each, "loss_doubt", method, key) or 0.0 for each in (row, scene)]
        if own is None or (other is not None and own - other > math.hypot(*doubts)):
            return True
    return False


def _is_cheaper(row: Row, other: Row, margin: float) -> bool:
    """Return whether a variant certainly takes less time than another."""
    return bool(row["cpu_s"] and other["cpu_s"] and row["cpu_s"] < (1 - margin) * other["cpu_s"])


def _format_light(row: Row, scene: Row | None) -> str:
    """Format the change of the mean radiance by a variant, against the scene as described if it is given, else the
    reference.
    """
    change = (1 + row["bias"]) / (1 + scene["bias"]) - 1 if scene is not None else row["bias"]
    doubt = math.hypot(row["bias_doubt"] or 0.0, (scene["bias_doubt"] or 0.0) if scene is not None else 0.0)
    return f"the light by {100 * change:+.2f} ± {100 * doubt:.2f} %"


def _format_time(row: Row, scene: Row, margin: float) -> str:
    if not scene["cpu_s"]:
        return "takes an unknown time"
    ratio = row["cpu_s"] / scene["cpu_s"]
    if _is_cheaper(row, scene, margin):
        return f"saves {100 * (1 - ratio):.0f} % of the time"
    return (
        f"takes {ratio:.1f} times the time"
        if _is_cheaper(scene, row, margin)
        else (f"takes as long, within {100 * margin:.0f} %")
    )
