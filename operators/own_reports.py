"""Which reports were made here: no other is opened in the browser.

A report is a web page, and a page runs what whoever made it wrote into it. One that came along with somebody's data
set looks like ours; that its content is what this user's evaluator wrote is kept by its checksum.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from ..errors import IcyMoonError
from ..files import sha256, write_json
from ..records import TABLE, read_record
from ..render.cost.speed import own_cache_folder

#: How many are remembered, the newest last.
_MOST = 500
#: Those of this session, for a cache folder that cannot be written to.
_session: set[str] = set()


def _file() -> Path:
    return own_cache_folder() / "reports.json"


def _known() -> list[str]:
    with suppress(OSError, IcyMoonError):
        return list(read_record(_file(), TABLE, "delete it"))
    return []


def remember(page: Path) -> None:
    """Keep that this page, which has just been written, was made here."""
    with suppress(OSError):  # a page that is gone already is not opened either
        made = sha256(page)
        _session.add(made)
        with suppress(IcyMoonError):
            write_json(_file(), dict.fromkeys([*_known(), made][-_MOST:], "sha256 of a report that was made here"))


def is_ours(page: Path) -> bool:
    """Whether this page is, byte for byte, one that was made here. Raises OSError if it cannot be read."""
    made = sha256(page)
    return made in _session or made in _known()
