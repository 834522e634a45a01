"""Meshes with many instances, and their export: PLY, OBJ, USD and glTF.

USD and glTF contain each mesh once, with a matrix for each place. PLY and OBJ have no instances, so each place gets its
own triangles there; places are written one after another, so that memory holds one at a time. Numbers in text have nine
digits, the full precision of single floats.

USD (https://openusd.org/release/glossary.html#usdglossary-instancing): the shapes are below a class, which is not
drawn, and each place is an instanceable prim that references one. A point instancer would be shorter, but its rotations
are quaternions of half precision, wrong by 5e-4. glTF 2.0 (https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html):
nodes that share a mesh, in one binary file, below a node that turns z up to the y up of the format.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import write_atomically
from .ply import FACE_TYPE, make_header

#: Number of rows of text that are made at a time.
_ROWS_AT_ONCE = 100_000
#: Bytes of a binary glTF file at most, since its length is a number of 32 bits.
_MAX_GLTF_BYTES = 2**32 - 1
#: Matrix from the axes of a site, z up, to the axes of glTF, y up; columns first, as in glTF.
_Z_UP_TO_Y_UP = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
#: glTF's number of 32-bit floats,
_GLTF_FLOAT = 5126
#: of 32-bit unsigned integers,
_GLTF_UNSIGNED = 5125
#: of data of vertices,
_GLTF_VERTICES = 34962
#: and of data of indices.
_GLTF_INDICES = 34963


@dataclass(frozen=True)
class PlacedMesh:
    """A mesh of one ``kind``, such as rock, and the matrices of its instances.

    ``vertices`` and ``normals`` (n, 3) and ``triangles`` (m, 3) are in the mesh's own coordinates, and ``places``
    (k, 4, 4) are the matrices from these to the site's frame, in metres.
    """

    kind: str
    vertices: Array
    normals: Array
    triangles: Array
    places: Array

    def transform_to_instances(self) -> Iterator[tuple[Array, Array, Array]]:
        """Yield the vertices (n, 3), m, normals (n, 3) and triangles (m, 3) of each instance in the site's frame."""
        for matrix in self.places:
            turned = self.normals @ np.linalg.inv(matrix[:3, :3])  # rows times the inverse: normals by its transpose
            turned = turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)
            mirrored = np.linalg.det(matrix[:3, :3]) < 0
            yield (
                self.vertices @ matrix[:3, :3].T + matrix[:3, 3],
                turned,
                self.triangles[:, ::-1] if mirrored else self.triangles,
            )


def group_by_kind(meshes: Iterable[PlacedMesh]) -> dict[str, list[PlacedMesh]]:
    """Group meshes by their kind, in their order."""
    kinds: dict[str, list[PlacedMesh]] = {}
    for mesh in meshes:
        kinds.setdefault(mesh.kind, []).append(mesh)
    return kinds


def write_ply(path: Path, meshes: Sequence[PlacedMesh], comment: str) -> None:
    """Write all instances of meshes as one mesh, a binary PLY file in single precision with normals."""
    vertices, triangles = (
        sum(len(mesh.places) * count for mesh, count in zip(meshes, counts, strict=True))
        for counts in ([len(mesh.vertices) for mesh in meshes], [len(mesh.triangles) for mesh in meshes])
    )

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            stream.write(make_header(("x", "y", "z", "nx", "ny", "nz"), vertices, triangles, (comment,)))
            for mesh in meshes:
                for positions, normals, _ in mesh.transform_to_instances():
                    stream.write(np.hstack([positions, normals]).astype("<f4").tobytes())
            first = 0
            for mesh in meshes:
                for positions, _, corners in mesh.transform_to_instances():
                    faces = np.empty(len(corners), FACE_TYPE)
                    faces["count"], faces["corners"] = 3, corners + first
                    stream.write(faces.tobytes())
                    first += len(positions)

    write_atomically(path, write)


def write_obj(path: Path, meshes: Sequence[PlacedMesh], comment: str) -> None:
    """Write all instances of meshes as an OBJ file with normals and an object for each kind."""

    def write(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="\n") as stream:
            stream.write(f"# {comment}\n")
            first = 1
            for kind, own in group_by_kind(meshes).items():
                stream.write(f"o {kind}\n")
                for positions, normals, corners in itertools.chain.from_iterable(
                    mesh.transform_to_instances() for mesh in own
                ):
                    _write_rows(stream, "v %.9g %.9g %.9g\n", positions.astype(np.float32))
                    _write_rows(stream, "vn %.9g %.9g %.9g\n", normals.astype(np.float32))
                    _write_rows(stream, "f %d//%d %d//%d %d//%d\n", np.repeat(corners + first, 2, axis=1))
                    first += len(positions)

    write_atomically(path, write)


