"""What a matcher hands back."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Result:
    """Disparity and what else a matcher knows."""

    disparity: np.ndarray  # float (H, W) px, NaN where there is no measurement
    arrays: dict[str, np.ndarray] = field(default_factory=dict)  # kept in the npz beside the disparity
    counts: dict[str, int] = field(default_factory=dict)  # pixels per outcome
    facts: dict[str, Any] = field(default_factory=dict)  # what it ran on, for the provenance
