"""The disparities that a matcher searches: from the rig, from the truth, or as the user states.

``disparities=auto`` (or ``max_disparity=auto``) searches the disparities that the rig can see; ``disparities=truth``
searches the true disparities of the pair, which no camera knows; the report states this. Numbers are searched as
stated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...physics.camera.nearest_ground import find_greatest_disparity_px
from ...physics.camera.search_range import disparity_range_px
from ...physics.rig.focal_length import focal_px
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError

AUTO, TRUTH = "auto", "truth"
#: Values of ``SearchRange.source``, the origin of a range.
RIG, SETTINGS, STATED, FIXED = "rig", "settings", "stated", "fixed"
#: Numbers of disparities are multiples of this, as OpenCV's matchers require.
STEP_PX = 16
#: Most disparities that are searched unless the user states more.
MAX_SEARCHED_PX = 1024
#: Share of the true disparities outside the search range above which a report mentions it.
REPORTED_MISSED_SHARE = 0.01
#: Number of disparities, from 0, for an unknown rig.
_UNKNOWN_RIG_PX = 96


@dataclass(frozen=True)
class SearchRange:
    """The integer disparities ``least_px`` to ``most_px``, both searched, and their source."""

    least_px: int
    most_px: int
    source: str

    def to_json(self, true_disparity: Array) -> dict[str, Any]:
        """Return the ``search`` entry of a row, with the share of true disparities that the range ``missed``."""
        return {**asdict(self), "missed": self.missed(true_disparity)}

    def missed(self, true_disparity: Array) -> float | None:
        """Return the share of true disparities, px, without a searched disparity within half a pixel; None if all of
        them are NaN.
        """
        known = true_disparity[np.isfinite(true_disparity)]
        if not known.size:
            return None
        return float(np.mean((known < self.least_px - 0.5) | (known > self.most_px + 0.5)))


def find_rig_range(settings: Settings, described: bool = True) -> SearchRange | None:
    """Find the disparities that the rig of the settings has in view, from its pose; None without ground in view.

    If the settings describe the whole scene, the near end follows from the described ground and rocks (SETTINGS).
    Otherwise relief may reach half of the camera's height (RIG).
    """
    rig = settings.rig
    bounds = disparity_range_px(rig)
    greatest = find_greatest_disparity_px(settings, focal_px(rig)) if described else None
    if greatest is not None:
        return _enclose_disparities(bounds[0] if bounds else 0.0, greatest, int(rig.width_px), SETTINGS)
    return None if bounds is None else _enclose_disparities(*bounds, int(rig.width_px), RIG)


def find_true_range(true_disparity: Array) -> SearchRange | None:
    """Find the range that encloses all true disparities (H, W), px; None if all are unknown."""
    known = true_disparity[np.isfinite(true_disparity)]
    if not known.size:
        return None
    # One more on both sides, since the sub-pixel fit needs neighbours.
    return _enclose_disparities(float(known.min()) - 1, float(known.max()) + 1, true_disparity.shape[1], TRUTH)


def find_known_ranges(
    settings: Settings | None, true_disparity: Array | None, by_hand: bool = False
) -> dict[str, SearchRange]:
    """Find the ranges of AUTO and TRUTH, if known, for ``match``.

    ``settings`` are the pair's settings, which do not describe the whole scene if it was edited ``by_hand``.
    ``true_disparity`` is NaN where only one eye sees the point.
    """
    found = {
        AUTO: find_rig_range(settings, not by_hand) if settings is not None else None,
        TRUTH: find_true_range(true_disparity) if true_disparity is not None else None,
    }
    return {name: each for name, each in found.items() if each is not None}


def require_range(method: str, word: str, option: str, ranges: Mapping[str, SearchRange]) -> SearchRange:
    """Return the range that an option names by AUTO or TRUTH; for AUTO without a known rig, a range of fixed size.

    Raises IcyMoonError if the true disparities are asked for and not known.
    """
    if word in ranges:
        return ranges[word]
    if word == AUTO:
        return SearchRange(0, _UNKNOWN_RIG_PX - 1, FIXED)
    raise IcyMoonError(f"{method}.{option} is {word}, but the true disparity is unknown here; give auto or a number.")


def refuse_true_range(options: Mapping[str, Any], whose: str) -> None:
    """Raise IcyMoonError if the ``options`` of a method, which ``whose`` names, ask for the true disparities."""
    if TRUTH in options.values():
        raise IcyMoonError(
            f"{whose} searches the range of the true disparities, which a lander does not know; leave the option out, "
            f"or give it {AUTO}."
        )


def _enclose_disparities(low_px: float, high_px: float, width_px: int, source: str) -> SearchRange:
    """Return a range that encloses both values. It starts at a multiple of STEP_PX, and its number of disparities is a
    multiple too. No disparity reaches the number of columns of the image.
    """
    high = min(math.ceil(high_px), width_px - 1)
    least = max(0, STEP_PX * math.floor(min(low_px, high) / STEP_PX))
    count = STEP_PX * max(1, math.ceil((high + 1 - least) / STEP_PX))
    return SearchRange(least, least + min(count, MAX_SEARCHED_PX) - 1, source)
