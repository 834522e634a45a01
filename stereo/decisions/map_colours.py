"""The colours of a stored map of decisions, and the number of cells of each kind. Needs only NumPy."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from ..images.colours import ERROR_SCALE, INVALID_GREY, colour_signed_errors
from .stored_maps import HEIGHT_ERROR, SLOPE, SUITABILITY, StoredMap

#: Height error, m, from which on the colour is saturated, as in the pictures of the report.
SATURATED_ERROR_M = 0.05
#: Texts of the legend for each kind of cell, by map.
LEGEND_BY_MAP = {
    SUITABILITY: {
        "safe": "Safe by the rules, green",
        "unsafe": "Not safe, orange",
        "unknown": "Not known or out of reach, grey",
    },
    SLOPE: {
        "gentle": "As gentle as the rules ask, green",
        "steep": "Up to twice as steep, yellow",
        "steeper": "Steeper, red",
        "unknown": "Not known, grey",
    },
    HEIGHT_ERROR: {
        "high": "Too high, red",
        "low": "Too low, blue",
        "right": f"Within {100 * ERROR_SCALE.low:g} cm, white",
        "unknown": "Not known, grey",
    },
}
#: Values and RGB colours between which colours are interpolated. The values are margins, or ratios of slopes to the
#: slope of the rules. Two entries at almost the same value are the border between two kinds.
_BORDER_WIDTH = 1e-9
_COLOUR_STOPS = {
    SUITABILITY: ((-1.0, (160, 60, 0)), (-_BORDER_WIDTH, (244, 190, 140)), (0.0, (180, 225, 190)), (0.5, (0, 140, 90))),
    SLOPE: (
        (0.0, (0, 120, 80)),
        (1.0, (180, 225, 190)),
        (1.0 + _BORDER_WIDTH, (250, 235, 150)),
        (2.0, (240, 200, 66)),
        (2.0 + _BORDER_WIDTH, (235, 130, 110)),
        (4.0, (150, 20, 20)),
    ),
}


def colour_cells(stored: StoredMap) -> Array:
    """Colour a stored map: RGB, uint8 (rows, columns, 3)."""
    values = stored.values
    if stored.kind == HEIGHT_ERROR:
        return colour_signed_errors(values.ravel(), SATURATED_ERROR_M).reshape(*values.shape, 3)
    scaled = values / stored.slope_deg if stored.kind == SLOPE else values
    at, rgb = zip(*_COLOUR_STOPS[stored.kind], strict=True)
    colours = np.stack([np.interp(scaled, at, channel) for channel in zip(*rgb, strict=True)], axis=-1)
    return np.where(np.isfinite(values)[..., None], np.rint(np.nan_to_num(colours)), INVALID_GREY).astype(np.uint8)


def count_cells(stored: StoredMap) -> dict[str, int]:
    """Count the cells of a map by the kinds in ``LEGEND_BY_MAP``."""
    known = np.isfinite(stored.values)
    values = stored.values[known]
    if stored.kind == SUITABILITY:
        of = {"safe": values >= 0, "unsafe": values < 0}
    elif stored.kind == SLOPE:
        share = values / stored.slope_deg
        of = {"gentle": share <= 1, "steep": (share > 1) & (share <= 2), "steeper": share > 2}
    else:
        of = {
            "high": values > ERROR_SCALE.low,
            "low": values < -ERROR_SCALE.low,
            "right": np.abs(values) <= ERROR_SCALE.low,
        }
    return {kind: int(which.sum()) for kind, which in of.items()} | {"unknown": int((~known).sum())}
