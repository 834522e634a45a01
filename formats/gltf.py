"""glTF 2.0 (Khronos), .gltf and .glb: the JSON of a file, and a check that its accessors have the bytes that they
state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar
from urllib.parse import unquote

from ..support.file_schemas import COUNT
from ..support.files import quote, shorten
from ..support.foreign_bytes import ForeignBytes, OverBudgetError, parse_json, read
from .ply import MAX_MESH_BYTES

Fact = TypeVar("Fact")
_FIX = "export the mesh again"
#: Bytes of memory for all values of the JSON.
_MAX_MEMORY = 2**29
#: Bytes of memory for each of these values.
_MEMORY_PER_VALUE = 120
#: Largest JSON in bytes, including buffers in it.
_MAX_JSON_BYTES = 2**28
#: Maximum number of nodes; Blender makes an object of each.
_MAX_NODES = 50_000
#: Maximum depth of nodes within nodes.
_DEEPEST_NODE = 500
#: Maximum number of uses of each byte of the buffers.
_MAX_USES_OF_BYTE = 64
#: Further bytes that may be used, whatever the size of the buffers.
_MAX_FREE_BYTES = 2**28
#: Bytes of a number by the type of component.
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
#: Numbers per element by the type of accessor.
_NUMBERS_PER_ELEMENT = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
#: First bytes of a .glb.
_GLB_MARK = b"glTF"
#: Bytes of a .glb before its JSON.
_GLB_HEADER_BYTES = 20


def read_gltf(path: Path, facts: Callable[[dict[str, Any]], Fact]) -> Fact:
    """Read facts from the JSON of a .gltf or .glb. Raises IcyMoonError if it violates the glTF standard."""
    return read(
        path, lambda foreign: facts(_parse_gltf(foreign)[0]), "a whole glTF file", _FIX, MAX_MESH_BYTES, _MAX_MEMORY
    )


def check_gltf(path: Path) -> list[str]:
    """Compare the statements of a file with its content and its buffers. Returns the names of its images. Raises
    IcyMoonError for accessors with fewer bytes than stated, for buffers outside the file's folder, and for too many
    nodes."""

    def compare(foreign: ForeignBytes) -> list[str]:
        document, binary = _parse_gltf(foreign)
        buffers = [_find_buffer_size(path, each, binary) for each in document.get("buffers", ())]
        views = [_find_view_size(each, buffers) for each in document.get("bufferViews", ())]
        accessors = [_find_accessor_size(each, views, document) for each in document.get("accessors", ())]
        used = sum(accessors[k] for k in _list_used_accessors(document))
        if used > _MAX_USES_OF_BYTE * sum(buffers) + _MAX_FREE_BYTES:
            raise OverBudgetError(f"uses {used / 1e6:.0f} MB for its meshes, of buffers of {sum(buffers) / 1e6:.3g} MB")
        _check_nodes(document.get("nodes", []))
        _check_scenes(document)
        return [
            unquote(each["uri"])
            for each in document.get("images", ())
            if "uri" in each and not each["uri"].startswith("data:")
        ]

    return read(path, compare, "a whole glTF file", _FIX, MAX_MESH_BYTES, _MAX_MEMORY)


def _parse_gltf(foreign: ForeignBytes) -> tuple[dict[str, Any], int]:
    """Parse the JSON; also return the number of bytes in the binary chunk of a .glb, 0 without one."""
    start, size, binary = 0, foreign.size, 0
    if foreign.size >= _GLB_HEADER_BYTES and foreign.part(0, 4) == _GLB_MARK:
        start, size = _GLB_HEADER_BYTES, int.from_bytes(foreign.part(12, 4), "little")
        if start + size > foreign.size:
            raise ValueError(f"it ends {start + size - foreign.size} bytes early")
        if start + size + 8 <= foreign.size:
            binary = int.from_bytes(foreign.part(start + size, 4), "little")
            if start + size + 8 + binary > foreign.size:
                raise ValueError(f"it ends {start + size + 8 + binary - foreign.size} bytes early")
    if size > _MAX_JSON_BYTES:
        raise OverBudgetError(f"has {size / 1e6:.0f} MB of JSON, and {_MAX_JSON_BYTES / 1e6:.0f} MB are read")
    text = foreign.part(start, size)
    foreign.budget.charge(_MEMORY_PER_VALUE * sum(text.count(mark) for mark in (b",", b"[", b"{", b":")), "JSON")
    document = parse_json(text.removeprefix(b"\xef\xbb\xbf"))
    if not isinstance(document, dict):
        raise ValueError("its JSON is not a table")
    return document, binary


def find_buffers(path: Path, document: dict[str, Any]) -> list[Path]:
    """Find the files of the buffers that a .gltf names. Raises ValueError for one outside its folder."""
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
    """Read a whole number of 0 or more. Raises ValueError for any other value, KeyError if it is missing and has no
    default."""
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
            raise ValueError(f"its buffer {shorten(uri)!r} does not exist")
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
    """Compute how many bytes the values of an accessor take."""
    count = _read_count(stated, "count")
    size = _COMPONENT_BYTES[stated["componentType"]] * _NUMBERS_PER_ELEMENT[stated["type"]]
    if "bufferView" in stated:
        place = _read_count(stated, "bufferView")
        step = _read_count(document["bufferViews"][place], "byteStride", 0) or size
        if count and _read_count(stated, "byteOffset", 0) + (count - 1) * step + size > views[place]:
            raise ValueError(f"an accessor of {count} values is not within its view")
    if (sparse := stated.get("sparse")) is not None:
        changed = _read_count(sparse, "count")
        for part, width in (("indices", _COMPONENT_BYTES[sparse["indices"]["componentType"]]), ("values", size)):
            within = views[_read_count(sparse[part], "bufferView")]
            if changed > count or _read_count(sparse[part], "byteOffset", 0) + changed * width > within:
                raise ValueError(f"an accessor that changes {changed} of {count} values is not within its view")
    return count * size


def _list_used_accessors(document: dict[str, Any]) -> Iterator[int]:
    """List the indices of the accessors of all primitives, skins and animations, one for each use."""
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
    """Check that scenes have existing nodes, and that the default scene exists."""
    scenes, nodes = document.get("scenes", []), document.get("nodes", [])
    if scenes and _read_count(document, "scene", 0) >= len(scenes):
        raise ValueError(f"its scene {document['scene']} does not exist")
    for scene in scenes:
        for node in scene.get("nodes", ()):
            if not COUNT.fits(node) or node >= len(nodes):
                raise ValueError(f"the node {quote(node)} of a scene does not exist")


def _check_nodes(nodes: list[dict[str, Any]]) -> None:
    """Check that nodes form trees, and that these are not too deep."""
    if len(nodes) > _MAX_NODES:
        raise OverBudgetError(f"has {len(nodes)} nodes, more than {_MAX_NODES}")
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", ()):
            if child in parents or not 0 <= child < len(nodes):
                raise ValueError(f"the node {child} does not exist, or has two parents")
            parents[child] = number
    depths: dict[int, int] = {}
    for number in parents:
        climbed = []
        while number in parents and number not in depths:
            climbed.append(number)
            number = parents[number]
            if len(climbed) > _DEEPEST_NODE:
                raise ValueError(f"nodes are nested more than {_DEEPEST_NODE} deep, or in a cycle")
        depth = depths.get(number, 0)
        for each in reversed(climbed):
            depth += 1
            depths[each] = depth
        if depth > _DEEPEST_NODE:
            raise ValueError(f"nodes are nested more than {_DEEPEST_NODE} deep")
