"""Marks that a scoop leaves in the ground: grooves of its teeth, and a step where each pass ends.

Grooves are cosines across the blade, and steps are saw teeth along the pull, both with a whole number of periods. So
both have a mean of 0, and a pull to one depth digs the same volume as without marks. The number of teeth and the sizes
are guesses.
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
#: Sideways shift of the teeth from one pass to the next, over the distance between two teeth. It is the golden section,
#: so that no two passes near each other have the same grooves.
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
        """Add the marks of the scoop to the depths, in metres, of a pull of length ``length_m``. ``along_m`` is
        measured from its start, ``right_m`` from its centre line. In a cut less deep than ``height_m``, the marks are
        lower in proportion, so that no ground is dug where the blade stays above it.
        """
        passes = round(length_m / (_PASS_LENGTH * self.width_m))
        done = passes * along_m / length_m if passes else np.zeros_like(along_m)
        shift = _PASS_SHIFT * np.floor(done)
        grooves = 0.5 * np.cos(2.0 * math.pi * (TEETH * right_m / self.width_m + shift))
        steps = _STEP_HEIGHT * (done - np.floor(done) - 0.5 * bool(passes))
        share = np.clip(depth_m / self.height_m, 0.0, 1.0)
        return np.asarray(depth_m + share * self.groove_m * (grooves + steps))


def make_marks(width_m: float, strength: float, friction_deg: float) -> ScoopMarks | None:
    """Make the marks of a blade; None for ``strength`` 0. At strength 1 the flanks of the grooves are as steep as
    friction holds them.
    """
    if strength == 0.0:
        return None
    return ScoopMarks(width_m, strength * width_m / TEETH * math.tan(math.radians(friction_deg)) / math.pi)
