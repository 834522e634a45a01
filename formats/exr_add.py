"""Light of one pass added to another, in an OpenEXR file or of another one, without an OpenEXR library.

Only the passes whose light changes are decoded; other parts stay as they are.
"""

from __future__ import annotations

import numpy as np

from ..labels import BAKED_AOV, BEAUTY
from .exr_parts import assemble, read_pieces, strip_passing
from .exr_pixels import Pixels

_IMAGE, _PLANET, _BAKED = (f"{BEAUTY}.{name}" for name in ("Combined", "Combined_Planet", BAKED_AOV))


def _find_bands(parts: list[Pixels], wanted: str) -> dict[str, tuple[int, int]]:
    """Where the bands R, G and B of a pass ``LAYER.PASS`` are: the number of the part and of the channel in it."""
    return {name[-1]: (number, k) for number, part in enumerate(parts) for k, name in enumerate(part.channels)
            if name.startswith(f"{wanted}.") and name[-2:] in (".R", ".G", ".B")}


def _read_bands(image: bytes, wanted: str) -> dict[str, np.ndarray]:
    """The bands R, G and B of a pass, each (height, width) float32. Raises KeyError if there is none."""
    parts = [Pixels(piece) for piece in read_pieces(image)]
    found = _find_bands(parts, wanted)
    decoded = {number: parts[number].decode() for number, _ in found.values()}
    return {band: decoded[found[band][0]][:, found[band][1]] for band in "RGB"}


def add_planet(image: bytes, planet: bytes) -> bytes:
    """An EXR file with what another has in its planet's light group added to its image and to its planet's group.

    Raises ValueError, IndexError, KeyError, struct.error or zlib.error for what cannot be added.
    """
    return _add(image, _read_bands(planet, _PLANET), (_IMAGE, _PLANET))[0]


def add_baked(image: bytes) -> tuple[bytes, float]:
    """An EXR file with its pass of baked light added to its image, and the share of baked light in all light.

    Raises as ``add_planet`` does.
    """
    light = _read_bands(image, _BAKED)
    added, total = _add(image, light, (_IMAGE,))
    baked = sum(float(values.sum(dtype=np.float64)) for values in light.values())
    return added, baked / total if total > 0 else 0.0


def _add(image: bytes, light: dict[str, np.ndarray], passes: tuple[str, ...]) -> tuple[bytes, float]:
    """A file with ``light`` (each band as decoded) added to passes, and the sum of the first of them then."""
    made = [strip_passing(piece, BEAUTY) for piece in read_pieces(image)]
    parts = [Pixels(piece) for piece in made]
    values: dict[int, np.ndarray] = {}
    total = 0.0
    for wanted in passes:
        found = _find_bands(parts, wanted)
        for band in "RGB":
            number, k = found[band]
            if number not in values:
                values[number] = parts[number].decode()
            values[number][:, k] += light[band]
            total += float(values[number][:, k].sum(dtype=np.float64)) if wanted == passes[0] else 0.0
    return assemble([parts[k].encode(values[k]) if k in values else piece for k, piece in enumerate(made)]), total
