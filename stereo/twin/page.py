"""Write photographed pairs beside their twins: one page that contains everything, and a table of all numbers."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from ...render.pairs.pair_folder import EYES
from ...support.files import write_text
from ...support.number_text import format_count
from ..images.colours import INVALID_GREY, VIRIDIS, Scale
from ..matchers.methods import Method, describe_method
from ..report.charts import METHOD_COLOURS, STYLE, add_legend, add_panel, set_logarithmic
from ..report.page_templates import read_template
from ..report.pictures import embed_picture
from .compare_twin import DISPARITY_TITLE, GRADIENT_BOUNDS, LEVEL_BOUNDS, MATCHED, SIDES, STATISTICS
from .plan import Twin
from .summary import SummaryRow, make_csv

PAGE, TABLE = "twin.html", "twin.csv"
#: Most pairs whose pictures the page contains, and most pairs whose curves are drawn beside the means.
_MAX_SHOWN, _MAX_CURVES = 6, 40
_SIDE_TITLES = {"photograph": "Photograph", "twin": "Twin"}


def write_page(
    out: Path,
    pictures: Path,
    twins: Sequence[Twin],
    records: Sequence[Mapping[str, Any]],
    rows: Sequence[SummaryRow],
    methods: Sequence[Method],
    limits: Sequence[str],
    notes: Sequence[str],
) -> Path:
    """Write ``twin.html`` and ``twin.csv`` into ``out``, and return the path of the page.

    ``pictures`` is the folder with the pictures from ``compare_twin``; ``limits`` and ``notes`` are sentences.
    """
    write_text(out / TABLE, make_csv(twins, records, methods))
    rig = twins[0].planned.settings.rig
    page = read_template("twin.html.j2", Path(__file__).parent).render(
        pairs=format_count(len(twins), "pair"),
        size=f"{rig.width_px} x {rig.height_px} px, baseline {rig.baseline_m:.4g} m",
        limits=limits,
        notes=notes,
        titles=_SIDE_TITLES,
        statistics=[row for row in rows if not row.method],
        methods=[
            (describe_method(method.label), [row for row in rows if row.method == method.label]) for method in methods
        ],
        explained=(*STATISTICS, *MATCHED),
        charts=_draw_curves(records),
        shown=[_make_section(twins[k], records[k], pictures, methods) for k in _choose_shown(len(twins))],
        grey=INVALID_GREY,
        table=TABLE,
    )
    write_text(out / PAGE, page)
    return out / PAGE


def _choose_shown(count: int) -> list[int]:
    """Choose the indices of the pairs to show: all, or some at equal steps."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, _MAX_SHOWN))})


def _make_section(twin: Twin, record: Mapping[str, Any], pictures: Path, methods: Sequence[Method]) -> dict[str, Any]:
    name, height = twin.photographs.name, twin.planned.settings.rig.height_px
    low, high = record["disparity_scale_px"]
    scale = Scale(low, high, VIRIDIS, DISPARITY_TITLE)
    rows = []
    for side in SIDES:
        cells = [(f"{_SIDE_TITLES[side]}, {eye} eye", pictures / f"{name}-{side}-{eye}.png") for eye in EYES]
        cells += [
            (
                f"{_SIDE_TITLES[side]}, {describe_method(method.label)}",
                pictures / f"{name}-{side}-{method.file_name}.png",
            )
            for method in methods
        ]
        rows.append([(caption, embed_picture(path, height)) for caption, path in cells])
    return {
        "name": name,
        "rows": rows,
        "gradient": ", ".join(scale.gradient()),
        "title": scale.title,
        "ticks": [(100 * share, text) for share, text in scale.labels],
        "seed": twin.planned.settings.dataset.seed,
        "twin": twin.planned.id,
    }


def _draw_curves(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Draw histogram, gradients and spectrum of both sides as SVG: thin lines for pairs, thick lines for their
    means.
    """
    found: list[str] = []
    with matplotlib.rc_context(STYLE):
        for key, title, label, logarithmic in (
            ("levels", "Histogram", "grey level", False),
            ("gradients", "Gradients", "gradient (levels/px)", True),
            ("power", "Spectrum", "cycles per px", True),
        ):
            with add_panel(found, f"twin-{key}", title) as axis:
                for k, side in enumerate(SIDES):
                    curves = [record[side]["curves"] for record in records]
                    places = _find_curve_places(key, curves)
                    drawn = np.array([curve[key] for curve in curves if len(curve[key]) == len(places)], float)
                    if not drawn.size:
                        continue
                    drawn = np.where(drawn > 0, drawn, np.nan) if key == "power" else 100 * drawn
                    for line in drawn[:_MAX_CURVES] if len(drawn) > 1 else ():
                        axis.plot(places, line, color=METHOD_COLOURS[k], linewidth=0.6, alpha=0.35)
                    axis.plot(
                        places,
                        _average_curves(key, drawn),
                        color=METHOD_COLOURS[k],
                        label=html.escape(_SIDE_TITLES[side]),
                    )
                axis.set_xlabel(label)
                axis.set_ylabel("power" if key == "power" else "pixels (%)")
                if logarithmic:
                    set_logarithmic(axis, "x")
                if key == "power" and np.isfinite(axis.dataLim.minposy):
                    axis.set_yscale("log")
                    axis.tick_params(axis="y", labelleft=False, which="both")
                add_legend(axis.figure, axis, len(SIDES))
    return found


def _find_curve_places(key: str, curves: Sequence[Mapping[str, Any]]) -> Any:
    """Find the x coordinates of the points of a curve."""
    if key == "power":
        return max((curve["cycles"] for curve in curves), key=len)
    bounds = np.array(LEVEL_BOUNDS if key == "levels" else GRADIENT_BOUNDS, float)
    return (bounds[1:] + bounds[:-1]) / 2 if key == "levels" else np.sqrt(bounds[1:] * bounds[:-1])


def _average_curves(key: str, drawn: Any) -> Any:
    """Average curves (pairs, points); spectra are averaged as logarithms."""
    return np.exp(np.log(drawn).mean(axis=0)) if key == "power" else drawn.mean(axis=0)
