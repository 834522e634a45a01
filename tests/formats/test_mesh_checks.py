"""What a mesh states is held against what it has, before Blender reads it."""

from __future__ import annotations

import io
import json
import os
import re
import struct
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from icymoon.formats import mesh_file, mesh_images, ply
from icymoon.formats.mesh_checks import check_mesh
from icymoon.formats.mesh_file import FORMATS
from icymoon.physics.triangle_files import obj, stl
from icymoon.physics.triangle_files.line_patterns import LinePatterns, UnusualTextError
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import ForeignBytes

pytestmark = pytest.mark.timeout(30)


def check_content(path: Path, content: bytes | str) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    kind = FORMATS[path.suffix]
    check_mesh(path, kind)


def refused(path: Path, content: bytes | str) -> str:
    with pytest.raises(IcyMoonError) as caught:
        check_content(path, content)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()
    assert str(caught.value).endswith(".")
    assert len(str(caught.value)) < 700
    return str(caught.value)


HEAD = (
    "ply\nformat {} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n"
    "property list uchar int vertex_indices\nend_header\n"
)
ASCII = HEAD.format("ascii", 1) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
BINARY = HEAD.format("binary_little_endian", 1).encode() + VERTICES + b"\3" + np.array([0, 1, 2], "<i4").tobytes()
MIXED = (
    HEAD.format("binary_little_endian", 3).encode()
    + VERTICES
    + b"\3"
    + struct.pack("<3i", 0, 1, 2)
    + b"\4"
    + struct.pack("<4i", 0, 1, 2, 1)
    + b"\3"
    + struct.pack("<3i", 0, 2, 1)
)


def test_whole_ply_files_pass(tmp_path):
    for content in (
        ASCII,
        ASCII.replace("\n", "\r\n"),
        ASCII[:-1],
        ASCII + "\n\n",
        BINARY,
        MIXED,
        ASCII.replace("1 0 0", "nan inf -1e400"),
        ASCII.replace("face 1", "face 0"),
    ):
        check_content(tmp_path / "a.ply", content)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (ASCII.replace("1 0 0", "1 zzz 0"), "line 11 is not a row of the element 'vertex': '1 zzz 0'"),
        (ASCII.replace("1 0 0", "1 0"), "line 11"),
        (ASCII.replace("1 0 0", "1 0,5 0"), "line 11"),
        (ASCII.replace("1 0 0", "1_0 0 0"), "line 11"),
        (ASCII.replace("1 0 0\n", "\n1 0 0\n"), "line 11"),
        (ASCII.replace("1 0 0", "\0 \x1b[31m 0"), "line 11"),
        (ASCII.replace("1 0 0", "9" * 2_000_000), "more than"),
        (ASCII.replace("3 0 1 2", "3 0 1 3"), "line 13 is not a row of the element 'face', whose vertices are 0 to 2"),
        (ASCII.replace("3 0 1 2", "3 0 1 -1"), "line 13"),
        (ASCII.replace("3 0 1 2", "3 0 1"), "line 13"),
        (ASCII.replace("3 0 1 2", "-3 0 1 2"), "line 13"),
        (ASCII.replace("3 0 1 2", "3 0 1 2.0"), "line 13"),
        (ASCII.replace("3 0 1 2", f"3 0 1 {'9' * 5000}"), "line 13"),
        (ASCII.replace("3 0 1 2", "300000000 0 1"), "line 13"),
        (ASCII.replace("3 0 1 2\n", ""), "follow"),
        (ASCII.replace("vertex 3", "vertex 1000000000000"), "bytes, but"),
        (ASCII.replace("face 1", "face 4"), "it ends early"),
        (ASCII.replace("vertex 3", "vertex -1"), "line 3 of the header"),
        (ASCII.replace("vertex 3", f"vertex {'9' * 5000}"), "line 3"),
        (ASCII.replace("vertex 3", "vertex 3.0"), "line 3"),
        (ASCII.replace("vertex 3", "vertex"), "line 3"),
        (ASCII.replace("vertex 3", "vertex ３"), "line 3"),
        (ASCII.replace("list uchar", "list float"), "line 8"),
        (ASCII.replace("list uchar", "list thing"), "line 8"),
        (ASCII.replace("property float y", "property float"), "line 5"),
        (ASCII.replace("float y", "float x"), "of one name"),
        (ASCII.replace("float y", "long y"), "line 5"),
        (ASCII.replace("ascii 1.0", "xml 1.0"), "its format"),
        (ASCII.replace("format ascii 1.0\n", ""), "its format"),
        (ASCII.replace("end_header", "end"), "no end"),
        (ASCII.replace("element face 1\n", "element face 1\nelement other 5\n"), "without a property"),
        ("ply\n" + "comment\n" * 10**5 + ASCII[4:], "no end"),
        ("ply\n", "no end"),
        (BINARY[:-1], "ends 1 bytes early"),
        (BINARY[:-13] + b"\4" + BINARY[-12:], "ends 4 bytes early"),
        (BINARY[:-4] + struct.pack("<i", 3), "has vertex 3"),
        (BINARY[:-4] + struct.pack("<i", -1), "has vertex -1"),
        (BINARY.replace(b"face 1", b"face 1000000000000"), "bytes, but"),
        (BINARY.replace(b"face 1", b"face 2"), "ends early"),
        (BINARY.replace(b"uchar int", b"int int") + b"\xff" * 3, "has vertex 256"),
        (BINARY.replace(b"uchar int", b"uint int").replace(b"\3\0\0\0\0", b"\xff\xff\xff\xff\0"), "early"),
        (BINARY.replace(b"little", b"big"), "follow|early|has vertex"),
        (MIXED[:-4] + struct.pack("<i", 3), "row 2 of the"),
        (MIXED[:-1], "early"),
        (MIXED.replace(b"uchar int", b"char int").replace(b"\4", b"\xff"), "a list of -1 values"),
        (MIXED.replace(b"\4" + struct.pack("<i", 0), b"\4" + struct.pack("<i", 2**31 - 1)), "row 1 of the"),
    ],
    ids=range(46),
)
def test_a_ply_that_states_what_it_has_not_is_refused(tmp_path, content, words):
    assert re.search(words, refused(tmp_path / "a.ply", content))


