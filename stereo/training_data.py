"""The samples that a training names: pairs made by rays, pairs of data sets, or both by turns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..support.errors import IcyMoonError
from .learning.made_pairs import MadePairs
from .learning.sources import GroundSource, SourcesByTurns
from .torch_data import Dataset

#: The word that names the pairs made by rays.
MADE = "made"
#: Crops of a pair that are taken at a time.
_CROPS_PER_PAIR = 4


class PairsOfDataSet:
    """Random crops of the pairs of a data set's split "train", with new noise each time."""

    def __init__(self, folder: Path, crop_px: tuple[int, int], seed: int) -> None:
        self._pairs = Dataset(folder, "train", crop_px=crop_px, seed=seed)
        self.name = f"{folder.resolve().name}-{seed}"

    def list_ground(self, number: int) -> Iterator[Mapping[str, Any]]:
        """Crops of one pair; all pairs come once before one comes again."""
        turn, pair = divmod(number, len(self._pairs))
        for crop in range(_CROPS_PER_PAIR):
            self._pairs.set_epoch(_CROPS_PER_PAIR * turn + crop)
            sample = self._pairs.arrays(pair)
            yield {**sample, **{eye: sample[eye].mean(axis=0, keepdims=True) for eye in ("left", "right")}}


def open_sources(names: Sequence[str], crop_px: tuple[int, int], seed: int) -> GroundSource:
    """The source of the names: ``MADE``, or folders of data sets. Raises IcyMoonError for a name that comes twice and a
    folder without such pairs."""
    if len(set(names)) < len(names):
        raise IcyMoonError(f"--data has {' '.join(names)}, of which one comes twice; name each once.")
    sources = [
        MadePairs("train", seed, crop_px) if name == MADE else PairsOfDataSet(Path(name), crop_px, seed)
        for name in names
    ]
    return sources[0] if len(sources) == 1 else SourcesByTurns(sources)
