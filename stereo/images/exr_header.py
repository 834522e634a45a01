"""Read the header of a foreign EXR file, with its channels, before a library decodes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...formats.exr_layout import read_layout
from ...support.foreign_bytes import ForeignBytes, RefusedError
from .image_headers import check_size

EXR_START = b"\x76\x2f\x31\x01"
_DEEP_FLAG = 0x800
#: Types of values, by their number in a header.
_PIXEL_TYPES = ("u4", "f2", "f4")


@dataclass(frozen=True)
class Channel:
    """A channel of one part of an EXR file, with its size and type."""

    part: int
    name: str
    width: int
    height: int
    dtype: np.dtype[np.generic]
    part_name: str = ""  # in a file with several parts

    @property
    def full_name(self) -> str:
        """The name of the channel. The part's name precedes it unless the channel's name begins with it, because parts
        may share names of channels.
        """
        first = self.part_name.partition(".")[0]
        is_named = not first or self.name.startswith(f"{first}.")
        return self.name if is_named else f"{self.part_name}.{self.name}"

    @property
    def size_bytes(self) -> int:
        """Bytes of the channel's pixels."""
        return self.width * self.height * self.dtype.itemsize


def parse_channels(foreign: ForeignBytes) -> list[Channel]:
    """Parse all channels of a file's header. The pixels of all count against the budget, because a library decodes
    whole parts.

    Raises ValueError or struct.error for a torn file, RefusedError and OverBudgetError for an unsupported one.
    """
    flags = foreign.part(0, 8)[4:]
    if int.from_bytes(flags, "little") & _DEEP_FLAG:
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
                    np.dtype(f"<{_PIXEL_TYPES[stated.kind]}"),
                    part_name,
                )
            )
            foreign.budget.charge(found[-1].size_bytes, "channels")
    if not found:
        raise ValueError("it has no channels")
    return found