def _write_rows(stream: IO[str], row: str, values: Array) -> None:
    """Write one text for each row of numbers (n, k)."""
    for start in range(0, len(values), _ROWS_AT_ONCE):
        some = values[start : start + _ROWS_AT_ONCE]
        stream.write((row * len(some)) % tuple(some.ravel().tolist()))


def write_usd(path: Path, meshes: Sequence[PlacedMesh], comment: str) -> None:
    """Write meshes as a USD file in text, z up, in metres, with an instance for each place of a repeated mesh."""

    def write(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="\n") as stream:
            stream.write(
                f'#usda 1.0\n(\n    defaultPrim = "ground"\n    doc = {json.dumps(comment)}\n'
                '    metersPerUnit = 1\n    upAxis = "Z"\n)\n\n'
            )
            stream.write('class "shapes"\n{\n')
            names = _make_names(meshes)
            for name, mesh in zip(names, meshes, strict=True):
                if len(mesh.places) > 1:
                    stream.write(f'    def Xform "{name}"\n    {{\n')
                    _write_usd_mesh(stream, "mesh", mesh)
                    stream.write("    }\n")
            stream.write('}\n\ndef Xform "ground"\n{\n')
            at = dict(zip(map(id, meshes), names, strict=True))
            for kind, own in group_by_kind(meshes).items():
                stream.write(f'    def Xform "{_make_identifier(kind)}"\n    {{\n')
                for mesh in own:
                    name = at[id(mesh)]
                    if len(mesh.places) == 1:
                        _write_usd_mesh(stream, name, mesh, mesh.places[0])
                        continue
                    for number, matrix in enumerate(mesh.places):
                        stream.write(
                            f'        def "{name}_{number}" (\n            instanceable = true\n'
                            f"            prepend references = </shapes/{name}>\n        )\n        {{\n"
                            f"{_format_usd_matrix(matrix)}        }}\n"
                        )
                stream.write("    }\n")
            stream.write("}\n")

    write_atomically(path, write)


def _make_names(meshes: Sequence[PlacedMesh]) -> list[str]:
    """Make unique names of meshes from their kinds and numbers."""
    return [f"{_make_identifier(mesh.kind)}_{number}" for number, mesh in enumerate(meshes)]


def _make_identifier(text: str) -> str:
    return re.sub("[^A-Za-z0-9_]", "_", text)


def _format_usd_matrix(matrix: Array) -> str:
    """Write the transform of a prim. USD multiplies rows by matrices, so the transform is transposed."""
    rows = ", ".join("(" + ", ".join(f"{value:.17g}" for value in row) + ")" for row in matrix.T.tolist())
    return (
        f"            matrix4d xformOp:transform = ( {rows} )\n"
        '            uniform token[] xformOpOrder = ["xformOp:transform"]\n'
    )


def _write_usd_mesh(stream: IO[str], name: str, mesh: PlacedMesh, matrix: Array | None = None) -> None:
    low, high = (
        ", ".join(f"{value:.9g}" for value in ends.tolist())
        for ends in (mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))
    )
    stream.write(f'        def Mesh "{name}"\n        {{\n            float3[] extent = [({low}), ({high})]\n')
    for text, row, values in (
        ("int[] faceVertexCounts", "%d, ", np.full((len(mesh.triangles), 1), 3)),
        ("int[] faceVertexIndices", "%d, %d, %d, ", mesh.triangles),
        ("point3f[] points", "(%.9g, %.9g, %.9g), ", mesh.vertices.astype(np.float32)),
        ("normal3f[] normals", "(%.9g, %.9g, %.9g), ", mesh.normals.astype(np.float32)),
    ):
        stream.write(f"            {text} = [")
        # Lists of USD may not end in a comma.
        _write_rows(stream, row, values[:-1])
        stream.write(row.rstrip(", ") % tuple(values[-1].tolist()))
        stream.write(
            "]" + (' (\n                interpolation = "vertex"\n            )' if "normals" in text else "") + "\n"
        )
    stream.write('            uniform token subdivisionScheme = "none"\n')
    stream.write(_format_usd_matrix(matrix) if matrix is not None else "")
    stream.write("        }\n")


