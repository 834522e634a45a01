"""FITS files of float images, by the relevant parts of the standard (version 4.0; Pence et al. 2010, A&A 524, A42)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..support.arrays import Array

#: Bytes of a card.
_CARD_BYTES = 80
#: Bytes of a block.
_BLOCK_BYTES = 2880
Value = bool | int | float | str


@dataclass(frozen=True)
class Image:
    """An image (H, W) or a cube (H, W, planes) of floats, with its ``name``, its ``unit`` and a ``comment`` on the
    meaning of its numbers. ``cards`` has a value and a comment for each key of at most 8 letters and digits."""

    name: str
    pixels: Array
    unit: str = ""
    cards: Mapping[str, tuple[Value, str]] = field(default_factory=dict)
    comment: str = ""


def encode_fits(images: Sequence[Image]) -> bytes:
    """Encode a FITS file: the first image, then the others as extensions, all as 32-bit floats.

    The first row of our images is at the top. FITS counts rows from the bottom, as its viewers show them.
    """
    return b"".join(_encode_image(image, first=k == 0, extended=len(images) > 1) for k, image in enumerate(images))


def _encode_image(image: Image, first: bool, extended: bool) -> bytes:
    pixels = image.pixels[::-1]
    planes = [] if pixels.ndim == 2 else [pixels.shape[2]]
    data = (pixels if pixels.ndim == 2 else np.moveaxis(pixels, -1, 0)).astype(">f4").tobytes()
    axes = [pixels.shape[1], pixels.shape[0], *planes]
    cards = [
        _make_card("SIMPLE", True, "conforms to FITS standard")
        if first
        else _make_card("XTENSION", "IMAGE", "image extension"),
        _make_card("BITPIX", -32, "32-bit floats"),
        _make_card("NAXIS", len(axes), ""),
        *(_make_card(f"NAXIS{k}", n, "") for k, n in enumerate(axes, 1)),
    ]
    if not first:
        cards += [_make_card("PCOUNT", 0, ""), _make_card("GCOUNT", 1, "")]
    elif extended:
        cards.append(_make_card("EXTEND", True, ""))
    cards.append(_make_card("EXTNAME", image.name, image.comment))
    if image.unit:
        cards.append(_make_card("BUNIT", image.unit, ""))
    cards += [_make_card(key, value, comment) for key, (value, comment) in image.cards.items()]
    header = b"".join([*cards, b"END".ljust(_CARD_BYTES)])
    return header.ljust(-(-len(header) // _BLOCK_BYTES) * _BLOCK_BYTES) + data.ljust(
        -(-len(data) // _BLOCK_BYTES) * _BLOCK_BYTES, b"\0"
    )


def _make_card(key: str, value: Value, comment: str) -> bytes:
    """Make a card of 80 characters. Raises ValueError for a value that a card cannot contain."""
    if isinstance(value, bool):
        text = ("T" if value else "F").rjust(20)
    elif isinstance(value, str):
        text = "'" + value.replace("'", "''").ljust(8) + "'"
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{key} is {value}, which a FITS header cannot contain")
    else:
        text = (f"{value:.14E}" if isinstance(value, float) else str(value)).rjust(20)
    card = f"{key.ljust(8)}= {text}" + (f" / {comment}" if comment else "")
    if len(key) > 8 or not card.isascii() or len(f"{key.ljust(8)}= {text}") > _CARD_BYTES:
        raise ValueError(f"{key} = {value!r} does not fit a card of a FITS header")
    return card[:_CARD_BYTES].ljust(_CARD_BYTES).encode("ascii")
