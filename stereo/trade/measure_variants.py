"""Speed against accuracy: rendering the variants of a scene and measuring them.

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

from ...errors import IcyMoonError
from ...render.cost.abilities import Abilities, ask, lacking
from ...render.cost.variants import GROUPS, SHAPES, Variant, reference, variants
from ...render.workers.job import Job, render_job
from ...render.workers.process import Message
from ...settings.description import Settings, changed, defaults, merged
from ...version import version
from ..environment import packages

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
    own: tuple[str, ...] = ()  # the person's own matchers, as ``stereo.methods.own_matchers`` has them


def scaled_view(settings: Settings, factor: float) -> Settings:
    """The same view in ``factor`` times as many pixels along each side. Raises IcyMoonError outside 0.01 to 1."""
    if not 0.01 <= factor <= 1.0:
        raise IcyMoonError(f"An image cannot be scaled by {factor:g} here; give 0.01 to 1.")
    rig = settings["rig"]
    sides = {key: max(4, round(rig[key] * factor)) for key in ("width_px", "height_px")}
    return merged(settings, {"rig": sides | {key: rig[key] * factor for key in ("principal_x_px", "principal_y_px")}})


def run_trade(bench: Bench, groups: Sequence[str] = ()) -> dict[str, Any]:
    """Render and measure all variants in ``groups``, and write the report into ``bench.out``; see ``trade_report``.

    Raises IcyMoonError if a render fails, with the words of Blender's process.
    """
    packages.require(*packages.PACKAGES)
    from ..matchers.methods import parse_methods
    from .losses import measure, read_reference
    from .report import write_trade

    methods = parse_methods(bench.methods, own=bench.own)
    able = check_abilities(bench, bench.settings)
    chosen = [replace(variant, repeats=bench.repeats) for variant in variants(bench.settings, groups, able)]
    kinds = sorted({variant.group in SHAPES for variant in chosen})
    bests = {fine: reference(bench.settings, bench.samples, fine) for fine in kinds}
    counter = RenderCounter(bench.on_event, sum(variant.repeats for variant in (*bests.values(), *chosen)))
    truths = {fine: read_reference(render_all(best, bench, counter), methods, {}) for fine, best in bests.items()}
    folders: dict[str, list[Path]] = {variant.key: [] for variant in chosen}
    for repeat in range(bench.repeats):  # all once before any twice: a machine that slows down is seen in the repeats
        for variant in chosen:
            folders[variant.key] += render_once(variant, repeat, bench, counter)
    rows = []
    for variant in chosen:
        found = measure(folders[variant.key], truths[variant.group in SHAPES], methods)
        rows.append({"group": variant.group, "name": variant.name, "key": variant.key,
                     "changed": _changed(variant.settings, bench.settings), **found})
    references = [{"name": bests[fine].name, "noise": truth.noise, "stereo": truth.stereo, "own": truth.own,
                   "cpu_s": truth.cpu_s, "changed": _changed(bests[fine].settings, bench.settings)}
                  for fine, truth in truths.items()]
    return write_trade(rows, [method.label for method in methods], references, GROUPS, _provenance(bench), bench.out)


def check_abilities(bench: Bench, settings: Settings) -> Abilities:
    """What the bench's Blender can do; what is therefore left out is told.

    Raises IcyMoonError if it cannot render these settings.
    """
    able = ask(bench.blender)
    if lack := lacking(settings, able):
        raise IcyMoonError(lack)
    if not able.denoiser:
        bench.on_event({"type": "warning", "message": "What is denoised is left out: this Blender was built without "
                                                      "OpenImageDenoise."})
    return able


class RenderCounter:
    """How many renders are done, told as fractions."""

    def __init__(self, tell: Event, total: int) -> None:
        self.tell, self.total, self.done = tell, total, 0

    def tell_fraction(self, fraction: float, message: str) -> None:
        self.tell({"type": "progress", "fraction": (self.done + fraction) / self.total, "message": message,
                   "done": self.done, "total": self.total})


def render_all(variant: Variant, bench: Bench, counter: RenderCounter) -> list[Path]:
    """The pair folders of a variant's renders; see ``render``."""
    return [folder for repeat in range(variant.repeats) for folder in render_once(variant, repeat, bench, counter)]


def render_once(variant: Variant, repeat: int, bench: Bench, counter: RenderCounter) -> list[Path]:
    """The pair folder of one of a variant's renders, made by a process of its own unless it is there.

    Raises IcyMoonError with the name of the variant and the words of Blender's process.
    """
    def hear(message: Message) -> None:
        if message["type"] == "progress":
            counter.tell_fraction(message["fraction"], variant.key)
        elif message["type"] == "warning" and variant.group == "scene" and repeat == 0:
            counter.tell(message)

    try:
        folders = render_job(Job(bench.out / "data", variant.settings, repeat=repeat), bench.blender, hear)
    except IcyMoonError as error:
        raise IcyMoonError(f"{variant.key}: {error}") from None
    counter.done += 1
    counter.tell_fraction(0.0, variant.key)
    return folders


def _changed(settings: Settings, scene: Settings) -> dict[str, Any]:
    return {f"{topic}.{key}": value for topic, values in changed(settings, scene).items()
            for key, value in values.items()}


def _provenance(bench: Bench) -> dict[str, Any]:
    return {"created": datetime.now(UTC).isoformat(timespec="seconds"), "icymoon": version(),
            "platform": platform.platform(), "processor": platform.processor(), "packages": packages.find_versions(),
            "differs_from_defaults": _changed(bench.settings, defaults())}
