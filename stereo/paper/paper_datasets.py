"""The data sets for the tables and figures of the GUISS paper, in the requested size."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from ...render.plans.combine import combine
from ...render.plans.plan_file import Plan, find_plan, parse_plan, read_plan
from ...render.plans.planned_pair import PlannedPair
from ...render.plans.render_order import order_pairs
from ...render.plans.stratified import choose_stratified
from ...settings.description import changed, defaults, merged
from ...settings.toml_text import to_toml, to_toml_value
from ...settings.topics.declaration import Parts
from ..trade.measure_variants import scale_view

#: The data sets of ``datasets/guiss_all``, and the figures of ``datasets/guiss_figures``, in the order of their plans.
SETS = ("reconstructions", "textures", "landforms", "generative", "terrains", "rocks", "snow")
FIGURES = ("ruggedness", "subsurface", "texture", "suns", "rocks")
#: Columns and rows of the figures' images as a share of the other images', because figures are small on a page.
_OF_FIGURES = 0.5
#: Grounds of each set on which its cameras are checked before the render; the render sets pairs aside that it cannot
#: render.
_CHECKED_GROUNDS = 4
#: The evaluations: the matched part, the folder within the part's folder, and settings of the response. Images of the
#: albedo figure are developed twice from one render, at its stated exposure and automatically exposed.
EVALUATIONS: dict[str, tuple[str, str, Parts]] = {
    "data": ("data", "evaluation", {}),
    "albedo": ("albedo", "evaluation", {}),
    "albedo_automatic": ("albedo", "evaluation_automatic", {"sensor": {"auto_exposure": True}}),
}
#: Share of the pairs in a quick run.
QUICK_SHARE = 0.1


@dataclass(frozen=True)
class Part:
    """A data set: its folder in the output, the text of its plan, and the pairs of each of its sets."""

    folder: str
    text: str
    sets: Mapping[str, Sequence[PlannedPair]]

    @cached_property
    def pairs(self) -> list[PlannedPair]:
        """All pairs, in the order in which they are rendered."""
        return order_pairs([pair for pairs in self.sets.values() for pair in pairs])


def make_parts(
    count: int | None, scale: float, overrides: Parts, files: Path | None = None, glossy: bool = False
) -> dict[str, Part]:
    """Make the ``data`` of the tables with about ``count`` pairs (None: all), the pairs of the ``albedo`` figure, and
    the pairs of the ``figures`` of images.

    ``scale`` multiplies the columns and rows of the images. ``overrides`` are settings that replace the plans'
    settings. ``files`` is the folder of files that replace stand-ins. With ``glossy`` the pairs of the tables have the
    materials and the sampling of the paper's public code. Raises IcyMoonError for an invalid scale, setting or file.
    """
    plan = "guiss_all_glossy" if glossy else "guiss_all"
    data = _make_part("data", plan, SETS, scale, overrides, files)
    if count is not None:
        total = sum(map(len, data.sets.values()))
        sets = {
            name: choose_stratified(pairs, max(1, math.floor(count * len(pairs) / total + 0.5)))
            for name, pairs in data.sets.items()
        }
        data = replace(data, sets=sets)
    return {
        "data": data,
        "albedo": _make_part("albedo", "guiss_albedo", ("albedo",), scale, overrides, files),
        "figures": _make_part("figures", "guiss_figures", FIGURES, scale * _OF_FIGURES, overrides, files),
    }


def _make_part(folder: str, plan: str, sets: Sequence[str], scale: float, overrides: Parts, files: Path | None) -> Part:
    shipped = f"datasets/{plan}"
    text = "\n".join(
        [
            "[plan]",
            f'title = "The paper again: {folder}"',
            f'extends = "{shipped}"',
            *([f"files = {to_toml_value(str(files.absolute()))}"] if files else []),
            "",
            to_toml(merged(_scale_settings(read_plan(find_plan(shipped)), scale), overrides)),
        ]
    )
    parsed = parse_plan(Path(f"{folder}.toml"), text)
    return Part(
        folder,
        text,
        {name: combine(design, _CHECKED_GROUNDS).pairs for name, design in zip(sets, parsed.designs, strict=True)},
    )


def _scale_settings(plan: Plan, scale: float) -> Parts:
    """Return the settings of a plan that differ at another size of the images. A stated exposure is shorter for larger
    pixels, because a pixel that sees more ground gets more light.
    """
    if scale == 1:
        return {}
    base = merged(defaults(), *(part.settings for part in plan.designs[0].base))
    scaled = scale_view(base, scale)
    if not base.sensor.auto_exposure:
        scaled = merged(scaled, {"sensor": {"exposure_s": base.sensor.exposure_s * scale**2}})
    return changed(scaled, base)
