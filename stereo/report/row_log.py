"""A log of rows that is complete at every moment, so that an evaluation can continue from it."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from ...support.errors import IcyMoonError
from ...support.file_schemas import FILE_NAME, TEXT, Shape, find_fault
from ...support.files import explain_disk_errors, write_atomically
from ...support.foreign_bytes import parse_json
from ...support.system import flush_handle

Row = dict[str, Any]
#: Most bytes of a row. Rows with all metrics have about 10 kB.
_LONGEST_ROW = 2**24
#: Shapes of the entries that each row has.
ROW_NAMES: dict[str, Shape] = {"pair": FILE_NAME, "method": TEXT, "key": TEXT}


class RowLog:
    """A JSON-lines file with a row per (pair, method); if there are several, the last row counts.

    An appended row is on the disk. Only the place and the ``key`` of each row are in memory. An incomplete row of an
    interrupted run is removed; lines that are no rows of ``shape`` are skipped. Raises IcyMoonError if the file cannot
    be read or written.
    """

    def __init__(self, path: Path, shape: Mapping[str, Shape] = ROW_NAMES) -> None:
        self._path, self._shape = path, {**ROW_NAMES, **shape}
        self._rows: dict[tuple[str, str], tuple[int, str]] = {}
        with explain_disk_errors("write", path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("a+b") as stream:
                if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                    raise OSError(errno.EINVAL, "it is not a regular file", str(path))
                stream.seek(0)
                self._index_rows(stream)

    def _index_rows(self, stream: BinaryIO) -> None:
        start = 0
        while line := stream.readline(_LONGEST_ROW):
            length, first = len(line), line
            while len(line) == _LONGEST_ROW and not line.endswith(b"\n"):  # no row is so long
                line = stream.readline(_LONGEST_ROW)
                length += len(line)
            if not line.endswith(b"\n"):
                stream.truncate(start)
                break
            row = self._parse_row(first) if length == len(first) else None
            if row is not None:
                self._rows[row["pair"], row["method"]] = start, row["key"]
            start += length

    def find(self, pair: str, method: str, key: str) -> Row | None:
        """Find the row of a pair and method; None without a row that has this ``key``."""
        known = self._rows.get((pair, method), (0, ""))[1] == key
        return self.read(pair, method) if known else None

    def read(self, pair: str, method: str) -> Row:
        """Read the row of a pair and method, which must exist. Raises IcyMoonError if another program removed it."""
        with explain_disk_errors("read", self._path), self._path.open("rb") as stream:
            stream.seek(self._rows[pair, method][0])
            row = self._parse_row(stream.readline(_LONGEST_ROW))
        if row is None or (row["pair"], row["method"]) != (pair, method):
            raise IcyMoonError(f"{self._path} was changed by another program while it was in use; evaluate again.")
        return row

    def append(self, row: Mapping[str, Any]) -> None:
        """Add one row. If the disk accepts only a part of the row, this part is removed."""
        rest = memoryview((json.dumps(row, allow_nan=False) + "\n").encode())
        with explain_disk_errors("write", self._path), self._path.open("ab", buffering=0) as stream:
            end = stream.tell()
            try:
                while rest:
                    rest = rest[stream.write(rest) :]
                flush_handle(stream.fileno())
            except OSError:
                stream.truncate(end)
                raise
        self._rows[row["pair"], row["method"]] = end, row["key"]

    def compact(self, first: Iterable[tuple[str, str]]) -> None:
        """Keep one line per (pair, method): first the lines of ``first``, in its order."""
        order = dict.fromkeys(first)
        order |= dict.fromkeys(self._rows)
        places = {}

        def fill(part: Path) -> None:
            with self._path.open("rb") as old, part.open("wb") as new:
                for name in order:
                    start, key = self._rows[name]
                    old.seek(start)
                    places[name] = new.tell(), key
                    new.write(old.readline())

        write_atomically(self._path, fill)
        self._rows = places

    def _parse_row(self, line: bytes) -> Row | None:
        try:
            row = parse_json(line)
        except ValueError:
            return None
        return None if find_fault(row, self._shape) else row


class LazyRows(Sequence[Row]):
    """Rows that are read from the disk on demand, to save memory."""

    def __init__(self, count: int, read: Callable[[int], Row]) -> None:
        self._count, self._get = count, read

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Row]:
        return map(self._get, range(self._count))

    def __getitem__(self, index: Any) -> Any:
        places = range(self._count)[index]
        return self._get(places) if isinstance(places, int) else [self._get(place) for place in places]
