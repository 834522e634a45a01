"""Truth that a format cannot hold. It is refused if most of it would be lost, else reported once for all pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from ...support.errors import IcyMoonError
from ...support.number_text import format_count
from ..measure.prepare_pair import LoadedPair

#: Largest share of a pair's true disparities that may be lost. A pair that would lose more is not written.
MAX_LOST_SHARE = 0.5
#: Formats that can store all numbers of a map.
_LOSSLESS_FORMATS = {"disparity": "pfm and middlebury", "depth": "pfm and raw", "flow": "the .flo files"}


@dataclass(frozen=True)
class Loss:
    """The part of a map that a format cannot store.

    ``share`` is its share of the known pixels, ``why`` the end of a sentence.
    """

    what: str  # "disparity" or "depth"
    share: float
    why: str


#: A ``Write`` function writes a pair and returns its losses. An ``Each`` function calls a ``Write`` with each pair.
Write = Callable[[LoadedPair], Sequence[Loss] | None]
Each = Callable[[Write], None]


def refuse_losses(pair: LoadedPair, losses: Sequence[Loss]) -> None:
    """Raise IcyMoonError if most of the true disparities of a pair would be lost. Call it before files are written."""
    for loss in losses:
        if loss.what == "disparity" and loss.share > MAX_LOST_SHARE:
            raise IcyMoonError(
                f"{pair.pair.folder}: {100 * loss.share:.0f} % of its true disparities are {loss.why}; "
                f"export it as {_LOSSLESS_FORMATS[loss.what].replace(' and ', ' or ')}."
            )


@dataclass
class Losses:
    """Collects the losses of all exported pairs, to report each kind of loss once."""

    _found: dict[tuple[str, str], list[tuple[float, str]]] = field(default_factory=dict)

    def add(self, pair: LoadedPair, losses: Sequence[Loss]) -> None:
        """Note the largest loss of each kind among a pair's maps."""
        for key in {(loss.what, loss.why) for loss in losses}:
            share = max(loss.share for loss in losses if (loss.what, loss.why) == key)
            self._found.setdefault(key, []).append((share, pair.pair.folder.name))

    def sentences(self, pairs: int) -> Iterator[str]:
        """Yield a sentence for each kind of loss; ``pairs`` is the number of written pairs."""
        for (what, why), found in self._found.items():
            share, name = max(found)
            written = f"{100 * share:.2g} %" if share < 0.995 else "all"
            yield (
                f"In {len(found)} of {format_count(pairs, 'pair')} up to {written} of the true {what} is lost (pair "
                f"{name}): it is {why}. {_LOSSLESS_FORMATS[what]} hold all of it."
            )
