"""The result of a matcher."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.number_text import format_count
from ..adapters.icymoon_serve import drop_single_axes

#: Kinds of numbers that state a confidence: from 0 to 1, an expected error in px, or the logit of a confidence.
CONFIDENCE_KINDS = CONFIDENCE, ERROR_PX, LOGIT = "confidence", "error_px", "logit"


def _to_sigmoid(logit: Array) -> Array:
    return np.asarray(1 / (1 + np.exp(-np.clip(logit, -80.0, 80.0))))


#: The rule that turns each kind of numbers into a confidence. An expected error of e px is the confidence exp(-e),
#: which is also what icynet learns; only the calibration depends on this choice, since every order is kept.
_RULES: dict[str, Callable[[Array], Array]] = {
    CONFIDENCE: np.asarray,
    ERROR_PX: lambda error: np.exp(-error),
    LOGIT: _to_sigmoid,
}


@dataclass(frozen=True)
class Confidence:
    """A matcher's confidence in each pixel of its disparity map, as the matcher states it: ``values`` of one of the
    kinds.
    """

    values: object  # (H, W), any number where nothing was measured
    kind: str = CONFIDENCE

    def check(self, who: str, valid: Array) -> Array:
        """Check the values, and return the confidence, float32 (H, W) from 0 to 1, 0 where not ``valid``.

        Raises IcyMoonError, which begins with ``who``, for another shape, and for a value of a valid pixel that is not
        a number or not in the range of its kind.
        """
        try:
            found = drop_single_axes(np.ma.filled(np.ma.asarray(self.values, np.float64), np.nan))
        except (TypeError, ValueError):
            raise IcyMoonError(
                f"{who} states a confidence of {type(self.values).__name__}; give an array of numbers."
            ) from None
        if found.shape != valid.shape:
            raise IcyMoonError(
                f"{who} states a confidence of the shape {found.shape} for images of {valid.shape}; give a number for "
                "each pixel of the left image."
            )
        judged = found[valid]
        if unknown := int(np.isnan(judged).sum()):
            raise IcyMoonError(
                f"{who} states no confidence (NaN) for {format_count(unknown, 'measured pixel')}; give 0 to "
                "pixels that cannot be trusted."
            )
        least, most = (float(judged.min()), float(judged.max())) if judged.size else (0.0, 0.0)
        if self.kind == CONFIDENCE and not 0 <= least <= most <= 1:
            raise IcyMoonError(
                f"{who} states confidences from {least:.4g} to {most:.4g}; give numbers from 0 to 1, or state expected "
                "errors in px as such."
            )
        if self.kind == ERROR_PX and least < 0:
            raise IcyMoonError(f"{who} states an expected error of {least:.4g} px; give 0 or more.")
        confidence = np.zeros(valid.shape, np.float32)
        confidence[valid] = _RULES[self.kind](judged)
        return confidence


@dataclass(frozen=True)
class Result:
    """A disparity map, and the further reports of the matcher."""

    disparity: Array  # float (H, W) px, NaN where there is no measurement
    arrays: dict[str, Array] = field(default_factory=dict)  # kept in the npz beside the disparity
    counts: dict[str, int] = field(default_factory=dict)  # pixels per outcome
    facts: dict[str, Any] = field(default_factory=dict)  # such as the device, for the provenance
    costs: dict[str, float] = field(default_factory=dict)  # costs of another process, by names from metrics.COSTS
    confidence: Confidence | None = None  # confidence in each pixel, if the matcher states one
