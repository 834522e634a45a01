"""Find whether a cheaper rendering leads to the same decisions as the reference: where digging is safe, and the chosen
site.

The decisions of a matcher on a variant are compared with the same matcher's decisions on the reference, over the cells
in reach. Both are judged by the true heights of the reference. Cells of one map are not independent, so doubts are from
a jackknife over tiles of the map, as the doubts of a loss are over tiles of the image.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...render.cost.error_tolerance import combine_verdicts
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..decisions.rules import Rules
from ..decisions.safe_sites import Sites
from ..decisions.scores import score_sites
from ..decisions.workspace import Workspace, decide_from_depth, open_workspace
from ..measure.jackknife import jackknife, sum_over_tiles
from ..measure.prepare_pair import none_if_not_finite, prepare_pair
from ..measure.row_metrics import disparity_to_depth

#: Limits within which decisions count as the same, doubts included: the share of the cells in reach that are decided
#: differently, the change of the share of unsafe cells that are taken for safe, and the additional regret of the chosen
#: site. They are assumptions: a twentieth of the map, a hundredth of dangerous cells, a tenth of a margin.
MAX_OTHERWISE_SHARE, MAX_UNSAFE_SHARE, MAX_REGRET = 0.05, 0.01, 0.1
RULE = (
    f"Decisions are the same if at most {100 * MAX_OTHERWISE_SHARE:g} % of the cells in reach are decided otherwise, "
    f"the unsafe ones taken for safe differ by at most {100 * MAX_UNSAFE_SHARE:g} % of the cells, both with their "
    f"doubts, and the chosen site's regret is at most {MAX_REGRET:g} larger."
)


@dataclass(frozen=True)
class MatchedRender:
    """The left image of one render as matchers see it, and their disparities (H, W), px, by label."""

    left: Array
    disparities: dict[str, Array]


@dataclass(frozen=True)
class DecisionReference:
    """The workspace of a reference, and each matcher's decisions on it from the reference's images."""

    workspace: Workspace
    sites: dict[str, Sites]

    def decide(self, matched: MatchedRender) -> dict[str, Sites]:
        """Decide by each matcher on the images of a render; return the sites by label."""
        seen = replace(self.workspace, prepared=replace(self.workspace.prepared, left=matched.left))
        return {
            label: decide_from_depth(seen, disparity_to_depth(seen.prepared, disparity)).sites
            for label, disparity in matched.disparities.items()
        }

    def compare(self, renders: Sequence[MatchedRender]) -> dict[str, dict[str, Any]]:
        """Compare, by matcher, the decisions on renders of one variant with the reference's decisions, see
        ``_compare``.
        """
        found = [self.decide(matched) for matched in renders]
        return {label: self._compare([each[label] for each in found], own) for label, own in self.sites.items()}

    def _compare(self, found: Sequence[Sites], own: Sites) -> dict[str, Any]:
        """Compare the sites of renders of one variant with the reference's. All numbers are means over renders, None
        where undefined.

        ``otherwise`` is the share of the cells in reach with another decision. ``unsafe`` is the increase of unsafe
        cells that are taken for safe, as a share of all cells. Their ``_doubt`` is two standard errors. ``shift_m`` is
        the shift of the chosen site, and ``regret`` the increase of its regret. ``taken`` is the share of cells that
        are taken for safe on the reference. ``same`` is whether the decisions are equal within the limits, None where
        noise leaves this open.
        """
        truth, among = self.workspace.truth, self._find_judged_cells
        danger = among & ~truth.sites.safe
        sums = np.stack(
            [
                sum_over_tiles(among, among & (each.safe != own.safe), danger & each.safe, danger & own.safe)
                for each in found
            ]
        )
        values, errors = jackknife(_compute_shares, sums)
        result: dict[str, Any] = {
            "otherwise": none_if_not_finite(float(values[0])),
            "unsafe": none_if_not_finite(float(values[1])),
            "otherwise_doubt": none_if_not_finite(2 * float(errors[0])),
            "unsafe_doubt": none_if_not_finite(2 * float(errors[1])),
            "taken": float((among & own.safe).sum() / among.sum()),
        }
        result |= self._compare_choices(found, own)
        return result | {
            "same": combine_verdicts(
                (
                    _is_within(result["otherwise"], result["otherwise_doubt"], MAX_OTHERWISE_SHARE),
                    _is_within(result["unsafe"], result["unsafe_doubt"], MAX_UNSAFE_SHARE),
                    result.pop("as_good"),
                )
            )
        }

    @property
    def _find_judged_cells(self) -> Array:
        return np.asarray(self.workspace.reached & self.workspace.truth.dem.known)

    def _compare_choices(self, found: Sequence[Sites], own: Sites) -> dict[str, Any]:
        """Return the chosen site's ``shift_m`` and ``regret``, and whether it is ``as_good``."""
        first, *others = (
            score_sites(each, self.workspace.truth.sites, self._find_judged_cells) for each in (own, *found)
        )
        if any((each["chosen"] is None) != (first["chosen"] is None) for each in others):
            return {"shift_m": None, "regret": None, "as_good": False}
        if first["chosen"] is None:
            return {"shift_m": None, "regret": None, "as_good": True}
        cell = self.workspace.grid.cell_m
        shift = np.mean([math.dist(each["chosen"], first["chosen"]) * cell for each in others])
        if first["regret"] is None:  # no site is safe, so every choice is as wrong
            return {"shift_m": float(shift), "regret": None, "as_good": True}
        regret = float(np.mean([each["regret"] - first["regret"] for each in others]))
        return {"shift_m": float(shift), "regret": regret, "as_good": regret <= MAX_REGRET}


