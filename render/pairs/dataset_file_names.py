"""The names of Icy Moon's files in a data set's folder; only such files are ever removed. Imports no Blender.

Anyone may have written a plan, a claim or a folder. So each id from a file is checked before it becomes part of a path.
Each removal goes through ``remove_own_file``, which proves that its target lies in one of our folders and has one of
our names.
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

#: Folder of a data set for arrays from a program: heights, albedos, rocks.
INPUTS = "inputs"
_PAIR_ID = re.compile(r"[0-9a-f]{12}")
#: The suffix that ``files.make_part_path`` appends: host, process and number.
_PART_SUFFIX = r"\.[^/\\]+-\d+-\d+\.part"
_CLAIM_NAME = r"[0-9a-f]{12}\.\d{1,9}"
#: Patterns of the names that may be removed, by folder.
_NAMES_BY_FOLDER = {
    "": re.compile(rf"(plan\.jsonl|manifest\.json|\.icymoon){_PART_SUFFIX}"),
    "pairs": re.compile(rf"[0-9a-f]{{12}}({_PART_SUFFIX})?|\.clock{_PART_SUFFIX}"),
    "light": re.compile(rf"[0-9a-f]{{12}}(-[0-9a-f]{{12}})?\.npz({_PART_SUFFIX})?"),
    "claims": re.compile(rf"{_CLAIM_NAME}({_PART_SUFFIX})?"),
    "pairs/*": re.compile(rf"pair\.json{_PART_SUFFIX}"),
}
#: Names of the files in a pair's folder.
_PAIR_FILES = re.compile(
    rf"pair\.json({_PART_SUFFIX})?|(left|right)(_truth|_toed_truth|_raw_truth)?\.exr|workspace(_materials)?\.npy|"
    rf"lidar\.(npz|json|wdp|ply|las|laz)({_PART_SUFFIX})?|{PATTERN}"
)


def pairs_folder(dataset: Path) -> Path:
    """Return the folder of a data set that contains its pairs."""
    return dataset / "pairs"


def folder_of_pair(dataset: Path, name: str) -> Path:
    """Return the folder of a pair in a data set. Its name is the pair's id."""
    return pairs_folder(dataset) / name


def is_pair_id(name: str) -> bool:
    """Return whether a name is the id of a pair."""
    return bool(_PAIR_ID.fullmatch(name))


def check_id(value: object, where: object) -> str:
    """Check a pair's id that was read from ``where``, and return it. Raises IcyMoonError for other texts."""
    if not isinstance(value, str) or not is_pair_id(value):
        raise IcyMoonError(
            f"{where} names a pair {str(value)[:40]!r}, but a pair's id is 12 of the digits 0 to 9 and a to f. The "
            "file was changed or is not ours; use another one."
        )
    return value


def is_unfinished_name(path: Path) -> bool:
    """Return whether a path has the name of one of our unfinished files or folders."""
    return bool(re.fullmatch(rf".+{_PART_SUFFIX}", path.name))


def is_pair_name(path: Path) -> bool:
    """Return whether a path has the name of a pair, finished or not."""
    return bool(_NAMES_BY_FOLDER["pairs"].fullmatch(path.name)) and not path.name.startswith(".")


def is_claim_name(path: Path) -> bool:
    """Return whether a path has the name of a claim."""
    return bool(re.fullmatch(_CLAIM_NAME, path.name))


def is_regular_file(path: Path) -> bool:
    """Return whether a path is a regular file, not a link. Raises OSError if the system refuses to tell."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return False


def check_no_link(*paths: Path) -> None:
    """Raise IcyMoonError if one of these paths in a data set is a link, which may lead to files of others.

    The data set itself may be a link.
    """
    for path in paths:
        if path.is_symlink():
            raise IcyMoonError(
                f"{path} is a link, and Icy Moon does not write through links. Replace the link by its target, or "
                "choose another data set."
            )


def find_reason_to_keep(path: Path, dataset: Path) -> str:
    """Find the reason why a file or folder of a data set may not be removed, as a clause; empty if Icy Moon wrote
    it."""
    inside = path.parent.relative_to(dataset).as_posix() if path.parent != dataset else ""
    kind = "pairs/*" if _PAIR_ID.fullmatch(inside.removeprefix("pairs/")) else inside
    if kind not in _NAMES_BY_FOLDER or not _NAMES_BY_FOLDER[kind].fullmatch(path.name):
        return "its name is not a name of Icy Moon's files"
    # A link, here or in a folder above, may lead to anyone's files.
    if path.is_symlink() or path.resolve() != dataset.resolve() / inside / path.name:
        return "it is a link or lies behind one"
    if path.is_dir() and inside != "pairs":
        return "it is a folder"
    foreign = list_foreign_files(path) if inside == "pairs" and _PAIR_ID.fullmatch(path.name) else []
    if not foreign:
        return ""
    return "it is not a folder" if foreign[0] == path else f"{foreign[0].name} in it is not Icy Moon's"


def list_foreign_files(folder: Path) -> list[Path]:
    """List the files, folders and links in a pair's folder that Icy Moon did not write; the path itself if it is not a
    folder."""
    if not folder.is_dir():
        return [folder] if folder.exists() else []
    return [
        entry
        for entry in sorted(folder.iterdir())
        if not (_PAIR_FILES.fullmatch(entry.name) or is_of_file_manager(entry.name))
        or entry.is_symlink()
        or not entry.is_file()
    ]


def remove_own_file(path: Path, dataset: Path) -> bool:
    """Remove a file or folder of Icy Moon from a data set, and return whether it is gone. Files of others stay."""
    with suppress(OSError):
        if not find_reason_to_keep(path, dataset):
            if path.is_dir():
                system.remove_folder(path)
            else:
                system.remove(path)
    return not path.exists() and not path.is_symlink()
