"""Patterns of projectors, arrays (count, rows, columns) float32 from 0 to 1: dots, stripes, and Gray code with phase.

A Gray code and phase shifts together give the column of the projector that lights a pixel of a camera. Sources of the
Gray code b ⊕ (b >> 1): Gray 1953; of phase shifts: Srinivasan et al. 1984, Applied Optics 23, 3105. Imports no Blender.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from .device import Projector

#: Names of the patterns.
PATTERNS = ("DOTS", "STRIPES", "GRAY_PHASE")
#: Minimum number of phase shifts.
_MIN_SHIFTS = 3


@dataclass(frozen=True)
class Pattern:
    """The patterns of a projector: one of dots, one of stripes, or a sequence of Gray code and phase. ``dots`` is the
    number of dots, ``dot_px`` their diameter, ``period_px`` the period of stripes, and ``shifts`` the number of their
    phases.
    """

    kind: str = "DOTS"
    dots: int = 3000
    dot_px: float = 3.0
    period_px: float = 32.0
    shifts: int = 4
    seed: int = 0

    def make(self, projector: Projector) -> Array:
        """Make the patterns, (count, rows, columns). Raises IcyMoonError for an unknown kind and for numbers that give
        no pattern. Numbers of the other kinds are checked too, because pairs state all of them.
        """
        _check_dot(self.dot_px)
        _check_period(self.period_px)
        if self.kind == "DOTS":
            return make_dots(projector, self.dots, self.dot_px, self.seed)[None]
        if self.kind == "STRIPES":
            return make_stripes(projector, self.period_px)[None]
        if self.kind == "GRAY_PHASE":
            return make_gray_and_phase(projector, self.period_px, self.shifts)
        raise IcyMoonError(f"There is no pattern {self.kind[:40]!r}; choose one of {', '.join(PATTERNS)}.")


def make_dots(projector: Projector, count: int, size_px: float, seed: int) -> Array:
    """Make a pattern (rows, columns) of about ``count`` round dots of one diameter, each at a random place in its cell
    of a grid. The same seed gives the same dots. Raises IcyMoonError for an impossible number or diameter.
    """
    if count < 1 or count > projector.columns * projector.rows:
        raise IcyMoonError(f"The projector has {count} dots; give 1 to {projector.columns * projector.rows}.")
    _check_dot(size_px)
    across = max(1, round(math.sqrt(count * projector.columns / projector.rows)))
    down = max(1, round(count / across))
    random = np.random.default_rng([seed, 45])
    column, row = (each.ravel() for each in np.meshgrid(np.arange(across), np.arange(down)))
    x = (column + random.uniform(size=column.size)) * projector.columns / across
    y = (row + random.uniform(size=row.size)) * projector.rows / down
    made = np.zeros((projector.rows, projector.columns), np.float32)
    reach = math.ceil(size_px / 2 + 1)
    for dx in range(-reach, reach + 1):
        for dy in range(-reach, reach + 1):
            i, j = np.floor(x).astype(int) + dx, np.floor(y).astype(int) + dy
            away = np.hypot(i + 0.5 - x, j + 0.5 - y)
            value = np.clip(size_px / 2 + 0.5 - away, 0.0, 1.0).astype(np.float32)
            inside = (i >= 0) & (i < projector.columns) & (j >= 0) & (j < projector.rows)
            np.maximum.at(made, (j[inside], i[inside]), value[inside])
    return made


def make_stripes(projector: Projector, period_px: float, shift_rad: float = 0.0) -> Array:
    """Make vertical stripes of a sinusoid, (rows, columns): the value at column u is (1 + cos(2π u / period + shift)) /
    2.
    """
    _check_period(period_px)
    at = np.arange(projector.columns) + 0.5
    row = 0.5 + 0.5 * np.cos(2 * np.pi * at / period_px + shift_rad)
    return np.tile(row.astype(np.float32), (projector.rows, 1))


def count_gray_bits(projector: Projector, period_px: float) -> int:
    """Count the Gray patterns, one for each bit, that give each half period its own number."""
    return max(1, math.ceil(math.log2(projector.columns / (period_px / 2))))


def make_gray_and_phase(projector: Projector, period_px: float, shifts: int) -> Array:
    """Make a sequence (count, rows, columns): all on, all off, the Gray code of the half periods from its highest bit
    on, and the shifted stripes.
    """
    _check_period(period_px)
    if not _MIN_SHIFTS <= shifts <= 64:
        raise IcyMoonError(f"The phase has {shifts} shifts; give {_MIN_SHIFTS} to 64.")
    half = np.floor((np.arange(projector.columns) + 0.5) / (period_px / 2)).astype(int)
    gray, bits = half ^ (half >> 1), count_gray_bits(projector, period_px)
    rows = [np.ones(projector.columns), np.zeros(projector.columns)]
    rows += [(gray >> bit & 1).astype(float) for bit in range(bits - 1, -1, -1)]
    flat = [np.tile(row.astype(np.float32), (projector.rows, 1)) for row in rows]
    return np.stack(flat + [make_stripes(projector, period_px, 2 * np.pi * n / shifts) for n in range(shifts)])


def _check_dot(size_px: float) -> None:
    if not 0.5 <= size_px <= 1000:
        raise IcyMoonError(f"The projector's dots are {size_px:g} pixels wide; give 0.5 to 1000.")


def _check_period(period_px: float) -> None:
    if not 4 <= period_px <= 1e6:
        raise IcyMoonError(f"The stripes have a period of {period_px:g} pixels; give 4 or more.")
