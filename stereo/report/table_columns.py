"""The columns of the summary tables, printed and in the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Column:
    """A column: its key in a row or summary, and the format of its number."""

    key: str
    heading: str
    unit: str = ""
    decimals: int = 3
    doc: str = ""

    @property
    def title(self) -> str:
        """The heading with the unit."""
        return f"{self.heading} ({self.unit})" if self.unit else self.heading


#: Columns over all true pixels, where missing measurements count.
TOTAL_COLUMNS = (
    Column("coverage", "Coverage", "%", 1, "share of the pixels with a true depth that got a valid one"),
    Column(
        "total_bad_1",
        "> 1 px or missing",
        "%",
        1,
        "share of all true pixels without a disparity, or with one wrong by more than 1 px",
    ),
    Column(
        "total_l1_rate_10",
        "> 10 cm or missing",
        "%",
        1,
        "share of all true pixels without a depth, or with one wrong by more than 10 cm",
    ),
)
#: Columns over the measured pixels.
MEASURED_COLUMNS = (
    Column("l1_m", "L1", "m", 3, "mean absolute depth error"),
    Column("epe_px", "EPE", "px", 3, "mean absolute disparity error"),
    Column("bad_1", "bad-1", "%", 1, "share of the measured pixels with a disparity wrong by more than 1 px"),
    Column("l1_rate_10", "L1-rate-10", "%", 1, "share of the measured pixels with a depth wrong by more than 10 cm"),
    Column("si_rmse", "si-RMSE", "", 4, "root of the scale-invariant mean square error of log depth"),
    Column("dod", "DOD", "%", 2, "share of all pairs of pixels in the wrong depth order, tolerance 1 %"),
)
SECONDS_COLUMN = Column("seconds", "CPU", "s", 3, "processor seconds of matching one pair, one thread")
SUMMARY_COLUMNS = (*TOTAL_COLUMNS, *MEASURED_COLUMNS, SECONDS_COLUMN)
#: The metric that ranks methods if there is room for one rank.
RANKING_METRIC = "total_bad_1"
#: The text in place of a rank for a method without measurements.
NO_RESULT = "no result"
#: The beginning of the note on pairs whose result noise of the render decides.
NOISE_DECIDES = "Noise of the render decides the result"
#: The columns of the GUISS reference code, each with our column.
GUISS_COLUMNS = (
    (Column("guiss_l1_m", "L1", "m", 3), Column("l1_m", "L1", "m", 3)),
    (Column("guiss_l1_rate_10", "L1-rate-10", "%", 1), Column("l1_rate_10", "L1-rate-10", "%", 1)),
    (Column("guiss_si_rmse", "si-RMSE", "", 4), Column("si_rmse", "si-RMSE", "", 4)),
    (Column("guiss_dod", "DOD", "%", 2), Column("dod", "DOD", "%", 2)),
)

#: All metrics by key, for the full tables.
METRIC_NAMES = {
    column.key: column
    for column in (
        TOTAL_COLUMNS[0],
        *MEASURED_COLUMNS,
        Column("median_m", "median", "m"),
        Column("rmse_m", "RMSE", "m"),
        Column("bias_m", "bias", "m"),
        Column("abs_rel", "abs-rel", "", 4),
        Column("si_mse", "si-MSE", "", 5),
        Column("l1_rate_30", "L1-rate-30", "%", 1),
        Column("l1_rate_100", "L1-rate-100", "%", 1),
        Column("bad_0_5", "bad-0.5", "%", 1),
        Column("bad_2", "bad-2", "%", 1),
        Column("bad_3", "bad-3", "%", 1),
        Column("d1", "D1", "%", 1),
        Column("a50_px", "A50", "px"),
        Column("a90_px", "A90", "px"),
        Column("a95_px", "A95", "px"),
        Column("a99_px", "A99", "px"),
    )
}

#: Columns of the table of comparisons between methods; see ``summary.COMPARED``. Ratios have the unit ×.
COMPARED_COLUMNS = (
    Column("total_bad_1", "> 1 px or missing", "%", 1),
    Column("total_l1_rate_10", "> 10 cm or missing", "%", 1),
    Column("total_dod", "DOD, missing is wrong", "%", 2),
    Column("coverage", "Coverage", "%", 1),
    Column("common_l1_m", "L1", "×", 2),
    Column("common_epe_px", "EPE", "×", 2),
    Column("common_si_rmse", "si-RMSE", "×", 2),
    Column("common_bad_1", "bad-1", "%", 1),
    Column("seconds", "CPU", "×", 2),
)


def make_plugin_columns(metrics: Sequence[Mapping[str, Any]]) -> list[Column]:
    """Make the columns of the metrics of plug-ins, from ``plug_ins`` of a report."""
    return [Column(m["name"], m["heading"], m["unit"], m["decimals"], m["doc"]) for m in metrics]


def format_plugin(entry: Mapping[str, Any], column: Column) -> str:
    """Format the mean of a plug-in's metric in the summary of a method; a dash if it is undefined."""
    return format_mean(entry["plug_ins"], column)


def format_mean(means: Mapping[str, Any], column: Column) -> str:
    """Format the ``mean`` of a column in a table of means with intervals; a dash if it is undefined."""
    return _format_value(means.get(column.key, {}).get("mean"), column)


def format_number(entry: Mapping[str, Any], column: Column, prefix: str = "") -> str:
    """Format the number ``entry[prefix + key]`` without its unit; a dash if it is undefined."""
    return _format_value(entry.get(prefix + column.key), column)


def format_interval(bounds: Sequence[float | None] | None, column: Column) -> str:
    """Format the bounds of a mean, "low … high"; "" if a bound is unknown."""
    if bounds is None or None in bounds:
        return ""
    return " … ".join(_format_value(bound, column) for bound in bounds)


def format_result(entry: Mapping[str, Any], column: Column) -> str:
    """Format the number of a method in its summary, without unit; a dash if it is undefined.

    A method that measured nothing has no result: it is not the worst, and its coverage is no achievement. Only its cost
    is shown.
    """
    return format_number(entry, column) if entry["n"] or column == SECONDS_COLUMN else "–"


def format_rank(entry: Mapping[str, Any], metric: str) -> str:
    """Format the best and the worst rank that a method of a summary may have, "1–3"; a dash if there is no verdict."""
    if not entry["n"]:
        return NO_RESULT
    best, worst = entry["ranks"].get(metric, (None, None))
    return "–" if best is None else str(best) if best == worst else f"{best}–{worst}"


def is_best(entry: Mapping[str, Any], metric: str, summary: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether a method of a summary is best by a comparison: no other is significantly better, and at least one
    is significantly worse.
    """
    ranks = entry["ranks"].get(metric)
    return ranks is not None and ranks[0] == 1 and ranks[1] < sum(metric in other["ranks"] for other in summary)


def _format_value(value: float | None, column: Column) -> str:
    if value is None:
        return "–"
    text = f"{100 * value if column.unit == '%' else value:.{column.decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text
