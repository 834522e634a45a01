"""What a reader must know before the numbers: sentences on pairs whose results say less than they seem to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...records import COUNT, NUMBER, TEXT, Maybe, Shape
from ..matchers.methods import Method
from ..matchers.search_range import FIXED, MISSED, STATED, TRUTH

#: ``search`` of a row, see ``search_range``.
SEARCH: Shape = Maybe({"least_px": COUNT, "most_px": COUNT, "source": TEXT,
                       "missed": Maybe(NUMBER, null=True)}, null=True)
_FIXES = {STATED: "Leave the option out, and the range follows from the rig.",
          FIXED: "Nothing is known of the rig, so state a larger range."}


class Notes:
    """Collects from rows, one after the other, what ``sentences`` says."""

    def __init__(self, methods: Sequence[Method]) -> None:
        self._search: dict[str, list[tuple[str, Mapping[str, Any]]]] = {method.label: [] for method in methods}

    def add(self, row: Mapping[str, Any]) -> None:
        """Add the row of a method on a pair."""
        label = row["method"]
        if row.get("search"):
            self._search[label].append((row["pair"], row["search"]))

    def sentences(self) -> list[str]:
        """What is to be said, the most important first."""
        missed = (self._missed(label, found) for label, found in self._search.items())
        from_truth = [label for label, found in self._search.items() if any(s["source"] == TRUTH for _, s in found)]
        known = (f"{label}: range from truth. It searches only the disparities that each pair contains, which no "
                 "camera knows." for label in from_truth)
        return [*filter(None, missed), *known]

    @staticmethod
    def _missed(label: str, found: Sequence[tuple[str, Mapping[str, Any]]]) -> str:
        beyond = [(each["missed"], pair, each) for pair, each in found if (each["missed"] or 0.0) > MISSED]
        if not beyond:
            return ""
        most, pair, worst = max(beyond, key=lambda entry: entry[0])
        fix = _FIXES.get(worst["source"], "State a larger range.")
        return (f"{label} cannot measure everything: in {len(beyond)} of {len(found)} pairs its search range leaves "
                f"out more than {100 * MISSED:g} % of the true disparities, at most {100 * most:.0f} % (pair {pair}, "
                f"searched {worst['least_px']} to {worst['most_px']} px). {fix}")
