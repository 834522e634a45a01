"""Which files in a data set's folder are ours: the names that we give, and removal of nothing else. Imports no Blender.

A plan, a claim or a folder may have been written by anyone. Every id that is read back is checked before it becomes a
part of a path. Every removal goes through ``remove_ours``, which proves that its target lies in one of our folders and
is something that we write.
"""

from __future__ import annotations

import re
import stat
from contextlib import suppress
from pathlib import Path

from ...support import system
from ...support.errors import IcyMoonError
from ...support.files import is_of_file_manager
from .head_files import PATTERN

#: Folder of a data set for arrays that a program gave: heights, albedos, rocks.
INPUTS = "inputs"
_ID = re.compile(r"[0-9a-f]{12}")
#: What ``files.make_part_path`` appends: host, process and number.
_UNFINISHED = r"\.[^/\\]+-\d+-\d+\.part"
_CLAIM = r"[0-9a-f]{12}\.\d{1,9}"
#: Names in each of our folders that may be removed.
_OUR_NAMES = {
    "": re.compile(rf"(plan\.jsonl|manifest\.json|\.icymoon){_UNFINISHED}"),
    "pairs": re.compile(rf"[0-9a-f]{{12}}({_UNFINISHED})?|\.clock{_UNFINISHED}"),
    "light": re.compile(rf"[0-9a-f]{{12}}(-[0-9a-f]{{12}})?\.npz({_UNFINISHED})?"),
    "claims": re.compile(rf"{_CLAIM}({_UNFINISHED})?"),
    "pairs/*": re.compile(rf"pair\.json{_UNFINISHED}"),
}
#: Files of a pair.
_PAIR_FILES = re.compile(
    rf"pair\.json({_UNFINISHED})?|(left|right)(_truth|_toed_truth|_raw_truth)?\.exr|workspace(_materials)?\.npy|{PATTERN}"
)


def pairs_folder(dataset: Path) -> Path:
    """The folder of a data set that contains its pairs."""
    return dataset / "pairs"


def folder_of_pair(dataset: Path, name: str) -> Path:
    """The folder of a pair, by its name: its id."""
    return pairs_folder(dataset) / name


def check_id(value: object, where: object) -> str:
    """A pair's id as it was read from ``where``. Raises IcyMoonError if the value is no id."""
    if not isinstance(value, str) or not _ID.fullmatch(value):
        raise IcyMoonError(
            f"{where} names a pair {str(value)[:40]!r}, and a pair's id is 12 of the digits 0 to 9 and "
            "a to f; the file was changed or is not ours, take another."
        )
    return value


def is_unfinished_name(path: Path) -> bool:
    """Whether a name is one that we give to an unfinished file or folder."""
    return bool(re.fullmatch(rf".+{_UNFINISHED}", path.name))


def is_pair_name(path: Path) -> bool:
    """Whether a name is one that we give to a pair, finished or not."""
    return bool(_OUR_NAMES["pairs"].fullmatch(path.name)) and not path.name.startswith(".")


def is_claim_name(path: Path) -> bool:
    """Whether a name is the name of a claim."""
    return bool(re.fullmatch(_CLAIM, path.name))


def is_regular_file(path: Path) -> bool:
    """Whether there is a regular file, which is no link. Raises OSError where that cannot be told."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return False


def check_no_link(*paths: Path) -> None:
    """Raise IcyMoonError if something in a data set is a link, which may lead to anyone's files.

    The data set itself may be reached by a link.
    """
    for path in paths:
        if path.is_symlink():
            raise IcyMoonError(
                f"{path} is a link, and nothing is written through one; put what it leads to in its "
                "place, or choose another data set."
            )


def find_reason_to_keep(path: Path, dataset: Path) -> str:
    """Why a file or folder of a data set may not be removed, as a clause; empty if it is ours."""
    inside = path.parent.relative_to(dataset).as_posix() if path.parent != dataset else ""
    kind = "pairs/*" if _ID.fullmatch(inside.removeprefix("pairs/")) else inside
    if kind not in _OUR_NAMES or not _OUR_NAMES[kind].fullmatch(path.name):
        return "its name is not one that Icy Moon gives"
    # A link, in its place or above it, may lead to anyone's files.
    if path.is_symlink() or path.resolve() != dataset.resolve() / inside / path.name:
        return "it is a link or lies behind one"
    if path.is_dir() and inside != "pairs":
        return "it is a folder"
    foreign = list_foreign(path) if inside == "pairs" and _ID.fullmatch(path.name) else []
    if not foreign:
        return ""
    return "it is no folder" if foreign[0] == path else f"{foreign[0].name} in it is not Icy Moon's"


def list_foreign(folder: Path) -> list[Path]:
    """Files and folders in a pair's folder that we did not write, links too; the path itself if it is no folder."""
    if not folder.is_dir():
        return [folder] if folder.exists() else []
    return [
        entry
        for entry in sorted(folder.iterdir())
        if not (_PAIR_FILES.fullmatch(entry.name) or is_of_file_manager(entry.name))
        or entry.is_symlink()
        or not entry.is_file()
    ]


def remove_ours(path: Path, dataset: Path) -> bool:
    """Remove something of ours from a data set; whether nothing is there any more. Anything that is not ours stays."""
    with suppress(OSError):
        if not find_reason_to_keep(path, dataset):
            if path.is_dir():
                system.remove_folder(path)
            else:
                system.remove(path)
    return not path.exists() and not path.is_symlink()