def test_a_list_of_a_million_values_is_read_as_it_is(tmp_path):
    corners = np.tile(np.array([0, 1, 2], "<i4"), 400_000)
    content = (
        HEAD.format("binary_little_endian", 1).replace("uchar int", "uint int").encode()
        + VERTICES
        + struct.pack("<I", len(corners))
        + corners.tobytes()
    )
    check_content(tmp_path / "a.ply", content)
    refused(tmp_path / "a.ply", content[:-4] + struct.pack("<i", 3))
    refused(tmp_path / "a.ply", content[:-4])


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"
STL = "solid a\nfacet normal 0 0 1\n outer loop\n" + "  vertex 1 0 0\n" * 3 + " endloop\nendfacet\nendsolid a\n"


def test_whole_obj_and_stl_files_pass(tmp_path):
    for content in (
        OBJ,
        "# caf\xe9\n" + OBJ,
        OBJ.replace("1 0 0", "1 0 0 0.5 0.5 0.5"),
        OBJ.replace("v 1 0 0", "v 1 \\\n0 0"),
        OBJ.replace("v 1 0 0", "v 1 0 0 # corner"),
        OBJ.replace("3/1", "3/1 # face"),
        OBJ.replace("\n", "\r\n"),
        OBJ.replace("3/1", "\\\n3/1"),
        OBJ.replace("f 1/1", "f -3//"),
        OBJ.replace("v 0 0", "v\t0 0"),
    ):
        check_content(tmp_path / "a.obj", content)
    for text in (
        STL,
        STL.replace("  vertex", "\tvertex"),
        STL.upper(),
        STL.replace("1 0 0", "1e-3 +0. .5"),
        b"\0" * 80 + struct.pack("<I", 1) + bytes(50),
    ):
        check_content(tmp_path / "a.stl", text)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", OBJ.replace("v 1 0 0", "v 1,5 0,5 0"), "vertex of line 2 is not three numbers: '1,5 0,5 0'"),
        ("a.obj", OBJ.replace("v 1 0 0", "v 1 zzz 0"), "line 2"),
        ("a.obj", OBJ.replace("v 1 0 0", "v 1 0"), "line 2"),
        ("a.obj", OBJ.replace("v 1 0 0", "v 1 \\\n0,5 0"), "vertex of line 3"),
        ("a.obj", OBJ.replace("3/1", "3,1"), "face of line 5"),
        ("a.obj", OBJ.replace("3/1", "abc"), "face of line 5"),
        ("a.obj", OBJ + "f " + "1 2 3 " * 10**5, "line 6 has more"),
        ("a.obj", OBJ + "v 1 \\\n" * 40_000, "has more than"),
        ("a.obj", OBJ + "mtllib a\n" * 200, "material libraries"),
        ("a.obj", OBJ + "v " + "9" * 70_000, "has more than"),
        ("a.obj", OBJ.replace("1 0 0", "1 \x1b[31m 0"), "line 2"),
        ("a.stl", STL.replace("1 0 0", "1 zz 0"), "vertex of line 4"),
        ("a.stl", STL.replace("1 0 0", "1 0,5 0"), "line 4"),
        ("a.stl", STL.replace("vertex 1 0 0\n", "vertex 1 0 0\nvertex 1 0\n", 1), "line 5"),
        (
            "a.stl",
            STL.replace("1 0 0", "1 1e100 0", 1).replace("1 0 0", "0 -1e400 0", 1),
            "three numbers: '0 -1e400 0'",
        ),
        ("a.obj", OBJ.replace("v 1 0 0", "v 1 inf 0"), "line 2"),
        ("a.stl", b"x" * 200, "cut off"),
        ("a.stl", STL.replace("  vertex 1 0 0\n", "", 1), "cut off"),
        ("a.stl", b"x" * 80 + b"\xff" * 4 + bytes(50), "cut off"),
        ("a.stl", b"", "cut off"),
        ("a.stl", b"solid" + b" " * 10**6, "more than"),
    ],
    ids=range(21),
)
def test_an_obj_or_stl_of_no_numbers_is_refused_with_its_line(tmp_path, name, content, words):
    if words == "cut off" and not content:
        check_content(tmp_path / name, content)  # detect_kind has refused it
    else:
        assert words in refused(tmp_path / name, content)


