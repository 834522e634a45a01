"""The effects of a detector that can be switched off. Each has its own random stream, so that switching one off changes
no other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ..random_numbers.seeds import make_generator

#: The child of the seed stream "lidar" and of the scan's number, from which each effect draws; never renumber them.
AMPLITUDE, JITTER, ALARMS, WAVEFORM, ARRIVALS, RETURNS, GATES = range(7)
#: Number of returns of a beam, and of packets of its waveform, with independent random numbers; later returns and
#: packets use the same numbers again.
_SLOTS = 4


@dataclass(frozen=True)
class Effects:
    """The effects of a detector: each is simulated if true."""

    shot_noise: bool = True  # of signal and background
    amplifier_noise: bool = True
    dark_counts: bool = True
    jitter: bool = True
    walk: bool = True  # of a leading edge with the amplitude
    false_alarms: bool = True
    quantization: bool = True
    saturation: bool = True


#: A detector without noise or faults.
IDEAL = Effects(False, False, False, False, False, False, False, False)


def draw_return_normals(beam: Array, order: Array, first: int, end: int, seed: int, scan: int = 0) -> Array:
    """Draw two normal variates (2, k) for each of k returns of the beams from number ``first`` to before ``end``. They
    depend only on seed, scan, the number of the beam and the return's ``order`` in it, not on the beams processed
    together.
    """
    random = make_generator(seed, "lidar", scan, RETURNS)
    _skip(random, first * _SLOTS * 2)
    drawn = random.random((end - first, _SLOTS, 2))[beam - first, (order.astype(np.int64) - 1) % _SLOTS]
    radius, turn = np.sqrt(-2.0 * np.log1p(-drawn[:, 0])), 2.0 * np.pi * drawn[:, 1]
    return np.stack([radius * np.cos(turn), radius * np.sin(turn)])


def draw_sample_normals(
    beam: Array, slot: Array, first: int, end: int, samples: int, seed: int, scan: int = 0
) -> Array:
    """Draw normal variates (p, samples) for packets of the beams from number ``first`` to before ``end``. They depend
    only on seed, scan, the number ``beam`` (p,) and the packet's ``slot`` (p,) in the beam. ``samples`` must be even.
    """
    drawn = np.zeros((len(beam), samples))
    for one in np.unique(slot % _SLOTS).tolist():
        random = make_generator(seed, "lidar", scan, WAVEFORM, one)
        _skip(random, first * samples)
        own = np.flatnonzero(slot % _SLOTS == one)
        even = random.random((end - first, samples))[beam[own] - first]
        radius, turn = np.sqrt(-2.0 * np.log1p(-even[:, ::2])), 2.0 * np.pi * even[:, 1::2]
        drawn[own, ::2], drawn[own, 1::2] = radius * np.cos(turn), radius * np.sin(turn)
    return drawn


def draw_beam_waits(first: int, end: int, seed: int, scan: int = 0) -> Array:
    """Draw an exponential variate of mean 1 for each beam from number ``first`` to before ``end``. It depends on seed,
    scan and the beam's number.
    """
    random = make_generator(seed, "lidar", scan, GATES)
    _skip(random, first)
    return np.asarray(-np.log1p(-random.random(end - first)))


def _skip(random: np.random.Generator, count: int) -> None:
    """Skip ``count`` doubles of a generator; each double takes one 64-bit number."""
    bits = random.bit_generator
    assert isinstance(bits, np.random.PCG64)
    bits.advance(count)
