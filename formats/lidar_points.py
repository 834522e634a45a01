"""Returns of a laser scanner in ``lidar.npz``, written and read in parts, so that a scan of any size needs little
memory."""

from __future__ import annotations

import math
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..physics.lidar.digitiser import Waves
from ..physics.lidar.measured_returns import Alarms
from ..physics.lidar.returns import Returns
from ..physics.lidar.scan_patterns import ScanPattern
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors, write_atomically
from ..support.foreign_bytes import explain_errors
from .wave_packets import count_packet_bytes

#: Rows that are processed together.
ROWS_AT_ONCE = 2**16
#: Bytes that are copied at once.
_COPIED_AT_ONCE = 2**22
#: Bytes on the disk for a return with detector and ice while its file is written: its arrays, and their copy.
_BYTES_A_RETURN = 2 * 220
#: The same for the return's place among the waveforms.
_BYTES_A_WAVE = 2 * 17
_FIX = "scan the scene again"
#: End of the names of arrays with three columns.
_POINTS = "point_m"


def check_room(folder: Path, beams: int, samples: int = 0) -> None:
    """Raise IcyMoonError if the disk of a folder, which need not exist, lacks room for a return of each beam, and for a
    packet of ``samples`` of its waveform."""
    there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
    with explain_disk_errors("write to", there):
        free = shutil.disk_usage(there).free
    each = _BYTES_A_RETURN + (_BYTES_A_WAVE + count_packet_bytes(samples) if samples else 0)
    if (needed := each * beams) > free:
        fewer = "fewer samples of --waveforms, or fewer rows and columns" if samples else "fewer rows and columns"
        raise IcyMoonError(
            f"{folder} has {free / 1e6:.0f} MB free, and a scan of {beams:.3g} beams may need {needed / 1e6:.0f} MB "
            f"while it is written; free some space, choose another folder, or give {fewer}."
        )


class ReturnWriter:
    """Writes returns as npz, batch by batch. The file contains the fields of ``Returns``, further arrays, and ``row``,
    ``column`` and ``time_s`` of each return's beam. False alarms have ``false_beam``, ``false_range_m`` and
    ``false_point_m``. With waveforms, both have the fields of ``Waves``.

    Arrays first grow in nameless files on the same disk, because an npz states an array's length before its values. So
    the disk briefly needs twice the size of the file.
    """

    def __init__(self, folder: Path, pattern: ScanPattern) -> None:
        self._folder, self._pattern = folder, pattern
        self._parts: dict[str, tuple[IO[bytes], np.dtype[Any], tuple[int, ...]]] = {}
        self._rows: dict[str, int] = {}

    def add(
        self,
        returns: Returns,
        beside: dict[str, Array],
        alarms: Alarms | None = None,
        waves: tuple[Waves, Waves] | None = None,
    ) -> None:
        """Append returns (k,), further arrays (k,) by name, false alarms (None for a scan without a detector), and the
        waveform packets of both. Raises IcyMoonError if the disk refuses."""
        row, column, time_s = find_cells(returns.beam, self._pattern)
        arrays = {field.name: getattr(returns, field.name) for field in fields(Returns)} | beside
        arrays |= {"row": row, "column": column, "time_s": time_s}
        if alarms is not None:
            arrays |= {f"false_{field.name}": getattr(alarms, field.name) for field in fields(Alarms)}
        if waves is not None:
            arrays |= vars(waves[0]) | {f"false_{name}": values for name, values in vars(waves[1]).items()}
        with explain_disk_errors("write to", self._folder):
            for name, values in arrays.items():
                if name not in self._parts:
                    self._folder.mkdir(parents=True, exist_ok=True)
                    part = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115  closed by ``close``
                    self._parts[name], self._rows[name] = (part, values.dtype, values.shape[1:]), 0
                self._parts[name][0].write(np.ascontiguousarray(values).tobytes())
                self._rows[name] += len(values)

    def finish(self, path: Path) -> None:
        """Write everything that was added to a file. Raises IcyMoonError if the disk refuses."""
        write_atomically(path, self._write)

    def _write(self, path: Path) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for name, (part, dtype, shape) in self._parts.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                    header = {
                        "descr": np.lib.format.dtype_to_descr(dtype),
                        "fortran_order": False,
                        "shape": (self._rows[name], *shape),
                    }
                    np.lib.format.write_array_header_1_0(stream, header)
                    part.seek(0)
                    while piece := part.read(_COPIED_AT_ONCE):
                        stream.write(piece)

    def close(self) -> None:
        """Remove the arrays that were added."""
        for part, _, _ in self._parts.values():
            part.close()

    def __enter__(self) -> ReturnWriter:
        return self

    def __exit__(self, *why: object) -> None:
        self.close()


def find_cells(beam: Array, pattern: ScanPattern) -> tuple[Array, Array, Array]:
    """Return the row, the column and the time in s (n,) of beams (n,)."""
    spinning = pattern.kind == "SPINNING"
    first, second = np.divmod(beam, pattern.rows if spinning else pattern.columns)
    row, column = (second, first) if spinning else (first, second)
    steps = {"SPINNING": column / pattern.columns, "RASTER": beam / pattern.count, "FLASH": np.zeros(len(beam))}
    return row, column, steps[pattern.kind] * pattern.period_s


def read_returns(path: Path, names: Sequence[str], rows: int = ROWS_AT_ONCE) -> Iterator[dict[str, Array]]:
    """Read the arrays of a ``lidar.npz`` by their names, ``rows`` entries at a time. Names that the file lacks are left
    out.

    Points have three columns, other arrays one, so a part needs little memory whatever the file states. Raises
    IcyMoonError if the file is damaged, has arrays of other shapes, or arrays of different lengths.
    """
    with explain_errors(path, "returns of a laser scanner", _FIX), zipfile.ZipFile(path) as archive:
        present = set(archive.namelist())
        streams = {name: archive.open(f"{name}.npy") for name in names if f"{name}.npy" in present}
        shapes = {name: _read_header(stream, name) for name, stream in streams.items()}
        counts = {shape[0] for shape, _ in shapes.values()}
        if len(counts) > 1:
            raise ValueError("arrays have different lengths")
        count = max(counts, default=0)
        for start in range(0, count, rows):
            size = min(rows, count - start)
            yield {
                name: np.frombuffer(streams[name].read(size * dtype.itemsize * math.prod(shape[1:])), dtype).reshape(
                    size, *shape[1:]
                )
                for name, (shape, dtype) in shapes.items()
            }


def _read_header(stream: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array has an unknown version")
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(stream)
    if by_columns or dtype.kind not in "biuf" or shape[1:] != ((3,) if name.endswith(_POINTS) else ()) or not shape:
        raise ValueError(f"{name} is not an array of numbers in rows, or has another number of columns")
    return shape, dtype
