"""The header of an EXR file of others, with its channels, before a library decodes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...formats.exr_layout import read_layout
from ...support.foreign_bytes import ForeignBytes, RefusedError
from .image_headers import check_size

EXR = b"\x76\x2f\x31\x01"
_DEEP = 0x800
#: Types of values by their number in a header.
_TYPES = ("u4", "f2", "f4")


@dataclass(frozen=True)
class Channel:
    """A channel of one of the parts of an EXR file, and its size and type."""

    part: int
    name: str
    width: int
    height: int
    dtype: np.dtype[np.generic]
    part_name: str = ""  # in a file of several

    @property
    def full_name(self) -> str:
        """Its name with its part's name in front, unless it has that already: parts may share names of channels."""
        first = self.part_name.partition(".")[0]
        is_named = not first or self.name.startswith(f"{first}.")
        return self.name if is_named else f"{self.part_name}.{self.name}"

    @property
    def size_bytes(self) -> int:
        """Bytes of its pixels."""
        return self.width * self.height * self.dtype.itemsize


def parse_channels(foreign: ForeignBytes) -> list[Channel]:
    """All channels that a file states, the pixels of all of them charged: a library decodes a part as a whole.

    Raises ValueError or struct.error if it is torn, RefusedError and OverBudgetError for one that is not read.
    """
    flags = foreign.part(0, 8)[4:]
    if int.from_bytes(flags, "little") & _DEEP:
        raise RefusedError("has several depths in a pixel; save it with one, as a flat EXR file.")
    found: list[Channel] = []
    parts = read_layout(foreign, tiles=True)
    for number, part in enumerate(parts):
        rows, columns = part.shape
        check_size(columns, rows)
        part_name = part.values.get(b"name", b"").decode() if len(parts) > 1 else ""
        for name, stated in part.channels.items():
            across, down = stated.steps
            found.append(
                Channel(
                    number,
                    name,
                    -(-columns // across),
                    -(-rows // down),
                    np.dtype(f"<{_TYPES[stated.kind]}"),
                    part_name,
                )
            )
            foreign.budget.charge(found[-1].size_bytes, "channels")
    if not found:
        raise ValueError("it has no channels")
    return found