def _compute_shares(total: Array) -> Array:
    """Compute two shares (..., 2) of cells, means over renders: cells with another decision, and the excess over the
    reference of cells that are taken for safe but are unsafe.

    ``total`` (renders, ..., 4) are numbers of cells: all cells, cells with another decision, and cells taken but
    unsafe, on the variant and on the reference.
    """
    shares = np.stack([total[..., 1], total[..., 2] - total[..., 3]], axis=-1) / total[..., :1]
    return np.asarray(shares.mean(axis=0))


def open_decision_reference(folder: Path, matched: MatchedRender, rules: Rules) -> DecisionReference | str:
    """Make the reference's decisions on the pair in ``folder``, from ``matched`` images; or return a sentence on why
    there are no decisions.
    """
    try:
        workspace = open_workspace(prepare_pair(folder, {}), rules)
    except IcyMoonError as error:
        return f"Decisions are not compared: {error}"
    if not (workspace.reached & workspace.truth.dem.known).any():
        return (
            "Decisions are not compared: no cell of the workspace whose height is known is in reach; move the "
            "workspace, the arm or the camera."
        )
    deciding = DecisionReference(workspace, {})
    return replace(deciding, sites=deciding.decide(matched))


def _is_within(value: float | None, doubt: float | None, most: float) -> bool | None:
    """Return whether a share is within ``most`` of 0 on both sides, including its uncertainty; None if the uncertainty
    crosses the limit.
    """
    if value is None or doubt is None:
        return None
    return True if abs(value) + doubt <= most else False if abs(value) - doubt > most else None


def describe_decisions(found: Mapping[str, Any]) -> str:
    """Describe the differences of a variant's decisions in words."""
    site = "" if found["shift_m"] is None else f", its site {found['shift_m']:.2f} m away"
    return (
        f"{_format_percent(found, 'otherwise', '')} of the cells otherwise, "
        f"{_format_percent(found, 'unsafe', '+')} unsafe ones taken{site}"
    )


def _format_percent(found: Mapping[str, Any], key: str, sign: str) -> str:
    if found[key] is None:
        return "an unknown share"
    doubt = found[f"{key}_doubt"]
    return f"{round(100 * found[key], 1) + 0.0:{sign}.1f}{'' if doubt is None else f' ± {100 * doubt:.1f}'} %"
