"""Notes for the reader before the numbers: sentences on pairs whose results are less certain than they seem."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...support.file_schemas import COUNT, NUMBER, TEXT, Maybe, Shape
from ...support.number_text import format_count, show_rounded
from ..images.disparity_and_occlusion import ESTIMATED
from ..matchers.methods import Method, describe_method
from ..matchers.search_range import FIXED, REPORTED_MISSED_SHARE, STATED, TRUTH
from ..measure.render_noise import BAKE, DECIDES, NOISY, UNKNOWN
from .table_columns import NOISE_DECIDES

#: ``search`` of a row, see ``search_range``.
SEARCH: Shape = Maybe(
    {"least_px": COUNT, "most_px": COUNT, "source": TEXT, "missed": Maybe(NUMBER, null=True)}, null=True
)
_NUMBER_OR_NULL = Maybe(NUMBER, null=True)
_LIGHT_PART_SHAPE = {
    "share": NUMBER,
    "noise_dn": _NUMBER_OR_NULL,
    "hidden": _NUMBER_OR_NULL,
    "baked_dn": _NUMBER_OR_NULL,
    "by_bake": _NUMBER_OR_NULL,
}
#: ``noise`` of the facts of a pair, see ``render_noise``.
NOISE: Shape = Maybe(
    {
        "verdict": Maybe(TEXT, null=True),
        "larger": Maybe(TEXT, null=True),
        "lit": _LIGHT_PART_SHAPE,
        "shadow": _LIGHT_PART_SHAPE,
        "doubt": _NUMBER_OR_NULL,
    },
    null=True,
)
#: ``baked`` of the facts of a pair: noise of baked light over all light, its share of the light, and the limit in the
#: settings.
BAKED: Shape = Maybe({"noise": Maybe(NUMBER), "share": Maybe(NUMBER), "bound": NUMBER}, null=True)
_FIX_BY_NOTE = {
    STATED: "Leave the option out, and the range follows from the rig.",
    FIXED: "Nothing is known of the rig, so state a larger range.",
}


@dataclass(frozen=True)
class Note:
    """A note for the reader, in brief and in ``detail``. A ``doubtful`` note gives a reason why results may be wrong or
    unfair; other notes are facts about the data.
    """

    brief: str
    detail: str
    doubtful: bool = False

    @property
    def sentence(self) -> str:
        """The note and its detail as one sentence."""
        return f"{self.brief}: {self.detail}"


class Notes:
    """Collects notes from pairs and rows, one after the other; ``found`` returns them."""

    def __init__(self, methods: Sequence[Method], faults: Sequence[str] = ()) -> None:
        self._faults = list(faults)
        self._failures: dict[str, list[str]] = {}
        self._search: dict[str, list[tuple[str, Mapping[str, Any]]]] = {method.label: [] for method in methods}
        self._pairs, self._unknown, self._estimated, self._estimated_renders = 0, 0, 0, 0
        self._noisy: list[bool] = []  # whether the larger part is noise of baked light
        self._decided: list[tuple[float, bool]] = []  # doubt, and whether the larger part is noise of baked light
        self._baked: list[tuple[float, float, float]] = []  # noise, share, bound

    def add_pair(self, facts: Mapping[str, Any]) -> bool:
        """Add the facts of a pair; return whether noise of its render decides its result."""
        noise = facts.get("noise") or {}
        self._pairs += 1
        self._unknown += noise.get("verdict") == UNKNOWN
        self._estimated += facts.get("occlusion") == ESTIMATED
        self._estimated_renders += facts.get("occlusion") == ESTIMATED and "layout" not in facts
        baked = facts.get("baked")
        if baked:
            self._baked.append((baked.get("noise", 0.0), baked.get("share", 0.0), baked["bound"]))
        decided, by_bake = noise.get("verdict") == DECIDES, noise.get("larger") == BAKE
        self._decided += [(noise["doubt"], by_bake)] if decided else []
        self._noisy += [by_bake] if noise.get("verdict") == NOISY else []
        return bool(decided)

    def add(self, row: Mapping[str, Any]) -> None:
        """Add the row of a method on a pair."""
        label = row["method"]
        for name, sentence in row.get("plug_in_faults", {}).items():
            self._failures.setdefault(name, []).append(f"{describe_method(label)} on {row['pair']}: {sentence}")
        if row.get("search"):
            self._search[label].append((row["pair"], row["search"]))

    @property
    def noise_doubt(self) -> float:
        """The difference between two methods' mean shares of wrong or missing pixels that noise alone may make; 0 if
        noise decides the result of no pair. A mean changes by the mean of the pairs' doubts at most."""
        return sum(doubt for doubt, _ in self._decided) / max(self._pairs, 1)

    def found(self) -> list[Note]:
        """Return the notes, the most important first."""
        missed = (self._note_missed(label, found) for label, found in self._search.items())
        from_truth = [label for label, found in self._search.items() if any(s["source"] == TRUTH for _, s in found)]
        known = (
            Note(
                f"{describe_method(label)} has its range from truth",
                "it searches only the disparities that each pair contains, which no camera knows.",
                True,
            )
            for label in from_truth
        )
        return [
            *filter(None, missed),
            *self._note_noise(),
            *known,
            *self._note_plugins(),
            *self._note_occlusion(),
            *self._note_baked_light(),
        ]

    def _note_plugins(self) -> Iterator[Note]:
        for fault in self._faults:
            yield Note("A metric is left out", fault, True)
        for name, sentences in self._failures.items():
            yield Note(
                f"The metric {name} failed {format_count(len(sentences), 'time')}",
                f"the first time, {sentences[0]}",
                True,
            )

    def _note_occlusion(self) -> Iterator[Note]:
        if self._estimated:
            better = " Pairs rendered since version 0.2 with quality.truth FULL contain what rays found."
            yield Note(
                f"Hidden pixels are estimated in {self._estimated} of {format_count(self._pairs, 'pair')}",
                f"from the depths of both eyes.{better if self._estimated_renders else ''}",
            )

    def _note_baked_light(self) -> Iterator[Note]:
        if not self._baked:
            return
        noise, share, _ = max(self._baked)
        over = sum(0.0 < bound < noise for noise, _, bound in self._baked)  # 0: any noise is accepted
        more = f" In {over} of them it is above quality.bake_noise; raise quality.bake_samples." if over else ""
        yield Note(
            f"Indirect light is baked in {len(self._baked)} of {format_count(self._pairs, 'pair')}",
            "its noise is fixed to the ground, alike in both eyes, so matchers take it for texture. It is at "
            f"most {show_rounded(100 * noise)} % of the light, in a pair of which "
            f"{show_rounded(100 * share)} % is indirect.{more}",
            over > 0,
        )

    def _note_noise(self) -> Iterator[Note]:
        if self._decided:
            doubt, by_bake = max(doubt for doubt, _ in self._decided), [by_bake for _, by_bake in self._decided]
            names = {"quality.bake_samples" if each else "quality.samples" for each in by_bake}
            yield Note(
                f"{NOISE_DECIDES}{self._format_pair_count(len(self._decided))}",
                "in light or in shadow, more than 5 % of the pixels have less texture than noise. Methods that "
                f"differ by less than {show_rounded(100 * doubt)} % of the pixels may differ by "
                f"noise alone; raise {' and '.join(sorted(names))} and look whether their order stays."
                + _describe_baked_noise(by_bake),
                True,
            )
        if self._unknown:
            yield Note(
                f"The noise of baked light is unknown{self._format_pair_count(self._unknown)}",
                "it is fixed to the ground, alike in both eyes, so comparing them does not show it, and an "
                "older version of Icy Moon kept no error of the bake. Matchers may take it for texture and look "
                "better than they are; render these pairs again into another data set.",
                True,
            )
        if self._noisy:
            yield Note(
                f"The render is noisy{self._format_pair_count(len(self._noisy))}",
                "in light or in shadow, 1 to 5 % of the pixels have less texture than noise."
                + _describe_baked_noise(self._noisy),
            )

    def _format_pair_count(self, count: int) -> str:
        return f" in {count} of {self._pairs} pairs" if self._pairs > 1 else ""

    @staticmethod
    def _note_missed(label: str, found: Sequence[tuple[str, Mapping[str, Any]]]) -> Note | None:
        beyond = [
            (each["missed"], pair, each) for pair, each in found if (each["missed"] or 0.0) > REPORTED_MISSED_SHARE
        ]
        if not beyond:
            return None
        most, pair, worst = max(beyond, key=lambda entry: entry[0])
        fix = _FIX_BY_NOTE.get(worst["source"], "State a larger range.")
        return Note(
            f"{describe_method(label)} cannot measure everything",
            f"in {len(beyond)} of {format_count(len(found), 'pair')} its search range leaves out more than "
            f"{100 * REPORTED_MISSED_SHARE:g} % of the true disparities, at most {100 * most:.0f} % (pair {pair}, "
            f"searched {worst['least_px']} to {worst['most_px']} px). {fix}",
            True,
        )


def _describe_baked_noise(by_bake: Sequence[bool]) -> str:
    """Write the warning on pairs in which noise of baked light is the larger part of the noise; "" without such
    pairs.
    """
    count = sum(by_bake)
    if not count:
        return ""
    which = "Most of it is" if count == len(by_bake) else f"In {format_count(count, 'pair')} of these most of it is"
    return (
        f" {which} noise of baked light, which is fixed to the ground: matchers take it for texture and look "
        "better than they are."
    )
