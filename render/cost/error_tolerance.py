"""The stereo error that a quality may add to the error of an image without noise. Imports no Blender.

The command line and the window have the same limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ...support.errors import IcyMoonError

#: Tolerated mean disparity error, px: default, least and most.
PX, PX_LEAST, PX_MOST = 0.02, 1e-4, 10.0
#: Tolerated fraction of the pixels that are missing or off by more than 1 px: default, least and most.
BAD_1, BAD_1_LEAST, BAD_1_MOST = 0.005, 1e-5, 0.5


@dataclass(frozen=True)
class Tolerance:
    """The largest errors that a quality may add, None for no limit.

    ``epe_px`` is the mean disparity error in px, ``wrong_or_missing`` the fraction of the pixels that are missing or
    off by more than 1 px.
    """

    epe_px: float | None
    wrong_or_missing: float | None

    @property
    def limits(self) -> dict[str, float]:
        """The limits that are set, by the key of ``stereo.trade``'s losses."""
        return {
            key: value
            for key, value in (("epe_px", self.epe_px), ("wrong_or_missing", self.wrong_or_missing))
            if value is not None
        }

    def __str__(self) -> str:
        px = [] if self.epe_px is None else [f"{self.epe_px:g} px"]
        bad = [] if self.wrong_or_missing is None else [f"{100 * self.wrong_or_missing:g} % bad-1"]
        return " and ".join(px + bad)

    def allows(self, loss: Mapping[str, float | None], doubt: Mapping[str, float | None]) -> bool | None:
        """Return whether a matcher's ``loss`` is within the tolerance, for every value within ``doubt`` of it; None if
        ``doubt`` crosses the limit."""
        return combine_verdicts(_is_under(loss[key], doubt[key], limit) for key, limit in self.limits.items())


def combine_verdicts(verdicts: Iterable[bool | None]) -> bool | None:
    """Combine verdicts: True if all are true, False if one is false, otherwise None because one is unknown."""
    found = list(verdicts)
    return False if False in found else None if None in found else True


def _is_under(value: float | None, doubt: float | None, limit: float) -> bool | None:
    if value is None:
        return False
    return None if doubt is None or abs(value - limit) < doubt else value <= limit


def make_tolerance(epe_px: float | None, bad_1: float | None) -> Tolerance:
    """Make the tolerance with these limits, or, without any, with the default mean disparity error PX.

    Raises IcyMoonError for a limit out of range: a smaller error is lost in noise, and with a larger error stereo is
    useless.
    """
    if epe_px is None and bad_1 is None:
        epe_px = PX
    if epe_px is not None and not (math.isfinite(epe_px) and PX_LEAST <= epe_px <= PX_MOST):
        raise IcyMoonError(f"A tolerance of {epe_px:g} px cannot be searched for; give {PX_LEAST:g} to {PX_MOST:g} px.")
    if bad_1 is not None and not (math.isfinite(bad_1) and BAD_1_LEAST <= bad_1 <= BAD_1_MOST):
        raise IcyMoonError(
            f"A tolerance of {100 * bad_1:g} % bad-1 cannot be searched for; give {100 * BAD_1_LEAST:g} "
            f"% to {100 * BAD_1_MOST:g} %, as in 0.5% or 0.005."
        )
    return Tolerance(epe_px, bad_1)


def parse_fraction(text: str) -> float:
    """Parse a fraction, 0.005 for "0.5%" or "0.005". Raises ValueError for other texts."""
    number = text.strip()
    return float(number[:-1]) / 100 if number.endswith("%") else float(number)
