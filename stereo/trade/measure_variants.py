"""Render the variants of a scene and measure them, for a trade of speed against accuracy.

Runs in the evaluator's Python. Every render is a separate process with Blender, so that its seconds and memory belong
to one render. Existing renders are not repeated.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...render.cost.blender_abilities import Abilities, describe_lack, query_abilities
from ...render.cost.quality_variants import GROUPS, SHAPES, Variant, list_variants, make_reference
from ...render.workers.job_commands import Job, render_job
from ...render.workers.process import Message
from ...settings.description import changed, defaults, merged
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.version import version
from ..environment import packages

if TYPE_CHECKING:
    from .quality_losses import Reference

#: Folders of the renders, by ``quality.files``: full and compact files of one render have the same id.
_RENDER_FOLDERS = {"COMPACT": "data", "FULL": "data_full"}
#: Gets events: ``progress`` (``fraction``, ``message``, ``done``, ``total``) and ``warning``.
Event = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class TradeBench:
    """The inputs, the folder and the Blender for the renders and measurements of variants."""

    settings: Settings  # complete
    out: Path
    blender: str  # a Blender, or a Python with bpy
    methods: str  # the methods, separated by commas
    samples: int  # per pixel of the reference
    repeats: int  # renders per variant; from two on, noise can be separated from other errors
    on_event: Event = lambda event: None
    own: tuple[str, ...] = ()  # the user's own matchers, see ``methods.parse_own_matchers``
    images: int = 1  # number of images of the ground under this Sun, which share the cost of baking its light


def scale_view(settings: Settings, factor: float) -> Settings:
    """Scale the settings of a view to ``factor`` times the pixels along each side. Raises IcyMoonError unless this is
    0.01 to 1.
    """
    if not 0.01 <= factor <= 1.0:
        raise IcyMoonError(f"An image cannot be scaled by {factor:g} here; give 0.01 to 1.")
    rig = settings.rig
    sides = {key: max(4, round(rig[key] * factor)) for key in ("width_px", "height_px")}
    return merged(settings, {"rig": sides | {key: rig[key] * factor for key in ("principal_x_px", "principal_y_px")}})


def _make_reference_entry(best: Variant, truth: Reference, settings: Settings) -> dict[str, Any]:
    return {
        "name": best.name,
        "noise": truth.noise,
        "stereo": truth.stereo,
        "own": truth.own,
        "cpu_s": truth.cpu_s,
        "own_decisions": truth.own_decisions,
        "undecided": truth.deciding if isinstance(truth.deciding, str) else "",
        "changed": _list_changes(best.settings, settings),
    }


def run_trade(bench: TradeBench, groups: Sequence[str] = ()) -> dict[str, Any]:
    """Render and measure all variants in ``groups``, and write the report to ``bench.out``; return it, see
    ``write_trade``.

    Raises IcyMoonError with the error of Blender's process if a render fails.
    """
    packages.require_modules(*packages.PACKAGES)
    from ..decisions.rules import FIRST_CELLS, read_rules
    from ..matchers.methods import parse_methods
    from .quality_losses import measure_variant, read_reference
    from .report import write_trade

    methods = parse_methods(bench.methods, own=bench.own)
    able = check_abilities(bench, bench.settings)
    chosen = [replace(variant, repeats=bench.repeats) for variant in list_variants(bench.settings, groups, able)]
    kinds = sorted({variant.group in SHAPES for variant in chosen})
    bests = {fine: make_reference(bench.settings, bench.samples, fine) for fine in kinds}
    counter = RenderCounter(bench.on_event, sum(variant.repeats for variant in (*bests.values(), *chosen)))
    rules = replace(read_rules(), cells=FIRST_CELLS)  # so that trades of all versions can be compared
    truths = {
        fine: read_reference(render_all(best, bench, counter), methods, {}, rules) for fine, best in bests.items()
    }
    folders: dict[str, list[Path]] = {variant.key: [] for variant in chosen}
    for repeat in range(bench.repeats):  # all once before any twice, so that repeats show if the machine slows down
        for variant in chosen:
            folders[variant.key] += render_once(variant, repeat, bench, counter)
    rows = []
    for variant in chosen:
        found = measure_variant(folders[variant.key], truths[variant.group in SHAPES], methods, bench.images)
        rows.append(
            {
                "group": variant.group,
                "name": variant.name,
                "key": variant.key,
                "changed": _list_changes(variant.settings, bench.settings),
                **found,
            }
        )
    references = [_make_reference_entry(bests[fine], truth, bench.settings) for fine, truth in truths.items()]
    return write_trade(
        rows, [method.label for method in methods], references, GROUPS, _describe_provenance(bench), bench.out
    )


def check_abilities(bench: TradeBench, settings: Settings) -> Abilities:
    """Query the abilities of the bench's Blender, and warn about variants that are left out.

    Raises IcyMoonError if it cannot render these settings.
    """
    able = query_abilities(bench.blender)
    if lack := describe_lack(settings, able):
        raise IcyMoonError(lack)
    if not able.denoiser:
        bench.on_event(
            {
                "type": "warning",
                "message": "Variants with a denoiser are left out, as this Blender was built without OpenImageDenoise.",
            }
        )
    return able


class RenderCounter:
    """Counts finished renders, and reports the progress as a fraction."""

    def __init__(self, tell: Event, total: int) -> None:
        self.tell, self.total, self.done = tell, total, 0

    def tell_fraction(self, fraction: float, message: str) -> None:
        self.tell(
            {
                "type": "progress",
                "fraction": (self.done + fraction) / self.total,
                "message": message,
                "done": self.done,
                "total": self.total,
            }
        )


def render_all(variant: Variant, bench: TradeBench, counter: RenderCounter) -> list[Path]:
    """Render a variant as often as it asks; return the pair folders. See ``render_once``."""
    return [folder for repeat in range(variant.repeats) for folder in render_once(variant, repeat, bench, counter)]


def render_once(variant: Variant, repeat: int, bench: TradeBench, counter: RenderCounter) -> list[Path]:
    """Render a variant once, in a separate process, unless it is already rendered; return the pair folders.

    Raises IcyMoonError with the name of the variant and the error of Blender's process.
    """

    def hear(message: Message) -> None:
        if message["type"] == "progress":
            counter.tell_fraction(message["fraction"], variant.key)
        elif message["type"] == "warning" and variant.group == "scene" and repeat == 0:
            counter.tell(message)

    try:
        data = bench.out / _RENDER_FOLDERS[variant.settings.quality.files]
        folders = render_job(Job(data, variant.settings, repeat=repeat), bench.blender, hear)
    except IcyMoonError as error:
        raise IcyMoonError(f"{variant.key}: {error}") from None
    counter.done += 1
    counter.tell_fraction(0.0, variant.key)
    return folders


def _list_changes(settings: Settings, scene: Settings) -> dict[str, Any]:
    return {
        f"{topic}.{key}": value for topic, values in changed(settings, scene).items() for key, value in values.items()
    }


def _describe_provenance(bench: TradeBench) -> dict[str, Any]:
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "icymoon": version(),
        "platform": platform.platform(),
        "processor": platform.processor(),
        "packages": packages.find_versions(),
        "differs_from_defaults": _list_changes(bench.settings, defaults()),
    }
