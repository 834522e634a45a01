"""Small robots as URDF files with meshes."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from icymoon.support.arrays import Array

#: A tetrahedron: its right angle at the origin, sides of 0.1.
CORNERS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))

JOINTS = """
  <joint name="mount" type="fixed"><parent link="base"/><child link="post"/>
    <origin xyz="0 0 0.1" rpy="0.1 -0.2 0.3"/></joint>
  <joint name="yaw" type="continuous"><parent link="post"/><child link="one"/><origin xyz="0 0.02 0.2"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="pitch" type="revolute"><parent link="one"/><child link="two"/>
    <origin xyz="0.3 0 0" rpy="1.5707963 0.2 -0.4"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="reach" type="prismatic"><parent link="two"/><child link="three"/><origin xyz="0.4 0 0.1"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" effort="1" velocity="1"/></joint>
  <joint name="geared" type="revolute"><parent link="three"/><child link="tool"/><origin xyz="0.2 0 0" rpy="0 0 1"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
    <mimic joint="pitch" multiplier="-0.5" offset="0.1"/></joint>
"""
LINKS = ("base", "post", "one", "two", "three", "tool")


def visual(mesh: str, scale: str = "1 1 1", origin: str = "") -> str:
    return f'<visual>{origin}<geometry><mesh filename="{mesh}" scale="{scale}"/></geometry></visual>'


def write_robot(
    folder: Path,
    joints: str = JOINTS,
    links: Sequence[str] = LINKS,
    shapes: dict[str, str] | None = None,
    before: str = "",
) -> Path:
    """A URDF file of these joints and links; ``shapes`` are the visuals by link."""
    inside = "".join(f'<link name="{link}">{(shapes or {}).get(link, "")}</link>' for link in links)
    path = folder / "arm.urdf"
    path.write_text(f'<?xml version="1.0"?>{before}<robot name="arm">{inside}{joints}</robot>', encoding="utf-8")
    return path


def write_stl(path: Path, corners: Array = CORNERS) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *np.asarray(corners)[list(face)].ravel(), 0) for face in FACES)
    path.write_bytes(b"solid that is binary".ljust(80) + struct.pack("<I", len(FACES)) + body)
    return path


def write_ascii_stl(path: Path) -> Path:
    facets = "".join(
        "facet normal 0 0 0\n outer loop\n"
        + "".join("  vertex {} {} {}\n".format(*CORNERS[k]) for k in face)
        + " endloop\nendfacet\n"
        for face in FACES
    )
    path.write_text(f"solid one\n{facets}endsolid one\n", encoding="utf-8")
    return path


def write_obj(path: Path) -> Path:
    lines = [
        "mtllib /etc/passwd",
        *("v {} {} {}".format(*corner) for corner in CORNERS),
        *("f " + " ".join(f"{k + 1}//1" for k in face) for face in FACES[:2]),
        *("f " + " ".join(str(k - 4) for k in face) for face in FACES[2:]),
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path