def gltf_of(**changes) -> dict:
    """A triangle, with parts exchanged."""
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 42, "uri": "a.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
    } | changes


def glb_of(document: dict, **lies: int) -> bytes:
    text, content = json.dumps(document).encode(), bytes(44)
    return (
        struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(content))
        + struct.pack("<I4s", lies.get("text", len(text)), b"JSON")
        + text
        + struct.pack("<I4s", lies.get("binary", len(content)), b"BIN\0")
        + content
    )


def test_whole_gltf_files_pass(tmp_path):
    (tmp_path / "a.bin").write_bytes(bytes(42))
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "b c.bin").write_bytes(bytes(42))
    for document in (
        gltf_of(),
        gltf_of(buffers=[{"byteLength": 42, "uri": "sub/b%20c.bin"}]),
        gltf_of(buffers=[{"byteLength": 42, "uri": "data:application/octet-stream;base64," + "A" * 56}]),
        gltf_of(images=[{"uri": "absent.png"}, {"uri": "data:image/png;base64,AAAA"}, {"bufferView": 0}]),
    ):
        check_content(tmp_path / "a.gltf", json.dumps(document))
    check_content(tmp_path / "a.gltf", "\ufeff" + json.dumps(gltf_of()))
    check_content(tmp_path / "a.glb", glb_of(gltf_of(buffers=[{"byteLength": 42}])))


ACCESSOR = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
SCALARS = {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}
SPARSE = {"count": 3, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}


