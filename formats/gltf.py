"""glTF 2.0 (Khronos), .gltf and .glb: the JSON of a file, and whether its accessors have the bytes that they state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar
from urllib.parse import unquote

from ..support.file_schemas import COUNT
from ..support.files import quote, shorten
from ..support.foreign_bytes import ForeignBytes, OverBudgetError, parse_json, read
from .ply import MOST_MESH

Fact = TypeVar("Fact")
_FIX = "export the mesh again"
#: Bytes of memory for the values of the JSON, and for each of them; largest JSON in bytes, with buffers in it.
_MOST_MEMORY, _OF_A_VALUE, _MOST_JSON = 2**29, 120, 2**28
#: Maximum number of nodes (Blender makes an object of each), and maximum depth of nodes within nodes.
_MOST_NODES, _DEEPEST = 50_000, 500
#: How often each byte of the buffers may be used, and bytes that may be used beside them.
_MOST_USES, _MOST_BESIDE = 64, 2**28
#: Bytes of a number by the type of component; numbers by the type of accessor.
_COMPONENTS = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
#: Begin of a .glb, and its bytes before the JSON.
_MARK, _HEADER = b"glTF", 20


def read_gltf(path: Path, facts: Callable[[dict[str, Any]], Fact]) -> Fact:
    """Facts from the JSON of a .gltf or .glb. Raises IcyMoonError if it is not what glTF demands."""
    return read(
        path, lambda foreign: facts(_parse_gltf(foreign)[0]), "a whole glTF file", _FIX, MOST_MESH, _MOST_MEMORY
    )


def check_gltf(path: Path) -> list[str]:
    """Compare a file with itself and its buffers; gives the names of the images that it names.

    Raises IcyMoonError for accessors that have not the bytes that they state, for buffers outside of the file's
    folder, and for more nodes than a mesh needs.
    """

    def compare(foreign: ForeignBytes) -> list[str]:
        document, binary = _parse_gltf(foreign)
        buffers = [_find_buffer_size(path, each, binary) for each in document.get("buffers", ())]
        views = [_find_view_size(each, buffers) for each in document.get("bufferViews", ())]
        accessors = [_find_accessor_size(each, views, document) for each in document.get("accessors", ())]
        used = sum(accessors[k] for k in _list_used_accessors(document))
        if used > _MOST_USES * sum(buffers) + _MOST_BESIDE:
            raise OverBudgetError(f"uses {used / 1e6:.0f} MB for its meshes, of buffers of {sum(buffers) / 1e6:.3g} MB")
        _check_nodes(document.get("nodes", []))
        _check_scenes(document)
        return [
            unquote(each["uri"])
            for each in document.get("images", ())
            if "uri" in each and not each["uri"].startswith("data:")
        ]

    return read(path, compare, "a whole glTF file", _FIX, MOST_MESH, _MOST_MEMORY)


def _parse_gltf(foreign: ForeignBytes) -> tuple[dict[str, Any], int]:
    """The JSON, and the bytes of the binary chunk of a .glb, 0 without one."""
    start, size, binary = 0, foreign.size, 0
    if foreign.size >= _HEADER and foreign.part(0, 4) == _MARK:
        start, size = _HEADER, int.from_bytes(foreign.part(12, 4), "little")
        if start + size > foreign.size:
            raise ValueError(f"it ends {start + size - foreign.size} bytes early")
        if start + size + 8 <= foreign.size:
            binary = int.from_bytes(foreign.part(start + size, 4), "little")
            if start + size + 8 + binary > foreign.size:
                raise ValueError(f"it ends {start + size + 8 + binary - foreign.size} bytes early")
    if size > _MOST_JSON:
        raise OverBudgetError(f"has {size / 1e6:.0f} MB of JSON, and {_MOST_JSON / 1e6:.0f} MB are read")
    text = foreign.part(start, size)
    foreign.budget.charge(_OF_A_VALUE * sum(text.count(mark) for mark in (b",", b"[", b"{", b":")), "JSON")
    document = parse_json(text.removeprefix(b"\xef\xbb\xbf"))
    if not isinstance(document, dict):
        raise ValueError("its JSON is no table")
    return document, binary


def find_buffers(path: Path, document: dict[str, Any]) -> list[Path]:
    """The files of the buffers that a .gltf names. Raises ValueError for one outside of its folder."""
    names = [each["uri"] for each in document.get("buffers", ()) if "uri" in each]
    return [_find_inside(path, name) for name in names if name and not name.startswith("data:")]


def _find_inside(path: Path, uri: str) -> Path:
    name = PurePosixPath(unquote(uri))
    if name.is_absolute() or ".." in name.parts or ":" in uri or "\\" in str(name) or "\0" in str(name):
        raise ValueError(f"its buffer {shorten(uri)!r} is not in its folder")
    if not (path.parent / name).resolve().is_relative_to(path.parent.resolve()):
        raise ValueError(f"its buffer {shorten(uri)!r} is a link that leads out of its folder")
    return path.parent / name


def _read_count(table: dict[str, Any], key: str, default: int | None = None) -> int:
    """A whole number of 0 or more. Raises ValueError for anything else, KeyError if it has to be there."""
    value = table[key] if default is None else table.get(key, default)
    if not COUNT.fits(value):
        raise ValueError(f"{key} is {shorten(repr(value))}, not {COUNT.name}")
    return int(value)


def _find_buffer_size(path: Path, stated: dict[str, Any], binary: int) -> int:
    size, uri = _read_count(stated, "byteLength"), stated.get("uri")
    if uri is None:
        there = binary
    elif uri.startswith("data:"):
        there = 3 * len(uri) // 4
    else:
        file = _find_inside(path, uri)
        if not file.is_file():
            raise ValueError(f"its buffer {shorten(uri)!r} is not there")
        there = file.stat().st_size
    if size > there:
        raise ValueError(f"a buffer states {size} bytes and has {there}")
    return size


def _find_view_size(stated: dict[str, Any], buffers: list[int]) -> int:
    size = _read_count(stated, "byteLength")
    if _read_count(stated, "byteOffset", 0) + size > buffers[_read_count(stated, "buffer")]:
        raise ValueError(f"a view of {size} bytes is not within its buffer")
    return size


def _find_accessor_size(stated: dict[str, Any], views: list[int], document: dict[str, Any]) -> int:
    """The bytes of an accessor's values."""
    count = _read_count(stated, "count")
    size = _COMPONENTS[stated["componentType"]] * _WIDTHS[stated["type"]]
    if "bufferView" in stated:
        place = _read_count(stated, "bufferView")
        step = _read_count(document["bufferViews"][place], "byteStride", 0) or size
        if count and _read_count(stated, "byteOffset", 0) + (count - 1) * step + size > views[place]:
            raise ValueError(f"an accessor of {count} values is not within its view")
    if (sparse := stated.get("sparse")) is not None:
        changed = _read_count(sparse, "count")
        for part, width in (("indices", _COMPONENTS[sparse["indices"]["componentType"]]), ("values", size)):
            within = views[_read_count(sparse[part], "bufferView")]
            if changed > count or _read_count(sparse[part], "byteOffset", 0) + changed * width > within:
                raise ValueError(f"an accessor that changes {changed} of {count} values is not within its view")
    return count * size


