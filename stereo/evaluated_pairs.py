"""The pairs that are evaluated: rendered pairs, and pairs of other data sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ..physics.camera.nearest_ground import make_ground_name_key
from ..render.pairs.pair_folder import has_pairs, read_pair
from ..settings.description import Restorer
from ..support.errors import IcyMoonError
from ..support.file_schemas import FILE_NAME
from ..support.files import read_checksum
from .datasets.dataset_layouts import KNOWN_LAYOUTS, FoundPair, find_foreign_pairs
from .datasets.foreign_pair import ForeignPair
from .measure.prepare_pair import PreparedPair, list_distinct_pairs, prepare_pair
from .measure.sequences import sort_by_time


class Source(Protocol):
    """A pair before it is read."""

    @property
    def name(self) -> str:
        """The name of the pair in results, unique in an evaluation."""

    @property
    def folder(self) -> Path:
        """The folder of the pair, for messages."""

    def list_dependencies(self) -> list[Any]:
        """List everything that determines the numbers of the pair: checksums of its files."""

    def prepare(self, response: Mapping[str, Mapping[str, Any]]) -> PreparedPair:
        """Read the pair, and compute the arrays that matchers and metrics need. Raises IcyMoonError if the pair cannot
        be used.
        """


@dataclass(frozen=True)
class RenderedPair:
    """The folder of a pair that was rendered here."""

    folder: Path

    @property
    def name(self) -> str:
        """The name of the pair's folder."""
        return self.folder.name

    def list_dependencies(self) -> list[Any]:
        """List the checksum of ``pair.json``, which contains the checksums of the images."""
        return [read_checksum(self.folder / "pair.json")]

    def prepare(self, response: Mapping[str, Mapping[str, Any]]) -> PreparedPair:
        """Read and develop the rendered pair, see ``measure.prepare_pair``."""
        return prepare_pair(self.folder, response)


def _refuse_without_eyes(folder: Path) -> None:
    """Raise IcyMoonError for a pair that has only the cameras of a head. A broken pair is reported when its
    turn comes.
    """
    try:
        pair = read_pair(folder)
    except IcyMoonError:
        return
    pair.image("left")


def find_sources(paths: Sequence[Path]) -> list[Source]:
    """Find all pairs at ``paths``, each once: pair folders, data sets, and folders in the layout of other data sets.

    Raises IcyMoonError if a path has no pair, if two different pairs have the same name, or if the name of a pair
    cannot be a name in the results.
    """
    rendered = [path for path in paths if has_pairs(path)]
    found: list[Source] = [
        RenderedPair(folder) for folder in (sort_by_time(list_distinct_pairs(rendered)) if rendered else ())
    ]
    for source in found[:1]:  # all pairs of one plan have eyes or none has; a pair of another plan fails in its turn
        _refuse_without_eyes(source.folder)
    found += [pair for path in dict.fromkeys(paths) if path not in rendered for pair in _find_foreign(path)]
    first: dict[str, Source] = {}
    for source in found:
        if not FILE_NAME.fits(source.name):
            raise IcyMoonError(
                f"{source.folder}: results cannot have a pair of this name, which is not a name of a file "
                "on every system; rename its folder."
            )
        same = first.setdefault(source.name, source)
        if same is not source:
            raise IcyMoonError(
                f"{same.folder} and {source.folder} have different pairs of the same name, "
                f"{source.name}; give one of them at a time."
            )
    return found


def sort_by_ground(sources: Sequence[Source]) -> list[Source]:
    """Sort the sources so that pairs on the same ground follow each other; the ground for their search ranges is then
    made once. Unreadable pairs come first.
    """
    restore, grounds = Restorer(), {}
    for source in sources:
        grounds[source.name] = ""
        if isinstance(source, RenderedPair):
            with suppress(IcyMoonError):  # the error is reported when the pair's turn comes
                grounds[source.name] = make_ground_name_key(read_pair(source.folder, restore).settings)
    return sorted(sources, key=lambda source: grounds[source.name])


def _find_foreign(path: Path) -> list[FoundPair]:
    pairs = find_foreign_pairs(path)
    if not pairs:
        raise IcyMoonError(
            f"{path} contains no complete stereo pair; render one first or choose another folder: a data set, "
            f"{KNOWN_LAYOUTS}."
        )
    return pairs


def check_response(sources: Sequence[Source], response: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise IcyMoonError if ``response`` would change the camera response of photographed pairs."""
    foreign = next((source for source in sources if isinstance(source, ForeignPair)), None)
    if response and foreign:
        raise IcyMoonError(
            f"{foreign.folder} was not rendered here, and its images have the response of their camera; "
            "leave out --set."
        )
