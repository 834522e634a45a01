"""Icy landforms, each a height field of position that is added to the ground, each off by default.

A module holds one feature: its origin, its limits, and a maker ``make(settings, random, size_m) -> Landform | None``.
The maker returns None if the settings ask for no such feature.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import chaos, cracks, craters, hollows, penitentes, pits, ridges
from .landform import Landform, Walls
from .plug_in import make_plugin_landforms

#: Makers in the order in which landforms shape the ground; the position is part of the seed.
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
