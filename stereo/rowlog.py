"""A log of rows that is whole at every moment."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..files import disk_errors


class RowLog:
    """A JSON-lines file, started anew, that holds whole rows only, each on the disk once appended.

    Raises IcyMoonError when the disk refuses.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with disk_errors("write", path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(b"")

    def append(self, row: Mapping[str, Any]) -> None:
        """Add one row. A disk that takes only a part of it is made to give that part back."""
        rest = memoryview((json.dumps(row, allow_nan=False) + "\n").encode())
        with disk_errors("write", self._path), self._path.open("ab", buffering=0) as stream:
            end = stream.tell()
            try:
                while rest:
                    rest = rest[stream.write(rest):]
                os.fsync(stream.fileno())
            except OSError:
                stream.truncate(end)
                raise
