"""Vertices of PLY files, as they stand in them."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
from icymoon.formats.ply import read_vertices
from icymoon.support.errors import IcyMoonError

POINTS = np.array([(500000.0625, -4.5e6, 3.25), (math.nan, 1.0, 2.0), (0.1, math.inf, -7.0)])


def write(path: Path, encoding: str, number: str = "double", properties: str = "") -> Path:
    header = (
        f"ply\nformat {encoding} 1.0\ncomment made by a test\nelement vertex 3\n"
        f"property uchar quality\n{properties}property {number} x\nproperty {number} y\n"
        f"property {number} z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    order, code = (">" if "big" in encoding else "<"), {"double": "d", "float": "f"}[number]
    if encoding == "ascii":
        rows = "".join(f"9 {x!r} {y!r} {z!r}\n" for x, y, z in POINTS.tolist())
        path.write_text(header + rows + "3 0 1 2\n")
    else:
        packed = b"".join(struct.pack(f"{order}B3{code}", 9, *point) for point in POINTS)
        path.write_bytes(header.encode() + packed + struct.pack(f"{order}B3i", 3, 0, 1, 2))
    return path


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_doubles_and_what_is_no_number_are_kept(tmp_path, encoding):
    assert np.array_equal(read_vertices(write(tmp_path / "a.ply", encoding)), POINTS, equal_nan=True)
    single = read_vertices(write(tmp_path / "a.ply", encoding, "float"))
    assert np.array_equal(single, POINTS if encoding == "ascii" else POINTS.astype(np.float32), equal_nan=True)


def test_layouts_that_are_not_usual_are_left_to_blender(tmp_path):
    assert (
        read_vertices(write(tmp_path / "a.ply", "binary_little_endian", properties="property list uchar int k\n"))
        is None
    )
    whole = write(tmp_path / "a.ply", "binary_little_endian").read_bytes()
    (tmp_path / "faces_first.ply").write_bytes(whole.replace(b"element vertex", b"element edge"))
    assert read_vertices(tmp_path / "faces_first.ply") is None


def test_vertices_that_are_cut_off_are_told_so(tmp_path):
    whole = write(tmp_path / "a.ply", "binary_little_endian").read_bytes()
    (tmp_path / "torn.ply").write_bytes(whole[:-60])
    with pytest.raises(IcyMoonError, match=r"torn\.ply: .*cut off.*; export the mesh again"):
        read_vertices(tmp_path / "torn.ply")
