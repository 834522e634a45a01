"""Speed against accuracy: rendering the variants of a scene, measuring them, and finding the cheapest that will do.

Runs in the evaluator's Python and starts Blender for every render, each in a process of its own, so that the
seconds and the memory are its own. What is rendered already is not rendered again.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .errors import IcyMoonError
from .render.launch import Job, blender_command
from .render.queue import Process
from .render.variants import GROUPS, SHAPES, Variant, candidates, reference, variants
from .settings import Settings, defaults, merged
from .stereo import check
from .version import version

#: What is told while it goes on: ``progress`` (``fraction``, ``message``, ``done``, ``total``), ``warning``.
Event = Callable[[dict[str, Any]], None]

METHODS = "sgbm,bm,jplv"
REFERENCE_SAMPLES = 1024


@dataclass(frozen=True)
class Bench:
    """Where and how the variants are rendered and measured."""

    settings: Settings  # complete
    out: Path
    blender: str  # a Blender, or a Python with bpy
    methods: str = METHODS
    samples: int = REFERENCE_SAMPLES  # of the reference
    repeats: int = 2  # renders per variant; noise is told from the rest by two
    on_event: Event = lambda event: None


def scaled(settings: Settings, factor: float) -> Settings:
    """The same view in ``factor`` times as many pixels along each side. Raises IcyMoonError outside 0.01 to 1."""
    if not 0.01 <= factor <= 1.0:
        raise IcyMoonError(f"An image cannot be scaled by {factor:g} here; give 0.01 to 1.")
    rig = settings["rig"]
    sides = {key: max(4, round(rig[key] * factor)) for key in ("width_px", "height_px")}
    return merged(settings, {"rig": sides | {key: rig[key] * factor for key in ("principal_x_px", "principal_y_px")}})


def trade(bench: Bench, groups: Sequence[str] = ()) -> dict[str, Any]:
    """Render and measure all variants in ``groups``, and write the report into ``bench.out``; see ``trade_report``.

    Raises IcyMoonError if a render fails, with the words of Blender's process.
    """
    check.require(*check.PACKAGES)
    from .stereo.methods import parse_methods
    from .stereo.trade import measure, read_reference
    from .stereo.trade_report import write_trade

    methods = parse_methods(bench.methods)
    chosen = [replace(variant, repeats=bench.repeats) for variant in variants(bench.settings, groups)]
    kinds = sorted({variant.group in SHAPES for variant in chosen})
    bests = {fine: reference(bench.settings, bench.samples, fine) for fine in kinds}
    counter = _Counter(bench.on_event, sum(variant.repeats for variant in (*bests.values(), *chosen)))
    truths = {fine: read_reference(_render(best, bench, counter), methods, {}) for fine, best in bests.items()}
    rows = []
    for variant in chosen:
        found = measure(_render(variant, bench, counter), truths[variant.group in SHAPES], methods)
        rows.append({"group": variant.group, "name": variant.name, "key": variant.key,
                     "changed": _changed(variant.settings, bench.settings), **found})
    references = [{"name": bests[fine].name, "noise": truth.noise, "stereo": truth.stereo, "cpu_s": truth.cpu_s,
                   "changed": _changed(bests[fine].settings, bench.settings)} for fine, truth in truths.items()]
    return write_trade(rows, [method.label for method in methods], references, GROUPS, _provenance(bench), bench.out)


def auto(bench: Bench, tolerance_px: float, tolerance_bad_1: float | None = None) -> dict[str, Any]:
    """The cheapest way to compute the light of the scene whose stereo error is within ``tolerance_px`` of the
    reference's for every matcher, and its share of wrong pixels within ``tolerance_bad_1`` where that is given.

    Tries the candidates from the cheapest on and stops at the first that does. Returns ``chosen`` (its name, or None),
    ``settings`` (of quality, to use), and ``tried``: name, seconds and losses of each. Raises IcyMoonError if the
    tolerance is not above zero, or a render fails.
    """
    if not tolerance_px > 0:
        raise IcyMoonError(f"A tolerance of {tolerance_px:g} px cannot be met by any noise; give one above zero.")
    check.require(*check.PACKAGES)
    from .stereo.methods import parse_methods
    from .stereo.trade import measure, read_reference

    methods = parse_methods(bench.methods)
    ladder = [replace(variant, repeats=1) for variant in candidates(bench.settings)]
    best = reference(bench.settings, bench.samples)
    counter = _Counter(bench.on_event, best.repeats + len(ladder))
    truth = read_reference(_render(best, bench, counter), methods, {})
    tried: list[dict[str, Any]] = []
    for variant in ladder:
        found = measure(_render(variant, bench, counter), truth, methods)
        tried.append({"name": variant.name, "cpu_s": found["cpu_s"], "wall_s": found["wall_s"], "loss": found["loss"]})
        if all(_within(loss["epe_px"], tolerance_px) and (tolerance_bad_1 is None or _within(
                loss["wrong_or_missing"], tolerance_bad_1)) for loss in found["loss"].values()):
            return {"chosen": variant.name, "settings": {"quality": variant.settings["quality"]}, "tried": tried}
    return {"chosen": None, "settings": {}, "tried": tried}


def _within(loss: float | None, tolerance: float) -> bool:
    return loss is not None and loss <= tolerance


class _Counter:
    """How many renders are done, told as fractions."""

    def __init__(self, tell: Event, total: int) -> None:
        self.tell, self.total, self.done = tell, total, 0

    def at(self, fraction: float, message: str) -> None:
        self.tell({"type": "progress", "fraction": (self.done + fraction) / self.total, "message": message,
                   "done": self.done, "total": self.total})


def _render(variant: Variant, bench: Bench, counter: _Counter) -> list[Path]:
    """The pair folders of a variant's renders, each made by a process of its own."""
    folders = []
    for repeat in range(variant.repeats):
        job = Job(bench.out / "data", variant.settings, repeat=repeat)
        process = Process(blender_command(bench.blender, "worker", str(job.file)))
        made: list[str] = []
        failure = ""
        try:
            for message in process.messages():
                if message["type"] == "progress":
                    counter.at(message["fraction"], variant.key)
                elif message["type"] == "warning" and variant.group == "scene" and not repeat:
                    counter.tell(message)
                elif message["type"] == "error":
                    failure = message["message"]
                elif message["type"] == "done":
                    made = message["folders"]
        finally:
            process.stop()
            job.remove()
        if failure or not made:
            raise IcyMoonError(f"{variant.key}: {failure}" if failure else
                               f"{variant.key}: Blender ended without a result (status {process.returncode}): "
                               f"{process.last_words}")
        counter.done += 1
        counter.at(0.0, variant.key)
        folders.append(Path(made[0]))
    return folders


def _changed(settings: Settings, scene: Settings) -> dict[str, Any]:
    return {f"{topic}.{key}": value for topic, values in settings.items() for key, value in values.items()
            if value != scene[topic][key]}


def _provenance(bench: Bench) -> dict[str, Any]:
    return {"created": datetime.now(UTC).isoformat(timespec="seconds"), "icymoon": version(),
            "platform": platform.platform(), "processor": platform.processor(), "packages": check.versions(),
            "differs_from_defaults": _changed(bench.settings, defaults())}


def progress(title: str) -> AbstractContextManager[Event]:
    """A progress bar for people at a terminal."""
    from .stereo.console import progress_bar

    return progress_bar(title)
