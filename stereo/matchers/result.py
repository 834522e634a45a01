"""The result of a matcher."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ...support.arrays import Array


@dataclass(frozen=True)
class Result:
    """A disparity map, and the further reports of the matcher."""

    disparity: Array  # float (H, W) px, NaN where there is no measurement
    arrays: dict[str, Array] = field(default_factory=dict)  # kept in the npz beside the disparity
    counts: dict[str, int] = field(default_factory=dict)  # pixels per outcome
    facts: dict[str, Any] = field(default_factory=dict)  # such as the device, for the provenance
    costs: dict[str, float] = field(default_factory=dict)  # costs of another process, by names from metrics.COSTS
