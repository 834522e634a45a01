"""Find the cheapest quality of a scene whose stereo error is within a tolerance, by trying candidates.

Runs in the evaluator's Python, as ``measure_variants`` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...render.cost.error_tolerance import Tolerance, combine_verdicts
from ...render.cost.quality_variants import Variant, list_candidates, list_settings_with_less_light, make_reference
from ...settings.description import changed, merged
from ...settings.toml_text import to_toml
from ...support.files import explain_disk_errors, write_text
from ...support.system import remove
from ..environment import packages
from .measure_variants import RenderCounter, TradeBench, check_abilities, render_all, render_once

if TYPE_CHECKING:
    from ..matchers.methods import Method
    from .quality_losses import Reference

#: Most renders of a candidate; more renders reduce the doubt that noise leaves.
_MAX_RENDERS = 4
#: Limits for leaving out a part of the light: the largest change of the mean radiance, and the least saved share of the
#: time.
_MAX_LIGHT_CHANGE_SHARE, _MIN_SAVED_SHARE = 0.01, 0.05
#: Settings of the quality that are always written, even if the choice does not change them.
_ALWAYS_WRITTEN = ("samples", "denoiser", "noise_threshold")


def _is_leaner(found: Mapping[str, Any], cost_s: float) -> bool:
    """Return whether a candidate without a part of the light saves time and keeps the radiance."""
    saves = found["cpu_s"] < (1 - _MIN_SAVED_SHARE) * cost_s
    return bool(saves and abs(found["bias"]) <= _MAX_LIGHT_CHANGE_SHARE)


def find_cheapest_quality(bench: TradeBench, tolerance: Tolerance) -> dict[str, Any]:
    """Find the cheapest quality whose stereo error is within ``tolerance`` of the error of an image without noise, for
    every matcher, in 19 of 20 cases. Write it to ``auto.toml`` in ``bench.out``, with all that was tried.

    Candidates are tried from the cheapest on, until one is within ``tolerance``. Then parts of the light are left out,
    one by one, if the error stays within, the mean radiance changes by at most 1 %, and the time is less.

    Return ``chosen`` (its name, or None), ``settings`` (to use), ``said`` (the result in words, a line each), ``file``
    and ``tried``: for each candidate its name, seconds, renders, losses with their doubts, ``bias``, and whether it is
    ``within`` (None if noise leaves this open). Raises IcyMoonError if a render fails.
    """
    packages.require_modules(*packages.PACKAGES)
    from ..matchers.methods import describe_method, parse_methods
    from .quality_losses import read_reference

    methods = parse_methods(bench.methods, own=bench.own)
    best = make_reference(bench.settings, bench.samples)
    ladder = list_candidates(bench.settings, check_abilities(bench, best.settings), bench.images)
    parts = list_settings_with_less_light(bench.settings)
    counter = RenderCounter(bench.on_event, best.repeats + len(ladder) + len(parts))
    file = bench.out / "auto.toml"
    with explain_disk_errors("write to", bench.out):
        remove(file)  # the result of an earlier search
    exact = read_reference(render_all(best, bench, counter), methods, {})
    search = _QualitySearch(bench, exact, methods, tolerance, counter)
    chosen = next((variant for variant in ladder if search.try_variant(variant)), None)
    if chosen is None:
        return {
            "chosen": None,
            "settings": {},
            "said": [*search.make_tried_lines(), search.make_failure_advice()],
            "file": None,
            "tried": search.tried,
        }
    cost = search.tried[-1]["cpu_s"]
    for name, part in parts.items():
        trial = replace(chosen, name=f"{chosen.name}, {name}", settings=merged(chosen.settings, part))
        found = search.try_variant(trial) and search.tried[-1]
        if found and _is_leaner(found, cost):
            chosen, cost = trial, found["cpu_s"]
    quality = chosen.settings.quality
    keys = {*_ALWAYS_WRITTEN, *changed(chosen.settings, bench.settings).get("quality", {})}
    settings = {"quality": {key: quality[key] for key in quality if key in keys}}
    said = [
        *search.make_tried_lines(),
        f"Use {chosen.name}: {cost:.1f} CPU seconds a pair here, within {tolerance} for "
        f"{_join_words([describe_method(method.label) for method in methods])}.",
    ]
    write_text(file, "".join(f"# {line}\n" for line in said) + to_toml(settings))
    return {"chosen": chosen.name, "settings": settings, "file": str(file), "tried": search.tried, "said": said}


@dataclass
class _QualitySearch:
    bench: TradeBench
    truth: Reference
    methods: list[Method]
    tolerance: Tolerance
    counter: RenderCounter
    tried: list[dict[str, Any]] = field(default_factory=list)

    def try_variant(self, variant: Variant) -> bool:
        """Render and measure a variant; return whether it is certainly within the tolerance. It is rendered again while
        more renders may show this.
        """
        from .quality_losses import measure_variant

        folders: list[Path] = []
        for count in range(1, _MAX_RENDERS + 1):
            self.counter.total += count > 1
            folders += render_once(variant, count - 1, self.bench, self.counter)
            found = measure_variant(folders, self.truth, self.methods, self.bench.images)
            verdict = self._judge_losses(found, 1.0)
            # At best, noise falls with the square root of the number of renders.
            if verdict is not None or self._judge_losses(found, (count / _MAX_RENDERS) ** 0.5) is None:
                break
        self.tried.append(
            {
                "name": variant.name,
                "renders": len(folders),
                "within": verdict,
                **{key: found[key] for key in ("cpu_s", "wall_s", "bias", "loss", "loss_doubt")},
            }
        )
        return verdict is True

    def _judge_losses(self, found: dict[str, Any], share: float) -> bool | None:
        """Return whether all matchers would be within the tolerance if their uncertainties fell to this ``share``; None
        if this is open.
        """
        return combine_verdicts(
            self.tolerance.allows(
                loss, {key: doubt and share * doubt for key, doubt in found["loss_doubt"][label].items()}
            )
            for label, loss in found["loss"].items()
        )

    def make_tried_lines(self) -> list[str]:
        """Describe the tried candidates in words, a line each."""
        words = {True: "within", False: "", None: "hidden by noise"}
        return [
            f"{step['name']}: {step['cpu_s']:.1f} CPU s; "
            + ", ".join(self._format_loss(label, step) for label in step["loss"])
            + (f"; {words[step['within']]}" * (step["within"] is not False))
            for step in self.tried
        ]

    def _format_loss(self, label: str, step: dict[str, Any]) -> str:
        from ..matchers.methods import describe_method
        from .advice import format_coverage

        parts = []
        for key, factor, text in (("epe_px", 1.0, "{:+.3f}{} px"), ("wrong_or_missing", 100.0, "{:+.2f}{} % bad-1")):
            value, doubt = step["loss"][label][key], step["loss_doubt"][label][key]
            if key in self.tolerance.limits and value is not None:
                digits = 3 if factor == 1.0 else 2
                spread = f" ± {factor * doubt:.{digits}f}" if doubt is not None else ""
                parts.append(text.format(factor * value, spread))
        fewer = format_coverage(step["loss"][label], step["loss_doubt"][label])
        name = describe_method(label)
        return f"{name} {' and '.join(parts)}{fewer}" if parts else f"{name} measures nothing"

    def make_failure_advice(self) -> str:
        """Describe why nothing was chosen, and the fix."""
        if all(step["within"] is False for step in self.tried):
            return f"No quality that was tried is within {self.tolerance}; allow more."
        own = max(
            (self.truth.own[method.label][key] or 0.0) / limit
            for method in self.methods
            for key, limit in self.tolerance.limits.items()
        )
        fix = (
            f"the reference of {self.bench.samples} samples has too much noise; give more reference samples"
            if own > 0.5
            else "the image has too few pixels to separate errors from noise; give a larger scale"
        )
        return f"No quality that was tried is surely within {self.tolerance}: {fix}, or allow more."


def _join_words(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))
