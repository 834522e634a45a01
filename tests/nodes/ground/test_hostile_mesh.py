"""Meshes of strangers as grounds: a sentence, in bounded memory, and Blender keeps nothing of them."""

from __future__ import annotations

import json
import resource
import struct
import subprocess
import sys

import bpy
import pytest
from icymoon.nodes.ground import import_mesh
from icymoon.nodes.ground.import_mesh import read_mesh
from icymoon.support.errors import IcyMoonError
from icymoon.support.system import bound_memory_and_time

pytestmark = pytest.mark.timeout(60)
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.ply", PLY.replace("1 0 0", "1 zzz 0"), "line 11 is not a row of the element 'vertex': '1 zzz 0'"),
        ("a.ply", PLY.replace("3 0 1 2", "3 0 1 9"), "line 13"),
        ("a.ply", PLY.replace("vertex 3", "vertex 1000000000000"), "but"),
        ("a.obj", OBJ.replace("1 0 0", "1,5 0,25 0,0"), "vertex of line 2 is not three numbers: '1,5 0,25 0,0'"),
        ("a.obj", OBJ + "f " + "1 2 3 " * 3_000_000, "line 5 has more than"),
        ("a.stl", "solid a\nfacet\nvertex 0 0 0\nvertex 1 zz 0\nvertex 0 1 0\n", "vertex of line 4"),
    ],
    ids=range(6),
)
def test_a_mesh_that_blender_would_take_for_another_is_refused(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    before = len(bpy.data.meshes)
    with pytest.raises(IcyMoonError) as caught:
        read_mesh(tmp_path / name)
    assert words in str(caught.value)
    assert len(bpy.data.meshes) == before


def test_copies_of_a_mesh_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(import_mesh, "MAX_TRIANGLES", 0)
    (tmp_path / "a.obj").write_text(OBJ)
    with pytest.raises(IcyMoonError, match="more than 0 triangles with all its copies"):
        read_mesh(tmp_path / "a.obj")


def test_an_importer_has_the_memory_of_its_mesh_and_gives_it_back(tmp_path):
    before = resource.getrlimit(resource.RLIMIT_AS)
    with bound_memory_and_time(2**28), pytest.raises(MemoryError):
        bytearray(2**40)
    (tmp_path / "a.obj").write_text(OBJ)
    assert len(read_mesh(tmp_path / "a.obj")[1]) == 1
    assert resource.getrlimit(resource.RLIMIT_AS) == before


@pytest.mark.heavy
def test_what_an_importer_refuses_reaches_the_user_as_a_sentence(tmp_path):
    """Its report has no end of line, and the message of the worker followed it in the same line."""
    corners, faces = struct.pack("<9f", 0, 0, 0, 5, 0, 0, 0, 0, 5), struct.pack("<3H", 0, 1, 65535)
    (tmp_path / "a.bin").write_bytes(corners + faces)
    (tmp_path / "a.gltf").write_text(
        json.dumps(
            {
                "asset": {"version": "2.0"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
                "buffers": [{"byteLength": 42, "uri": "a.bin"}],
                "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
                "accessors": [
                    {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
                    {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
                ],
            }
        )
    )
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "icymoon",
            "render",
            "--set",
            "source.kind=MESH",
            "--set",
            f"source.file={tmp_path / 'a.gltf'}",
            "--out",
            str(tmp_path / "out"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith(f"icymoon: {tmp_path / 'a.gltf'}: Blender cannot read it as glTF")
    assert done.stderr.count("\n") == 1
