"""Icy landforms, each a height field of position that is added to the ground, each off by default.

A module holds one feature: where it comes from, its limits, and a maker
``make(settings, random, size_m) -> Landform | None``, None if its settings ask for none.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import chaos, cracks, craters, hollows, penitentes, pits, ridges
from .landform import Landform, Walls
from .plug_in import make_plugin_landforms

#: In the order in which they shape the ground; the position is part of each one's seed.
MAKERS: dict[str, Callable[[Any, np.random.Generator, float], Landform | None]] = {
    "chaos": chaos.make,
    "ridges": ridges.make,
    "cracks": cracks.make,
    "craters": craters.make,
    "hollows": hollows.make,
    "penitentes": penitentes.make,
    "pits": pits.make,
}

__all__ = ["MAKERS", "Landform", "Walls", "make_plugin_landforms"]
