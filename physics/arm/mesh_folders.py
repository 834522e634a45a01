"""The folders that may hold the meshes of a URDF file: its own, its ROS package's, and a package beside that package.

A folder is a package if it has a ``package.xml`` (ROS REP 149). Nothing else above the URDF file is ever read.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, parse_xml, read

_MANIFEST = "package.xml"
#: Number of folders above the URDF's folder that are searched.
_MAX_PARENTS = 8
#: Largest package.xml in bytes.
_MAX_MANIFEST_BYTES = 1_000_000
#: A folder, and a file that is used if it exists and lies in that folder.
Place = tuple[Path, Path]


class MeshFolders:
    """The folders around a URDF file, with symbolic links resolved. ``own`` is the file's folder, ``package`` the
    folder of its ROS package; both are the same without a package.
    """

    def __init__(self, urdf: Path) -> None:
        self.own = urdf.resolve().parent
        self._packages = [each for each in (self.own, *self.own.parents)[: _MAX_PARENTS + 1] if _is_package(each)]
        self.package = self._packages[0] if self._packages else self.own

    def find_relative_places(self, path: str) -> list[Place]:
        """List the candidate files for a mesh path that is relative to the URDF."""
        return [(self.package, self.own / path)]

    def find_package_places(self, package: str, path: str) -> list[Place]:
        """List the candidate files for a mesh of a package. They are in packages of this name above the URDF or beside
        a package above it; then in the URDF's own package, because its folder may have been renamed.
        """
        named = [each for each in self._packages if package in (each.name, _read_package_name(each))]
        beside = [each.parent / package for each in self._packages]
        # Names such as .. leave the folder, and a link could lead anywhere.
        named += [each for each in beside if each.resolve() == each and _is_package(each)]
        return [
            *((each, each / path) for each in named),
            *((self.package, each) for each in (self.package / path, self.package / package / path, self.own / path)),
        ]


def _is_package(folder: Path) -> bool:
    try:
        return (folder / _MANIFEST).is_file()
    except (OSError, ValueError):  # a folder that may not be entered, or an impossible path
        return False


def _read_package_name(folder: Path) -> str:
    """Read the name in a package's manifest; empty without a readable name."""

    def parse(foreign: ForeignBytes) -> ElementTree.Element:
        return parse_xml(foreign.text())

    try:
        return (
            read(folder / _MANIFEST, parse, "a package.xml", "correct it", most=_MAX_MANIFEST_BYTES).findtext("name")
            or ""
        ).strip()
    except IcyMoonError:
        return ""
