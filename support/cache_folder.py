"""The folder of data that Icy Moon can recreate: speeds of this machine, marks of reports, stand-ins."""

from __future__ import annotations

import os
from pathlib import Path

from .files import parse_path
from .system import find_cache_folder

#: Environment variable for another cache folder, for tests and for users.
FOLDER_VARIABLE = "ICYMOON_CACHE"


class _Choice:
    """The folder that the user chose in the preferences; empty for the user's cache."""

    path = ""


def choose_folder(path: str) -> None:
    """Move the cache to another folder; empty for the user's cache."""
    _Choice.path = path


def own_cache_folder() -> Path:
    """Return the cache folder of Icy Moon, which may be missing: from the environment, the preferences, or the user's
    default."""
    if given := os.environ.get(FOLDER_VARIABLE) or _Choice.path:
        return parse_path(given, FOLDER_VARIABLE).absolute()
    return find_cache_folder() / "icymoon"
