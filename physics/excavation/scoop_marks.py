"""Marks that a scoop leaves in the ground that it cuts: grooves of its teeth, and a step where each pass ends.

Grooves are cosines across the blade with a whole number of periods. Steps are saw teeth along the pull, also a whole
number. So both have a mean of 0, and a pull to one depth digs the volume that it digs without marks. The numbers of
teeth and the sizes are guesses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array

#: Number of teeth of a blade.
TEETH = 6
#: Length of a pass of the scoop over the width of its blade.
_PASS_LENGTH = 1.0
#: Height of the step between two passes over the depth of a groove.
_STEP_HEIGHT = 2.0
#: Share of the distance of two teeth by which the teeth of the next pass are off to the side: the golden section, so
#: that no two passes near each other have the same grooves.
_PASS_SHIFT = 0.381966


@dataclass(frozen=True)
class ScoopMarks:
    """Marks of a blade ``width_m`` wide, with grooves ``groove_m`` deep from ridge to bottom."""

    width_m: float
    groove_m: float

    @property
    def height_m(self) -> float:
        """The greatest height in metres of marks above or below the depth of the pull."""
        return 0.5 * (1.0 + _STEP_HEIGHT) * self.groove_m

    def add_to(self, depth_m: Array, along_m: Array, right_m: Array, length_m: float) -> Array:
        """Depths in metres with marks, from depths of a pull that is ``length_m`` long. ``along_m`` counts from its
        start, ``right_m`` from its middle. Where the pull is less deep than the marks are high, they are as low as it
        is deep, so that nothing is dug where the blade stays above the ground."""
        passes = round(length_m / (_PASS_LENGTH * self.width_m))
        done = passes * along_m / length_m if passes else np.zeros_like(along_m)
        shift = _PASS_SHIFT * np.floor(done)
        grooves = 0.5 * np.cos(2.0 * math.pi * (TEETH * right_m / self.width_m + shift))
        steps = _STEP_HEIGHT * (done - np.floor(done) - 0.5 * bool(passes))
        share = np.clip(depth_m / self.height_m, 0.0, 1.0)
        return np.asarray(depth_m + share * self.groove_m * (grooves + steps))


def make_marks(width_m: float, strength: float, friction_deg: float) -> ScoopMarks | None:
    """The marks of a blade, of a ``strength`` from 0 for none to 1 for grooves whose flanks are as steep as friction
    holds them."""
    if strength == 0.0:
        return None
    return ScoopMarks(width_m, strength * width_m / TEETH * math.tan(math.radians(friction_deg)) / math.pi)
