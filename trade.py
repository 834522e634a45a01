"""Speed against accuracy: rendering the variants of a scene, measuring them, and finding the cheapest that will do.

Runs in the evaluator's Python and starts Blender for every render, each in a process of its own, so that the
seconds and the memory are its own. What is rendered already is not rendered again.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .errors import IcyMoonError
from .render.launch import Job, rendered
from .render.queue import Message
from .render.variants import GROUPS, SHAPES, Variant, candidates, reference, variants
from .settings import Settings, changed, defaults, merged
from .stereo import check
from .version import version

#: What is told while it goes on: ``progress`` (``fraction``, ``message``, ``done``, ``total``), ``warning``.
Event = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Bench:
    """Where and how the variants are rendered and measured."""

    settings: Settings  # complete
    out: Path
    blender: str  # a Blender, or a Python with bpy
    methods: str  # of the matchers, separated by commas
    samples: int  # of the reference
    repeats: int  # renders per variant; noise is told from the rest by two
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
        def hear(message: Message, first: bool = repeat == 0) -> None:
            if message["type"] == "progress":
                counter.at(message["fraction"], variant.key)
            elif message["type"] == "warning" and variant.group == "scene" and first:
                counter.tell(message)

        try:
            folders += rendered(Job(bench.out / "data", variant.settings, repeat=repeat), bench.blender, hear)
        except IcyMoonError as error:
            raise IcyMoonError(f"{variant.key}: {error}") from None
        counter.done += 1
        counter.at(0.0, variant.key)
    return folders


def _changed(settings: Settings, scene: Settings) -> dict[str, Any]:
    return {f"{topic}.{key}": value for topic, values in changed(settings, scene).items()
            for key, value in values.items()}


def _provenance(bench: Bench) -> dict[str, Any]:
    return {"created": datetime.now(UTC).isoformat(timespec="seconds"), "icymoon": version(),
            "platform": platform.platform(), "processor": platform.processor(), "packages": check.versions(),
            "differs_from_defaults": _changed(bench.settings, defaults())}
