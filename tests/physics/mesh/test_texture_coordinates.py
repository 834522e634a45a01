"""Texture coordinates of meshes: through repair and cutting, the mean that a surface shows, and the files."""

from __future__ import annotations

import base64
import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from icymoon.formats import mesh_images
from icymoon.formats.ply import read_texture_coordinates
from icymoon.physics.mesh import texture_coordinates
from icymoon.physics.mesh.halve_edges import halve_edges
from icymoon.physics.mesh.mesh_faults import repair_mesh
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from sheets import sheet


def layout(points: Array, of_face: Array) -> Array:
    """UV (m, 3, 2) of points (m, 3, 3): turned, mirrored, and elsewhere on the image where ``of_face`` is set."""
    return np.stack([0.1 + 0.07 * points[..., 1] + 0.5 * of_face[:, None], 0.9 - 0.11 * points[..., 0]], axis=-1)


def laid() -> tuple[Array, Array, Array]:
    """A sheet with a seam at x = 2 and its UV."""
    positions, faces = sheet()
    points = positions[faces]
    return positions, faces, layout(points, points[..., 0].mean(axis=1) > 2.0).astype(np.float32)


def agrees(positions: Array, faces: Array, uv: Array) -> bool:
    """Whether each corner of each face is where the layout says."""
    points = positions[faces]
    return bool(np.allclose(uv, layout(points, points[..., 0].mean(axis=1) > 2.0), atol=1e-6))


def test_repair_keeps_every_corner_on_its_place_of_the_image():
    positions, faces, uv = laid()
    n = len(positions)
    # Every face has vertices of its own, as files with a normal per corner have; some are flipped, some doubled.
    loose = np.concatenate([positions[faces].reshape(-1, 3), [(np.nan, 0, 0)]])
    own = np.arange(3 * len(faces)).reshape(-1, 3)
    flipped = np.random.default_rng(0).random(len(faces)) < 0.4
    broken = np.concatenate(
        [np.where(flipped[:, None], own[:, ::-1], own), [(0, 1, len(loose) - 1), (0, 0, 1)], own[:5, [1, 2, 0]]]
    )
    of_broken = np.concatenate(
        [np.where(flipped[:, None, None], uv[:, ::-1], uv), np.zeros((2, 3, 2)), uv[:5, [1, 2, 0]]]
    ).astype(np.float32)
    order = np.random.default_rng(1).permutation(len(broken))
    after, mended, kept = repair_mesh(loose, broken[order], of_broken[order])
    assert (len(after), len(mended), kept.shape) == (n, len(faces), (len(faces), 3, 2))
    assert agrees(after, mended, kept)
    plain = repair_mesh(loose, broken[order])
    assert np.array_equal(plain[0], after)
    assert np.array_equal(plain[1], mended)
    assert plain[2] is None


def test_cutting_puts_new_corners_in_the_middle_and_keeps_seams():
    positions, faces, uv = laid()
    for _ in range(2):
        positions, faces = halve_edges(positions, faces)
        uv = texture_coordinates.halve_coordinates(uv)
    assert uv.dtype == np.float32
    assert agrees(positions, faces, uv)


def mean_shown(image: Array, points: Array, weight: Array) -> Array:
    return weight @ image[texture_coordinates.find_pixels(points, *image.shape[:2])]


def test_the_mean_is_of_what_the_surface_shows():
    # Two triangles, one of three times the other's area, on the two halves of a black and white image.
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 9), (3, 0, 9), (0, 1, 9)], float)
    faces = np.array([(0, 1, 2), (3, 4, 5)])
    uv = np.array([[(0.05, 0.1), (0.4, 0.1), (0.05, 0.8)], [(2.6, -0.9), (2.9, -0.9), (2.6, -0.1)]], np.float32)
    image = np.zeros((10, 20, 3))
    image[:, 10:] = (1.0, 0.5, 0.25)
    expected = 0.75 * np.array([1.0, 0.5, 0.25])
    samples = texture_coordinates.sample_surface(positions, faces, uv)
    assert mean_shown(image, *samples) == pytest.approx(expected, abs=1e-4)
    # The same surface of many triangles, of which some stand for all.
    for _ in range(8):
        positions, faces = halve_edges(positions, faces)
        uv = texture_coordinates.halve_coordinates(uv)
    assert len(faces) == 2 * 4**8
    points, weight = texture_coordinates.sample_surface(positions, faces, uv)
    assert len(points) < 70000
    assert weight.sum() == pytest.approx(1.0)
    assert mean_shown(image, points, weight) == pytest.approx(expected, abs=0.01)
    # A ramp has the value of the mean place.
    ramp = np.broadcast_to(np.arange(20)[None, :, None] / 20 + 1 / 40, (10, 20, 3))
    centroids = np.array([(0.05 + 0.4 + 0.05) / 3, (0.6 + 0.9 + 0.6) / 3])
    assert mean_shown(ramp, points, weight) == pytest.approx([centroids @ (0.25, 0.75)] * 3, abs=0.005)


