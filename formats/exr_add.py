"""Light of one OpenEXR file added to another, without an OpenEXR library.

Only the passes whose light changes are decoded; other parts stay as they are.
"""

from __future__ import annotations

import numpy as np

from ..labels import BEAUTY
from .exr_parts import assemble, read_pieces, strip_passing
from .exr_pixels import Pixels

_PLANET = f"{BEAUTY}.Combined_Planet"


def _find_bands(parts: list[Pixels], wanted: str) -> dict[str, tuple[int, int]]:
    """Where the bands R, G and B of a pass ``LAYER.PASS`` are: the number of the part and of the channel in it."""
    return {name[-1]: (number, k) for number, part in enumerate(parts) for k, name in enumerate(part.channels)
            if name.startswith(f"{wanted}.") and name[-2:] in (".R", ".G", ".B")}


def add_planet(image: bytes, planet: bytes) -> bytes:
    """An EXR file with what another has in its planet's light group added to its image and to its planet's group.

    Raises ValueError, IndexError, KeyError, struct.error or zlib.error for what cannot be added.
    """
    made = [strip_passing(piece, BEAUTY) for piece in read_pieces(image)]
    parts, more = [Pixels(piece) for piece in made], [Pixels(piece) for piece in read_pieces(planet)]
    values: dict[int, np.ndarray] = {}
    source = _find_bands(more, _PLANET)
    for wanted in (f"{BEAUTY}.Combined", _PLANET):
        found = _find_bands(parts, wanted)
        for band in "RGB":
            (number, k), (of, at) = found[band], source[band]
            if number not in values:
                values[number] = parts[number].decode()
            values[number][:, k] += more[of].decode()[:, at]
    return assemble([parts[k].encode(values[k]) if k in values else piece for k, piece in enumerate(made)])