@pytest.mark.parametrize(
    "document",
    [
        *(
            gltf_of(accessors=[ACCESSOR | change, SCALARS])
            for change in (
                {"count": 4},
                {"count": -1},
                {"count": 3.0},
                {"count": True},
                {"count": "3"},
                {"count": 2**62},
                {"byteOffset": 1},
                {"byteOffset": -1},
                {"bufferView": 2},
                {"bufferView": -1},
                {"componentType": 1},
                {"type": "MAT9"},
                {"type": []},
                {"type": "MAT4"},
                {"sparse": SPARSE | {"count": 4}},
                {"sparse": SPARSE | {"values": {"bufferView": 1}}},
                {"sparse": {}},
                {"sparse": 3},
                {"count": 10**9, "bufferView": None},
            )
        ),
        gltf_of(accessors=[{"componentType": 5126, "count": 10**9, "type": "VEC3"}, SCALARS]),
        gltf_of(
            accessors=[{"componentType": 5126, "count": 10**6, "type": "VEC3"}, SCALARS],
            meshes=[{"primitives": [{"attributes": {"POSITION": 0}}] * 100}],
        ),
        *(
            gltf_of(bufferViews=[{"buffer": 0, "byteLength": 36} | change, {"buffer": 0, "byteLength": 6}])
            for change in (
                {"byteLength": 43},
                {"byteLength": -1},
                {"byteOffset": 7},
                {"buffer": 1},
                {"buffer": -1},
                {"byteStride": 13},
                {"byteStride": -1},
                {"byteLength": None},
            )
        ),
        *(
            gltf_of(buffers=[{"byteLength": 42, "uri": uri}])
            for uri in (
                "../a.bin",
                "/etc/passwd",
                "file:///etc/passwd",
                "http://x/a.bin",
                "absent.bin",
                "..%2fa.bin",
                "sub",
                "a\0.bin",
                "",
                "data:;base64,AAAA",
                "pipe",
                "a/../../a.bin",
                "..\\a.bin",
                3,
            )
        ),
        gltf_of(buffers=[{"byteLength": 43, "uri": "a.bin"}]),
        gltf_of(buffers=[{"uri": "a.bin"}]),
        gltf_of(buffers=[{}]),
        gltf_of(buffers=[3]),
        gltf_of(buffers=3),
        gltf_of(meshes=[3]),
        gltf_of(meshes=[{}]),
        gltf_of(meshes=[{"primitives": [{"attributes": {"POSITION": 7}}]}]),
        gltf_of(meshes=[{"primitives": [{"attributes": {"POSITION": -1}}]}]),
        gltf_of(nodes=[{}] * 50_001),
        gltf_of(nodes=[{"children": [0]}]),
        gltf_of(nodes=[{"children": [1]}, {"children": [0]}]),
        gltf_of(nodes=[{"children": [1, 1]}, {}]),
        gltf_of(nodes=[{"children": [5]}]),
        gltf_of(nodes=[{"children": [-1]}]),
        gltf_of(nodes=[{"children": [k + 1]} for k in range(900)] + [{}]),
        gltf_of(images=[{"uri": "pipe"}]),
        gltf_of(images=[{"uri": 3}]),
        gltf_of(buffers=[{"byteLength": 42, "uri": "link.bin"}]),
        gltf_of(scene=1),
        gltf_of(scene=-1),
        gltf_of(scenes=[{"nodes": [1]}]),
        gltf_of(scenes=[{"nodes": ["a"]}]),
        gltf_of(nodes=["a"]),
        gltf_of(nodes=[{"children": ["a"]}]),
        gltf_of(images=[{"uri": None}]),
        [],
        3,
        "text",
        None,
    ],
    ids=lambda document: json.dumps(document)[:4],
)
def test_a_gltf_that_states_what_it_has_not_is_refused(tmp_path, document):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.bin").write_bytes(bytes(42))
    (tmp_path.parent / "a.bin").write_bytes(bytes(42))
    (tmp_path / "link.bin").symlink_to(tmp_path.parent / "a.bin")
    text = refused(tmp_path / "a.gltf", json.dumps(document))
    assert not [word for word in ("object", "instance", "out of range", "NoneType", "subscript") if word in text]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"glTF",
        b"glTF" + b"\xff" * 16,
        glb_of(gltf_of())[:-50],
        glb_of(gltf_of(buffers=[{"byteLength": 45}])),
        glb_of(gltf_of(buffers=[{"byteLength": 42}]), text=2**32 - 1),
        glb_of(gltf_of(buffers=[{"byteLength": 42}]), text=3),
        glb_of(gltf_of(buffers=[{"byteLength": 42}]), binary=2**31),
        b"[" * 10**6,
        b'{"a":' * 10**5,
        b'{"a": NaN}',
        b'{"buffers": ' + b"1" * 5000 + b"}",
        b"[" + b"[],[]," * 2_000_000 + b"[]]",
    ],
    ids=range(13),
)
def test_a_gltf_that_is_none_is_refused(tmp_path, content):
    refused(tmp_path / "a.glb", content)


