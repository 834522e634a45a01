"""The format of a mesh file and the cost of loading it, from its first bytes and its size.

Formats: Stanford PLY, STL (binary and ASCII), Wavefront OBJ, glTF 2.0 (Khronos), USD (Pixar), FBX.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..physics.triangle_files import stl
from ..support.errors import IcyMoonError
from ..support.foreign_bytes import read
from . import ply
from .gltf import find_buffers, read_gltf

FORMATS = {
    ".obj": "OBJ",
    ".ply": "PLY",
    ".stl": "STL",
    ".gltf": "glTF",
    ".glb": "glTF",
    ".usd": "USD",
    ".usda": "USD",
    ".usdc": "USD",
    ".usdz": "USD",
    ".fbx": "FBX",
}
_OPENING_BYTES = 65536
#: An OBJ file has at least one line that begins with one of these words.
_OBJ_WORDS = (b"v", b"#", b"o", b"g", b"mtllib")
#: Measured on a grid of a million triangles that Blender 5.0 wrote: bytes of file per triangle, for formats whose
#: header states no number of triangles.
_FILE_BYTES_PER_TRIANGLE = {".obj": 74.0, ".stl": 250.0, ".fbx": 19.0, ".usda": 160.0}
_OTHER_FILE_BYTES_PER_TRIANGLE = 42.0
#: Seconds per triangle to read, examine and repair a mesh, on a server with 2 cores.
_SECONDS_PER_TRIANGLE = 10e-6
#: Bytes of memory per triangle.
_MEMORY_PER_TRIANGLE = 520.0
#: The same for USD in text: seconds per triangle,
_USDA_SECONDS_PER_TRIANGLE = 16e-6
#: and bytes of memory per triangle.
_USDA_MEMORY_PER_TRIANGLE = 1900.0


@dataclass(frozen=True)
class Cost:
    """Rough time and memory for loading a mesh. ``exact`` is true if the header states the number of triangles."""

    triangles: int
    seconds: float
    memory_mib: float
    exact: bool

    @property
    def is_high(self) -> bool:
        """Whether the cost is high enough to warn the user."""
        return self.seconds > 15.0 or self.memory_mib > 2048.0

    def sentence(self, path: Path) -> str:
        """Describe the cost as a part of a sentence."""
        about = "" if self.exact else "about "
        return (
            f"{path.name} has {about}{self.triangles / 1e6:.2g} million triangles; loading it takes about "
            f"{self.seconds:.0f} s and {self.memory_mib / 1024:.1f} GiB"
        )


def detect_kind(path: Path) -> str:
    """Detect the kind of a mesh file: 'OBJ', 'PLY', 'STL', 'glTF', 'USD' or 'FBX'. It follows from the suffix, and the
    file's first bytes confirm it.

    Raises IcyMoonError if the file is absent, empty, of another kind or does not match its suffix.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise IcyMoonError(f"{path}: is not a mesh that Icy Moon reads; give one of {', '.join(FORMATS)}.")
    start = read_opening(path)
    if not start:
        raise IcyMoonError(f"{path}: is empty; export the mesh again.")
    if not _looks_like(kind, path.suffix.lower(), start):
        raise IcyMoonError(
            f"{path}: is not {add_article(kind)} file, although its name ends so; export the mesh again."
        )
    return kind


def add_article(kind: str) -> str:
    """Return the kind of a mesh file with the article that its pronunciation needs."""
    return f"{'an' if kind in ('STL', 'OBJ', 'FBX') else 'a'} {kind}"


def read_opening(path: Path) -> bytes:
    """Read the first bytes of a file. Raises IcyMoonError if it cannot be read."""
    return read(
        path,
        lambda foreign: foreign.part(0, min(foreign.size, _OPENING_BYTES)),
        "a file",
        "check source.file",
        most=ply.MAX_MESH_BYTES,
    )


def _looks_like(kind: str, suffix: str, start: bytes) -> bool:
    if kind == "PLY":
        return start.startswith((b"ply\n", b"ply\r")) and b"end_header" in start
    if kind == "OBJ":
        return b"\0" not in start and any(
            line.split(None, 1)[0] in _OBJ_WORDS for line in start.splitlines() if line.strip()
        )
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
    """Estimate the cost of loading the mesh. Raises IcyMoonError as ``detect_kind`` does."""
    kind, size = detect_kind(path), path.stat().st_size
    counted, suffix = _read_triangle_count(kind, path), path.suffix.lower()
    triangles = (
        counted
        if counted is not None
        else round(size / _FILE_BYTES_PER_TRIANGLE.get(suffix, _OTHER_FILE_BYTES_PER_TRIANGLE))
    )
    seconds, memory = (
        (_USDA_SECONDS_PER_TRIANGLE, _USDA_MEMORY_PER_TRIANGLE)
        if suffix == ".usda"
        else (_SECONDS_PER_TRIANGLE, _MEMORY_PER_TRIANGLE)
    )
    return Cost(triangles, triangles * seconds, triangles * memory / 2**20, counted is not None)


def _read_triangle_count(kind: str, path: Path) -> int | None:
    """Read the number of triangles from the header; None if the header lacks it."""
    if kind == "PLY":
        return ply.count_triangles(path)
    if kind == "STL":
        return read(path, stl.count_triangles, "an STL file", "export the mesh again", most=ply.MAX_MESH_BYTES)
    if kind == "glTF":
        return read_gltf(
            path,
            lambda document: sum(
                int(document["accessors"][p["indices"]]["count"])
                for mesh in document.get("meshes", ())
                for p in mesh["primitives"]
                if "indices" in p
            )
            // 3,
        )
    return None


def find_geometry_files(path: Path) -> list[Path]:
    """Find the files that contain a mesh file's geometry: the file itself, and the buffers of a .gltf."""
    if path.suffix.lower() != ".gltf":
        return [path]
    return [path, *read_gltf(path, lambda document: find_buffers(path, document))]
