"""The depth error that 95 % of the measured pixels in view of both eyes do not exceed."""

from __future__ import annotations

from typing import Any

import numpy as np

ICYMOON_API = 1
TITLE = "Depth error, 95 %"
UNIT = "m"
DECIMALS = 3


def measure(found: Any) -> float:
    """The quantile in metres, NaN where nothing was measured."""
    error = np.abs(found.depth_m - found.true_depth_m)[found.visible]
    error = error[np.isfinite(error)]
    return float(np.quantile(error, 0.95)) if error.size else float("nan")
