"""The images of a mesh file for its surface: their purposes and their files.

OBJ names them in its material library, glTF in its materials, PLY in a comment of its header (``TextureFile``, as
VCGlib writes it). Formats: Wavefront MTL with the extension of Clara.io for physical materials, Khronos glTF 2.0.
"""

from __future__ import annotations

import base64
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from ..support.errors import IcyMoonError
from ..support.foreign_bytes import ForeignBytes, read
from . import ply
from .gltf import read_gltf
from .mesh_file import read_opening

#: Largest material library in bytes.
_MAX_LIBRARY_BYTES = 2**22
#: Suffixes of the meshes whose images are found.
MESH_SUFFIXES = (".obj", ".gltf", ".glb", ".ply")
#: Statements of a material library, by the kind of image. ``map_Bump`` is not among them: it is a height in some
#: files and a normal map in others.
_MTL_STATEMENTS = {"map_kd": "albedo", "map_pr": "roughness", "norm": "normal"}
#: Numbers that follow an option of such a statement; -o, -s and -t have one to three.
_OPTION_NUMBERS = {
    "-blendu": 1,
    "-blendv": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-texres": 1,
    "-bm": 1,
    "-boost": 1,
    "-type": 1,
    "-mm": 2,
}
#: Images of a glTF material: their kind, the path in the material, the channel in use, and the path of the factor on
#: it.
_GLTF_IMAGES = (
    ("albedo", ("pbrMetallicRoughness", "baseColorTexture"), 0, None),
    ("roughness", ("pbrMetallicRoughness", "metallicRoughnessTexture"), 1, "roughnessFactor"),
    ("normal", ("normalTexture",), 0, None),
)


@dataclass(frozen=True)
class MeshImage:
    """An image in ``file``: the whole file, or the bytes that ``data`` returns. ``channel`` is the channel in use if
    there is only one. ``not_followed`` is an unsupported request of the mesh. Equal objects are one image."""

    file: Path
    place: str = ""
    channel: int = 0
    not_followed: str = ""
    data: Callable[[], bytes] | None = field(default=None, compare=False)


@dataclass(frozen=True)
class MeshImages:
    """The different images of a mesh by their kind (albedo, roughness, normal), and the further files that name them
    (``named_in``)."""

    by_kind: dict[str, list[MeshImage]]
    named_in: tuple[Path, ...] = ()

    def files(self) -> list[Path]:
        """Every file that the images depend on, besides the mesh's own; a file may be missing."""
        found = [image.file for images in self.by_kind.values() for image in images]
        return list(dict.fromkeys([*self.named_in, *found]))


def find_images(path: Path) -> MeshImages:
    """Find the images that a mesh file names or contains. Raises IcyMoonError if it cannot be read."""
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return _find_in_obj(path)
    if suffix == ".ply":
        return _sort_by_kind(
            ("albedo", MeshImage(_find_beside(path, _decode_text(name)))) for name in ply.read_texture_files(path)
        )
    if suffix in (".gltf", ".glb"):
        return _sort_by_kind(read_gltf(path, lambda document: list(_find_in_gltf(path, document))))
    return MeshImages({})


def choose_images(path: Path) -> dict[str, MeshImage]:
    """Choose the one image of each kind from a mesh file. Raises IcyMoonError for several images of a kind, or an
    unsupported use of one."""
    found = {}
    for kind, several in find_images(path).by_kind.items():
        fix = "bake one plain image for the whole mesh, or name images with textures.set = OWN."
        if len(several) > 1:
            raise IcyMoonError(f"{path}: has {len(several)} {kind} images, and a ground has one; {fix}")
        if several[0].not_followed:
            raise IcyMoonError(f"{path}: its {kind} image {several[0].not_followed}, which is not followed; {fix}")
        found[kind] = several[0]
    return found


def _sort_by_kind(
    found: Iterator[tuple[str, MeshImage]] | list[tuple[str, MeshImage]], named_in: tuple[Path, ...] = ()
) -> MeshImages:
    by_kind: dict[str, list[MeshImage]] = {}
    for kind, image in found:
        if image not in by_kind.setdefault(kind, []):
            by_kind[kind].append(image)
    return MeshImages(by_kind, named_in)


def _decode_text(raw: bytes) -> str:
    return raw.decode("utf-8", "replace").strip().strip('"')


def _find_beside(path: Path, name: str) -> Path:
    """Find the file ``name`` that ``path`` refers to: at this relative path, else in the folder of ``path``."""
    stated = path.parent / name.replace("\\", "/")
    moved = path.parent / stated.name
    return moved if moved.is_file() and not stated.is_file() else stated


def _find_in_obj(path: Path) -> MeshImages:
    statements = (line.split(None, 1) for line in read_opening(path).splitlines())
    named = [words[1] for words in statements if len(words) == 2 and words[0] == b"mtllib"]
    libraries = tuple(_find_beside(path, _decode_text(name)) for name in named) or (path.with_suffix(".mtl"),)
    there = tuple(library for library in libraries if named or library.is_file())
    return _sort_by_kind([image for library in there if library.is_file() for image in _read_library(library)], there)


