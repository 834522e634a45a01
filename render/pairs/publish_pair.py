"""Moves a finished pair to its place atomically, also when other processes do the same or this one is killed.

A folder gets its final name by one rename, which fails if the place is taken. Nothing is deleted at a path that another
process may own: a folder in the way is first renamed to a name of our own and checked there, since a process that took
this one for dead may have just finished it. So a complete pair stays, or lies whole beside its place, and
``resolve_leftover`` moves it back. Imports no Blender.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ...support.errors import IcyMoonError
from ...support.files import explain_disk_errors, make_part_path
from ...support.system import flush, rename
from .dataset_file_names import find_reason_to_keep, is_pair_name, remove_own_file
from .pair_folder import is_whole


def publish_pair(part: Path, folder: Path, lost: Callable[[], bool], again: bool = False) -> None:
    """Move the pair in ``part`` to ``folder``, unless a whole pair is there; ``again`` replaces that pair too.

    ``lost`` returns whether another process has claimed the pair since; then the pair of that process stays. Raises
    IcyMoonError if the disk refuses, if something that is not ours is in the way, or if the rendered pair was lost and
    no other pair is there.
    """
    aside: list[Path] = []
    with explain_disk_errors("write", folder):
        try:
            flush(part)
            while not lost() and is_whole(part) and not _try_rename(part, folder):
                if not again and is_whole(folder):
                    return  # another process has finished the pair meanwhile
                check_place(folder)
                aside.append(make_part_path(folder))
                with suppress(FileNotFoundError):
                    _try_rename(folder, aside[-1])
                if not again:
                    # Moves the folder back into place if another process finished it just now.
                    resolve_leftover(aside[-1])
        except FileNotFoundError:
            pass  # a process that took this one for dead has moved or removed the part
        finally:
            for old in aside:
                resolve_leftover(old)
        flush(folder.parent)
        if not is_whole(folder):
            raise IcyMoonError(
                f"Another process took over pair {folder.name} because this one did not respond; wait for it, or "
                "render the pair again."
            )


def resolve_leftover(part: Path) -> None:
    """Move a complete leftover pair to its folder if this is free, and remove other leftovers of Icy Moon.

    Anything that is not ours stays unread. Raises OSError if the leftover cannot be read; then it stays too.
    """
    if not is_pair_name(part):
        return
    folder = part.with_name(part.name.split(".")[0])
    with suppress(FileNotFoundError):  # another process has settled it
        if not is_whole(part) or is_whole(folder):
            discard_unfinished(part)
        else:
            _try_rename(part, folder)  # if something broken is in its place, the pair stays here


def discard_unfinished(part: Path) -> None:
    """Remove an unfinished folder. A process that still writes to it loses all files at one moment.

    Files that cannot be removed are left for the next process that cleans up.
    """
    doomed, dataset = make_part_path(part.with_name(part.name.split(".")[0])), part.parent.parent
    with suppress(OSError):
        if not find_reason_to_keep(part, dataset):
            rename(part, doomed)
            remove_own_file(doomed, dataset)


def check_place(folder: Path) -> None:
    """Raise IcyMoonError if a file or folder of others takes the place of a pair."""
    if why := find_reason_to_keep(folder, folder.parent.parent):
        raise IcyMoonError(
            f"{folder} is in the place of the pair and is not replaced: {why}; move it, or choose another folder."
        )


def _try_rename(source: Path, target: Path) -> bool:
    """Rename a folder; False if the target exists. Raises FileNotFoundError without a source."""
    try:
        rename(source, target)
    except FileNotFoundError:
        raise
    except OSError:
        if not os.path.lexists(target):  # systems differ in the number of the error
            raise
        return False
    return True
