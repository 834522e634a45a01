"""Size-frequency laws of rocks: how many per square metre are larger than a diameter.

Two laws, both cut at a smallest and a largest diameter:

* a power law N(>D) ~ D^-a, as fitted to rock counts on Enceladus (Pajola et al. 2021, Universe 7,
  82). The exponent is a setting, because no metre-scale value is known for ice;
* Golombek's exponential F(>D) = k exp(-q D) for the share of the ground covered by rocks larger
  than D, with q = 1.79 + 0.152 / k per metre (Golombek and Rapp 1997, JGR 102 E2). It was fitted to
  rocks on Mars; for ice it is an analogue. Rocks per square metre follow from it since each rock
  of diameter D covers pi D²/4.

Rocks are counted from the largest down, so that "the n largest of the law" is a range of densities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ...settings.topics.rocks import RocksSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError

_TABLE_NODES = 8192  # nodes of Golombek's law; the trapezoidal rule is then within 1e-6


class SizeLaw(Protocol):
    """Rocks per square metre by diameter."""

    @property
    def smallest_m(self) -> float:
        """Diameter in metres at which the law starts."""
        ...

    @property
    def total_per_m2(self) -> float:
        """Rocks per square metre of all sizes of the law."""
        ...

    def per_m2_above(self, diameter_m: Array) -> Array:
        """Rocks per square metre that are larger than diameters in metres."""
        ...

    def diameter_m(self, per_m2: Array) -> Array:
        """Diameters in metres above which there are ``per_m2`` rocks per square metre."""
        ...


@dataclass(frozen=True)
class PowerLaw:
    """N(>D) ~ D^-index between two diameters in metres, covering a share of the ground."""

    coverage: float
    smallest_m: float
    largest_m: float
    index: float

    @property
    def mean_footprint_m2(self) -> float:
        """Mean of pi D²/4 in m²."""
        log_ratio = math.log(self.largest_m / self.smallest_m)
        if log_ratio == 0.0:
            return math.pi / 4 * self.smallest_m**2
        norm = -math.expm1(-self.index * log_ratio) / self.index  # integral of D^(-index-1), times smallest^index
        power = 2.0 - self.index
        second = log_ratio if abs(power) < 1e-9 else math.expm1(power * log_ratio) / power
        return math.pi / 4 * self.smallest_m**2 * second / norm

    @property
    def total_per_m2(self) -> float:
        """Rocks per square metre of all sizes."""
        return self.coverage / self.mean_footprint_m2

    @property
    def _share_above_largest(self) -> float:
        """Share of rocks above the largest diameter in the law without an upper end."""
        return (self.smallest_m / self.largest_m) ** self.index

    def per_m2_above(self, diameter_m: Array) -> Array:
        """Compute the rocks per square metre larger than diameters in metres; NaN if smallest and largest diameter are
        equal.
        """
        d = np.clip(diameter_m, self.smallest_m, self.largest_m)
        with np.errstate(invalid="ignore"):
            return (
                self.total_per_m2
                * ((self.smallest_m / d) ** self.index - self._share_above_largest)
                / (1.0 - self._share_above_largest)
            )

    def diameter_m(self, per_m2: Array) -> Array:
        """Compute the diameters in metres above which there are ``per_m2`` rocks per square metre."""
        share = np.asarray(per_m2) / self.total_per_m2
        return self.smallest_m * (share * (1.0 - self._share_above_largest) + self._share_above_largest) ** (
            -1.0 / self.index
        )


@dataclass(frozen=True)
class GolombekLaw:
    """Golombek's law for a rock abundance ``k``, between two diameters in metres."""

    k: float
    smallest_m: float
    largest_m: float

    @property
    def q_per_m(self) -> float:
        """Decay of the covered share with diameter, per metre."""
        return 1.79 + 0.152 / self.k

    def cover_above(self, diameter_m: Array) -> Array:
        """Compute the share of the ground under rocks larger than diameters in metres, without an upper end."""
        return self.k * np.exp(-self.q_per_m * np.asarray(diameter_m))

    @cached_property
    def _density_table(self) -> tuple[Array, Array]:
        """Diameters from the largest down, and the rocks per square metre above each."""
        log_d = np.linspace(math.log(self.largest_m), math.log(self.smallest_m), _TABLE_NODES)
        d = np.exp(log_d)
        # -dN/d(ln D) = (-dF/dD) D / (pi D²/4)
        slope = self.q_per_m * self.cover_above(d) * 4.0 / (math.pi * d)
        steps = (slope[1:] + slope[:-1]) / 2 * -np.diff(log_d)
        return d, np.append(0.0, np.cumsum(steps))

    @property
    def total_per_m2(self) -> float:
        """Rocks per square metre of all sizes."""
        return float(self._density_table[1][-1])

    def per_m2_above(self, diameter_m: Array) -> Array:
        """Compute the rocks per square metre larger than diameters in metres."""
        d, above = self._density_table
        return np.interp(np.log(diameter_m), np.log(d[::-1]), above[::-1])

    def diameter_m(self, per_m2: Array) -> Array:
        """Compute the diameters in metres above which there are ``per_m2`` rocks per square metre."""
        d, above = self._density_table
        return np.exp(np.interp(per_m2, above, np.log(d)))


