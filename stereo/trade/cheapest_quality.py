"""The cheapest way to compute the light of a scene that stereo matchers can bear, found by trying.

Runs in the evaluator's Python, as ``trade`` does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...files import explain_disk_errors, write_text
from ...render.cost.tolerance import Tolerance, every
from ...render.cost.variants import Variant, candidates, leaner, reference
from ...settings.description import changed, merged, to_toml
from ...system import remove
from ..environment import packages
from .measure_variants import Bench, RenderCounter, check_abilities, render_all, render_once

if TYPE_CHECKING:
    from ..matchers.methods import Method
    from .losses import Reference

#: Renders of a candidate at most: the more, the less its noise leaves in doubt.
_MOST_RENDERS = 4
#: What leaving out a part may change the mean radiance by, and the share of the time that it has to save.
_LIGHT, _SAVED = 0.01, 0.05
#: Of quality, what is always said of the choice.
_SAID = ("samples", "denoiser", "noise_threshold")


def find_cheapest_quality(bench: Bench, tolerance: Tolerance) -> dict[str, Any]:
    """The cheapest quality of the scene whose stereo error is within ``tolerance`` of that of an image without noise,
    for every matcher, in 19 of 20 cases; written to ``auto.toml`` in ``bench.out``, with what was tried.

    Tries the candidates from the cheapest on and stops at the first that does; then leaves parts of the light out, one
    after the other, where the error stays within, the mean radiance within a hundredth, and the time is less.
    Returns ``chosen`` (its name, or None), ``settings`` (to use), ``said`` (in words, a line each), ``file`` and
    ``tried``: of each name, seconds, renders, losses, what these may be off by, ``bias``, and whether it is ``within``
    (None: it cannot be told). Raises IcyMoonError if a render fails.
    """
    packages.require(*packages.PACKAGES)
    from ..matchers.methods import parse_methods
    from .losses import read_reference

    methods = parse_methods(bench.methods, own=bench.own)
    best = reference(bench.settings, bench.samples)
    ladder, parts = candidates(bench.settings, check_abilities(bench, best.settings)), leaner(bench.settings)
    counter = RenderCounter(bench.on_event, best.repeats + len(ladder) + len(parts))
    file = bench.out / "auto.toml"
    with explain_disk_errors("write to", bench.out):
        remove(file)  # what an earlier search said
    search = _Search(bench, read_reference(render_all(best, bench, counter), methods, {}), methods, tolerance, counter)
    chosen = next((variant for variant in ladder if search.try_variant(variant)), None)
    if chosen is None:
        return {"chosen": None, "settings": {}, "said": [*search.tried_lines(), search.failure_advice()], "file": None,
                "tried": search.tried}
    cost = search.tried[-1]["cpu_s"]
    for name, part in parts.items():
        trial = replace(chosen, name=f"{chosen.name}, {name}", settings=merged(chosen.settings, part))
        found = search.try_variant(trial) and search.tried[-1]
        if found and found["cpu_s"] < (1 - _SAVED) * cost and abs(found["bias"]) <= _LIGHT:
            chosen, cost = trial, found["cpu_s"]
    quality = chosen.settings["quality"]
    keys = {*_SAID, *changed(chosen.settings, bench.settings).get("quality", {})}
    settings = {"quality": {key: quality[key] for key in quality if key in keys}}
    said = [*search.tried_lines(), f"Use {chosen.name}: {cost:.1f} CPU seconds a pair here, within {tolerance} for "
            f"{_join_words([method.label for method in methods])}."]
    write_text(file, "".join(f"# {line}\n" for line in said) + to_toml(settings))
    return {"chosen": chosen.name, "settings": settings, "file": str(file), "tried": search.tried, "said": said}


@dataclass
class _Search:
    bench: Bench
    truth: Reference
    methods: list[Method]
    tolerance: Tolerance
    counter: RenderCounter
    tried: list[dict[str, Any]] = field(default_factory=list)

    def try_variant(self, variant: Variant) -> bool:
        """Whether a variant is surely within the tolerance; rendered again as long as that may tell."""
        from .losses import measure

        folders: list[Path] = []
        for count in range(1, _MOST_RENDERS + 1):
            self.counter.total += count > 1
            folders += render_once(variant, count - 1, self.bench, self.counter)
            found = measure(folders, self.truth, self.methods)
            verdict = self._verdict(found, 1.0)
            # Noise of independent renders falls with the root of their number, at best.
            if verdict is not None or self._verdict(found, (count / _MOST_RENDERS) ** 0.5) is None:
                break
        self.tried.append({"name": variant.name, "renders": len(folders), "within": verdict, **{
            key: found[key] for key in ("cpu_s", "wall_s", "bias", "loss", "loss_doubt")}})
        return verdict is True

    def _verdict(self, found: dict[str, Any], share: float) -> bool | None:
        """Whether all matchers are within, were the doubts this share of what they are."""
        return every(self.tolerance.keeps(loss, {key: doubt and share * doubt for key, doubt in found["loss_doubt"][
            label].items()}) for label, loss in found["loss"].items())

    def tried_lines(self) -> list[str]:
        """What was tried, a line each, for people."""
        words = {True: "within", False: "", None: "cannot be told"}
        return [f"{step['name']}: {step['cpu_s']:.1f} CPU s; " + ", ".join(
            self._loss_text(label, step) for label in step["loss"]) + (f"; {words[step['within']]}" * (
                step["within"] is not False)) for step in self.tried]

    def _loss_text(self, label: str, step: dict[str, Any]) -> str:
        from .advice import coverage_text

        said = []
        for key, factor, text in (("epe_px", 1.0, "{:+.3f}{} px"), ("wrong_or_missing", 100.0, "{:+.2f}{} % bad-1")):
            value, doubt = step["loss"][label][key], step["loss_doubt"][label][key]
            if key in self.tolerance.limits and value is not None:
                digits = 3 if factor == 1.0 else 2
                said.append(text.format(factor * value, f" ± {factor * doubt:.{digits}f}" if doubt is not None else ""))
        fewer = coverage_text(step["loss"][label], step["loss_doubt"][label])
        return f"{label} {' and '.join(said)}{fewer}" if said else f"{label} measures nothing"

    def failure_advice(self) -> str:
        """Why nothing was chosen, and what to do."""
        if all(step["within"] is False for step in self.tried):
            return f"Nothing that was tried is within {self.tolerance}; allow more."
        own = max((self.truth.own[method.label][key] or 0.0) / limit for method in self.methods
                  for key, limit in self.tolerance.limits.items())
        mend = (f"its reference of {self.bench.samples} samples has too much noise; give more reference samples"
                if own > 0.5 else "so few pixels do not tell it from noise; give a larger scale")
        return f"Nothing that was tried is surely within {self.tolerance}: {mend}, or allow more."


def _join_words(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))
