"""Walsh averages: the means of every two values and of each value with itself (Hodges and Lehmann 1963).

Values are rounded to a grid of whole numbers, so that ties, zeros and halves are exact.
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array

#: Bits of the largest value on the grid. Numbers that differ only by rounding are equal on it.
_GRID_BITS = 36
#: The binary exponent of the smallest number that is not zero.
_MIN_EXPONENT = -1074
#: Most values whose averages are all listed. Averages of more values are counted, which saves memory.
_MAX_LISTED_VALUES = 200
#: Number of remaining sums at which counting ends and listing begins.
_MAX_LISTED_SUMS = 4000


def round_to_grid(values: Array) -> tuple[Array, float]:
    """Return the finite ``values`` (n,) in ascending order as whole numbers, int64, and the size of their unit."""
    most = float(np.abs(values).max(initial=0.0))
    unit = float(np.ldexp(1.0, max(int(np.frexp(most)[1]) - _GRID_BITS, _MIN_EXPONENT))) if most > 0 else 1.0
    return np.sort(np.rint(values / unit).astype(np.int64)), unit


class WalshSums:
    """Sums of every two of ascending whole numbers (n,), and of each with itself: twice the Walsh averages."""

    def __init__(self, ascending: Array) -> None:
        self.values = ascending
        self.count = len(ascending) * (len(ascending) + 1) // 2
        self._listed: Array | None = None
        if len(ascending) <= _MAX_LISTED_VALUES:
            one, other = np.triu_indices(len(ascending))
            self._listed = np.sort(ascending[one] + ascending[other])

    def count_up_to(self, limit: int) -> int:
        """Count the sums that are at most ``limit``."""
        if self._listed is not None:
            return int(np.searchsorted(self._listed, limit, side="right"))
        ordered = np.searchsorted(self.values, limit - self.values, side="right").sum()
        return int(ordered + (2 * self.values <= limit).sum()) // 2

    def at(self, place: int) -> int:
        """Return the sum at the index ``place`` in ascending order, from 0 on."""
        if self._listed is not None:
            return int(self._listed[place])
        low, high, below, reached = 2 * int(self.values[0]) - 1, 2 * int(self.values[-1]), 0, self.count
        while reached - below > _MAX_LISTED_SUMS and high - low > 1:
            middle = (low + high) // 2
            if (count := self.count_up_to(middle)) > place:
                high, reached = middle, count
            else:
                low, below = middle, count
        return high if high - low == 1 else self._find_sum_between(low, high, place - below)

    def _find_sum_between(self, low: int, high: int, place: int) -> int:
        """Find the sum at the index ``place`` among the sums above ``low`` and up to ``high``."""
        own = np.arange(len(self.values))
        begin = np.maximum(np.searchsorted(self.values, low - self.values, side="right"), own)
        number = np.maximum(np.searchsorted(self.values, high - self.values, side="right") - begin, 0)
        one = np.repeat(own, number)
        other = np.arange(number.sum()) - np.repeat(number.cumsum() - number - begin, number)
        return int(np.partition(self.values[one] + self.values[other], place)[place])

    def find_twice_median(self) -> int:
        """Return twice the median of the sums, which is four times the median of the averages."""
        middle = self.at(self.count // 2)
        return middle + (middle if self.count % 2 else self.at(self.count // 2 - 1))