def _list_used_accessors(document: dict[str, Any]) -> Iterator[int]:
    """The numbers of the accessors of all primitives, skins and animations, as often as they are used."""
    for mesh in document.get("meshes", ()):
        for primitive in mesh["primitives"]:
            named = [primitive["attributes"], *primitive.get("targets", ())]
            yield from (_read_count(table, key) for table in named for key in table)
            if "indices" in primitive:
                yield _read_count(primitive, "indices")
    yield from (
        _read_count(skin, "inverseBindMatrices") for skin in document.get("skins", ()) if "inverseBindMatrices" in skin
    )
    yield from (
        _read_count(sampler, key)
        for animation in document.get("animations", ())
        for sampler in animation["samplers"]
        for key in ("input", "output")
    )


def _check_scenes(document: dict[str, Any]) -> None:
    """Scenes must be of nodes that are there, and the one to show must be one of them."""
    scenes, nodes = document.get("scenes", []), document.get("nodes", [])
    if scenes and _read_count(document, "scene", 0) >= len(scenes):
        raise ValueError(f"its scene {document['scene']} is not there")
    for scene in scenes:
        for node in scene.get("nodes", ()):
            if not COUNT.fits(node) or node >= len(nodes):
                raise ValueError(f"the node {quote(node)} of a scene is not there")


def _check_nodes(nodes: list[dict[str, Any]]) -> None:
    """Nodes must be trees that are not too deep."""
    if len(nodes) > _MOST_NODES:
        raise OverBudgetError(f"has {len(nodes)} nodes, more than {_MOST_NODES}")
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", ()):
            if child in parents or not 0 <= child < len(nodes):
                raise ValueError(f"the node {child} is not there, or within two others")
            parents[child] = number
    depths: dict[int, int] = {}
    for number in parents:
        climbed = []
        while number in parents and number not in depths:
            climbed.append(number)
            number = parents[number]
            if len(climbed) > _DEEPEST:
                raise ValueError(f"nodes are within each other more than {_DEEPEST} deep, or in a ring")
        depth = depths.get(number, 0)
        for each in reversed(climbed):
            depth += 1
            depths[each] = depth
        if depth > _DEEPEST:
            raise ValueError(f"nodes are within each other more than {_DEEPEST} deep")
