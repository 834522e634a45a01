"""Truth that a format cannot hold: refused where most of it would be lost, else reported once for all pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from ...support.errors import IcyMoonError
from ...support.number_text import format_count
from ..measure.prepare_pair import LoadedPair

#: A pair is not written if more of its true disparities than this share would be lost: the rest is not its truth.
MOST_LOST = 0.5
#: Formats that hold every number of a map.
_WHOLE = {"disparity": "pfm and middlebury", "depth": "pfm and raw", "flow": "the .flo files"}


@dataclass(frozen=True)
class Loss:
    """The part of a map that a format cannot hold: ``share`` of its known pixels, and ``why``, a sentence's end."""

    what: str  # "disparity" or "depth"
    share: float
    why: str


#: ``Write`` writes a pair and returns its losses; ``Each`` calls such a function with each pair.
Write = Callable[[LoadedPair], Sequence[Loss] | None]
Each = Callable[[Write], None]


def refuse_losses(pair: LoadedPair, losses: Sequence[Loss]) -> None:
    """Raise IcyMoonError if most of the true disparities of a pair would be lost; call it before files are written."""
    for loss in losses:
        if loss.what == "disparity" and loss.share > MOST_LOST:
            raise IcyMoonError(
                f"{pair.pair.folder}: {100 * loss.share:.0f} % of its true disparities are {loss.why}; "
                f"export it as {_WHOLE[loss.what].replace(' and ', ' or ')}."
            )


@dataclass
class Losses:
    """Collects the losses of all exported pairs, to report each kind of loss once."""

    _found: dict[tuple[str, str], list[tuple[float, str]]] = field(default_factory=dict)

    def add(self, pair: LoadedPair, losses: Sequence[Loss]) -> None:
        """Note the losses of a pair, the worst of its maps."""
        for key in {(loss.what, loss.why) for loss in losses}:
            share = max(loss.share for loss in losses if (loss.what, loss.why) == key)
            self._found.setdefault(key, []).append((share, pair.pair.folder.name))

    def sentences(self, pairs: int) -> Iterator[str]:
        """A sentence for each kind of loss; ``pairs`` is the number of pairs that were written."""
        for (what, why), found in self._found.items():
            share, name = max(found)
            written = f"{100 * share:.2g} %" if share < 0.995 else "all"
            yield (
                f"In {len(found)} of {format_count(pairs, 'pair')} up to {written} of the true {what} is lost (pair "
                f"{name}): it is {why}. {_WHOLE[what]} hold all of it."
            )
