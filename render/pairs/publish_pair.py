"""Moves a finished pair to its place, whatever other processes do, and at whatever moment this one ends.

A folder gets its final name by one rename, which fails if the place is taken. Nothing is deleted at a path that another
process may own: a folder in the way is first renamed to a name of our own and checked there, since a process that took
this one for dead may have just finished it. So a complete pair stays, or lies whole beside its place, from where
``resolve_leftover`` puts it back. Imports no Blender.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ...support.errors import IcyMoonError
from ...support.files import explain_disk_errors, make_part_path
from ...support.system import flush, rename
from .dataset_file_names import find_reason_to_keep, is_pair_name, remove_ours
from .pair_folder import is_whole


def publish_pair(part: Path, folder: Path, lost: Callable[[], bool], again: bool = False) -> None:
    """Make the pair in ``part`` the one at ``folder``, unless a whole one is there; ``again`` replaces that too.

    ``lost`` returns whether another process has claimed the pair since, whose pair then stays. Raises IcyMoonError
    if the disk refuses, if something that is not ours is in the way, or if the rendered pair was lost and no other one
    is there.
    """
    aside: list[Path] = []
    with explain_disk_errors("write", folder):
        try:
            flush(part)
            while not lost() and is_whole(part) and not _try_rename(part, folder):
                if not again and is_whole(folder):
                    return  # another has finished it meanwhile
                check_place(folder)
                aside.append(make_part_path(folder))
                with suppress(FileNotFoundError):
                    _try_rename(folder, aside[-1])
                if not again:
                    resolve_leftover(aside[-1])  # moves it back into its place if it was finished just now
        except FileNotFoundError:
            pass  # a process that took this one for dead has put the part into its place, or cleared it away
        finally:
            for old in aside:
                resolve_leftover(old)
        flush(folder.parent)
        if not is_whole(folder):
            raise IcyMoonError(
                f"Pair {folder.name} was taken over by another process while this one stood still; "
                "wait for it, or render the pair again."
            )


def resolve_leftover(part: Path) -> None:
    """Move a whole pair that was left beside its place into that place if it is free, and remove anything else.

    Anything that is not ours stays, and is not read. Raises OSError if the leftover cannot be read; it then stays as it
    is.
    """
    if not is_pair_name(part):
        return
    folder = part.with_name(part.name.split(".")[0])
    with suppress(FileNotFoundError):  # another has settled it
        if not is_whole(part) or is_whole(folder):
            discard_unfinished(part)
        else:
            _try_rename(part, folder)  # and stays where it is if something broken is in its place


def discard_unfinished(part: Path) -> None:
    """Remove an unfinished folder. Whoever still writes to it loses it at one moment, not file by file.

    What cannot be removed is left for whoever sweeps next.
    """
    doomed, dataset = make_part_path(part.with_name(part.name.split(".")[0])), part.parent.parent
    with suppress(OSError):
        if not find_reason_to_keep(part, dataset):
            rename(part, doomed)
            remove_ours(doomed, dataset)


def check_place(folder: Path) -> None:
    """Raise IcyMoonError if the place of a pair is taken by something that we may not move."""
    if why := find_reason_to_keep(folder, folder.parent.parent):
        raise IcyMoonError(f"{folder} is in the way and stays as it is: {why}; move it, or choose another folder.")


def _try_rename(source: Path, target: Path) -> bool:
    """Rename a folder; False where the target is something already. Raises FileNotFoundError if there is no source."""
    try:
        rename(source, target)
    except FileNotFoundError:
        raise
    except OSError:
        if not os.path.lexists(target):  # systems differ in the number of the error
            raise
        return False
    return True
