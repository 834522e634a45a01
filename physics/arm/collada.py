"""Collada (.dae): the triangles, in metres, that the scene of a small file shows.

Format: Khronos, "COLLADA - Digital Asset Schema Release 1.4.1", 2008; 1.5 has the same elements. Blender reads Collada
up to 4.5 only, and Blender as a module does not. The nodes of the scene name the visible geometries. Materials, images
and animations are not read, and no other file is opened.

Coordinates are multiplied by the stated unit, and axes stay as they are written, whatever ``up_axis`` states. RViz,
MoveIt and Gazebo do the same (they leave out the turn of the root that Assimp makes of ``up_axis``), and published URDF
files are made to look right there.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from array import array
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np

from ...support.arrays import Array
from ...support.files import shorten
from ...support.foreign_bytes import Budget, ForeignBytes, RefusedError, parse_xml
from ...support.number_text import format_count
from .kinematics import make_rigid_transform, rotation_about

Number = TypeVar("Number", int, float)
#: Maximum number of nodes and their parts; each counts as many times as the scene shows it.
_MAX_NODES = 100_000
#: Maximum number of indices of a corner.
_MAX_INPUTS = 100
#: Number of characters that are split into words at once.
_CHARACTERS_AT_ONCE = 2**18
#: Largest number in a transform, and largest unit in metres.
_LARGEST_NUMBER = 1e9
#: Elements that contain triangles or polygons.
_PRIMITIVES = ("triangles", "polylist", "polygons", "trifans", "tristrips")
#: Vertices (n, 3) and triangles (m, 3).
Mesh = tuple[Array, Array]


def parse_triangles(foreign: ForeignBytes, most: int) -> Mesh:
    """Parse the vertices (n, 3) in metres and the triangles (m, 3); a polygon of more corners becomes a fan.

    Raises ValueError if the file is broken. Raises RefusedError if the scene shows no triangle, for more than ``most``
    triangles or three times as many vertices, and for unsupported content: skins, holes in polygons, and transforms
    that shear or look at a place.
    """
    # The parser would call its handler of text for each line.
    root = parse_xml(foreign.text().replace("\n", " ").replace("\t", " "), foreign.budget)
    return _ColladaDocument(root, foreign.budget, most).read()


class _ColladaDocument:
    """A parsed file: its elements by id, and the limits that hold while it is read."""

    def __init__(self, root: ElementTree.Element, budget: Budget, most: int) -> None:
        self.root, self.budget, self.most = root, budget, most
        self.by_id: dict[tuple[str, str], list[ElementTree.Element]] = {}
        for item in root.iter():
            item.tag = item.tag.rpartition("}")[2]
            if name := item.get("id"):
                self.by_id.setdefault((item.tag, name), []).append(item)
        # A file may refer to one element many times.
        self.array_of, self.positions_of, self.source_of = (
            cache(self._read_float_array),
            cache(self._read_positions),
            cache(self._find_position_source),
        )
        self.mesh_of, self.split_pose = cache(self._read_geometry), cache(self._compose_transforms)

    def read(self) -> Mesh:
        """Read the mesh of all shown geometries, in metres."""
        if self.root.tag != "COLLADA":
            raise ValueError(f"it begins with <{shorten(self.root.tag)}> and not with <COLLADA>")
        unit = self.root.find("asset/unit")
        metres = _parse_number(unit.get("meter", "1") if unit is not None else "1", "the unit")
        if not 0 < metres <= _LARGEST_NUMBER:
            raise ValueError(f"its unit is {metres:g} m")
        shown: list[Mesh] = []
        triangles = vertices = 0
        for geometry, place in self._find_shown_geometries():
            points, corners = self.mesh_of(geometry)
            if not len(corners):
                continue
            triangles, before, vertices = triangles + len(corners), vertices, vertices + len(points)
            _check_counts(triangles, vertices, self.most)  # before it is made: a file may show one many times
            if np.linalg.det(place[:3, :3]) < 0:
                corners = corners[:, ::-1]  # a mirrored mesh is inside out
            shown.append((points @ place[:3, :3].T + place[:3, 3], corners + before))
        if not shown:
            raise RefusedError("has a scene that shows no triangle; export it with its objects.")
        return np.concatenate([each for each, _ in shown]) * metres, np.concatenate([each for _, each in shown])

    def _find(self, tag: str, url: str | None) -> ElementTree.Element:
        """Find the element with this tag to which a reference such as ``#name`` points."""
        kind, _, name = (url or "").rpartition("#")
        if kind:
            raise RefusedError(f"refers to {shorten(url or '')!r}, which is in another file; export all into one file.")
        found = self.by_id.get((tag, name), [])
        if len(found) != 1:
            raise ValueError(f"{len(found) or 'no'} <{tag}> {'have' if found else 'has'} the id {shorten(name)!r}")
        return found[0]

    # The scene

    def _find_scene(self) -> ElementTree.Element:
        """Find the visual scene that the file's ``scene`` names, else its only visual scene."""
        named = self.root.find("scene/instance_visual_scene")
        if named is not None:
            return self._find("visual_scene", named.get("url"))
        scenes = self.root.findall("library_visual_scenes/visual_scene")
        if len(scenes) != 1:
            raise ValueError(f"it has {format_count(len(scenes), 'scene')}, and names none to be shown")
        return scenes[0]

    def _find_shown_geometries(self) -> Iterator[tuple[ElementTree.Element, Array]]:
        """Yield each geometry of the visible scene, with its pose (4, 4)."""
        left = [(node, np.eye(4)) for node in reversed(self._find_scene().findall("node"))]
        steps = 0
        while left:
            node, above = left.pop()
            steps += 1 + len(node)
            if steps > _MAX_NODES:  # nodes may show each other without end
                raise RefusedError(f"shows more than {_MAX_NODES} nodes and parts of nodes; join its objects.")
            if node.find("instance_controller") is not None:
                raise RefusedError(
                    "has a skin or a morph (instance_controller), which is not read; apply it and export a plain mesh."
                )
            place = above @ self.split_pose(node)
            if not np.abs(place).max() <= _LARGEST_NUMBER:
                raise ValueError("a node has a place that is not finite")
            for each in node.findall("instance_geometry"):
                yield self._find("geometry", each.get("url")), place
            inner = [
                self._find("node", each.get("url")) if each.tag == "instance_node" else each
                for each in node
                if each.tag in ("node", "instance_node")
            ]
            left += [(each, place) for each in reversed(inner)]

    def _compose_transforms(self, node: ElementTree.Element) -> Array:
        """Compute the pose (4, 4) of a node: the product of its transforms in their order."""
        made = np.eye(4)
        for each in node:
            if each.tag in _TRANSFORMS:
                made = made @ self._parse_transform(each)
            elif each.tag in ("lookat", "skew"):
                raise RefusedError(
                    f"has a node with <{each.tag}>, which is not read; apply the transforms of its "
                    "objects and export it again."
                )
        return made

    def _parse_transform(self, item: ElementTree.Element) -> Array:
        """Parse the pose (4, 4) of one transform element."""
        values = self._parse_numbers(item.text, float, _TRANSFORMS[item.tag], f"a <{item.tag}>")
        if not np.abs(values).max() <= _LARGEST_NUMBER:
            raise ValueError(f"a <{item.tag}> contains a value that is not a number")
        if item.tag == "matrix":
            if not np.allclose(values[12:], [0.0, 0.0, 0.0, 1.0], atol=1e-6):
                raise ValueError("a <matrix> must have the last row 0 0 0 1")
            return values.reshape(4, 4)
        if item.tag == "scale":
            return np.diag([*values, 1.0])
        return (
            make_rigid_transform(place=values)
            if item.tag == "translate"
            else make_rigid_transform(_rotation_about(values[:3], math.radians(values[3])))
        )

    # Geometries

    def _read_geometry(self, geometry: ElementTree.Element) -> Mesh:
        """Read the vertices and triangles of a geometry, in the file's unit."""
        mesh = geometry.find("mesh")
        found = [self._read_primitive(item) for item in mesh if item.tag in _PRIMITIVES] if mesh is not None else []
        starts, points, count = dict[ElementTree.Element, int](), [np.empty((0, 3))], 0
        for source, corners in found:
            places = self.positions_of(source)
            if corners.size and not 0 <= corners.min() <= corners.max() < len(places):
                wrong = corners[(corners < 0) | (corners >= len(places))][0]
                raise ValueError(f"a face has vertex {wrong}, and the vertices are 0 to {len(places) - 1}")
            if source not in starts:
                starts[source], count = count, count + len(places)
                points.append(places)
        _check_counts(sum(len(corners) for _, corners in found), count, self.most)
        return np.concatenate(points), np.concatenate(
            [np.empty((0, 3), np.int64), *(corners + starts[source] for source, corners in found)]
        )

    def _read_float_array(self, numbers: ElementTree.Element) -> Array:
        """Read the numbers (n,) of a ``<float_array>``."""
        found = self._parse_numbers(numbers.text, float, _read_count(numbers, "count"), "an array")
        if not np.isfinite(found).all():
            raise ValueError("an array contains a value that is not a number")
        return found

    def _read_positions(self, source: ElementTree.Element) -> Array:
        """Read the positions (n, 3) that a source contains."""
        accessor = source.find("technique_common/accessor")
        if accessor is None:
            raise ValueError("a source has no accessor")
        values = self.array_of(self._find("float_array", accessor.get("source")))
        count, start, stride = (
            _read_count(accessor, "count"),
            _read_count(accessor, "offset", 0),
            _read_count(accessor, "stride", 1),
        )
        # A parameter without a name is left out.
        columns = [k for k, each in enumerate(accessor.findall("param")) if each.get("name")]
        if len(columns) != 3 or columns[-1] >= stride:
            raise ValueError("an accessor of positions must have three named parameters")
        if count and start + (count - 1) * stride + columns[-1] >= len(values):
            raise ValueError(f"an accessor of {count} places needs more than the {len(values)} numbers of its array")
        _check_counts(0, count, self.most)
        self.budget.charge(24 * count, "vertices")
        return values[start + stride * np.arange(count)[:, None] + columns]

    def _find_position_source(self, vertices: ElementTree.Element) -> ElementTree.Element:
        """Find the source of the positions of a ``<vertices>`` element."""
        urls = [each.get("source") for each in vertices.findall("input") if each.get("semantic") == "POSITION"]
        if len(urls) != 1:
            raise ValueError("a <vertices> must have exactly one input POSITION")
        return self._find("source", urls[0])

    def _read_primitive(self, item: ElementTree.Element) -> tuple[ElementTree.Element, Array]:
        """Read the position source of a primitive, and its triangles (m, 3) as indices into that source."""
        inputs = [(each, _read_count(each, "offset")) for each in item.findall("input")]
        width = 1 + max((offset for _, offset in inputs), default=0)
        vertex = [(each, offset) for each, offset in inputs if each.get("semantic") == "VERTEX"]
        if len(vertex) != 1 or width > _MAX_INPUTS:
            raise ValueError(f"a <{item.tag}> has not one input VERTEX, or more than {_MAX_INPUTS} inputs")
        source = self.source_of(self._find("vertices", vertex[0][0].get("source")))
        if item.find("ph") is not None:
            raise RefusedError("has polygons with holes, which are not read; export it as triangles.")
        lengths, corners = self._read_corners(item, width)
        at = np.cumsum(lengths) - lengths
        fan = np.maximum(lengths - 2, 0)
        _check_counts(int(fan.sum()), 0, self.most)
        self.budget.charge(24 * int(fan.sum()), "triangles")
        first, inner = np.repeat(at, fan), np.arange(fan.sum()) - np.repeat(np.cumsum(fan) - fan, fan)
        triangles = np.stack([first, first + inner + 1, first + inner + 2], axis=1)
        if (
            item.tag == "tristrips"
        ):  # a triangle starts with its predecessor's last two corners; every second is flipped
            triangles[:, 0] += inner
            triangles[inner % 2 == 1] = triangles[inner % 2 == 1][:, [1, 0, 2]]
        return source, corners.reshape(-1, width)[:, vertex[0][1]][triangles]

    def _read_corners(self, item: ElementTree.Element, width: int) -> tuple[Array, Array]:
        """Read the number of corners of each polygon, fan or strip, and the indices of all corners, ``width`` for each,
        as one flat array.
        """
        lists = [each.text for each in item.findall("p")]
        if item.tag in ("triangles", "polylist"):
            count = _read_count(item, "count")
            if item.tag == "triangles":
                _check_counts(count, 0, self.most)
                lengths = np.full(count, 3)
            else:
                if count > 3 * self.most:
                    raise RefusedError(f"has more than {3 * self.most} polygons; make it coarser.")
                stated = item.find("vcount")
                lengths = self._parse_numbers(stated.text if stated is not None else "", int, count, "a <vcount>")
                if (lengths < 0).any():
                    raise ValueError("a <vcount> has a negative number")
                if lengths.max(initial=0) > 3 * self.most:  # so their sum cannot overflow
                    raise RefusedError(f"has more than {self.most} triangles; make it coarser.")
            return lengths, self._parse_numbers(
                " ".join(each or "" for each in lists), int, int(lengths.sum()) * width, f"the faces of a <{item.tag}>"
            )
        numbers, ends = array("q"), [0]
        for each in lists:
            for part in _split_words(each):
                self.budget.charge(8 * len(part), "faces")
                numbers.extend(_parse_words(part, int, f"the faces of a <{item.tag}>"))
            ends.append(len(numbers))
            if (ends[-1] - ends[-2]) % width:
                raise ValueError(f"a face of a <{item.tag}> has not {width} numbers for each corner")
        return np.array([(end - start) // width for start, end in pairwise(ends)], int), np.array(numbers, np.int64)

    def _parse_numbers(self, text: str | None, kind: type[Number], count: int, where: str) -> Array:
        """Parse the ``count`` numbers of a text. Raises ValueError for another count; ``where`` names the element in
        errors.
        """
        self.budget.charge(8 * count, "numbers")
        found, at = np.empty(count, np.int64 if kind is int else np.float64), 0
        for part in _split_words(text):
            if at + len(part) <= count:
                found[at : at + len(part)] = _parse_words(part, kind, where)
            at += len(part)
        if at != count:
            raise ValueError(f"there are {at} numbers in {where}, not {count}")
        return found


#: Count of numbers in each kind of transform that is read.
_TRANSFORMS = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}


def _check_counts(triangles: int, vertices: int, most: int) -> None:
    """Raise RefusedError for more than ``most`` triangles or three times as many vertices."""
    if triangles > most:
        raise RefusedError(f"has more than {most} triangles; make it coarser.")
    if vertices > 3 * most:
        raise RefusedError(f"has more than {3 * most} vertices; make it coarser.")


def _split_words(text: str | None) -> Iterator[list[str]]:
    """Yield the words of a text, one list for each part of the text."""
    at, text = 0, text or ""
    while at < len(text):
        end = text.find(" ", at + _CHARACTERS_AT_ONCE)
        end = len(text) if end < 0 else end
        yield text[at:end].split()
        at = end


def _parse_words(words: list[str], kind: type[Number], where: str) -> list[Number]:
    """Parse numbers of this ``kind`` (int or float) from words. Raises ValueError for a word that is not a number."""
    try:
        return list(map(kind, words))
    except ValueError:
        raise ValueError(f"there is something else than {'whole ' if kind is int else ''}numbers in {where}") from None


def _parse_number(text: str, where: str) -> float:
    """Parse one number. Raises ValueError for any other text."""
    return _parse_words([text], float, where)[0]


def _read_count(item: ElementTree.Element, key: str, default: int | None = None) -> int:
    """Read a count from an element's attribute. Raises ValueError if it is not a whole number."""
    text = item.get(key, "" if default is None else str(default)).strip()
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        raise ValueError(f"the {key} of <{item.tag}> is {shorten(text)!r}")
    return int(text)


def _rotation_about(axis: Array, angle: float) -> Array:
    """Make the rotation (3, 3) by an angle in radians about an axis (3,) of any length above 0. Raises ValueError for
    an axis without a length.
    """
    length = float(np.linalg.norm(axis))
    if angle == 0:
        return np.eye(3)
    if length < 1e-12:
        raise ValueError("a <rotate> has an axis without a length")
    return rotation_about(axis / length, angle)
