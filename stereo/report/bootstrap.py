"""How far a mean over pairs can be trusted: the cluster bootstrap.

Pairs of one scene share its ground, so they are not independent, and pixels even less. Scenes are: a scene is drawn
with all its pairs, with replacement, as many as there are; the middle 95 % of the means so found is the interval
(Efron and Tibshirani 1993; for clusters Field and Welsh 2007). It says what other scenes of the same kind would
give. Few scenes give intervals that are too narrow, which is why their number is always reported beside them.
"""

from __future__ import annotations

import numpy as np

from ...physics.random_numbers.seeds import generator

RESAMPLES = 2000
LEVEL = 0.95
#: Random numbers that are held at a time.
_AT_ONCE = 1_000_000


def clusters_of(scenes: np.ndarray) -> np.ndarray:
    """The clusters to draw, a whole number per pair, from the scene of each: the scenes, or where all pairs are of
    one scene the pairs themselves, since one cluster has no spread. The interval then says nothing about others."""
    return np.arange(len(scenes)) if len(np.unique(scenes)) < 2 else np.unique(scenes, return_inverse=True)[1]


def intervals(values: np.ndarray, clusters: np.ndarray, seed: int, resamples: int = RESAMPLES) -> np.ndarray:
    """Lower and upper bound (K, 2) of the mean of each column of ``values`` (pairs, K); NaN is undefined.

    ``clusters`` is a whole number per pair. The same seed draws the same clusters. NaN where fewer than two clusters
    have a value.
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
