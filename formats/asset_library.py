"""The folder of an asset library of Blender: .blend files, their catalogs, and a record of the files that we wrote.

The user may put other files into the folder. Only files that the record lists are replaced and removed, and the record
is checked first. Imports no Blender.
"""

from __future__ import annotations

import re
import shutil
import uuid
from functools import partial
from pathlib import Path

from ..support.errors import IcyMoonError
from ..support.file_schemas import TEXT, Each, read_record
from ..support.files import explain_disk_errors, write_atomically, write_json, write_text
from ..support.system import remove
from ..support.version import version

#: The catalog that contains all others. Without it Blender would add it and report changed catalogs.
_PARENT_CATALOG = "Icy Moon"
#: The catalog of each kind of asset. The kind is also the folder of its .blend files.
CATALOGS = {
    "scenes": f"{_PARENT_CATALOG}/Scenes",
    "gallery": f"{_PARENT_CATALOG}/Scenes",
    "surfaces": f"{_PARENT_CATALOG}/Surfaces",
    "rigs": f"{_PARENT_CATALOG}/Rigs",
    "lights": f"{_PARENT_CATALOG}/Lights",
    "bodies": f"{_PARENT_CATALOG}/Lights",
    "skies": f"{_PARENT_CATALOG}/Skies",
}
#: Name of Blender's file of catalogs.
_CATALOG_FILE = "blender_assets.cats.txt"
#: Name of the file of catalogs that Blender has replaced.
_REPLACED_CATALOG_FILE = "blender_assets.cats.txt~"
#: Name of our record of files.
RECORD_FILE = "icymoon_assets.json"
_RECORD_SHAPE = {"made_with": TEXT, "files": Each(TEXT)}
_ASSET_PATTERN = re.compile(rf"({'|'.join(CATALOGS)})/[a-z0-9_]+\.blend")
_CATALOG_NAMESPACE = uuid.UUID("5d0ad3ab-2c5f-4a51-9d1c-7a0b0f8e4c11")


def catalog_id(kind: str) -> str:
    """Return the id of the catalog for a kind of preset. It never changes, so that assets stay in their catalog."""
    return _make_id(CATALOGS[kind])


def _make_id(path: str) -> str:
    return str(uuid.uuid5(_CATALOG_NAMESPACE, path))


def make_catalogs_text() -> str:
    """Make the text of Blender's file of catalogs."""
    paths = dict.fromkeys([_PARENT_CATALOG, *CATALOGS.values()])
    lines = [f"{_make_id(path)}:{path}:{path.replace('/', '-')}" for path in paths]
    return "\n".join(["# Catalogs of the asset library that Icy Moon makes.", "", "VERSION 1", "", *lines, ""])


def has_library(folder: Path) -> bool:
    """Return whether a folder contains a complete library."""
    return (folder / _CATALOG_FILE).is_file() and (folder / RECORD_FILE).is_file()


def find_files(folder: Path) -> list[Path]:
    """Find the .blend files that a library's record lists and that exist in its folder.

    Raises IcyMoonError if the record is not Icy Moon's, or if a folder of the library is a link.
    """
    if links := [part for part in (folder, *(folder / kind for kind in CATALOGS)) if part.is_symlink()]:
        raise IcyMoonError(f"{links[0]} is a link, which Icy Moon did not make; remove it by hand.")
    try:
        listed = read_record(folder / RECORD_FILE, _RECORD_SHAPE, "delete the folder by hand")["files"]
    except FileNotFoundError:
        return []
    if strange := [name for name in listed if not _ASSET_PATTERN.fullmatch(name)]:
        raise IcyMoonError(
            f"{folder / RECORD_FILE} lists {strange[0]!r}, which is not an asset; delete the folder by hand."
        )
    return [path for path in map(folder.joinpath, listed) if path.is_file()]


def install_library(made: Path, folder: Path) -> list[Path]:
    """Copy the .blend files in the folder ``made`` into a library, and remove its earlier files. Returns the new paths.
    Each file is replaced as a whole. Raises IcyMoonError as ``find_files`` does, and if writing fails."""
    names = sorted(path.relative_to(made).as_posix() for path in made.glob("*/*.blend"))
    earlier = find_files(folder)
    listed = sorted({*names, *(path.relative_to(folder).as_posix() for path in earlier)})
    write_json(
        folder / RECORD_FILE, {"made_with": version(), "files": listed}
    )  # before the files, so that it lists each of them
    for name in names:
        write_atomically(folder / name, partial(_copy, made / name))
    new = [folder / name for name in names]
    with explain_disk_errors("write to", folder):
        for path in set(earlier) - set(new):
            remove(path)
    write_text(folder / _CATALOG_FILE, make_catalogs_text())
    write_json(folder / RECORD_FILE, {"made_with": version(), "files": names})
    return new


def _copy(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)


def uninstall_library(folder: Path) -> list[Path]:
    """Remove our files from a library, and its folders if they are then empty. Returns the remaining files. Raises
    IcyMoonError as ``find_files`` does, and if the disk refuses."""
    ours = find_files(folder)
    with explain_disk_errors("remove files from", folder):
        for path in [*ours, *(folder / name for name in (_CATALOG_FILE, _REPLACED_CATALOG_FILE, RECORD_FILE))]:
            remove(path)
        for part in [*(folder / kind for kind in CATALOGS), folder]:
            if part.is_dir() and not any(part.iterdir()):
                part.rmdir()
    return sorted(path for path in folder.rglob("*") if path.is_file()) if folder.is_dir() else []
