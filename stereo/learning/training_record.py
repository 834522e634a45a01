"""Writes the record of a training run beside its weights: a card with their origin, and a curve of the losses."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ...support.arrays import Array
from ...support.files import write_atomically, write_text
from ...support.version import version
from ..report.charts import METHOD_COLOURS, STYLE
from ..report.sweep_charts import ON_WHITE

CARD_FILE, CURVE_FILE = "card.md", "curve.png"
#: Number of last steps that the card averages, and the part of a run over which the curve averages.
_LAST_STEPS, _AVERAGED_SHARE = 100, 0.02
_CURVES = (("loss", "loss", 1.0), ("bad_1", "% of pixels wrong by over 1 px", 100.0))


def write_record(folder: Path, plan: Mapping[str, Any], rows: Sequence[Mapping[str, float]]) -> None:
    """Write the card and the curve of a run into its folder.

    ``plan`` are its settings, ``rows`` the rows of its log. Raises IcyMoonError if the disk is full.
    """
    write_text(folder / CARD_FILE, _describe(plan, rows))
    write_atomically(folder / CURVE_FILE, lambda part: _draw_curve(part, rows))


def make_metadata(plan: Mapping[str, Any], step: int) -> dict[str, str]:
    """Make the metadata for the file of the weights."""
    return {"icymoon": version(), "steps": str(step), "plan": json.dumps(plan)}


def _describe(plan: Mapping[str, Any], rows: Sequence[Mapping[str, float]]) -> str:
    last = rows[-_LAST_STEPS:]
    mean = {key: float(np.mean([row[key] for row in last])) for key in ("loss", "bad_1")} if last else {}
    hours = sum(row["seconds"] for row in rows) / 3600
    lines = [
        f"# Weights of {plan['network']}",
        "",
        f"Trained for {len(rows)} of {plan['steps']} steps in {hours:.2f} hours of the clock.",
        "",
        "| | |",
        "|---|---|",
        *(f"| {key} | {value} |" for key, value in {"icymoon": version(), **plan}.items()),
        "",
    ]
    if mean:
        lines += [
            f"In the last {len(last)} steps the loss was {mean['loss']:.3f}, and {100 * mean['bad_1']:.1f} % of the "
            "pixels in sight were wrong by over 1 px. These are pairs of the training; how the weights do on others is "
            "measured by `python -m icymoon.stereo evaluate`.",
            "",
        ]
    return "\n".join(lines)


def _draw_curve(file: Path, rows: Sequence[Mapping[str, float]]) -> None:
    """Draw the loss and the share of wrong pixels against the step, averaged over a part of the run."""
    with matplotlib.rc_context({**STYLE, **ON_WHITE}):
        figure = Figure(figsize=(8.0, 3.2), facecolor="white", layout="constrained")
        FigureCanvasAgg(figure)
        window = max(1, round(_AVERAGED_SHARE * len(rows)))
        for axis, (key, label, factor), colour in zip(figure.subplots(1, 2), _CURVES, METHOD_COLOURS, strict=False):
            values = factor * np.array([row[key] for row in rows])
            steps = np.array([row["step"] for row in rows])
            axis.plot(steps, values, ".", color=colour, alpha=0.25, markersize=2)
            if len(values) >= window:
                axis.plot(*_average(steps, values, window), color=colour)
            axis.set(xlabel="step", ylabel=label)
            axis.set_ylim(bottom=0.0, top=1.1 * float(np.quantile(values, 0.99)) if len(values) else None)
        figure.savefig(file, format="png", dpi=120)


def _average(steps: Array, values: Array, window: int) -> tuple[Array, Array]:
    """Return running means of ``steps`` and ``values`` over ``window`` steps."""
    share = np.full(window, 1.0 / window)
    return np.convolve(steps, share, "valid"), np.convolve(values, share, "valid")