def fbx_array(values: bytes, count: int, packed: int = 1) -> bytes:
    content = zlib.compress(values) if packed else values
    return b"d" + struct.pack("<3I", count, packed, len(content)) + content


def fbx_of(
    *properties: bytes, end: int | None = None, length: int | None = None, number: int | None = None, inner: bytes = b""
) -> bytes:
    """A binary FBX file of one node."""
    content = b"".join(properties)
    start = 27 + 13 + 4
    stop = start + len(content) + len(inner)
    return (
        b"Kaydara FBX Binary  \0\x1a\0"
        + struct.pack("<I", 7400)
        + struct.pack(
            "<3IB",
            stop if end is None else end,
            len(properties) if number is None else number,
            len(content) if length is None else length,
            4,
        )
        + b"Node"
        + content
        + inner
        + bytes(13)
    )


def test_a_whole_fbx_passes(tmp_path):
    for content in (
        fbx_of(),
        fbx_of(b"I\1\0\0\0", b"S\3\0\0\0abc", fbx_array(bytes(800), 100), fbx_array(bytes(80), 10, 0)),
        fbx_of(b"C\1", inner=bytes(13)),
        b"; FBX 7.4.0 project file\n",
    ):
        check_content(tmp_path / "a.fbx", content)


@pytest.mark.parametrize(
    "content",
    [
        fbx_of(end=27),
        fbx_of(end=1),
        fbx_of(end=2**32 - 1),
        fbx_of(end=30),
        fbx_of(length=2**32 - 1),
        fbx_of(length=3),
        fbx_of(number=2**32 - 1),
        fbx_of(b"Q"),
        fbx_of(b"S\xff\xff\xff\xff"),
        fbx_of(b"R\xff\xff\xff\x7fabc"),
        fbx_of(b"I\1"),
        fbx_of(fbx_array(bytes(80), 2**31)),
        fbx_of(fbx_array(bytes(80), 2**28)),
        fbx_of(fbx_array(bytes(80), 11, 0)),
        fbx_of(*[fbx_array(bytes(8 * 10**5), 10**5)] * 4000),
        fbx_of()[:-13],
        fbx_of()[:30],
        fbx_of(b"I\1\0\0\0", length=4),
        fbx_of(inner=b"\xff" * 13),
        fbx_of(number=1, length=0),
    ],
    ids=range(20),
)
def test_an_fbx_whose_nodes_or_arrays_cannot_be_is_refused(tmp_path, content):
    refused(tmp_path / "a.fbx", content)


def test_an_archive_of_usd_holds_no_more_than_its_bytes(tmp_path):
    def archive(method: int, count: int = 1) -> bytes:
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", method) as file:
            for k in range(count):
                file.writestr(f"{k}.usda", bytes(1000))
        return stream.getvalue()

    check_content(tmp_path / "a.usdz", archive(zipfile.ZIP_STORED))
    for content in (
        archive(zipfile.ZIP_DEFLATED),
        archive(zipfile.ZIP_STORED, 1001),
        archive(zipfile.ZIP_STORED)[:-30],
        b"PK\3\4" + bytes(1000),
    ):
        refused(tmp_path / "a.usdz", content)


