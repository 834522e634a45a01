"""Sources of samples for training. Several sources are used in rotation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol


class GroundSource(Protocol):
    """Samples in groups, each of one ray-traced ground or of some pairs. Numbers go on without end."""

    @property
    def name(self) -> str:
        """Name for files, which differs where the samples differ."""

    def list_ground(self, number: int) -> Iterator[Mapping[str, Any]]:
        """Yield the samples of a group, as ``MadePairs.make_sample`` makes them."""


class RotatingSources:
    """Grounds of several sources in rotation."""

    def __init__(self, sources: Sequence[GroundSource]) -> None:
        self._sources = sources
        self.name = "+".join(each.name for each in sources)

    def list_ground(self, number: int) -> Iterator[Mapping[str, Any]]:
        """Return the samples of this ground, from the sources in rotation."""
        turn, place = divmod(number, len(self._sources))
        return self._sources[place].list_ground(turn)
