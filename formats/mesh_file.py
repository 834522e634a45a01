"""What a mesh file is and what loading it will cost, from its first bytes and its size.

Formats: Stanford PLY, STL (binary and ASCII), Wavefront OBJ, glTF 2.0 (Khronos), USD (Pixar), FBX.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote

from ..errors import IcyMoonError

FORMATS = {".obj": "OBJ", ".ply": "PLY", ".stl": "STL", ".gltf": "glTF", ".glb": "glTF", ".usd": "USD", ".usda": "USD",
           ".usdc": "USD", ".usdz": "USD", ".fbx": "FBX"}
_OPENING = 65536
Fact = TypeVar("Fact")
#: Measured on a grid of a million triangles that Blender 5.0 wrote: bytes of file per triangle where no header
#: counts them; seconds and bytes of memory per triangle to read, examine and repair it, on a 2-core server.
_FILE_BYTES = {".obj": 74.0, ".stl": 250.0, ".fbx": 19.0, ".usda": 160.0}
_FILE_BYTES_ELSE = 42.0
_SECONDS, _MEMORY_BYTES = 10e-6, 520.0
_SECONDS_USDA, _MEMORY_BYTES_USDA = 16e-6, 1900.0


@dataclass(frozen=True)
class Cost:
    """What loading a mesh will take, roughly; ``exact`` if the header states the number of triangles."""

    triangles: int
    seconds: float
    memory_mib: float
    exact: bool

    @property
    def is_high(self) -> bool:
        """Whether the user should be warned first."""
        return self.seconds > 15.0 or self.memory_mib > 2048.0

    def sentence(self, path: Path) -> str:
        """The cost as a part of a sentence."""
        about = "" if self.exact else "about "
        return (f"{path.name} has {about}{self.triangles / 1e6:.2g} million triangles; loading it takes about "
                f"{self.seconds:.0f} s and {self.memory_mib / 1024:.1f} GiB")


def detect_kind(path: Path) -> str:
    """'OBJ', 'PLY', 'STL', 'glTF', 'USD' or 'FBX': the suffix, confirmed by the file's first bytes.

    Raises IcyMoonError if the file is absent, empty, of another kind or not what its suffix promises.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise IcyMoonError(f"{path}: is not a mesh that Icy Moon reads; give one of {', '.join(FORMATS)}.")
    start = read_opening(path)
    if not start:
        raise IcyMoonError(f"{path}: is empty; export the mesh again.")
    if not _looks_like(kind, path.suffix.lower(), start):
        raise IcyMoonError(f"{path}: is not a {kind} file, although its name ends so; export the mesh again.")
    return kind


def read_opening(path: Path) -> bytes:
    """The first bytes of a file. Raises IcyMoonError if it cannot be read."""
    try:
        with path.open("rb") as stream:
            return stream.read(_OPENING)
    except OSError as error:
        raise IcyMoonError(f"{path}: cannot be read ({error.strerror}); check source.file.") from None


def _looks_like(kind: str, suffix: str, start: bytes) -> bool:
    if kind == "PLY":
        return start.startswith((b"ply\n", b"ply\r")) and b"end_header" in start
    if kind == "OBJ":
        return b"\0" not in start and re.search(rb"^\s*(v|#|o|g|mtllib)\s", start, re.MULTILINE) is not None
    if kind == "STL":
        return len(start) >= 84 or start.lstrip().startswith(b"solid")
    if suffix == ".glb":
        return start.startswith(b"glTF")
    if suffix == ".gltf":
        return start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
    if kind == "USD":
        return start.startswith((b"#usda", b"PXR-USDC", b"PK\x03\x04"))
    return start.startswith(b"Kaydara FBX Binary") or start.lstrip().startswith(b"; FBX")


def estimate_cost(path: Path) -> Cost:
    """What loading the mesh will take. Raises IcyMoonError as ``detect_kind`` does."""
    kind, size = detect_kind(path), path.stat().st_size
    counted, suffix = _read_triangle_count(kind, path), path.suffix.lower()
    triangles = counted if counted is not None else round(size / _FILE_BYTES.get(suffix, _FILE_BYTES_ELSE))
    seconds, memory = (_SECONDS_USDA, _MEMORY_BYTES_USDA) if suffix == ".usda" else (_SECONDS, _MEMORY_BYTES)
    return Cost(triangles, triangles * seconds, triangles * memory / 2**20, counted is not None)


def _read_triangle_count(kind: str, path: Path) -> int | None:
    """The number of triangles that the header states, if it does."""
    start = read_opening(path)
    if kind == "PLY":
        stated = re.search(rb"^element face (\d+)", start, re.MULTILINE)
        return int(stated[1]) if stated else None
    if kind == "STL" and len(start) >= 84:
        n = int(struct.unpack_from("<I", start, 80)[0])
        return n if path.stat().st_size == 84 + 50 * n else None
    if kind == "glTF":
        return read_gltf(path, lambda document: sum(
            int(document["accessors"][p["indices"]]["count"]) for mesh in document.get("meshes", ())
            for p in mesh["primitives"] if "indices" in p) // 3)
    return None


def read_gltf(path: Path, facts: Callable[[dict[str, Any]], Fact]) -> Fact:
    """Facts from the JSON of a .gltf or .glb. Raises IcyMoonError if it is not what glTF demands."""
    try:
        with path.open("rb") as stream:
            if path.suffix.lower() == ".glb":
                length = struct.unpack("<12xI4x", stream.read(20))[0]
                return facts(json.loads(stream.read(length)))
            return facts(json.load(stream))
    except (OSError, ValueError, struct.error, TypeError, LookupError, AttributeError,
            RecursionError) as error:
        raise IcyMoonError(f"{path}: is not a whole glTF file ({type(error).__name__}: {error}); "
                           "export the mesh again.") from None


def find_geometry_files(path: Path) -> list[Path]:
    """The files that a mesh file's geometry lies in: itself, and the buffers of a .gltf."""
    if path.suffix.lower() != ".gltf":
        return [path]
    uris = read_gltf(path, lambda document: [unquote(b.get("uri", "")) for b in document.get("buffers", ())])
    return [path, *(path.parent / uri for uri in uris if uri and not uri.startswith("data:"))]