def _read_library(path: Path) -> list[tuple[str, MeshImage]]:
    return read(
        path,
        lambda foreign: list(_parse_library(path, foreign)),
        "a material library",
        "check source.file",
        most=_MAX_LIBRARY_BYTES,
    )


def _parse_library(path: Path, foreign: ForeignBytes) -> Iterator[tuple[str, MeshImage]]:
    for _, line in foreign.lines():
        statement, _, rest = _decode_text(line).partition(" ")
        if statement.lower() not in _MTL_STATEMENTS:
            continue
        words, moved = rest.split(), ""
        while words and words[0].startswith("-"):
            option = words.pop(0)
            if option in ("-o", "-s", "-t"):
                given = [words.pop(0) for _ in range(3) if len(words) > 1 and re.fullmatch(r"[-+.\deE]+", words[0])]
                if any(float(number) != (option == "-s") for number in given):
                    moved = f"is shifted or scaled by {option} {' '.join(given)}"
            else:
                del words[: min(_OPTION_NUMBERS.get(option, 0), len(words) - 1)]
        if words:
            # The name may contain runs of spaces, which split() would shorten.
            yield (
                _MTL_STATEMENTS[statement.lower()],
                MeshImage(_find_beside(path, rest[rest.index(words[0]) :]), not_followed=moved),
            )


def _find_in_gltf(path: Path, document: dict[str, Any]) -> Iterator[tuple[str, MeshImage]]:
    materials = document.get("materials", [])
    used = {
        part["material"] for mesh in document.get("meshes", ()) for part in mesh["primitives"] if "material" in part
    }
    for index in sorted(used):
        material = materials[index]
        for kind, where, channel, factor in _GLTF_IMAGES:
            holder: dict[str, Any] = material
            for step in where[:-1]:
                holder = holder.get(step, {})
            stated = holder.get(where[-1])
            if stated is None:
                continue
            texture = document["textures"][stated["index"]]
            webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
            source = webp.get("source", texture.get("source"))
            odd = _unsupported_use(stated, holder.get(factor, 1.0) if factor else stated.get("scale", 1.0))
            if source is None:
                yield kind, MeshImage(path, f"texture {stated['index']}", not_followed="is of no usual kind")
            else:
                yield kind, _locate_gltf_image(path, document, source, channel, odd)


def _unsupported_use(stated: dict[str, Any], factor: float) -> str:
    """Describe, as a clause, an unsupported request of a glTF material for its image; empty without such a request."""
    transform = stated.get("extensions", {}).get("KHR_texture_transform", {})
    if stated.get("texCoord", 0) != 0 or transform.get("texCoord", 0) != 0:
        return "has separate UV coordinates"
    if any(
        value != plain
        for key, plain in (("offset", [0, 0]), ("scale", [1, 1]), ("rotation", 0))
        if (value := transform.get(key, plain))
    ):
        return "is shifted, scaled or turned (KHR_texture_transform)"
    return "" if factor == 1.0 else f"is scaled by {factor:g}"


def _locate_gltf_image(path: Path, document: dict[str, Any], number: int, channel: int, odd: str) -> MeshImage:
    stated, place = document["images"][number], f"image {number}"
    if "bufferView" not in stated:
        uri = stated["uri"]
        if uri.startswith("data:"):
            return MeshImage(path, place, channel, odd, lambda: _decode_uri(path, uri))
        return MeshImage(_find_beside(path, unquote(uri)), "", channel, odd)
    view = document["bufferViews"][stated["bufferView"]]
    begin, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
    uri = document["buffers"][view["buffer"]].get("uri")
    if uri is None:
        return MeshImage(path, place, channel, odd, lambda: _read_bytes(path, _find_binary_start(path) + begin, length))
    if uri.startswith("data:"):
        return MeshImage(path, place, channel, odd, lambda: _decode_uri(path, uri)[begin : begin + length])
    file = path.parent / unquote(uri)
    return MeshImage(file, place, channel, odd, lambda: _read_bytes(file, begin, length))


def _find_binary_start(path: Path) -> int:
    """Find the offset in bytes of the binary chunk's data in a .glb, after the JSON and the headers of both chunks."""
    return 28 + int(struct.unpack_from("<I", read_opening(path), 12)[0])


def _read_bytes(path: Path, begin: int, length: int) -> bytes:
    return read(
        path,
        lambda foreign: foreign.part(begin, length),
        "a mesh with its images in it",
        "export the mesh again",
        most=ply.MAX_MESH_BYTES,
    )


def _decode_uri(path: Path, uri: str) -> bytes:
    try:
        return base64.b64decode(unquote(uri.partition(",")[2]))
    except ValueError as error:
        raise IcyMoonError(f"{path}: an image inside it is damaged ({error}); export the mesh again.") from None
