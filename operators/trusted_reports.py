"""Record the reports that this user's evaluator wrote; no other report is opened in the browser.

A report is a web page, and a browser runs the scripts in it. A report in another user's data set looks the same, so
the user's own reports are recognised by their checksums.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from ..support.cache_folder import own_cache_folder
from ..support.errors import IcyMoonError
from ..support.file_schemas import TABLE, read_record
from ..support.files import hash_file, write_json

#: Maximum number of checksums in the file, the newest last.
_MAX_CHECKSUMS = 500
#: Checksums of this session, in case the cache folder is not writable.
_session: set[str] = set()


def _find_checksums_file() -> Path:
    return own_cache_folder() / "reports.json"


def _read_checksums() -> list[str]:
    with suppress(OSError, IcyMoonError):
        return list(read_record(_find_checksums_file(), TABLE, "delete it"))
    return []


def remember_report(page: Path) -> None:
    """Record the checksum of a page that the evaluator has just written."""
    with suppress(OSError):  # a page that no longer exists needs no record
        checksum = hash_file(page)
        _session.add(checksum)
        with suppress(IcyMoonError):
            write_json(
                _find_checksums_file(),
                dict.fromkeys(
                    [*_read_checksums(), checksum][-_MAX_CHECKSUMS:], "sha256 of a report that was made here"
                ),
            )


def is_own_report(page: Path) -> bool:
    """Return whether a page equals a recorded page, byte for byte. Raises OSError if it cannot be read."""
    checksum = hash_file(page)
    return checksum in _session or checksum in _read_checksums()
