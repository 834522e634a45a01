"""Temporary folders, removed after use; leftovers of a killed process are removed when the next one is made."""

from __future__ import annotations

import functools
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from . import system
from .errors import IcyMoonError
from .file_schemas import PROCESS, TEXT, read_record
from .files import explain_disk_errors

_FOLDER_PREFIX = "icymoon-"
_OWNER_FILE = ".icymoon.json"
#: Shape of the record of the process that made a scratch folder.
_OWNER_SHAPE = {"pid": PROCESS, "place": TEXT, "computer": TEXT}


def make_scratch_folder() -> Path:
    """Make a temporary folder, after removing the folders of killed processes of ours.

    Raises IcyMoonError if the disk is full or may not be written to.
    """
    _remove_abandoned()
    with explain_disk_errors("write to", Path(tempfile.gettempdir())):
        folder = Path(tempfile.mkdtemp(prefix=_FOLDER_PREFIX))
        owner = {"pid": os.getpid(), "place": system.find_process_scope(), "computer": system.find_computer_name()}
        (folder / _OWNER_FILE).write_text(json.dumps(owner), encoding="utf-8")
    return folder


@contextmanager
def open_scratch_folder() -> Iterator[Path]:
    """Make a temporary folder for a ``with`` statement. Raises IcyMoonError if none can be made."""
    folder = make_scratch_folder()
    try:
        yield folder
    finally:
        system.remove_folder(folder)


@functools.cache
def _remove_abandoned() -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{_FOLDER_PREFIX}*"):
        with suppress(OSError, IcyMoonError):  # the folder is another user's or not a scratch folder
            if _is_ours(folder) and _is_abandoned(read_record(folder / _OWNER_FILE, _OWNER_SHAPE, "delete it")):
                system.remove_folder(folder)


def _is_ours(folder: Path) -> bool:
    """Return whether a folder, not a link to one, belongs to this user."""
    return (
        not folder.is_symlink()
        and folder.is_dir()
        and not (folder / _OWNER_FILE).is_symlink()
        and system.belongs_to_user(folder)
    )


def _is_abandoned(owner: dict[str, Any]) -> bool:
    """Return whether the process that made a folder has certainly ended."""
    here = system.find_process_scope()
    rebooted = owner["computer"] == system.find_computer_name() and owner["place"].split(" ")[0] != here.split(" ")[0]
    return bool(here and owner["place"]) and (rebooted or system.has_ended(owner["pid"], owner["place"]))
