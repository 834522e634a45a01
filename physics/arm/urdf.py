"""A robot's description in URDF (wiki.ros.org/urdf/XML): links with shapes, and joints with limits.

The file comes from a stranger. A file with a document type, whose entities can grow without end, is refused before it
is parsed. Meshes are read only from the URDF's own package, or from a package beside it that the file names. All values
are checked before use.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from urllib.parse import unquote

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import shorten
from ...support.foreign_bytes import ForeignBytes, parse_xml, read
from .mesh_folders import MeshFolders

#: Largest file in bytes.
MAX_BYTES = 4_000_000
#: Maximum number of links; each gets its own label.
MAX_LINKS = 50
#: Types of joints that do not move,
FIXED = ("fixed",)
#: that turn,
TURNS = ("revolute", "continuous")
#: and that slide.
SLIDES = ("prismatic",)
#: Largest absolute coordinate, limit or size in metres.
_LARGEST_M = 1e3
#: Maximum number of characters of a path in usual file systems.
_LONGEST_PATH = 4095
#: End of the XML namespace of xacro macros that are not expanded yet.
_XACRO_NAMESPACE = "/wiki/xacro}"


@dataclass(frozen=True)
class Shape:
    """A visible shape of a link: a mesh ``file`` with its scale (3,), or a solid with its size in metres, both in
    ``size``.

    ``kind`` is mesh, box (three sides), cylinder (radius and length, about z) or sphere (radius). ``origin`` (4, 4) is
    its pose in the link's frame.
    """

    kind: str
    origin: Array
    size: tuple[float, ...]
    file: Path | None = None


@dataclass(frozen=True)
class UrdfJoint:
    """A joint. ``origin`` (4, 4) is the child's pose in the parent's frame at value 0, and ``axis`` (3,) a unit vector
    in the child's frame. Limits are in radians or metres. ``mimic`` is the name, factor and offset of the joint that it
    follows.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    low: float
    high: float
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True)
class Urdf:
    """A tree of links. ``links`` are the shapes of each link; ``joints`` are sorted so that a parent's joint comes
    before its children's.
    """

    root: str
    links: dict[str, tuple[Shape, ...]]
    joints: tuple[UrdfJoint, ...]

    @property
    def files(self) -> list[Path]:
        """The mesh files, each listed once."""
        return list(
            dict.fromkeys(shape.file for shapes in self.links.values() for shape in shapes if shape.file is not None)
        )


def read_urdf(path: Path) -> Urdf:
    """Read the robot that a file describes. Raises IcyMoonError, with the fault and its place, for a file that cannot
    be used.
    """
    return _Reader(path).read()


