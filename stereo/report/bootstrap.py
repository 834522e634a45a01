"""Confidence intervals of means over pairs: the cluster bootstrap.

Pairs of one scene share its ground, so they are not independent, and pixels even less; scenes are. Scenes are drawn
with replacement, as many as there are, each with all its pairs. The middle 95 % of the means of such draws is the
interval (Efron and Tibshirani 1993; for clusters Field and Welsh 2007). It holds for other scenes of the same kind.
With few scenes it is too narrow, so reports always show the number of scenes.
"""

from __future__ import annotations

import numpy as np

from ...physics.random_numbers.seeds import generator

RESAMPLES = 2000
LEVEL = 0.95
#: Random numbers that are in memory at a time.
_AT_ONCE = 1_000_000


def clusters_of(scenes: np.ndarray) -> np.ndarray:
    """The clusters to draw, a whole number per pair, from the scene of each pair: the scenes or, if there is only one,
    the pairs, since one cluster has no spread. The interval then does not hold for other scenes."""
    return np.arange(len(scenes)) if len(np.unique(scenes)) < 2 else np.unique(scenes, return_inverse=True)[1]


def intervals(values: np.ndarray, clusters: np.ndarray, seed: int, resamples: int = RESAMPLES) -> np.ndarray:
    """Lower and upper bound (K, 2) of the mean of each column of ``values`` (pairs, K), in which NaN is undefined.

    ``clusters`` is a whole number per pair. The same seed draws the same clusters. A bound is NaN if fewer than two
    clusters have a value.
    """
    label, cluster = np.unique(clusters, return_inverse=True)
    count = len(label)
    defined = ~np.isnan(values)
    sums, counts = np.zeros((count, values.shape[1])), np.zeros((count, values.shape[1]))
    np.add.at(sums, cluster, np.where(defined, values, 0.0))
    np.add.at(counts, cluster, defined)
    bounds = np.full((values.shape[1], 2), np.nan)
    enough = (counts > 0).sum(axis=0) >= 2
    if not enough.any():
        return bounds
    random = generator(seed, "statistics")
    means = []
    step = max(1, _AT_ONCE // count)
    for start in range(0, resamples, step):
        drawn = random.multinomial(count, np.full(count, 1 / count), min(step, resamples - start)).astype(np.float64)
        whole = drawn @ counts[:, enough]
        means.append(np.divide(drawn @ sums[:, enough], whole, out=np.full(whole.shape, np.nan), where=whole > 0))
    tail = (1 - LEVEL) / 2
    bounds[enough] = np.nanquantile(np.concatenate(means), (tail, 1 - tail), axis=0).T
    return bounds