def write_gltf(path: Path, meshes: Sequence[PlacedMesh], comment: str) -> None:
    """Write meshes as a binary glTF file, in metres, with a node for each instance.

    Raises IcyMoonError for more than 4 GB, which the format does not allow.
    """
    arrays = [
        array
        for mesh in meshes
        for array in (
            np.ascontiguousarray(mesh.vertices, "<f4"),
            np.ascontiguousarray(mesh.normals, "<f4"),
            np.ascontiguousarray(mesh.triangles, "<u4"),
        )
    ]
    text = json.dumps(_make_gltf_json(meshes, arrays, comment), separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    size = sum(array.nbytes for array in arrays)
    whole = 12 + 8 + len(text) + 8 + size
    if whole > _MAX_GLTF_BYTES:
        raise IcyMoonError(
            f"The ground is {whole / 1e9:.1f} GB as glTF, which holds 4.3 GB; export usd, or make the "
            "ground coarser by a larger mesh.error_px."
        )

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            stream.write(b"glTF" + np.array([2, whole, len(text)], "<u4").tobytes() + b"JSON" + text)
            stream.write(np.array([size], "<u4").tobytes() + b"BIN\0")
            for array in arrays:
                stream.write(array.data)

    write_atomically(path, write)


def _make_gltf_json(meshes: Sequence[PlacedMesh], arrays: Sequence[Array], comment: str) -> Mapping[str, Any]:
    """Make the JSON of a glTF file whose data are ``arrays``: vertices, normals and triangles of each mesh."""
    starts = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
    views = [
        {
            "buffer": 0,
            "byteOffset": start,
            "byteLength": array.nbytes,
            "target": _GLTF_INDICES if array.dtype.kind == "u" else _GLTF_VERTICES,
        }
        for start, array in zip(starts, arrays, strict=False)
    ]
    names = _make_names(meshes)
    shapes = [
        {"name": name, "primitives": [{"attributes": {"POSITION": 3 * k, "NORMAL": 3 * k + 1}, "indices": 3 * k + 2}]}
        for k, name in enumerate(names)
    ]
    return {
        "asset": {"version": "2.0", "generator": "Icy Moon", "extras": {"frame": comment}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": _nodes(meshes, names),
        "meshes": shapes,
        "accessors": [_accessor(number, array) for number, array in enumerate(arrays)],
        "bufferViews": views,
        "buffers": [{"byteLength": starts[-1]}],
    }


def _accessor(number: int, array: Array) -> dict[str, Any]:
    """Make the glTF accessor for the array with an index. The order is vertices, normals, triangles, mesh by mesh."""
    if array.dtype.kind == "u":
        return {"bufferView": number, "componentType": _GLTF_UNSIGNED, "count": array.size, "type": "SCALAR"}
    # The format asks for the ends of positions.
    ends = {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()} if number % 3 == 0 else {}
    return {"bufferView": number, "componentType": _GLTF_FLOAT, "count": len(array), "type": "VEC3", **ends}


def _nodes(meshes: Sequence[PlacedMesh], names: Sequence[str]) -> list[dict[str, Any]]:
    """Make the tree of a scene: the ground, below it a node for each kind, and below that a node for each instance of a
    mesh."""
    nodes: list[dict[str, Any]] = [{"name": "ground", "matrix": _Z_UP_TO_Y_UP, "children": []}]
    numbers = {id(mesh): k for k, mesh in enumerate(meshes)}
    for kind, own in group_by_kind(meshes).items():
        nodes[0]["children"].append(len(nodes))
        count = sum(len(mesh.places) for mesh in own)
        nodes.append({"name": kind, "children": list(range(len(nodes) + 1, len(nodes) + 1 + count))})
        for mesh in own:
            k = numbers[id(mesh)]
            for place, matrix in enumerate(mesh.places):
                named = {"name": f"{names[k]}_{place}", "mesh": k}
                nodes.append(
                    named if np.array_equal(matrix, np.eye(4)) else named | {"matrix": matrix.T.ravel().tolist()}
                )
    return nodes
