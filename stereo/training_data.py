"""The sources of samples that a training names: ray-traced pairs, pairs of data sets, or both by turns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..settings.description import defaults, merged
from ..settings.preset_files import load_named
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from .learning.grounds import Variety
from .learning.made_pairs import MadePairs
from .learning.sources import GroundSource, RotatingSources
from .torch_data import Dataset

#: The word that names ray-traced pairs; ``made:`` and the name of a preset or a settings file takes the ground from it.
MADE, _MADE_OF = "made", "made:"
#: Pairs of a group, and crops of each: as many samples as from a ray-traced ground, and from more than one scene.
_PAIRS_PER_GROUP, _CROPS_PER_PAIR = 6, 4


class PairsOfDataSet:
    """Random crops of the pairs of a data set's split "train", with new noise each time."""

    def __init__(self, folder: Path, crop_px: tuple[int, int], seed: int) -> None:
        self._pairs = Dataset(folder, "train", crop_px=crop_px, seed=seed)
        self.name = f"{folder.resolve().name}-{seed}"

    def list_ground(self, number: int) -> Iterator[Mapping[str, Any]]:
        """Yield crops of a group of pairs. Every pair comes once before any comes again."""
        first = number * _PAIRS_PER_GROUP
        for each in range(first, first + _PAIRS_PER_GROUP):
            turn, pair = divmod(each, len(self._pairs))
            for crop in range(_CROPS_PER_PAIR):
                self._pairs.set_epoch(_CROPS_PER_PAIR * turn + crop)
                sample = self._pairs.arrays(pair)
                yield {**sample, **{eye: sample[eye].mean(axis=0, keepdims=True) for eye in ("left", "right")}}


def open_sources(names: Sequence[str], crop_px: tuple[int, int], seed: int) -> GroundSource:
    """Open the source of the names: ``MADE``, ``made:`` with a preset or a settings file, or folders of data sets.
    Raises IcyMoonError for a repeated name, a folder without training pairs, and ground that rays cannot make.
    """
    if len(set(names)) < len(names):
        raise IcyMoonError(f"--data has {' '.join(names)}, of which one comes twice; name each once.")
    sources = [_open_source(name, crop_px, seed) for name in names]
    return sources[0] if len(sources) == 1 else RotatingSources(sources)


def _open_source(name: str, crop_px: tuple[int, int], seed: int) -> GroundSource:
    if name == MADE:
        return MadePairs("train", seed, crop_px)
    if name.startswith(_MADE_OF):
        own = read_ground(name.removeprefix(_MADE_OF), f"--data {_MADE_OF}")
        return MadePairs("train", seed, crop_px, Variety(own=own))
    return PairsOfDataSet(Path(name), crop_px, seed)


def read_ground(name: str, option: str) -> Settings:
    """Read the complete settings of a preset or a settings file. ``option`` is the option that names it on a command
    line. Raises IcyMoonError for ground that rays cannot make.
    """
    settings = merged(defaults(), load_named(name))
    if settings.source.kind != "PROCEDURAL":
        raise IcyMoonError(
            f"{option}{name}: source.kind is {settings.source.kind}, and pairs made by rays have procedural ground "
            "only; give another file, or render pairs of this ground with icymoon batch."
        )
    return settings
