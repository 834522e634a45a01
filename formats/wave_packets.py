"""Packets of waveforms in ``lidar.wdp``, the external waveform data packets of LAS 1.4.

The file has a header of 60 bytes, the header of an extended variable length record. The samples follow, packet after
packet, as uncompressed 16-bit numbers (ASPRS, LAS specification 1.4 R15).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..physics.lidar.digitiser import BITS, ZERO, Digitiser
from ..support import system
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.file_schemas import COUNT, POSITIVE, Kind
from ..support.files import explain_disk_errors, make_part_path

FILE_NAME = "lidar.wdp"
#: Reserved, user id, record id, length after the header, description.
_HEADER = struct.Struct("<H16sHQ32s")
HEADER_BYTES = _HEADER.size
_RECORD_ID = 65535
_SAMPLE = np.dtype("<u2")


def _count_to(most: int) -> Kind:
    return Kind(f"a whole number from 0 to {most}", lambda value: COUNT.fits(value) and value <= most)


#: The facts that a scan states on its packets. The light in an interval is (stored number - zero) times step times
#: 2^gain, in electrons; ``gains`` is the number of gains in use.
FACTS_SHAPE = {
    "packets": COUNT,
    "samples": _count_to(2**16),
    "spacing_ps": _count_to(2**32 - 1),
    "bits": Kind(str(BITS), lambda value: value == BITS),
    "zero": _count_to(2**BITS - 1),
    "step_electrons": POSITIVE,
    "gains": _count_to(255),
}


def count_packet_bytes(samples: int) -> int:
    """Return the number of bytes of a packet with this number of samples."""
    return samples * BITS // 8


class PacketWriter:
    """Writes ``lidar.wdp`` to a folder, batch by batch; the file appears when it is finished."""

    def __init__(self, folder: Path, digitiser: Digitiser) -> None:
        self._path, self._digitiser = folder / FILE_NAME, digitiser
        self._part = make_part_path(self._path)
        self._count, self._gains = 0, 0
        self._open = ExitStack()

    def __enter__(self) -> PacketWriter:
        with explain_disk_errors("write", self._path):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._stream: IO[bytes] = self._open.enter_context(self._part.open("wb"))
            self._stream.write(self._make_header())
        return self

    def add(self, samples: Array, gain: Array) -> None:
        """Append packets (p, s) uint16 with the numbers (p,) of their gains. Raises IcyMoonError if the disk
        refuses."""
        with explain_disk_errors("write", self._path):
            self._stream.write(np.ascontiguousarray(samples, _SAMPLE).tobytes())
        self._count += len(samples)
        self._gains = max(self._gains, int(gain.max()) + 1 if len(gain) else 0)

    def finish(self) -> dict[str, Any]:
        """Write the file under its final name, and return facts on it, see ``FACTS_SHAPE``. Raises IcyMoonError if the
        disk refuses."""
        with explain_disk_errors("write", self._path):
            self._stream.seek(0)
            self._stream.write(self._make_header())
            self._open.close()
            system.flush(self._part)
            system.replace(self._part, self._path)
        return {
            "packets": self._count,
            "samples": self._digitiser.samples,
            "spacing_ps": self._digitiser.spacing_ps,
            "bits": BITS,
            "zero": ZERO,
            "step_electrons": self._digitiser.step,
            "gains": self._gains,
        }

    def __exit__(self, *why: object) -> None:
        with explain_disk_errors("write", self._path):
            self._open.close()
            system.remove(self._part)

    def _make_header(self) -> bytes:
        length = self._count * count_packet_bytes(self._digitiser.samples)
        return _HEADER.pack(0, b"LASF_Spec", _RECORD_ID, length, b"Icy Moon waveforms")


def check_packets(folder: Path, facts: Mapping[str, Any]) -> None:
    """Raise IcyMoonError if a scan's stated packets are missing, or their file has another length."""
    path = folder / FILE_NAME
    needed = HEADER_BYTES + facts["packets"] * count_packet_bytes(facts["samples"])
    found = path.stat().st_size if path.is_file() else None
    if found != needed:
        what = "is missing" if found is None else f"has {found} bytes, and its scan has written {needed}"
        raise IcyMoonError(f"{path} {what}; scan the scene again.")