def test_what_is_no_number_is_zero_and_said():
    _, _, uv = laid()
    kept, found = texture_coordinates.repair_coordinates(uv)
    assert np.array_equal(kept, uv)
    assert len(found) == 1
    torn = uv.copy()
    torn[3, 1, 0], torn[5, 2] = np.nan, np.inf
    torn[7] = torn[7, :1]
    kept, found = texture_coordinates.repair_coordinates(torn)
    assert np.isfinite(kept).all()
    assert np.array_equal(kept[3, 1], (0, 0))
    assert np.array_equal(kept[8:], uv[8:])
    assert any("2 of 150 face corners" in sentence for sentence in found)
    assert any("1 of 50 triangles" in sentence for sentence in found)
    for nothing in (np.full_like(uv, np.nan), np.full_like(uv, 0.5), uv * np.array([1, 0], np.float32)):
        kept, found = texture_coordinates.repair_coordinates(nothing)
        assert kept is None
        assert "no area" in found[0]


def ply(path: Path, encoding: str, corner_uv: Array | None, vertex_uv: tuple[str, str] = ("", "")) -> Path:
    """The sheet as a PLY of doubles with UV of its corners, or of its vertices under these names."""
    positions, faces, _ = laid()
    named = "".join(f"property float {name}\n" for name in vertex_uv if name)
    lists = "property list uchar float texcoord\nproperty uchar flag\n" if corner_uv is not None else ""
    header = (
        f"ply\nformat {encoding} 1.0\ncomment TextureFile a b.png\nelement vertex {len(positions)}\n"
        f"property double x\nproperty double y\nproperty double z\n{named}element face {len(faces)}\n"
        f"property list uchar int vertex_indices\n{lists}end_header\n"
    )
    order = ">" if "big" in encoding else "<"
    body = b""
    for point in positions.tolist():
        extra = [0.25 * point[0], 0.5 * point[1]] if named else []
        body += (
            (" ".join(map(repr, [*point, *extra])) + "\n").encode()
            if encoding == "ascii"
            else struct.pack(f"{order}3d{len(extra)}f", *point, *extra)
        )
    for k, face in enumerate(faces.tolist()):
        six = [] if corner_uv is None else corner_uv[k].ravel().tolist()
        if encoding == "ascii":
            body += (" ".join(map(repr, [3, *face, *([6, *six, 7] if six else [])])) + "\n").encode()
        else:
            body += struct.pack(f"{order}B3i", 3, *face) + (struct.pack(f"{order}B6fB", 6, *six, 7) if six else b"")
    path.write_bytes(header.encode() + body)
    return path


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_has_coordinates_of_corners_or_of_vertices(tmp_path, encoding):
    positions, faces, uv = laid()
    assert np.array_equal(read_texture_coordinates(ply(tmp_path / "a.ply", encoding, uv), faces), uv)
    for names in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")):
        found = read_texture_coordinates(ply(tmp_path / "b.ply", encoding, None, names), faces)
        assert np.allclose(found, positions[faces][..., :2] * (0.25, 0.5))
    assert read_texture_coordinates(ply(tmp_path / "c.ply", encoding, None), faces) is None
    # Blender leaves out faces that it takes for broken; corners of other faces than the file's are not taken.
    some = np.arange(len(faces)) % 7 != 2
    assert np.array_equal(read_texture_coordinates(tmp_path / "a.ply", faces[some]), uv[some])
    assert read_texture_coordinates(tmp_path / "a.ply", faces[:, ::-1]) is None
    torn = uv.copy()
    torn[2, 1, 1] = math.nan
    assert np.array_equal(
        read_texture_coordinates(ply(tmp_path / "d.ply", encoding, torn), faces), torn, equal_nan=True
    )


def test_a_ply_names_its_image(tmp_path):
    path = ply(tmp_path / "a.ply", "ascii", None)
    assert mesh_images.choose_images(path)["albedo"].file == tmp_path / "a b.png"
    path.write_bytes(path.read_bytes().replace(b"element face", b"comment TextureFile c.png\nelement face", 1))
    with pytest.raises(IcyMoonError, match="has 2 albedo images"):
        mesh_images.choose_images(path)