def test_what_a_mesh_names_is_never_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_bump -bm 2 pipe\n")
    (tmp_path / "b.mtl").write_text("newmtl a\nmap_Kd pipe\n")
    assert "not a regular file" in refused(tmp_path / "a.obj", OBJ)  # its library by its name
    assert "not a regular file" in refused(tmp_path / "c.obj", "mtllib b.mtl\n" + OBJ)
    assert "not a regular file" in refused(tmp_path / "c.obj", "mtllib pipe\n" + OBJ)
    assert "not a regular file" in refused(tmp_path / "c.usda", "#usda 1.0\ndef A (references = @./pipe@) {}\n")
    for path in (tmp_path / "pipe.ply", tmp_path / "folder.ply"):
        os.mkfifo(path) if path.stem == "pipe" else path.mkdir()
        for act in (mesh_file.detect_kind, mesh_file.estimate_cost, mesh_images.find_images):
            with pytest.raises(IcyMoonError, match="cannot be read"):
                act(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", b"\n" * 10**6),
        ("a.obj", b" " * 10**6),
        ("a.obj", b"mtllib\n" * 10**5),
        ("a.ply", ASCII.encode()),
        ("a.ply", b"ply\nelement face " + b"9" * 5000 + b"\nend_header"),
        ("a.ply", b"ply\nend_header\n"),
        ("a.stl", b"\n" * 10**6),
        ("a.gltf", b'{"accessors": [{"count": 1e400}]}'),
        ("a.gltf", b'{"meshes": [{"primitives": [{"indices": 5}]}]}'),
        ("a.gltf", b'{"buffers": [{"uri": "../../x"}]}'),
        ("a.gltf", b'{"buffers": 5}'),
        ("a.glb", b"glTF" + b"\xff" * 99),
        ("a.gltf", b'{"materials": 3, "meshes": [{"primitives": [{"material": 0}]}]}'),
    ],
    ids=range(13),
)
def test_facts_of_a_hostile_mesh_are_facts_or_a_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    for act in (mesh_file.estimate_cost, mesh_file.find_geometry_files, mesh_images.find_images):
        with suppress(IcyMoonError):
            act(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [
        "map_Kd -o - x.png",
        "map_Kd -s 1e 1e x.png",
        "map_Kd " + "-mm " * 10**4,
        "map_Kd",
        "map_Kd \0\x1b",
        "map_Kd -o",
        "norm " + "a" * 60_000,
        "map_Kd " + "../" * 9 + "etc/passwd",
    ],
)
def test_a_hostile_library_is_images_or_a_sentence(tmp_path, text):
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + OBJ)
    (tmp_path / "a.mtl").write_text(text)
    with suppress(IcyMoonError):
        mesh_images.find_images(tmp_path / "a.obj")


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", ASCII.encode()),
        ("a.ply", BINARY),
        ("a.ply", MIXED),
        ("a.obj", OBJ.encode()),
        ("a.stl", STL.encode()),
        ("a.fbx", fbx_of(b"I\1\0\0\0", fbx_array(bytes(800), 100))),
        ("a.glb", glb_of(gltf_of(buffers=[{"byteLength": 42}]))),
    ],
)
def test_a_damaged_mesh_is_checked_or_refused(tmp_path, name, content, seed):
    random = np.random.default_rng(seed)
    for _ in range(100):
        data = bytearray(content)
        for at in random.integers(0, len(data), 2):
            data[at] = random.integers(0, 256)
        (tmp_path / name).write_bytes(data)
        for act in (mesh_file.estimate_cost, mesh_images.find_images):
            with suppress(IcyMoonError):
                act(tmp_path / name)
        with suppress(IcyMoonError):
            check_mesh(tmp_path / name, FORMATS[name[1:]])


