"""Grounds from files: every format, axes, scale, placing, damage, bad input, and truth of the render."""

from __future__ import annotations

import math
import os
import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import OpenEXR
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.ground import import_heights
from icymoon.nodes.ground import user_ground as grounds
from icymoon.nodes.ground.import_heights import read_heights
from icymoon.nodes.ground.import_mesh import read_mesh
from icymoon.physics.mesh.mesh_faults import examine_mesh
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.support.blender import compat
from icymoon.support.errors import IcyMoonError
from mathutils.bvhtree import BVHTree
from mesh_exports import FORMATS, export
from rendering import complete, empty_scene, render
from tiffs import write_tiff


def hill(n: int = 9) -> tuple[Array, Array]:
    """A bumpy, lopsided sheet, 8 m x 4 m, z up: vertices (n², 3) and quadrilaterals."""
    y, x = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    z = 0.5 * np.sin(5 * x) + 0.3 * x * y
    positions = np.stack([8 * x + 3, 4 * y - 1, z + 2], axis=-1).reshape(-1, 3)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return positions, np.stack([k, k + 1, k + n + 1, k + n], 1)


def write_ply(path: Path, positions: Array, faces: Array) -> Path:
    """An ASCII PLY, by hand."""
    lines = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(positions)}",
        "property float x",
        "property float y",
        "property float z",
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    lines += [" ".join(map(str, p)) for p in positions] + [f"{len(f)} " + " ".join(map(str, f)) for f in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def own(path: Path, **source) -> Settings:
    """Settings of a small scene that stands on a file."""
    return complete({"source": {"kind": grounds.find_kind(path), "file": str(path), **source}})


def positions_of(item: bpy.types.Object) -> Array:
    out = np.empty(len(item.data.vertices) * 3, np.float32)
    item.data.attributes["position"].data.foreach_get("vector", out)
    return out.reshape(-1, 3).astype(float)


def everything() -> set:
    """Every data-block by kind and name."""
    return {
        (prop.identifier, block.name)
        for prop in bpy.data.bl_rna.properties
        if prop.type == "COLLECTION"
        for block in getattr(bpy.data, prop.identifier)
    }


def nearest_gaps(a: Array, b: Array) -> float:
    """Largest distance from a vertex of one set to the nearest of the other, both ways."""
    apart = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(max(apart.min(axis=0).max(), apart.min(axis=1).max()))


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_ground_and_leaves_nothing(tmp_path, name):
    positions, faces = hill()
    path = export(tmp_path / name, positions, faces)
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene, cube = bpy.context.scene, bpy.data.objects["Cube"]
    before, selected = everything(), [o.name for o in bpy.context.selected_objects]
    _, triangles, _ = read_mesh(path)
    assert everything() == before
    assert (bpy.context.scene, bpy.context.active_object) == (scene, cube)
    assert [o.name for o in bpy.context.selected_objects] == selected
    assert len(triangles) == 128
    built = scenes.build_scene(scene, own(path, centre=False))
    # Blender's own exporters write z-up scenes as their formats want them: all come back as they were.
    assert nearest_gaps(positions_of(built.terrain), positions) < 1e-5
    assert len(built.terrain.data.vertices) == 81
    assert (examine_mesh(positions_of(built.terrain), read_triangles(built.terrain)).facing_down) == 0
    scenes.clear_scene(scene)
    assert {b for b in everything() if b[0] != "images"} == {b for b in before if b[0] != "images"}


def read_triangles(item: bpy.types.Object) -> Array:
    item.data.calc_loop_triangles()
    return np.array([t.vertices for t in item.data.loop_triangles])


TURNED = {
    "Z": lambda p: p,
    "Y": lambda p: p[:, [0, 2, 1]] * [1, 1, -1],
    "X": lambda p: p[:, [2, 0, 1]],
    "-Z": lambda p: p * [1, -1, -1],
    "-Y": lambda p: p[:, [0, 2, 1]] * [1, -1, 1],
    "-X": lambda p: p[:, [2, 1, 0]] * [-1, 1, 1],
}


@pytest.mark.parametrize("axis", sorted(TURNED))
def test_any_axis_of_the_file_can_be_up(tmp_path, axis):
    positions, faces = hill()
    path = write_ply(tmp_path / "a.ply", TURNED[axis](positions), faces)
    built = scenes.build_scene(empty_scene(), own(path, up_axis=axis, centre=False, repair=False))
    assert np.abs(positions_of(built.terrain) - positions).max() < 1e-5
    assert not any("may point up" in warning for warning in built.warnings)
    if axis in "XY":
        wrong = scenes.build_scene(empty_scene(), own(path))
        assert any(f"point along {axis}" in warning and "source.up_axis" in warning for warning in wrong.warnings)


@pytest.mark.parametrize("name", ["a.obj", "a.glb"])
def test_the_axis_of_formats_that_are_y_up_is_the_files(tmp_path, name):
    positions, faces = hill()
    path = export(tmp_path / name, positions, faces)
    built = scenes.build_scene(empty_scene(), own(path, up_axis="Z", centre=False, repair=False))
    assert nearest_gaps(positions_of(built.terrain), TURNED["Y"](positions)) < 1e-5


@pytest.mark.skipif(compat.find_mesh_importer("USD") is None, reason="this Blender reads no USD")
def test_the_unit_and_the_axis_inside_a_usd_are_followed(tmp_path):
    path = tmp_path / "a.usda"
    path.write_text("""#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
def Mesh "Slab"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 3, 2, 1]
    point3f[] points = [(0, 0, 0), (400, 0, 0), (400, 50, 200), (0, 50, 200)]
}
""")
    built = scenes.build_scene(empty_scene(), own(path))
    unit = 1.0 if compat.applies_usd_unit() else 100.0
    assert np.ptp(positions_of(built.terrain), axis=0) == pytest.approx([4 * unit, 2 * unit, 0.5 * unit])
    assert any("source.scale" in warning for warning in built.warnings) == (unit == 100.0)


def test_scale_centre_and_origin_place_the_ground_and_are_reported(tmp_path):
    positions, faces = hill()
    path = write_ply(tmp_path / "a.ply", positions * 1000, faces)
    built = scenes.build_scene(empty_scene(), own(path, scale=0.001, origin_x_m=1.0, repair=False))
    placed = positions_of(built.terrain)
    expected = positions - [7 + 1, 1, np.median(positions[:, 2])]
    assert np.abs(placed - expected).max() < 1e-5
    text = " ".join(built.ground["report"])
    assert "0.001 m per unit" in text
    assert "Moved by -8, -1, -2." in text
    assert "81 vertices, 128 triangles, 8 x 4 x" in text


def test_the_camera_and_the_blocks_stand_on_the_mesh(tmp_path):
    positions, faces = hill(33)
    path = write_ply(tmp_path / "a.ply", positions, faces)
    settings = description.merged(
        own(path), {"rig": {"x_m": 1.5, "y_m": -0.7, "height_m": 1.25}, "rocks": {"coverage": 0.1}}
    )
    built = scenes.build_scene(empty_scene(), settings)
    bpy.context.view_layer.update()
    hit, where, *_ = built.terrain.ray_cast((1.5, -0.7, 50), (0, 0, -1))
    assert hit
    assert built.camera.location.z == pytest.approx(where.z + 1.25, abs=1e-5)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    blocks = [
        [(i.matrix_world @ v.co).to_tuple() for v in i.object.data.vertices]
        for i in depsgraph.object_instances
        if i.is_instance
    ]
    assert len(blocks) > 5
    for block in blocks:
        ground = [built.terrain.ray_cast((x, y, 50), (0, 0, -1)) for x, y, _ in block]
        assert any(hit for hit, *_ in ground), "a block lies beyond the ground"
        gaps = [z - where.z for (_, _, z), (hit, where, *_) in zip(block, ground, strict=True) if hit]
        assert min(gaps) < 1e-4, "a block floats"


def test_beside_the_ground_the_camera_takes_the_nearest_height_and_says_so(tmp_path):
    positions, faces = hill()
    path = write_ply(tmp_path / "a.ply", positions, faces)
    built = scenes.build_scene(empty_scene(), description.merged(own(path), {"rig": {"x_m": 30.0}}))
    assert math.isfinite(built.camera.location.z)
    assert any("no ground under the camera" in warning for warning in built.warnings)


def test_damage_is_reported_and_mended(tmp_path):
    positions, faces = hill()
    broken = faces[:-1].copy()
    broken[:20] = broken[:20, ::-1]
    positions = np.concatenate([positions, [(math.nan, 0, 0)], positions[:3]])
    broken = np.concatenate([broken, [(80, 79, 81, 81)], [(5, 5, 6, 6)]])
    path = write_ply(tmp_path / "a.ply", positions, broken)
    with pytest.raises(IcyMoonError, match=r"1 vertex without finite coordinates.*source\.repair"):
        scenes.build_scene(empty_scene(), own(path, repair=False))
    built = scenes.build_scene(empty_scene(), own(path))
    text = " ".join(built.ground["report"])
    for words in (
        "1 vertex without finite coordinates",
        "3 duplicate vertices",
        "flipped",
        "faces down",
        "Repaired: 80",
    ):
        assert words in text, text
    assert examine_mesh(positions_of(built.terrain), read_triangles(built.terrain)).facing_down == 0
    assert len(built.terrain.data.polygons) == 2 * 63


def test_coordinates_on_a_map_of_the_world_keep_their_precision(tmp_path):
    positions, faces = hill()
    away = np.array([500000.0, 4500000.0, 0.0])
    path = write_ply(tmp_path / "a.ply", positions + away, faces)
    path.write_text(path.read_text().replace("property float", "property double"))
    built = scenes.build_scene(empty_scene(), own(path, repair=False))
    expected = positions - [7, 1, np.median(positions[:, 2])]
    assert np.abs(positions_of(built.terrain) - expected).max() < 1e-5
    assert built.warnings == ()
    halves = np.round(2 * positions + 2 * away) / 2  # all that single precision leaves at 4500 km
    coarse = write_ply(tmp_path / "b.ply", halves, faces)
    assert any("rounded to 0.5 units" in warning for warning in scenes.build_scene(empty_scene(), own(coarse)).warnings)


def test_an_unlikely_size_is_said(tmp_path):
    positions, faces = hill()
    built = scenes.build_scene(empty_scene(), own(write_ply(tmp_path / "a.ply", positions * 0.01, faces)))
    assert any("is 0.08 m wide" in warning and "source.scale" in warning for warning in built.warnings)


@pytest.mark.parametrize(
    ("size", "height_m", "doubted"),
    [
        (1000.0, 1.6, True),
        (1.0, 1.6, False),
        (1000.0, 2000.0, False),
        (4.0, 1.6, False),
        (5.0, 1.6, True),
        (1.0, 9.0, True),
        (0.01, 1.6, True),
    ],
)
def test_a_mesh_whose_unit_does_not_fit_the_camera_is_doubted(tmp_path, size, height_m, doubted):
    """8 m with triangles of 1 m: in millimetres one fills the image, and a camera at 9 m sees beyond all of them."""
    positions, faces = hill()
    settings = description.merged(
        own(write_ply(tmp_path / "a.ply", positions * size, faces)), {"rig": {"height_m": height_m}}
    )
    said = [warning for warning in scenes.build_scene(empty_scene(), settings).warnings if "source.scale" in warning]
    assert len(said) == doubted, said
    if size == 1000.0 and doubted:
        assert re.fullmatch(
            r"a\.ply is 8e\+03 m wide with triangles of \S+ m, and the camera is 1\.6 m above it; if "
            r"its unit is not what you meant, set source\.scale \(0\.001 for millimetres\)\.",
            said[0],
        )


def with_horizon(positions, faces, far_m):
    """The mesh, and below it two triangles out to a far distance, as our exports have the ground out to the horizon."""
    corners = [(x * far_m, y * far_m, -far_m / 50) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    n = len(positions)
    return np.concatenate([positions, corners]), [*faces, (n, n + 1, n + 2), (n, n + 2, n + 3)]


def test_a_site_with_the_ground_out_to_its_horizon_is_read_whole(tmp_path):
    """119 km on Europa under a camera at 1.6 m, with relief on the horizon; the millimetres of a site are refused."""
    positions, faces = hill()
    fine = positions * 0.01  # triangles of 1 cm
    path = write_ply(tmp_path / "a.ply", *with_horizon(fine, faces, 6e4))
    settings = description.merged(own(path), {"source": {"centre": False}})
    built = scenes.build_scene(empty_scene(), settings)
    assert not [warning for warning in built.warnings if "source.scale" in warning]
    assert len(positions_of(built.terrain)) == len(positions) + 4
    assert len(read_triangles(built.terrain)) == 2 * len(faces) + 2
    for found, far_m, words in (
        (fine, 4e6, r"cut off what is far .* or set source\.scale"),
        (positions * 2e4, 9e4, r"source\.scale"),
    ):
        path = write_ply(tmp_path / "b.ply", *with_horizon(found, faces, far_m))
        with pytest.raises(IcyMoonError, match=rf"outside the size of a landing site .*{words}"):
            scenes.build_scene(empty_scene(), own(path))


def test_a_scene_of_blender_is_no_ground_under_any_name(tmp_path):
    """Of such a file nothing is run or loaded: its texts and drivers would run where scripts are allowed."""
    mark, path = tmp_path / "run", tmp_path / "a.blend"
    scene = empty_scene()
    text = bpy.data.texts.new("run.py")
    text.write(f"open({str(mark)!r}, 'w')")
    text.use_module = True
    thing = bpy.data.objects.new("thing", None)
    scene.collection.objects.link(thing)
    thing.driver_add("location", 0).driver.expression = f"open({str(mark)!r}, 'w') and 1"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    mark.unlink(missing_ok=True)
    for suffix in grounds.SUFFIXES:
        named = Path(shutil.copy(path, tmp_path / f"b{suffix}"))
        with pytest.raises(IcyMoonError, match=r"^[^\n]*\Z") as caught:
            scenes.build_scene(empty_scene(), own(named))
        assert str(named) in str(caught.value)
    assert not mark.exists()
    assert "run.py" not in bpy.data.texts


def bad_inputs(folder: Path) -> dict[str, tuple[Path, dict, str]]:
    """Name, file, settings and the words that the error must have."""
    positions, faces = hill(3)
    (folder / "text.obj").write_text("hello")
    (folder / "empty.ply").write_text("")
    (folder / "torn.glb").write_bytes(b"glTF\2\0\0\0\xff\xff\0\0\x10\0\0\0JSON{")
    (folder / "no_faces.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (folder / "nothing.obj").write_text("# nothing\n")
    (folder / "torn.stl").write_bytes(b"x" * 80 + struct.pack("<I", 1000) + bytes(60))
    (folder / "torn.fbx").write_bytes(b"Kaydara FBX Binary  \0\x1a\0" + bytes(40))
    (folder / "torn.usda").write_text('#usda 1.0\ndef Mesh "a" {')
    (folder / "mesh.jpg").write_bytes(b"\xff\xd8")
    (folder / "picture.png").write_bytes(b"\xff\xd8\xff\xe0")
    (folder / "torn.png").write_bytes(png(np.zeros((9, 9), np.uint16))[:60])
    (folder / "colour.png").write_bytes(png(np.zeros((9, 9), np.uint8), colour=2))
    (folder / "torn.exr").write_bytes(b"\x76\x2f\x31\x01\2\0\0\0channels\0chlist\0\x12\0\0\0Y\0")
    whole = height_files(folder)["exr"][0].read_bytes()
    (folder / "half.exr").write_bytes(whole[: len(whole) // 2])
    OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage},
        {"height": np.zeros((9, 9), np.float32)},
    ).write(str(folder / "named.exr"))
    np.save(folder / "three.npy", np.zeros((3, 3, 3)))
    np.save(folder / "objects.npy", np.array([["a"]], object), allow_pickle=True)
    np.save(folder / "thin.npy", np.zeros((1, 5)))
    np.save(folder / "nan.npy", np.full((5, 5), np.nan))
    np.save(folder / "flat.npy", np.zeros((5, 5)))
    write_tiff(folder / "degrees.tif", np.zeros((5, 5), np.float32), pixel=(1e-4, 1e-4), geographic=True)
    write_tiff(folder / "feet.tif", np.zeros((5, 5), np.float32), pixel=(3.0, 3.0), keys={3072: 2263})
    np.save(folder / "absurd.npy", np.array([[0.0, 1e29], [1.0, 2.0]]))
    np.save(folder / "lost.npy", np.full((5, 5), 1e300))
    write_tiff(folder / "plain.tif", np.zeros((5, 5), np.float32))
    cases: dict[str, tuple[Any, dict, str]] = {
        "absent mesh": ("absent.ply", {}, "cannot be read"),
        "wrong mesh": ("text.obj", {}, "not an OBJ file"),
        "empty file": ("empty.ply", {}, "is empty"),
        "torn glb": ("torn.glb", {}, "torn.glb"),
        "point cloud": ("no_faces.obj", {}, "point cloud"),
        "no mesh": ("nothing.obj", {}, "contains no mesh"),
        "torn stl": ("torn.stl", {}, "torn.stl"),
        "torn fbx": ("torn.fbx", {}, "torn.fbx"),
        "torn usd": ("torn.usda", {}, "torn.usda"),
        "wrong kind": ("mesh.jpg", {"kind": "MESH"}, "not a mesh"),
        "no area": (write_ply(folder / "line.ply", positions * [1, 0, 0], faces), {}, "has an area"),
        "all nan": (write_ply(folder / "nan.ply", positions * math.nan, faces), {}, "none of its 9 vertices"),
        "tiny": (write_ply(folder / "tiny.ply", positions * 1e-5, faces), {}, "source.scale"),
        "vast": (write_ply(folder / "vast.ply", positions, faces), {"scale": 1e6}, "source.scale"),
        "wrong png": ("picture.png", {"metres_per_pixel": 1}, "not a PNG"),
        "torn png": ("torn.png", {"metres_per_pixel": 1}, "torn.png"),
        "colour png": ("colour.png", {"metres_per_pixel": 1}, "colour image"),
        "torn exr": ("torn.exr", {"metres_per_pixel": 1}, "torn.exr"),
        "exr channel": ("named.exr", {"metres_per_pixel": 1}, "one channel called Y"),
        "half exr": ("half.exr", {"metres_per_pixel": 1}, "half.exr"),
        "cube of numbers": ("three.npy", {"metres_per_pixel": 1}, "(3, 3, 3)"),
        "objects": ("objects.npy", {"metres_per_pixel": 1}, "objects.npy"),
        "thin": ("thin.npy", {"metres_per_pixel": 1}, "5 x 1"),
        "nan": ("nan.npy", {"metres_per_pixel": 1}, "is a height"),
        "no pixel size": ("flat.npy", {}, "source.metres_per_pixel"),
        "plain tiff": ("plain.tif", {}, "metres_per_pixel"),
        "degrees": ("degrees.tif", {}, "degrees"),
        "unknown unit": ("feet.tif", {}, "EPSG:2263"),
        "absurd heights": ("absurd.npy", {"metres_per_pixel": 1}, "relief of 1e+29 m"),
        "heights beyond any number": ("lost.npy", {"metres_per_pixel": 1}, "is a height"),
        "tall mesh": (write_ply(folder / "tall.ply", positions * [1, 1, 1e30], faces), {}, "relief"),
        "far off": ("flat.npy", {"metres_per_pixel": 1, "origin_x_m": 500.0}, "source.origin_x_m"),
        "height map kind": ("no_faces.obj", {"kind": "HEIGHT_MAP"}, "not a height map"),
        "no file": ("", {"kind": "MESH"}, "source.file is empty"),
    }
    return {
        name: (Path(file) if not file or Path(file).is_absolute() else folder / file, source, words)
        for name, (file, source, words) in cases.items()
    }


def test_bad_input_is_a_sentence_and_changes_nothing(tmp_path):
    scene = empty_scene()
    scenes.build_scene(scene, complete())
    before, mark = everything(), scenes.find_built(scene).extra
    for name, (path, source, words) in bad_inputs(tmp_path).items():
        settings = complete(
            {
                "source": {
                    "kind": source.get("kind") or grounds.find_kind(path),
                    "file": str(path) if path.name else "",
                    **source,
                }
            }
        )
        if path.suffix == ".usda" and compat.find_mesh_importer("USD") is None:
            words = "cannot read USD"
        try:
            scenes.build_scene(scene, settings)
            pytest.fail(f"{name} was accepted")
        except IcyMoonError as error:
            message = str(error)
        assert words in message, f"{name}: {message}"
        assert "\n" not in message, name
        assert everything() == before, name
        assert scenes.find_built(scene).extra == mark, name


def png(values: Array, colour: int = 0) -> bytes:
    """A PNG of 8 or 16-bit values, unfiltered."""
    import zlib

    rows, columns = values.shape
    bits = 8 * values.dtype.itemsize
    plain = np.repeat(values[:, :, None], 3, 2).reshape(rows, -1) if colour == 2 else values
    raw = b"".join(b"\0" + row.astype(f">u{bits // 8}").tobytes() for row in plain)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, bits, colour, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(raw))
        + chunk(b"IEND", b"")
    )


def crater(rows: int = 41, columns: int = 61) -> Array:
    """Heights in metres with a range of about 4 m, north first."""
    y, x = np.meshgrid(np.linspace(1, -1, rows), np.linspace(-1, 1, columns), indexing="ij")
    return 3 * np.hypot(x + 0.2, y) ** 2 - 1.5 * np.exp(-20 * (x**2 + (y - 0.3) ** 2)) + 0.2 * x


def height_files(folder: Path) -> dict[str, tuple[Path, dict, float, float]]:
    """A crater in each kind of file: the settings it needs, what was added to it and its rounding, in metres."""
    heights = crater()
    np.save(folder / "a.npy", heights)
    (folder / "a16.png").write_bytes(png(np.rint((heights + 2) / 2e-4).astype(np.uint16)))
    (folder / "a8.png").write_bytes(png(np.rint((heights + 2) / 0.05).astype(np.uint8)))
    write_tiff(
        folder / "a.tif",
        heights.astype(np.float32),
        pixel=(0.5, 0.5),
        deflate=True,
        predictor=3,
        tie=(0, 0, 0, 7000.0, -3000.0, 0),
    )
    write_tiff(folder / "i.tif", np.rint(heights / 0.001).astype(np.int16), pixel=(0.5, 0.5), order=">")
    image = bpy.data.images.new("Heights", 61, 41, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((41, 61, 4), np.float32)
    pixels[..., :3] = heights[::-1, :, None]
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = str(folder / "a.exr"), "OPEN_EXR"
    image.save()
    bpy.data.images.remove(image)
    half = {"metres_per_pixel": 0.5}
    return {
        "npy": (folder / "a.npy", half, 0.0, 1e-12),
        "png16": (folder / "a16.png", half | {"height_scale_m": 2e-4}, 2.0, 1.001e-4),
        "png8": (folder / "a8.png", half | {"height_scale_m": 0.05}, 2.0, 0.02501),
        "float tiff": (folder / "a.tif", {}, 0.0, 2.5e-7),
        "int16 tiff": (folder / "i.tif", {"height_scale_m": 0.001}, 0.0, 5.001e-4),
        "exr": (folder / "a.exr", half, 0.0, 2.5e-7),
    }


@pytest.mark.parametrize("kind", ["npy", "png16", "png8", "float tiff", "int16 tiff", "exr"])
def test_heights_are_within_the_files_quantisation(tmp_path, kind):
    empty_scene()
    path, source, added, rounding = height_files(tmp_path)[kind]
    before = everything()
    values = read_heights(path).values * source.get("height_scale_m", 1.0)
    assert everything() == before
    assert np.abs(values - added - crater()).max() <= rounding
    settings = description.merged(own(path, **source), {"terrain": {"size_m": 100.0, "resolution": 401}})
    built = scenes.build_scene(empty_scene(), settings)
    vertices = positions_of(built.terrain)
    assert np.ptp(vertices, axis=0)[:2] == pytest.approx([30.0, 20.0])
    grid = vertices.reshape(-1, round(30 / 0.25) + 1, 3)[::-2, ::2]  # every other vertex is at a pixel
    assert np.abs(grid[..., 2] - (values - np.median(values))).max() < 1e-5
    assert np.median(grid[..., 2]) == pytest.approx(0.0, abs=1e-6)


def test_missing_heights_are_filled_and_their_share_is_said(tmp_path):
    heights = crater().astype(np.float32)
    heights[10:14, 20:26] = -9999
    path = write_tiff(tmp_path / "a.tif", heights, pixel=(0.5, 0.5), nodata="-9999")
    built = scenes.build_scene(empty_scene(), own(path))
    assert any("0.96% of a.tif" in warning for warning in built.warnings)
    assert positions_of(built.terrain)[:, 2].min() > -5


@pytest.mark.parametrize("name", ["kilometres", "south_up", "mirrored", "lzw_words", "unit_name"])
def test_the_ground_of_a_geotiff_is_the_hill_that_it_states(name):
    """From the file that GDAL wrote to the vertices: metres, north up, whatever its units and directions."""
    path = Path(__file__).parents[2] / "data" / "heights" / f"{name}.tif"
    settings = own(path, centre=False, origin_x_m=1000.0, origin_y_m=-500.0)
    settings = description.merged(settings, {"terrain": {"size_m": 60.0, "resolution": 31}})
    built = scenes.build_scene(empty_scene(), settings)
    east, north, height = positions_of(built.terrain).T
    hill = 40.0 + 0.5 * east + 0.25 * north + 0.01 * east * north  # bilinear, as is the ground between pixels
    step = 0.004 if name == "lzw_words" else 0.0
    assert np.abs(height - hill).max() < step / 2 + 2e-5  # vertices are float32
    known = ("under the camera", "clockwise of the map's up", "no unit for its heights")
    assert all(any(words in warning for words in known) for warning in built.warnings)


def test_a_height_map_too_large_for_the_memory_is_named(tmp_path, monkeypatch):
    def too_large(path, site, missing):
        raise MemoryError

    monkeypatch.setattr(import_heights.geotiff, "read", too_large)
    path = write_tiff(tmp_path / "large.tif", np.zeros((9, 9), np.float32))
    with pytest.raises(IcyMoonError, match=r"large\.tif: is too large for the memory.*cut out"):
        scenes.build_scene(empty_scene(), own(path))


def test_a_relief_larger_than_the_map_is_said(tmp_path):
    np.save(tmp_path / "a.npy", 10.0 * crater())
    built = scenes.build_scene(empty_scene(), own(tmp_path / "a.npy", metres_per_pixel=0.1))
    assert any("source.height_scale_m" in warning for warning in built.warnings)


def test_roughness_can_be_added_below_the_pixel(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((41, 41)))
    flat = scenes.build_scene(empty_scene(), own(tmp_path / "a.npy", metres_per_pixel=1.0))
    assert np.ptp(positions_of(flat.terrain)[:, 2]) == 0.0
    rough = scenes.build_scene(empty_scene(), own(tmp_path / "a.npy", metres_per_pixel=1.0, detail=True))
    assert 0.005 < positions_of(rough.terrain)[:, 2].std() < 0.2


def test_roughness_can_be_added_along_the_normals_of_a_mesh(tmp_path):
    positions, faces = hill()
    level = positions * [1, 1, 0]
    wall = write_ply(tmp_path / "wall.ply", level[:, [0, 2, 1]] + [0, 0, 3], faces)
    settings = description.merged(own(wall, detail=True), {"terrain": {"size_m": 20.0, "resolution": 201}})
    built = scenes.build_scene(empty_scene(), settings)
    vertices = positions_of(built.terrain)
    assert len(built.terrain.data.polygons) == 128 * 4**4  # edges of 1 m in the median, vertices wanted 0.1 m apart
    assert 0.002 < vertices[:, 1].std() < 0.3  # a wall is roughened sideways
    assert np.ptp(vertices[:, 0]) == pytest.approx(8.0, abs=1e-5)
    assert any("Roughness of 0.125 to 2 m added on 32768" in line for line in built.ground["report"])


def test_pairs_are_named_by_the_files_content_not_its_place(tmp_path):
    positions, faces = hill()
    ids, scene = [], empty_scene()
    (tmp_path / "b").mkdir()
    for path, height in ((tmp_path / "a.ply", 0.0), (tmp_path / "b" / "a.ply", 0.0), (tmp_path / "a.ply", 0.5)):
        moved = positions.copy()
        moved[40, 2] += height
        settings = own(write_ply(path, moved, faces))
        built = scenes.find_built(scene)
        assert built is None or "source.file" in scenes.list_changed_settings(built, settings)
        built = scenes.build_scene(scene, settings)
        assert not built.edited
        assert scenes.list_changed_settings(built, settings) == []
        ids.append(expand_headings(settings, built.extra)[0].id)
    assert ids[0] == ids[1] != ids[2]
    (tmp_path / "a.ply").unlink()
    assert scenes.list_changed_settings(built, settings) == []  # what was built is still there
    assert expand_headings(complete(), "")[0].id == expand_headings(complete({"source": {"file": "x.ply"}}), "")[0].id


def test_the_depth_of_a_rendered_mesh_is_that_of_a_ray_cast(tmp_path):
    positions, faces = hill(65)
    path = write_ply(tmp_path / "a.ply", positions, faces)
    pair, built = render(
        tmp_path / "set", {"source": {"kind": "MESH", "file": str(path)}, "rig": {"height_m": 1.5, "pitch_deg": 60.0}}
    )
    assert pair.data["ground"]["report"][0].startswith("PLY, Z up")
    depth = read_view(pair.image("left")).depth
    pose = np.array(pair.data["poses_camera_to_world"]["left"])
    tree = BVHTree.FromPolygons(positions_of(built.terrain).tolist(), read_triangles(built.terrain).tolist())
    checked = 0
    for v, u in np.random.default_rng(0).integers((0, 0), depth.shape, (60, 2)):
        ray = pose[:3, :3] @ (
            (u + 0.5 - pair.camera.cx_px) / pair.camera.focal_px,
            (v + 0.5 - pair.camera.cy_px) / pair.camera.focal_px,
            1.0,
        )
        hit, _, _, distance = tree.ray_cast(pose[:3, 3].tolist(), ray.tolist())
        if hit is None:
            assert not np.isfinite(depth[v, u]) or depth[v, u] > 1e9
        else:
            assert depth[v, u] == pytest.approx(distance / np.linalg.norm(ray), rel=2e-4)
            checked += 1
    assert checked > 40


def test_a_large_mesh_says_its_cost_before_it_is_loaded(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nelement face 50000000\nend_header\n")
    (warning,) = grounds.warn_of_cost(own(path))
    assert "50 million triangles" in warning
    small = write_ply(tmp_path / "b.ply", *hill())
    assert grounds.warn_of_cost(own(small)) == []


def test_the_operator_imports_builds_and_takes_back_what_failed(scene, tmp_path):
    path = write_ply(tmp_path / "a.ply", *hill())
    scene.icymoon.terrain.resolution = 65
    assert bpy.ops.icymoon.import_ground(filepath=str(path)) == {"FINISHED"}
    assert scene.icymoon.source.kind == "MESH"
    built = scenes.find_built(scene)
    assert len(built.terrain.data.polygons) == 128
    from icymoon.operators.import_ground import list_report_lines

    assert any("81 vertices" in line for line in list_report_lines(scene))
    (tmp_path / "dem.asc").write_text("ncols 2\n")
    for bad in ("absent.ply", "a.jpg", "dem.asc.*gdal_translate"):
        with pytest.raises(RuntimeError, match=bad):
            bpy.ops.icymoon.import_ground(filepath=str(tmp_path / bad.partition(".*")[0]))
    assert scene.icymoon.source.file == str(path)
    shown = bpy.ops.icymoon.import_ground.get_rna_type().properties["filter_glob"].default.split(";")
    assert {"*.ply", "*.tif", "*.asc", "*.hgt", "*.img", "*.lbl"} <= set(shown)


@pytest.mark.long
def test_the_command_line_renders_an_imported_ground(tmp_path):
    pytest.importorskip("rich")  # which the command line shows its progress with
    write_ply(tmp_path / "a.ply", *hill())
    (tmp_path / "scene.toml").write_text('[source]\nkind = "MESH"\nfile = "a.ply"\n')
    words = ["terrain.resolution=65", "quality.samples=1", "rig.width_px=32", "rig.height_px=24", "quality.threads=1"]
    command = [
        sys.executable,
        "-m",
        "icymoon",
        "render",
        "--out",
        str(tmp_path / "set"),
        *(w for text in words for w in ("--set", text)),
    ]
    one = subprocess.run(
        [*command, "--settings", str(tmp_path / "scene.toml")], capture_output=True, text=True, timeout=240, check=False
    )
    assert one.returncode == 0, one.stderr
    again = subprocess.run(
        [*command, "--set", "source.kind=MESH", "--set", "source.file=a.ply"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert "was already there" in again.stdout, again.stdout + again.stderr
    shutil.copy(tmp_path / "a.ply", tmp_path / "b.ply")
    os.truncate(tmp_path / "b.ply", 300)
    bad = subprocess.run(
        [*command, "--set", "source.kind=MESH", "--set", f"source.file={tmp_path / 'b.ply'}"],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert bad.returncode == 1
    assert "b.ply" in bad.stderr
    assert len(bad.stderr.strip().splitlines()) == 1
