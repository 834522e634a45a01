"""Debris: fragments that rocks have shed, on the ground around them.

A rock of diameter D sheds fragments whose volumes add up to a share of its own; all fragments count as alike in shape.
Their number follows N(>d) ~ d^-a, from ``_LARGEST`` D down to a smallest diameter that is the same for all rocks, so a
larger rock has more fragments and larger ones. Broken rocks mostly have exponents near 2.5 over one or two orders of
magnitude (Turcotte 1986, J. Geophys. Res. 91 B2, 1921; Glazner and Mills 2012, Geosphere 8, 902); above 3, most of the
volume is in the smallest fragments.

A fragment lies beyond the outline of its rock, at an exponentially distributed distance. This is the distribution of
travel of particles that lose by friction as much energy as they gain (Furbish et al. 2021, Earth Surf. Dynam. 9, 577).
Coarser fragments travel farther, as on screes (Statham 1976, Earth Surf. Process. 1, 43), so fines are at the foot. The
distances, and their growth with size, are guesses for ice: rocks on the Moon break in place too (Ruesch et al. 2020,
Icarus 336, 113431), but no image shows either moon at metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...settings.topics.rocks import RocksSettings
from ...support.arrays import Array

#: Largest possible diameter of a fragment over the diameter of its rock: a guess.
_LARGEST = 0.3
#: Exponent by which the mean distance grows with a fragment's diameter: a guess.
_SORTING = 0.5
#: Halvings of the range of the smallest diameter that keeps to a number of fragments.
_HALVINGS = 60


@dataclass(frozen=True)
class Outlines:
    """Ellipses on the map around ``n`` rocks: ``places_m`` (n, 2) are their centres, ``half_m`` (n, 2) the longer and
    the shorter half axis, and ``turn_rad`` (n,) the direction of the longer axis from east over north.
    """

    places_m: Array
    half_m: Array
    turn_rad: Array


@dataclass(frozen=True)
class Debris:
    """``n`` fragments, largest first: ``places_m`` (n, 2), ``diameter_m`` (n,), and ``parent`` (n,) the index of the
    rock from which each comes. ``smallest_m`` is the smallest diameter that a fragment could have; a limit on their
    number raises it above the setting.
    """

    places_m: Array
    diameter_m: Array
    parent: Array
    smallest_m: float


def shed_debris(
    rocks: RocksSettings, diameter_m: Array, outlines: Outlines, seen_m: Array, random: np.random.Generator
) -> Debris:
    """Draw the debris of rocks with diameters (n,) in metres, at most ``rocks.debris_most`` fragments.

    Fragments smaller than ``seen_m`` (n,), one diameter per rock, are left out, and so are the smallest fragments of
    all rocks if there would be too many. This changes the size of no other fragment.
    """
    per_unit = _count_per_unit(rocks, diameter_m)
    counts, smallest = _limit_counts(rocks, diameter_m, per_unit, seen_m)
    parent = np.repeat(np.arange(len(counts)), counts)
    rank = np.arange(len(parent)) - np.repeat(np.cumsum(counts) - counts, counts)
    size = _mean_diameters(float(rocks.debris_index), rank, per_unit[parent], _LARGEST * diameter_m[parent])
    order = np.argsort(-size, kind="stable")
    parent, size = parent[order], size[order]
    mean_m = rocks.debris_reach / 2 * diameter_m[parent] * (size / (_LARGEST * diameter_m[parent])) ** _SORTING
    turn, chance = random.random((len(size), 2)).T
    away_m = size / 2 - mean_m * np.log1p(-chance)
    return Debris(_place_beyond(outlines, parent, 2 * np.pi * turn, away_m), size, parent, smallest)


def count_debris(rocks: RocksSettings, diameter_m: Array) -> Array:
    """Count the fragments (n,) of rocks with diameters (n,) in metres."""
    if rocks.debris == 0.0:
        return np.zeros(len(diameter_m), np.int64)
    return _limit_counts(rocks, diameter_m, _count_per_unit(rocks, diameter_m), np.zeros(len(diameter_m)))[0]


def _count_per_unit(rocks: RocksSettings, diameter_m: Array) -> Array:
    """Compute the factor c (n,) of the law N(>d) = c (d^-a - largest^-a) that gives the debris its volume."""
    largest = np.maximum(_LARGEST * diameter_m, rocks.debris_smallest_m)
    volume = _sum_cubes(float(rocks.debris_index), float(rocks.debris_smallest_m), largest)
    with np.errstate(divide="ignore"):
        return np.where(volume > 0.0, rocks.debris * diameter_m**3 / volume, 0.0)


def _sum_cubes(index: float, smaller_m: float | Array, larger_m: Array) -> Array:
    """Sum the cubed diameters between two diameters, for the law with a factor of 1: the integral of a d^(2 - a)."""
    log_ratio, power = np.log(larger_m / smaller_m), 3.0 - index
    if power == 0.0:
        return np.asarray(index * log_ratio)
    return np.asarray(index / power * np.power(smaller_m, power) * np.expm1(power * log_ratio))


def _limit_counts(rocks: RocksSettings, diameter_m: Array, per_unit: Array, seen_m: Array) -> tuple[Array, float]:
    """Limit the number (n,) of the fragments of each rock to ``rocks.debris_most`` in total. Return the numbers and the
    smallest diameter.
    """
    index, largest = float(rocks.debris_index), _LARGEST * diameter_m

    def count(smallest_m: float) -> Array:
        end = np.minimum(np.maximum(seen_m, smallest_m), largest)
        return np.floor(per_unit * (end**-index - largest**-index))

    smallest = float(rocks.debris_smallest_m)
    if count(smallest).sum() > rocks.debris_most:
        low, high = math.log(smallest), math.log(float(largest.max()))
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if count(math.exp(middle)).sum() <= rocks.debris_most else (middle, high)
        smallest = math.exp(high)
    return count(smallest).astype(np.int64), smallest


def _mean_diameters(index: float, rank: Array, per_unit: Array, largest_m: Array) -> Array:
    """Compute the diameters (n,) of fragments from their ``rank`` among the fragments of their rock, 0 for the largest.
    Each has the mean volume of its part of the law, so the volumes add up exactly.
    """
    upper, lower = ((k / per_unit + largest_m**-index) ** (-1.0 / index) for k in (rank, rank + 1.0))
    return np.asarray(np.cbrt(per_unit * _sum_cubes(index, lower, upper)))


def _place_beyond(outlines: Outlines, parent: Array, turn: Array, away_m: Array) -> Array:
    """Compute places (n, 2) at distances from the outlines of the parents, in directions ``turn`` of the ellipses."""
    along, across = np.cos(turn), np.sin(turn)
    long, short = outlines.half_m[parent].T
    outward = np.stack([along / long, across / short])
    x, y = np.stack([long * along, short * across]) + away_m * outward / np.hypot(*outward)
    cosine, sine = np.cos(outlines.turn_rad[parent]), np.sin(outlines.turn_rad[parent])
    return outlines.places_m[parent] + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