LIBRARY = """newmtl a
map_Kd -clamp on -s 1 1 1 -mm 0 1.5 textures\\my rock.png
map_Pr -imfchan g r.png
norm n.png
map_Bump height.png
newmtl b
map_Kd textures/my rock.png
newmtl c
Kd 1 1 1
"""


def test_an_obj_names_its_images_in_its_library(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("# a\nmtllib my mesh.mtl\nv 0 0 0\n")
    assert mesh_images.choose_images(path) == {}
    assert mesh_images.find_images(path).files() == [tmp_path / "my mesh.mtl"]  # its coming will change what is shown
    (tmp_path / "my mesh.mtl").write_text(LIBRARY)
    found = mesh_images.choose_images(path)
    assert {kind: image.file for kind, image in found.items()} == {
        "albedo": tmp_path / "textures/my rock.png",
        "roughness": tmp_path / "r.png",
        "normal": tmp_path / "n.png",
    }
    (tmp_path / "my rock.png").write_bytes(b"moved here")
    assert mesh_images.choose_images(path)["albedo"].file == tmp_path / "my rock.png"
    (tmp_path / "my mesh.mtl").write_text(
        LIBRARY.replace("-s 1 1 1", "-s 2 2").replace("map_Kd textures/my rock.png\n", "")
    )
    with pytest.raises(IcyMoonError, match=r"albedo image is shifted or scaled by -s 2 2.*textures\.set"):
        mesh_images.choose_images(path)
    (tmp_path / "my mesh.mtl").write_text(LIBRARY + "map_Kd other.png\n")
    with pytest.raises(IcyMoonError, match="has 2 albedo images"):
        mesh_images.choose_images(path)
    # Without a library of its own, the one of its name.
    path.write_text("v 0 0 0\n")
    assert mesh_images.find_images(path).files() == []
    (tmp_path / "a.mtl").write_text("map_Kd x.png\n")
    assert mesh_images.choose_images(path)["albedo"].file == tmp_path / "x.png"


def gltf(folder: Path, binary: bytes, images: list[dict], **changed) -> dict:
    """A glTF document with one material of three images."""
    folder.joinpath("a.bin").write_bytes(binary)
    return {
        "meshes": [{"primitives": [{"material": 1}]}],
        "textures": [{"source": k} for k in range(len(images))],
        "images": images,
        "buffers": [{"uri": "a.bin", "byteLength": len(binary)}],
        "bufferViews": [{"buffer": 0, "byteOffset": 3, "byteLength": 4}],
        "materials": [
            {"normalTexture": {"index": 9}},
            {
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": 0, **changed},
                    "metallicRoughnessTexture": {"index": 1},
                },
                "normalTexture": {"index": 2},
            },
        ],
    }


def test_a_gltf_holds_or_names_its_images(tmp_path):
    held = {"uri": "data:image/png;base64," + base64.b64encode(b"inside").decode()}
    document = gltf(tmp_path, b"012data789", [{"bufferView": 0}, {"uri": "my%20map.png"}, held])
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(document))
    found = mesh_images.choose_images(path)
    assert found["albedo"].data() == b"data"
    assert (found["roughness"].file, found["roughness"].channel) == (tmp_path / "my map.png", 1)
    assert found["normal"].data() == b"inside"
    assert set(mesh_images.find_images(path).files()) == {tmp_path / "a.bin", tmp_path / "my map.png", path}
    del document["buffers"][0]["uri"]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    (tmp_path / "a.glb").write_bytes(
        b"glTF"
        + struct.pack("<II", 2, 0)
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", 10, b"BIN\0")
        + b"012data789"
    )
    assert mesh_images.choose_images(tmp_path / "a.glb")["albedo"].data() == b"data"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"texCoord": 1}, "separate UV coordinates"),
        ({"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}, "KHR_texture_transform"),
        ({"extensions": {"KHR_texture_transform": {"scale": [1.0, 1.0], "offset": [0, 0]}}}, ""),
    ],
)
def test_what_cannot_be_followed_is_said(tmp_path, changed, words):
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(gltf(tmp_path, b"012data789", [{"uri": f"{k}.png"} for k in range(3)], **changed)))
    if words:
        with pytest.raises(IcyMoonError, match=f"albedo image .*{words}.*OWN"):
            mesh_images.choose_images(path)
    else:
        assert mesh_images.choose_images(path)["albedo"].file == tmp_path / "0.png"


def test_a_gltf_without_what_it_names_is_a_sentence(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(gltf(tmp_path, b"", [])))
    with pytest.raises(IcyMoonError, match="not a whole glTF"):
        mesh_images.choose_images(path)