#: Texts of more than one part that is looked at together.
GRID = [f"{x / 7:.6g} {y / 9:.6g} {x * y / 1e7:.6g}" for x in range(-50, 50) for y in range(-50, 50)]
CORNERS = [(k, k + 1, k + 100) for k in range(9_899)]
LARGE = {
    "a.ply": (
        HEAD.format("ascii", len(CORNERS)).replace("vertex 3", f"vertex {len(GRID)}")
        + "\n".join(GRID)
        + "\n"
        + "".join("3 {} {} {}\n".format(*each) for each in CORNERS)
    ),
    "a.obj": (
        "# made\nmtllib a.mtl\n"
        + "".join(f"v {each}\n" for each in GRID)
        + "g part_1\n"
        + "".join("f {}/1 {}/2 {}/3\n".format(*(k + 1 for k in each)) for each in CORNERS)
        + "mtllib b 1.mtl\n"
    ),
    "a.stl": (
        "solid a\n"
        + "".join(
            "facet normal 0 0 1\n outer loop\n"
            + "".join(f"  vertex {GRID[k]}\n" for k in each)
            + " endloop\nendfacet\n"
            for each in CORNERS[::3]
        )
        + "endsolid a\n"
    ),
}


def read_by_lines(monkeypatch) -> list[int]:
    """A list that gets an item for each file that is looked at line by line."""
    found: list[int] = []
    lines = ForeignBytes.lines
    monkeypatch.setattr(ForeignBytes, "lines", lambda self, *rest: found.append(self.size) or lines(self, *rest))
    return found


@pytest.mark.parametrize("name", LARGE)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_the_lines_of_a_usual_mesh_are_not_looked_at_one_by_one(tmp_path, monkeypatch, name, end):
    found = read_by_lines(monkeypatch)
    check_content(tmp_path / name, LARGE[name].replace("\n", end))
    check_content(tmp_path / name, LARGE[name][:-1])
    assert not found
    (tmp_path / name).write_text(
        LARGE[name].replace("0.5", "0_5", 1) if name == "a.ply" else LARGE[name].replace("0.714286", "0,714286", 1),
        encoding="utf-8",
    )
    refused(tmp_path / name, (tmp_path / name).read_bytes())
    assert found


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", LARGE)
def test_many_lines_together_are_judged_as_each_by_itself(tmp_path, monkeypatch, name, seed):
    path, random = tmp_path / name, np.random.default_rng(seed)
    tokens = [
        b"",
        b" ",
        b"-",
        b".",
        b"e",
        b"0",
        b"7",
        b"\n",
        b"\r",
        b"#",
        b"\\\n",
        b"\0",
        b"_",
        b"nan",
        b"x",
        b"/",
        b"\t",
        b"vertex",
        b"\nv 1 2 3",
        b"\n\n",
        b"99999999999999999999",
        b"\nmtllib c.mtl\n",
        b"+",
        b"1e5",
        b"\xff",
    ]
    texts = [LARGE[name][:k].encode() for k in (90_000, 70_000, 300)] + [LARGE[name].encode()] * 3

    def outcome() -> str:
        try:
            check_mesh(path, FORMATS[path.suffix])
        except IcyMoonError as error:
            return str(error)
        return "passed"

    judged = set()
    for _ in range(40):
        content = texts[random.integers(len(texts))]
        for _ in range(random.integers(1, 3)):
            at = int(random.integers(len(content)))
            content = content[:at] + tokens[random.integers(len(tokens))] + content[at + int(random.integers(3)) :]
        path.write_bytes(content)
        together = outcome()
        with monkeypatch.context() as patch:
            for module in (obj, ply, stl):
                patch.setattr(module, "reduce_digits", refuse)
            assert outcome() == together
        judged.add(together == "passed")
    assert judged == {True, False}


def test_long_and_many_forms_are_not_kept():
    forms = LinePatterns(len)
    for k in range(300):
        forms.check_lines(b"\n".join(b"%s%s" % (bytes([97 + k % 26]) * (k // 26), bytes([97 + j])) for j in range(26)))
    forms.check_lines(b"\n".join(b"#%x" % j for j in range(20_000)) + b"\n" + b"x" * 60_000)
    assert len(forms._known) == 10_000
    assert max(map(len, forms._known)) <= 200


def refuse(_: bytes) -> bytes:
    raise UnusualTextError
