"""Ray-traced training pairs as an ``IterableDataset`` of PyTorch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from torch.utils.data import IterableDataset, get_worker_info

from .made_pairs import MadePairs
from .tensors import to_tensors


class SampleStream(IterableDataset[dict[str, Any]]):
    """Samples without end, see ``made_pairs.MadePairs.make_sample``; arrays are tensors.

    Worker k of n makes grounds k, k + n, k + 2 n and so on, so that no ground is built twice. A sample depends only on
    its number.
    """

    def __init__(self, pairs: MadePairs, first_ground: int = 0) -> None:
        self._pairs, self._first = pairs, first_ground

    def __iter__(self) -> Iterator[dict[str, Any]]:
        worker = get_worker_info()
        own, workers = (worker.id, worker.num_workers) if worker else (0, 1)
        for sample in self._pairs.iterate(self._first + own, workers):
            yield to_tensors(sample)
