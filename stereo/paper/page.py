"""Write the GUISS paper's tables and figures, made again, as HTML, CSV, LaTeX and pictures in one folder."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path

from ...support.files import write_text
from ...support.number_text import format_count
from ..report.charts import list_method_keys
from ..report.page_templates import read_template
from . import PAPER_PAGE
from .figures import SHEETS, SweepCharts, draw_albedo, write_figure_sheet, write_qualitative
from .paper_datasets import Part
from .printed import TABLE_METHODS
from .results import PaperResults, measure_rendering_seconds
from .tables import (
    RUNTIME_COLUMNS,
    list_metric_columns,
    make_result_rows,
    make_results_csv,
    make_results_latex,
    make_runtime_rows,
    make_runtimes_csv,
    make_runtimes_latex,
)

#: The charts of error by albedo: the evaluation of each, and its title.
_ALBEDO_CHARTS = {
    "albedo": ("albedo_one_exposure", "One exposure for all albedos, as in the paper"),
    "albedo_automatic": ("albedo_automatic", "The same pairs at automatic exposure"),
}


def _draw_albedos(measured: Mapping[str, PaperResults], out: Path) -> list[tuple[str, SweepCharts]]:
    """Draw the charts of error by albedo; return them with their titles."""
    return [
        (title, drawn)
        for key, (name, title) in _ALBEDO_CHARTS.items()
        if (drawn := draw_albedo(measured[key], name, out)) is not None
    ]


def write_paper(
    out: Path,
    parts: Mapping[str, Part],
    measured: Mapping[str, PaperResults],
    missing: Mapping[str, str],
    scale: float,
    planned: int,
) -> Path:
    """Write all tables and figures to ``out``, and return the path of the page.

    ``measured`` are the results of the ``EVALUATIONS``, and ``missing`` states why a matcher could not run. ``scale``
    is the size of the images over the paper's, and ``planned`` the number of pairs of the table.
    """
    data = measured["data"]
    results = make_result_rows(data, with_theirs=scale == 1)
    rendering = measure_rendering_seconds(out / parts["data"].folder, parts["data"].pairs)
    runtimes = make_runtime_rows(data, rendering)
    size = describe_size(data, scale, planned)
    lacking = [f"{method.title}: {missing[method.matcher]}" for method in TABLE_METHODS if method.matcher in missing]
    write_text(out / "results.csv", make_results_csv(results))
    write_text(out / "runtimes.csv", make_runtimes_csv(runtimes))
    caption = f"Results printed in the GUISS paper and measured here. {size}"
    write_text(out / "results.tex", make_results_latex(results, " ".join([caption, *lacking])))
    write_text(
        out / "runtimes.tex", make_runtimes_latex(runtimes, f"Run times printed in the paper and measured. {size}")
    )
    shown = write_qualitative(data, parts["data"].sets, out / "qualitative.jpg")
    sheets = []
    for name, pairs in parts["figures"].sets.items() if "figures" in parts else ():
        file = out / f"figure_{name}.jpg"
        if write_figure_sheet(name, pairs, out / parts["figures"].folder, file):
            sheets.append((*SHEETS[name][1:], _embed_picture(file)))
    html = read_template("paper.html.j2", Path(__file__).parent).render(
        size=size,
        results=results,
        metrics=[ours for _, ours in list_metric_columns()],
        lacking=lacking,
        with_theirs=scale == 1,
        runtime_columns=RUNTIME_COLUMNS,
        runtimes=runtimes,
        keys=list_method_keys(data.table.methods),
        charts=_draw_albedos(measured, out),
        qualitative=_embed_picture(out / "qualitative.jpg") if shown else "",
        sheets=sheets,
        folders=[part.folder for part in parts.values()],
    )
    write_text(out / PAPER_PAGE, html)
    return out / PAPER_PAGE


def describe_size(data: PaperResults, scale: float, planned: int) -> str:
    """Describe the number, the kinds and the size of the pairs in sentences."""
    scenes = data.table.scene_count()
    reconstructed = int(data.group("Reconstructed").sum())
    kinds = f"{reconstructed} reconstructed and {len(data.facts) - reconstructed} synthetic"
    own = f"{format_count(len(data.facts), 'pair')} of {planned} ({kinds}) from {format_count(scenes, 'scene')}"
    sides = " x ".join(f"{round(side * scale)}" for side in (640, 480))
    note = "" if scale == 1 else ", so depth errors are not comparable with those of the paper's 640 x 480 px"
    mixed = "The row All is their mean. In the paper it is of 3060 reconstructed and 1960 synthetic pairs."
    return f"{own[0].upper()}{own[1:]}, {sides} px{note}. {mixed}"


def _embed_picture(file: Path) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(file.read_bytes()).decode('ascii')}"
