"""Which rocks keep their support when the ground under them is dug away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ..rocks.rocks import Rocks

#: Loss of height in metres that counts as dug away.
_LOST_M = 2.0e-3
#: Points of a footprint: its centre and eight round it, at this share of the rock's diameter.
_RING = 0.3


def keep_supported(before: Rocks, after: Rocks, change_m: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Rocks:
    """Rocks at rest on dug ground, from the same rocks on untouched ground and on the floor of the trench.

    A simplification: a rock falls straight down and lies along the ground there, where most of its footprint has been
    dug away. Otherwise it stays. ``change_m`` is how much higher the ground is than untouched, at east and north.
    """
    if len(before.diameter_m) != len(after.diameter_m):
        raise ValueError("both grounds must have the same rocks")
    turn = np.linspace(0.0, 2 * np.pi, 8, endpoint=False)
    dx, dy = (np.append(f(turn), 0.0) * _RING * before.diameter_m[:, None] for f in (np.cos, np.sin))
    x, y = before.position_m[:, :1] + dx, before.position_m[:, 1:2] + dy
    falls = (change_m(x, y) < -_LOST_M).mean(axis=1) > 0.5
    arrays: dict[str, Any] = {}
    for each in fields(before):
        a, b = getattr(before, each.name), getattr(after, each.name)
        if isinstance(a, np.ndarray):
            arrays[each.name] = np.where(falls.reshape(-1, *[1] * (a.ndim - 1)), b, a)
    return replace(before, **arrays)