def make_size_law(rocks: RocksSettings) -> PowerLaw | GolombekLaw:
    """Make the law that ``rocks`` settings describe; their coverage must be above 0.

    Raises IcyMoonError if the largest diameter is below the smallest.
    """
    smallest, largest = float(rocks.smallest_m), float(rocks.largest_m)
    if largest < smallest:
        raise IcyMoonError(
            f"rocks.largest_m ({largest:g} m) is below rocks.smallest_m ({smallest:g} m); "
            "raise the first or lower the second."
        )
    if rocks.law == "GOLOMBEK":
        return GolombekLaw(float(rocks.coverage), smallest, largest)
    return PowerLaw(float(rocks.coverage), smallest, largest, float(rocks.power_index))


def make_law_beyond(rocks: RocksSettings) -> SizeLaw:
    """Make the law of rocks beyond the patch: the law of ``make_size_law``, up to ``rocks.beyond_largest`` times its
    largest diameter. It has as many rocks per square metre of each size that both laws have. Rocks of one size have no
    law that could go on. Raises IcyMoonError as ``make_size_law`` does.
    """
    law = make_size_law(rocks)
    if rocks.beyond_largest == 1.0 or law.smallest_m == law.largest_m:
        return law
    largest = law.largest_m * float(rocks.beyond_largest)
    if isinstance(law, GolombekLaw):
        return replace(law, largest_m=largest)
    longer = replace(law, largest_m=largest)
    # The coverage of a power law fixes its number of rocks, and larger rocks add coverage.
    shared = longer.total_per_m2 - float(longer.per_m2_above(np.array(law.largest_m)))
    return replace(longer, coverage=law.coverage * law.total_per_m2 / shared)


def draw_diameters(law: SizeLaw, area_m2: float, most: int, random: np.random.Generator) -> tuple[Array, float]:
    """Draw the diameters in metres of the rocks on an area, largest first. Also return the smallest diameter that could
    be drawn.

    The number follows from the law, up to ``most``; beyond that, only the largest rocks of the law are drawn. One
    diameter comes from each of n equal parts of the law, so that sizes and covered share follow the law as closely as n
    rocks can.
    """
    total = law.total_per_m2 * area_m2
    n = round(min(total, most))
    reached = min(total, float(most)) / area_m2
    diameters = law.diameter_m((np.arange(n) + random.random(n)) / max(n, 1) * reached)
    return diameters, float(law.diameter_m(np.array(reached))) if total > most else law.smallest_m
