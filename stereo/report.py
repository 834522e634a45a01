"""The HTML report: one file with everything in it, which opens without a network."""

from __future__ import annotations

import base64
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import jinja2
import numpy as np

from ..files import write_text
from ..settings import to_toml
from . import pictures
from .columns import SUMMARY, shown
from .factors import Sweep
from .images import encoded, read_png
from .measure import REGIONS
from .summary import Table

#: Pairs shown with pictures, at most; half of them are the worst ones. The CSV has all.
MOST_PAIRS = 24
#: After Okabe and Ito, told apart by colour-blind eyes; in lightness between white and black paper.
_COLOURS = ("#2a86c8", "#d55e00", "#009e73", "#c0699a", "#c98a00", "#6f7f8f")
_WIDTH_PX = 480  # of embedded pictures
_JPEG_QUALITY = 80
_SCREEN_GAMMA = 1 / 2.2


def write_report(report: Mapping[str, Any], table: Table, sweeps: Sequence[Sweep], out: Path, seed: int,
                 guiss: bool) -> None:
    """Write ``out/report.html`` from what ``evaluate`` returns and the pictures it wrote to ``out``."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True,
                                     undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    shown_pairs = choose_pairs(report)
    html = environment.get_template("report.html.j2").render(
        report=report, regions=REGIONS, chart=error_chart(report), columns=SUMMARY, shown=shown,
        error_bar=_bar(pictures.ERROR), invalid=pictures.INVALID_GREY, sky=pictures.SKY_GREY,
        pairs=[_pair(facts, report, out) for facts in report["pairs"] if facts["pair"] in shown_pairs])
    write_text(out / "report.html", html)


def choose_pairs(report: Mapping[str, Any]) -> set[str]:
    """Names of the pairs to show: all, or if there are too many the worst half and an even choice.

    Worst by mean depth error of the worst method; a method that measured nothing is worst of all.
    """
    names = [facts["pair"] for facts in report["pairs"]]
    if len(names) <= MOST_PAIRS:
        return set(names)
    badness = dict.fromkeys(names, 0.0)
    for row in report["rows"]:
        if row["pair"] in badness:
            error = float("inf") if row["l1_m"] is None else row["l1_m"]
            badness[row["pair"]] = max(badness[row["pair"]], error)
    worst = sorted(names, key=badness.__getitem__, reverse=True)[:MOST_PAIRS // 2]
    rest = [name for name in names if name not in worst]
    even = np.linspace(0, len(rest) - 1, MOST_PAIRS - len(worst)).round().astype(int)
    return {*worst, *(rest[i] for i in even)}


def error_chart(report: Mapping[str, Any]) -> dict[str, Any]:
    """What the template draws of the cumulative error curves: SVG points and labels, in px."""
    steps = report["provenance"]["error_curve_steps_m"]
    left, top, width, height = 46, 10, 620, 250
    scale = pictures.Scale(steps[0], steps[-1])

    def point(step: float, share: float) -> tuple[float, float]:
        return round(left + width * float(scale.position(step)), 1), round(top + height * (1 - share), 1)

    curves = []
    for entry, colour in zip(report["summary"], itertools.cycle(_COLOURS)):
        if entry["error_curve"]:
            points = [point(*pair) for pair in zip(steps, entry["error_curve"], strict=True)]
            curves.append({"label": entry["method"], "colour": colour, "end": points[-1],
                           "points": " ".join(f"{x},{y}" for x, y in points)})
    spaced = top + height
    for curve in sorted(curves, key=lambda curve: curve["end"][1], reverse=True):
        spaced = min(spaced, curve["end"][1])  # labels of curves that end together stay apart
        curve["label_y"] = spaced + 4
        spaced -= 16
    return {"curves": curves, "left": left, "right": left + width, "top": top, "bottom": top + height,
            "columns": [(point(tick, 0)[0], f"{tick:g}") for tick in scale.ticks],
            "rows": [(point(1, share)[1], f"{100 * share:.0f}") for share in (0, 0.25, 0.5, 0.75, 1)]}


def _pair(facts: Mapping[str, Any], report: Mapping[str, Any], out: Path) -> dict[str, Any]:
    height = facts["height_px"]
    scale = pictures.Scale(*facts["depth_scale_m"])
    rows = [row for row in report["rows"] if row["pair"] == facts["pair"]]
    return {"facts": facts, "left": _embedded(out / facts["images"]["left"], height, linear=True),
            "true_depth": _embedded(out / facts["images"]["true_depth"], height), "depth_bar": _bar(scale),
            "settings": to_toml(facts["settings"]),
            "methods": [{"row": row, **{kind: _embedded(out / row["images"][kind], height)
                                        for kind in ("depth", "error") if kind in row["images"]}} for row in rows]}


def _embedded(path: Path, height: int, linear: bool = False) -> str:
    """A picture as a data URL, without the colour bar below its ``height`` rows, which HTML draws better.

    ``linear`` grey values, as a sensor gives them, are brightened to what screens expect.
    """
    image = read_png(path)[:height]
    if linear:
        image = (255 * (image / 255.0) ** _SCREEN_GAMMA).astype(np.uint8)
    if image.shape[1] > _WIDTH_PX:
        size = (_WIDTH_PX, max(1, round(image.shape[0] * _WIDTH_PX / image.shape[1])))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    content = base64.b64encode(encoded(image, ".jpg", _JPEG_QUALITY)).decode("ascii")
    return f"data:image/jpeg;base64,{content}"


def _bar(scale: pictures.Scale) -> dict[str, Any]:
    ticks: Sequence[tuple[float, str]] = [(100 * float(scale.position(tick)), f"{tick:g}") for tick in scale.ticks]
    return {"title": scale.title, "gradient": ", ".join(scale.gradient()), "ticks": ticks}