class _Reader:
    """Reads a URDF file; ``fail`` names the file in every error."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, what: str, fix: str = "correct the file") -> NoReturn:
        """Raise IcyMoonError with the file, the fault ``what`` and the remedy ``fix``."""
        raise IcyMoonError(f"{self.path}: {what}; {fix}.")

    def read(self) -> Urdf:
        robot = read(self.path, self._parse, "a URDF file", "check lander.file", most=MAX_BYTES)
        links = self._index_by_name(robot, "link")
        if not links:
            self.fail("has no link", "give a URDF file, expanded from xacro")
        if len(links) > MAX_LINKS:
            self.fail(f"has {len(links)} links, more than {MAX_LINKS}", "merge those that do not move")
        joints = [
            self._read_joint(name, item, set(links)) for name, item in self._index_by_name(robot, "joint").items()
        ]
        root, joints = self._sort_tree(list(links), joints)
        self._check_mimics(joints)
        return Urdf(root, {name: self._read_shapes(name, item) for name, item in links.items()}, tuple(joints))

    def _parse(self, foreign: ForeignBytes) -> ElementTree.Element:
        """Parse the root element ``<robot>``. Fails for macros of xacro and for other documents."""
        robot = parse_xml(foreign.text())
        if any(_XACRO_NAMESPACE in item.tag for item in robot.iter()):
            self.fail("has macros of xacro", "expand it first: xacro FILE > arm.urdf")
        if robot.tag != "robot":
            self.fail(f"begins with <{shorten(robot.tag)}> and not with <robot>", "give a URDF file")
        return robot

    def _index_by_name(self, robot: ElementTree.Element, tag: str) -> dict[str, ElementTree.Element]:
        """Index the elements of a tag by their names. Fails if a name is missing or not unique."""
        found: dict[str, ElementTree.Element] = {}
        for item in robot.findall(tag):
            name = (item.get("name") or "").strip()
            if not name or len(name) > 80 or not name.isprintable():
                self.fail(f"has a {tag} whose name is empty, too long or not printable", "name it")
            if name in found:
                self.fail(f"has two {tag}s that are called {name}", "rename one")
            found[name] = item
        return found

    def _parse_numbers(self, text: str | None, count: int, where: str, most: float = _LARGEST_M) -> Array:
        """Parse ``count`` numbers of at most ``most`` (absolute) to an array (count,); ``where`` names the place in
        errors.
        """
        words = (text or "").split()
        try:
            found = np.array([float(word) for word in words])
        except ValueError:
            found = np.empty(0)
        if len(found) != count or not np.isfinite(found).all() or np.abs(found).max(initial=0.0) > most:
            self.fail(
                f"{where} is {shorten(text or '')!r}, not {count} number{'s' if count > 1 else ''} up to {most:g}"
            )
        return found

    def _read_origin(self, item: ElementTree.Element, where: str) -> Array:
        """Read the pose (4, 4) of an element's origin: rotations about the fixed x, y and z axes, in this order."""
        pose, origin = np.eye(4), item.find("origin")
        if origin is None:
            return pose
        pose[:3, 3] = self._parse_numbers(origin.get("xyz", "0 0 0"), 3, f"xyz of {where}")
        (r, p, y) = self._parse_numbers(origin.get("rpy", "0 0 0"), 3, f"rpy of {where}")
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (r, p, y))
        pose[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        return pose

    def _read_joint(self, name: str, item: ElementTree.Element, links: set[str]) -> UrdfJoint:
        kind = item.get("type", "")
        if kind not in (*FIXED, *TURNS, *SLIDES):
            self.fail(
                f"joint {name} has the type {shorten(kind)!r}, which is none of {', '.join((*FIXED, *TURNS, *SLIDES))}",
                "change it",
            )
        ends = []
        for tag in ("parent", "child"):
            link = item.find(tag)
            ends.append(link.get("link", "") if link is not None else "")
            if ends[-1] not in links:
                self.fail(f"the {tag} of joint {name} is {shorten(ends[-1])!r}, which is not a link of the file")
        axis = item.find("axis")
        along = self._parse_numbers(axis.get("xyz") if axis is not None else "1 0 0", 3, f"the axis of joint {name}")
        length = float(np.linalg.norm(along))
        if kind not in FIXED and length < 1e-9:
            self.fail(f"the axis of joint {name} has no length", "give a direction such as 0 0 1")
        low, high = self._read_limits(name, kind, item)
        return UrdfJoint(
            name,
            kind,
            ends[0],
            ends[1],
            self._read_origin(item, f"joint {name}"),
            along / length if length >= 1e-9 else np.array([1.0, 0.0, 0.0]),
            low,
            high,
            self._read_mimic(name, item),
        )

    def _read_limits(self, name: str, kind: str, item: ElementTree.Element) -> tuple[float, float]:
        """Read the lower and the upper limit in radians or metres."""
        if kind in FIXED:
            return 0.0, 0.0
        if kind == "continuous":
            return -math.inf, math.inf
        limit = item.find("limit")
        if limit is None:
            self.fail(f"joint {name} is {kind} and has no limit", "add one, or make it continuous")
        low, high = (
            float(self._parse_numbers(limit.get(end, "0"), 1, f"the limit {end} of joint {name}")[0])
            for end in ("lower", "upper")
        )
        if low > high:
            self.fail(f"the limits of joint {name} are {low:g} to {high:g}", "exchange them")
        return low, high

    def _read_mimic(self, name: str, item: ElementTree.Element) -> tuple[str, float, float] | None:
        """Read the name, factor and offset of the joint that this joint mimics; None for an independent joint."""
        mimic = item.find("mimic")
        if mimic is None:
            return None
        factor, offset = (
            float(self._parse_numbers(mimic.get(key, default), 1, f"{key} of joint {name}")[0])
            for key, default in (("multiplier", "1"), ("offset", "0"))
        )
        return mimic.get("joint", ""), factor, offset

    def _check_mimics(self, joints: Iterable[UrdfJoint]) -> None:
        """Fail for a joint that mimics a joint which cannot move independently."""
        leaders = {joint.name for joint in joints if joint.mimic is None and joint.kind not in FIXED}
        for joint in joints:
            if joint.mimic is not None and joint.mimic[0] not in leaders:
                self.fail(
                    f"joint {joint.name} follows {shorten(joint.mimic[0])!r}, which is not a joint that moves by itself"
                )

    def _sort_tree(self, links: list[str], joints: list[UrdfJoint]) -> tuple[str, list[UrdfJoint]]:
        """Find the name of the root link, and sort the joints from the root outward."""
        into: dict[str, UrdfJoint] = {}
        for joint in joints:
            if joint.child in into:
                self.fail(
                    f"link {joint.child} hangs on two joints, {into[joint.child].name} and {joint.name}", "remove one"
                )
            into[joint.child] = joint
        roots = [link for link in links if link not in into]
        if not roots:
            self.fail("its joints make a ring, so that no link is the first", "remove a joint")
        if len(roots) > 1:
            self.fail(f"the links {roots[0]} and {roots[1]} hang on no joint", "connect them or remove one")
        found, reached = [], {roots[0]}
        while next_ones := [joint for joint in joints if joint.parent in reached and joint.child not in reached]:
            found += next_ones
            reached |= {joint.child for joint in next_ones}
        if len(reached) < len(links):
            left = next(link for link in links if link not in reached)
            self.fail(f"link {left} is in a ring of joints that the first link is not in", "remove a joint")
        return roots[0], found

    def _read_shapes(self, name: str, item: ElementTree.Element) -> tuple[Shape, ...]:
        """Read the visible shapes of a link."""
        found = []
        for visual in item.findall("visual"):
            where = f"a visual of link {name}"
            geometry = visual.find("geometry")
            inside = geometry[0] if geometry is not None and len(geometry) else None
            if inside is None:
                self.fail(f"{where} has no geometry")
            found.append(self._read_shape(inside, self._read_origin(visual, where), where))
        return tuple(found)

    def _read_shape(self, item: ElementTree.Element, origin: Array, where: str) -> Shape:
        if item.tag == "mesh":
            scale = self._parse_numbers(item.get("scale", "1 1 1"), 3, f"the scale of {where}")
            if (scale == 0).any():
                self.fail(f"the scale of {where} has a 0")
            return Shape("mesh", origin, tuple(scale), self._find_mesh(item.get("filename", ""), where))
        sizes = {"box": (("size", 3),), "cylinder": (("radius", 1), ("length", 1)), "sphere": (("radius", 1),)}
        if item.tag not in sizes:
            self.fail(f"{where} is a {shorten(item.tag)!r}, not mesh, {', '.join(sizes)}")
        size = tuple(
            float(value)
            for key, count in sizes[item.tag]
            for value in self._parse_numbers(item.get(key), count, f"{key} of {where}")
        )
        if min(size) <= 0:
            self.fail(f"{where} has a size that is not above 0")
        return Shape(item.tag, origin, size)

    def _find_mesh(self, name: str, where: str) -> Path:
        """Find the file of a mesh by its name: in the folder of the URDF, in its package, or in the package beside it
        that the name states.
        """
        text = unquote(name)
        if len(text) > _LONGEST_PATH:
            self.fail(f"the mesh of {where} is {shorten(text)!r}, longer than a path can be")
        if "://" in text and not text.startswith(("package://", "file://")):
            self.fail(f"the mesh of {where} is {shorten(text)!r}, which is not a file of the folder", "copy it there")
        package, _, path = text.removeprefix("package://").partition("/")
        is_of_package = text.startswith("package://")
        folders = MeshFolders(self.path)
        try:
            places = [
                (folder, place.resolve())
                for folder, place in (
                    folders.find_package_places(package, path)
                    if is_of_package
                    else folders.find_relative_places(text.removeprefix("file://"))
                )
            ]
            inside = [place for folder, place in places if place.is_relative_to(folder)]
            found = next((place for place in inside if place.is_file()), None)
            is_outside = not inside or any(place.is_file() for _, place in places if place not in inside)
        except (OSError, ValueError):
            self.fail(f"the mesh of {where} is {shorten(text)!r}, which is not a valid file name")
        if found is None:
            looked_in = " or ".join(dict.fromkeys(str(folder) for folder, _ in places))
            self.fail(
                f"the mesh of {where}, {shorten(text)!r}, is {'outside' if is_outside else 'not in'} {looked_in}",
                f"copy it into {folders.package}"
                + (f", or put the package {shorten(package)!r} beside it" if is_of_package else ""),
            )
        return found
