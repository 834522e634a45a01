"""Folders of exports, in which no incomplete file appears."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...support.files import explain_disk_errors, make_part_path
from ...support.system import flush, remove_folder, replace


@contextmanager
def fill_whole_folder(target: Path) -> Iterator[Path]:
    """Yield a folder to fill, and move its files to ``target`` once all are written.

    The folder is beside ``target``. So no incomplete file appears in ``target``.
    """
    part = make_part_path(target)
    with explain_disk_errors("write", target):
        part.mkdir(parents=True)
    try:
        yield part
        with explain_disk_errors("write", target):
            for path in sorted(part.rglob("*")):
                if path.is_file() and not path.is_symlink():
                    place = target / path.relative_to(part)
                    place.parent.mkdir(parents=True, exist_ok=True)
                    flush(path)
                    replace(path, place)
    finally:
        remove_folder(part)
