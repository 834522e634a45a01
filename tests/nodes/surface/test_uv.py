"""Images by UV coordinates: each colour lies where the file says, whatever was mended or added; clear refusals."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.benchmarks.light.furnace import radiance
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.datablocks.fingerprint import TAG, find_instanced_objects
from icymoon.nodes.ground.import_mesh import read_mesh
from icymoon.nodes.surface import images
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.settings import description
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import UV_LAYER
from mesh_exports import FORMATS, export
from obj_files import obj
from rendering import complete, empty_scene, png

SIDE_M, CELLS = 4.0, 8
#: Linear colours of the image's lower left, lower right, upper left and upper right quarter.
QUARTERS = np.array([[(0.8, 0.2, 0.2), (0.2, 0.8, 0.2)], [(0.2, 0.2, 0.8), (0.6, 0.6, 0.1)]])
ALBEDO = 0.3
PIXELS = 32
#: How far the ground is moved west, so that no middle of a pixel is on an edge of a triangle, where rays may miss.
ASIDE_M = 0.013


def as_srgb(linear: Array) -> Array:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def quarters(path: Path) -> Path:
    """An image of 16 x 16 pixels whose quarters are these colours."""
    return png(path, as_srgb(np.repeat(np.repeat(QUARTERS, 8, axis=0), 8, axis=1)))


def layout(x: Array, y: Array, east: Array) -> Array:
    """UV of places on the ground: turned and mirrored, the east half beginning anew where the west half ends, so
    that a seam runs along x = 0."""
    return np.stack([(y + 2) / 4, np.where(east, (x + 2) / 4 - 0.5, (x + 2) / 4 + 0.5)], axis=-1)


def ground() -> tuple[Array, Array, Array]:
    """A level square as triangles, with the UV of their corners."""
    axis = np.linspace(-SIDE_M / 2, SIDE_M / 2, CELLS + 1)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    n = CELLS + 1
    k = (np.arange(CELLS)[:, None] * n + np.arange(CELLS)).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + n + 1], 1), np.stack([k, k + n + 1, k + n], 1)])
    positions = np.stack([x, y, np.zeros_like(x)], axis=1)
    corner = positions[faces]
    return positions, faces, layout(corner[..., 0], corner[..., 1], corner[..., :1].mean(axis=1) > 0)


def glb(
    path: Path,
    positions: Array,
    faces: Array,
    layers: list[Array],
    images: dict[str, Path],
    textures: dict[str, str],
) -> Path:
    """A binary glTF, z up as its coordinates are, with a vertex for each corner; ``textures`` says which image is for
    which use. V runs down in glTF."""
    own = np.arange(faces.size, dtype="<u4")
    arrays = [
        positions[faces].reshape(-1, 3).astype("<f4"),
        own,
        *((uv.reshape(-1, 2) * (1, -1) + (0, 1)).astype("<f4") for uv in layers),
    ]
    chunks = [a.tobytes() for a in arrays] + [file.read_bytes() for file in images.values()]
    chunks = [chunk + b"\0" * (-len(chunk) % 4) for chunk in chunks]
    starts = np.cumsum([0, *map(len, chunks)]).tolist()
    views = [{"buffer": 0, "byteOffset": starts[k], "byteLength": len(chunk)} for k, chunk in enumerate(chunks)]
    place = {name: {"index": list(images).index(image)} for name, image in textures.items()}
    pbr = {name: place[name] for name in ("baseColorTexture", "metallicRoughnessTexture") if name in place}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "buffers": [{"byteLength": starts[-1]}],
        "bufferViews": views,
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": len(own),
                "type": "VEC3",
                "min": positions.min(axis=0).tolist(),
                "max": positions.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5125, "count": len(own), "type": "SCALAR"},
            *(
                {"bufferView": 2 + k, "componentType": 5126, "count": len(own), "type": "VEC2"}
                for k in range(len(layers))
            ),
        ],
        "images": [{"bufferView": len(arrays) + k, "mimeType": "image/png"} for k in range(len(images))],
        "textures": [{"source": k} for k in range(len(images))],
        "materials": [
            {"pbrMetallicRoughness": pbr, **{name: place[name] for name in ("normalTexture",) if name in place}}
        ],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0, **{f"TEXCOORD_{k}": 2 + k for k in range(len(layers))}},
                        "indices": 1,
                        "material": 0,
                    }
                ]
            }
        ],
    }
    text = json.dumps({key: value for key, value in document.items() if value != []}).encode()
    text += b" " * (-len(text) % 4)
    path.write_bytes(
        b"glTF"
        + struct.pack("<II", 2, 28 + len(text) + starts[-1])
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", starts[-1], b"BIN\0")
        + b"".join(chunks)
    )
    return path


def corner_ply(path: Path, positions: Array, faces: Array, uv: Array) -> Path:
    """A PLY that has its UV in the faces."""
    lines = [
        "ply",
        "format ascii 1.0",
        "comment TextureFile quarters.png",
        f"element vertex {len(positions)}",
        "property float x",
        "property float y",
        "property float z",
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "property list uchar float texcoord",
        "end_header",
    ]
    lines += [" ".join(map(repr, p)) for p in positions.tolist()]
    lines += [
        " ".join(map(repr, [3, *f, 6, *t])) for f, t in zip(faces.tolist(), uv.reshape(-1, 6).tolist(), strict=True)
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def vertex_ply(names: tuple[str, str]) -> Callable[..., Path]:
    """Writer of a PLY that has a vertex for each corner, its UV under these names."""

    def write(path: Path, positions: Array, faces: Array, uv: Array) -> Path:
        rows = np.concatenate([positions[faces].reshape(-1, 3), uv.reshape(-1, 2)], axis=1)
        lines = [
            "ply",
            "format ascii 1.0",
            f"element vertex {len(rows)}",
            "property float x",
            "property float y",
            "property float z",
            *(f"property float {name}" for name in names),
            f"element face {len(faces)}",
            "property list uchar int vertex_indices",
            "end_header",
        ]
        lines += [" ".join(map(repr, row)) for row in rows.tolist()]
        lines += [f"3 {3 * k} {3 * k + 1} {3 * k + 2}" for k in range(len(faces))]
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def seen_by_obj(path: Path, positions: Array, faces: Array, uv: Array) -> Path:
    (path.parent / "a.mtl").write_text("newmtl a\nmap_Kd quarters.png\n")
    return obj(path, positions, faces, uv, "mtllib a.mtl\nusemtl a")


def seen_by_glb(path: Path, positions: Array, faces: Array, uv: Array) -> Path:
    return glb(
        path,
        positions,
        faces,
        [uv, 1 - uv],
        {"quarters": path.parent / "quarters.png"},
        {"baseColorTexture": "quarters"},
    )


WRITERS: dict[str, Callable[..., Path]] = {
    "a.obj": seen_by_obj,
    "a.glb": seen_by_glb,
    "a.ply": corner_ply,
    "st.ply": vertex_ply(("s", "t")),
    "uv.ply": vertex_ply(("u", "v")),
    "texture.ply": vertex_ply(("texture_u", "texture_v")),
}


def described(path: Path, textures: dict, source: dict | None = None, *more: dict) -> Settings:
    """Settings of a plain matt ground from a file, the Sun in the zenith."""
    return complete(
        {
            "source": {"kind": "MESH", "file": str(path), "up_axis": "Z", "origin_x_m": ASIDE_M, **(source or {})},
            "surface": {"model": "LAMBERT", "albedo": ALBEDO, "grain_amplitude_m": 0.0},
            "light": {"sun_elevation_deg": 90.0, "planet": False, "sun_angular_diameter_deg": 0.0},
            "textures": textures,
        },
        *more,
    )


def above(settings: Settings, samples: int = 4) -> Array:
    """Reflectance (PIXELS, PIXELS, 3) of the ground seen from above, row 0 southernmost and column 0 westernmost:
    radiance over that of level, white ground under a Sun in the zenith."""
    scene = empty_scene()
    scenes.build_scene(scene, settings)
    scene.render.engine, scene.cycles.samples = "CYCLES", samples
    return radiance(scene, 0.0, SIDE_M, PIXELS)[::-1, ::-1] * np.pi / settings.light.sun_irradiance_wm2


def expected(wanted: Array | None = None) -> Array:
    """The colours (PIXELS, PIXELS, 3) of the image, or of another (2, 2, 3), where the layout puts them."""
    axis = (np.arange(PIXELS) + 0.5) / PIXELS * SIDE_M - SIDE_M / 2
    x, y = np.meshgrid(axis + ASIDE_M, axis)
    uv = layout(x, y, x > 0)
    colours = QUARTERS if wanted is None else wanted
    return colours[(uv[..., 1] >= 0.5).astype(int), (uv[..., 0] >= 0.5).astype(int)]


def inner() -> Array:
    """Pixels that are more than a pixel of the image from the borders of the quarters."""
    axis = (np.arange(PIXELS) + 0.5) / PIXELS * SIDE_M - SIDE_M / 2
    near = np.abs(axis) < SIDE_M / 16  # the image's pixels are blended over that; the seam is sharp, but there too
    rim = np.abs(np.abs(axis) - SIDE_M / 2) < SIDE_M / 16  # where the repeat is blended in
    away = ~near & ~rim
    return away[:, None] & away[None, :]


def assert_laid(found: Array, tolerance: float = 0.015) -> None:
    """The mean colour is the albedo's; each quarter is where it belongs, in its colour."""
    wanted = expected()
    wanted = ALBEDO * wanted / QUARTERS.mean()
    assert found[inner()] == pytest.approx(wanted[inner()], rel=tolerance)


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_puts_the_colours_where_they_were_baked(tmp_path, name):
    image = quarters(tmp_path / "quarters.png")
    path = WRITERS[name](tmp_path / name, *ground())
    by_file = above(described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)}))
    assert_laid(by_file)
    if name in ("a.obj", "a.glb", "a.ply"):
        assert np.array_equal(above(described(path, {"set": "MESH"})), by_file)
    else:
        with pytest.raises(IcyMoonError, match=r"has no images.*textures\.set to OWN"):
            scenes.build_scene(empty_scene(), described(path, {"set": "MESH"}))


@pytest.mark.parametrize("name", FORMATS)
def test_what_blender_writes_comes_back(tmp_path, name):
    positions, faces, uv = ground()
    path = export(tmp_path / name, positions, faces, Baked=uv)
    built = scenes.build_scene(
        empty_scene(), complete({"source": {"kind": "MESH", "file": str(path), "centre": False}})
    )
    mesh = built.terrain.data
    if name == "a.stl":  # which has no place for them
        assert UV_LAYER not in mesh.attributes
        return
    corners = np.array([mesh.vertices[loop.vertex_index].co for loop in mesh.loops]).reshape(-1, 3, 3)
    found = np.array([item.vector for item in mesh.attributes[UV_LAYER].data]).reshape(-1, 3, 2)
    east = corners[..., :1].mean(axis=1) > 0
    wanted = layout(corners[..., 0], corners[..., 1], east)
    # A PLY has one place on the image for each vertex, of which Blender's exporter makes several along a seam.
    assert found == pytest.approx(wanted, abs=1e-5)


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "st.ply"])
def test_mending_scale_and_placing_leave_the_colours_where_they_were(tmp_path, name):
    image = quarters(tmp_path / "quarters.png")
    positions, faces, uv = ground()
    n = len(positions)
    positions = np.concatenate([positions, positions[:CELLS], [(5.0, 5.0, np.nan)]])
    faces[faces == 0] = n  # a vertex that is there twice
    flipped = np.arange(len(faces)) % 3 == 0
    faces[flipped], uv[flipped] = faces[flipped][:, ::-1], uv[flipped][:, ::-1]
    faces = np.concatenate([[(0, 0, 1)], faces, faces[:4], [(3, 4, n + CELLS)]])
    uv = np.concatenate([np.zeros((1, 3, 2)), uv, uv[:4], np.zeros((1, 3, 2))])
    path = WRITERS[name](tmp_path / name, 1000 * positions + [7000, -3000, 0], faces, uv)
    settings = described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)}, {"scale": 0.001})
    assert_laid(above(settings))
    built = scenes.find_built(bpy.context.scene)
    assert len(built.terrain.data.polygons) == 2 * CELLS**2
    assert any("UV coordinates from 0 to 1 and 0 to 1" in line for line in built.ground["report"])


def test_added_roughness_leaves_the_colours_where_they_were(tmp_path):
    image = quarters(tmp_path / "quarters.png")
    path = WRITERS["a.obj"](tmp_path / "a.obj", *ground())
    finer = {"terrain": {"size_m": 4.0, "resolution": 33, "rms_slope_deg": 3.0, "slope_baseline_m": 0.5}}
    settings = described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)}, {"detail": True}, finer)
    found = above(settings)
    heights = np.array([v.co.z for v in scenes.find_built(bpy.context.scene).terrain.data.vertices])
    assert len(heights) > 4 * CELLS**2
    assert heights.std() > 1e-4
    # Slopes darken all bands alike: the share of each band is the image's, but for light from the ground beside.
    share, wanted = (a / a.sum(axis=2, keepdims=True) for a in (found, expected()))
    assert share[inner()] == pytest.approx(wanted[inner()], abs=0.05)


def test_a_seam_is_sharp(tmp_path):
    image = quarters(tmp_path / "quarters.png")
    path = WRITERS["st.ply"](tmp_path / "a.ply", *ground())
    found = above(described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)}), samples=16)
    # V is 1 just west of the seam and 0 just east of it, which the repeat makes the same place of the image, where
    # two rows of pixels are blended: over half a pixel on either side, and no wider.
    middle, pixel = PIXELS // 2, SIDE_M / 16 / (SIDE_M / PIXELS)
    row = found[PIXELS // 4]
    wanted = ALBEDO * expected()[PIXELS // 4] / QUARTERS.mean()
    for west, east in ((middle - 1 - round(pixel), middle + round(pixel)),):
        assert row[west] == pytest.approx(wanted[west], rel=0.02)
        assert row[east] == pytest.approx(wanted[east], rel=0.02)


def test_the_mean_is_that_of_the_ground_and_blocks_take_it(tmp_path):
    # Red in the lower left quarter, which is all that the ground shows; the rest is the black between baked pieces.
    baked = np.zeros((2, 2, 3))
    baked[0, 0] = (0.6, 0.3, 0.3)
    image = png(tmp_path / "baked.png", as_srgb(np.repeat(np.repeat(baked, 32, axis=0), 32, axis=1)))
    positions, faces, uv = ground()
    path = obj(tmp_path / "a.obj", positions, faces, 0.05 + 0.35 * uv)
    settings = described(
        path,
        {"set": "OWN", "mapping": "UV", "albedo_file": str(image)},
        None,
        {"rocks": {"coverage": 0.1, "smallest_m": 0.1, "clear_radius_m": 0.0}},
    )
    found = above(settings)
    colour = ALBEDO * np.array([0.6, 0.3, 0.3]) / 0.4
    bare = np.median(found.reshape(-1, 3), axis=0)
    assert bare == pytest.approx(colour, rel=0.02)
    share = found[found.sum(axis=2) > 0.05]
    share = share / share.sum(axis=1, keepdims=True)
    # Light that went by two blocks is redder, (0.67, 0.17, 0.17) of it; grey would be a third of each.
    assert share == pytest.approx(np.broadcast_to([0.5, 0.25, 0.25], share.shape), abs=0.06)
    built = scenes.find_built(bpy.context.scene)
    assert built.rock_count > 3
    assert not built.edited
    blocks = next(item for item in built.collection.all_objects if item.get(TAG) == "rock")
    material = next(iter(find_instanced_objects(blocks))).data.materials[0]
    assert not [n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeTexImage"]
    own = description.merged(settings, {"rocks": {"own_surface": True}})
    scenes.build_scene(empty_scene(), own)
    blocks = bpy.data.materials["Icy Moon Rock Surface"].node_tree.nodes
    assert "Mean Albedo" not in blocks


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("direction", ["u", "v"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_normal_map_tilts_along_u_and_v(tmp_path, direction, mirrored):
    # A normal that leans by atan(0.5) along +u or +v. The layout below has +u north and +v west, or mirrored east.
    tilt = np.array([0.5, 0.0, 1.0] if direction == "u" else [0.0, 0.5, 1.0]) / np.hypot(0.5, 1.0)
    image = png(tmp_path / "n.png", np.broadcast_to(0.5 + 0.5 * tilt, (8, 8, 3)))
    positions, faces, _ = ground()
    at = positions[faces]
    uv = np.stack([(at[..., 1] + 2) / 4, (at[..., 0] * (1 if mirrored else -1) + 2) / 4], axis=-1)
    path = obj(tmp_path / "a.obj", positions, faces, uv)
    leans = {"u": 0.0, "v": 90.0 if mirrored else -90.0}[direction]  # azimuth from north over east

    def seen(azimuth: float, elevation: float, kind: str = "normal") -> float:
        textures = {"set": "OWN", "mapping": "UV", f"{kind}_file": str(image)}
        return float(
            above(
                described(
                    path, textures, None, {"light": {"sun_elevation_deg": elevation, "sun_azimuth_deg": azimuth}}
                ),
                1,
            )[8:-8, 8:-8].mean()
        )

    lean = np.degrees(np.arctan(0.5))
    # The cosine at a high Sun; near the terminator Blender 4.2 darkens tilted normals.
    assert seen(leans, 70.0) == pytest.approx(ALBEDO * np.cos(np.radians(20 - lean)), rel=0.01)
    assert seen(leans + 180, 70.0) == pytest.approx(ALBEDO * np.cos(np.radians(20 + lean)), rel=0.01)
    assert seen(leans + 90, 70.0) == pytest.approx(ALBEDO * np.cos(np.radians(20)) * tilt[2], rel=0.01)
    # Under a low Sun, what faces it is twice as bright as level ground (1.4 times in Blender 4.2), and what is turned
    # away is dark.
    level = ALBEDO * np.sin(np.radians(20))
    assert seen(leans, 20.0) > 1.3 * level
    assert seen(leans + 180, 20.0) < 0.05 * level


@pytest.mark.parametrize(("relief", "with_normals"), [("BUMP", False), ("DISPLACEMENT", False), ("DISPLACEMENT", True)])
def test_a_height_map_by_uv_is_in_metres(tmp_path, relief, with_normals):
    # Heights rise from 0 to 1 with u, which runs north over 4 m, so that 2 m make a slope of 1/2 facing south. A map
    # of level normals changes nothing, on ground that is moved neither.
    n = 64
    ramp = (np.arange(n) + 0.5) / n
    image = png(tmp_path / "h.png", np.broadcast_to(ramp[None, :, None], (n, n, 3)))
    level = png(tmp_path / "n.png", np.broadcast_to([0.5, 0.5, 1.0], (4, 4, 3)))
    positions, faces, _ = ground()
    at = positions[faces]
    uv = np.stack([(at[..., 1] + 2) / 4, (2 - at[..., 0]) / 4], axis=-1)
    path = obj(tmp_path / "a.obj", positions, faces, uv)
    textures = {
        "set": "OWN",
        "mapping": "UV",
        "height_file": str(image),
        "height_m": 2.0,
        "width_m": 0.01,
        **({"normal_file": str(level)} if with_normals else {}),
    }
    found = {
        azimuth: np.median(
            above(
                described(
                    path,
                    textures,
                    None,
                    {"surface": {"relief": relief}, "light": {"sun_elevation_deg": 60.0, "sun_azimuth_deg": azimuth}},
                ),
                16,
            )[8:-8, 8:-8]
        )
        for azimuth in (0.0, 180.0)
    }
    # Eight bits make steps of the bump; the rim of the displaced ground, where the image repeats, lights it a little.
    slope, tolerance = np.arctan(0.5), 0.05
    assert found[180.0] == pytest.approx(ALBEDO * np.cos(np.pi / 6 - slope), rel=tolerance)
    assert found[0.0] == pytest.approx(ALBEDO * np.cos(np.pi / 6 + slope), rel=tolerance)
    # About the middle of what the ground shows, so that its mean height stays.
    nodes = bpy.data.materials["Icy Moon Surface"].node_tree.nodes
    assert nodes["Map About 0"].inputs[1].default_value == pytest.approx(0.5, abs=0.005)


def test_a_gltf_s_roughness_is_its_green_channel(tmp_path):
    png(tmp_path / "quarters.png", np.full((4, 4, 3), 0.5))
    rough = png(tmp_path / "rough.png", np.broadcast_to([1.0, 0.4, 0.0], (4, 4, 3)))
    normal = png(tmp_path / "normal.png", np.broadcast_to([0.5, 0.5, 1.0], (4, 4, 3)))
    positions, faces, uv = ground()
    path = glb(
        tmp_path / "a.glb",
        positions,
        faces,
        [uv],
        {"a": tmp_path / "quarters.png", "r": rough, "n": normal},
        {"baseColorTexture": "a", "metallicRoughnessTexture": "r", "normalTexture": "n"},
    )
    built = scenes.build_scene(
        empty_scene(), described(path, {"set": "MESH"}, None, {"surface": {"model": "PRINCIPLED"}})
    )
    assert any("albedo, roughness, normal" in line for line in built.ground["report"])
    nodes = bpy.data.materials["Icy Moon Surface"].node_tree.nodes
    link = nodes["Snow"].inputs["Roughness"].links[0]
    assert link.from_socket.name in ("Y", "Green")
    spaces = {n.name: n.image.colorspace_settings.name for n in nodes if n.bl_idname == "ShaderNodeTexImage"}
    assert spaces == {"Albedo 0": "sRGB", "Roughness 0": "Non-Color", "Normal 0": "Non-Color"}
    assert all(n.image.packed_file for n in nodes if n.bl_idname == "ShaderNodeTexImage")
    count = len(bpy.data.images)
    scenes.build_scene(bpy.context.scene, built.settings)
    assert len(bpy.data.images) == count
    scenes.clear_scene(bpy.context.scene)
    assert not [image for image in bpy.data.images if image.name.startswith("a.glb")]


def test_beyond_the_unit_square_the_image_repeats(tmp_path):
    image = quarters(tmp_path / "quarters.png")
    positions, faces, uv = ground()
    path = obj(tmp_path / "a.obj", positions, faces, uv + np.array([3, -5]))
    settings = described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)})
    assert_laid(above(settings))
    report = " ".join(scenes.find_built(bpy.context.scene).ground["report"])
    assert "UV coordinates from 3 to 4 and -5 to -4" in report


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("name", ["a.obj", "a.ply", "st.ply"])
def test_coordinates_that_are_no_numbers_or_one_point_are_said(tmp_path, name):
    image = quarters(tmp_path / "quarters.png")
    positions, faces, uv = ground()
    uv[0, 1, 0], uv[5] = np.nan, uv[5, :1]
    path = WRITERS[name](tmp_path / name, positions, faces, uv)
    found = above(described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)}))
    assert np.isfinite(found).all()
    # Two triangles of 128 show something else.
    wrong = np.abs(found - ALBEDO * expected() / QUARTERS.mean()).max(axis=2) > 0.02
    assert wrong[inner()].mean() < 0.03
    built = scenes.build_scene(
        empty_scene(), described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)})
    )
    assert any("1 of 384 face corners have no UV" in warning for warning in built.warnings)
    assert any("1 of 128 triangles have no area" in warning for warning in built.warnings)
    for nothing in (np.full_like(uv, np.nan), np.full_like(uv, 0.25)):
        path = WRITERS[name](tmp_path / name, positions, faces, nothing)
        scenes.build_scene(empty_scene(), described(path, {"set": "OWN", "albedo_file": str(image)}))
        with pytest.raises(IcyMoonError, match="has no UV coordinates that show an image"):
            scenes.build_scene(
                empty_scene(), described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)})
            )


def test_of_two_layers_the_rendered_one_counts(tmp_path):
    scene = empty_scene()
    positions, faces, uv = ground()
    mesh = bpy.data.meshes.new("Two")
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    for name, values in (("First", 1 - uv), ("Baked", uv)):
        mesh.uv_layers.new(name=name).data.foreach_set("uv", values.astype(np.float32).ravel())
    mesh.uv_layers["Baked"].active_render = True
    item = bpy.data.objects.new("Two", mesh)
    scene.collection.objects.link(item)
    from icymoon.nodes.ground import import_mesh

    _, triangles, found = import_mesh._read_geometry(tmp_path)
    assert np.array_equal(triangles, faces)
    assert np.allclose(found, uv)
    # Of a file it is the first, TEXCOORD_0: `seen_by_glb` has another in TEXCOORD_1.
    quarters(tmp_path / "quarters.png")
    path = seen_by_glb(tmp_path / "a.glb", positions, faces, uv)
    empty_scene()
    assert np.allclose(read_mesh(path)[2].reshape(-1, 2), uv.reshape(-1, 2), atol=1e-6)


def test_a_ground_with_faces_of_four_corners_has_the_same_mean(tmp_path):
    import bmesh  # which is there once bpy is

    image = png(tmp_path / "a.png", np.random.default_rng(0).random((16, 16, 3)))
    scene = empty_scene()
    positions, faces, uv = ground()
    settings = described(
        obj(tmp_path / "a.obj", positions, faces, uv), {"set": "OWN", "mapping": "UV", "albedo_file": str(image)}
    )
    mesh = scenes.build_scene(scene, settings).terrain.data
    before = images.measure_means(mesh, images.load_maps(settings.textures, {"albedo": image}))["albedo"].mean
    edited = bmesh.new()
    edited.from_mesh(mesh)
    bmesh.ops.join_triangles(edited, faces=edited.faces[:], angle_face_threshold=0.1, angle_shape_threshold=3.0)
    edited.to_mesh(mesh)
    edited.free()
    assert len(mesh.polygons) < len(faces)
    after = images.measure_means(mesh, images.load_maps(settings.textures, {"albedo": image}))["albedo"].mean
    assert after == pytest.approx(before, abs=0.005)


def test_a_mesh_with_coordinates_is_the_same_mesh(tmp_path):
    positions, faces, uv = ground()
    positions[:, 2] = np.random.default_rng(0).normal(0, 0.1, len(positions))

    def shape(path: Path) -> tuple[bytes, bytes]:
        mesh = scenes.build_scene(empty_scene(), described(path, {}, {"detail": True})).terrain.data
        vertices, corners = np.empty(3 * len(mesh.vertices), np.float32), np.empty(len(mesh.loops), np.int32)
        mesh.vertices.foreach_get("co", vertices)
        mesh.loops.foreach_get("vertex_index", corners)
        assert (UV_LAYER in mesh.attributes) == (path.stem == "with")
        return vertices.tobytes(), corners.tobytes()

    assert shape(obj(tmp_path / "with.obj", positions, faces, uv)) == shape(
        obj(tmp_path / "without.obj", positions, faces, None)
    )


def test_the_images_of_a_mesh_are_the_pair_s(tmp_path):
    image = quarters(tmp_path / "quarters.png")
    path = WRITERS["a.obj"](tmp_path / "a.obj", *ground())
    settings, scene = described(path, {"set": "MESH"}), empty_scene()
    built = scenes.build_scene(scene, settings)
    first = expand_headings(settings, built.extra)[0].id
    assert not built.edited
    assert scenes.list_changed_settings(built, settings) == []
    png(image, np.full((4, 4, 3), 0.5))
    assert scenes.list_changed_settings(built, settings) == ["source.file"]
    built = scenes.build_scene(scene, settings)
    second = expand_headings(settings, built.extra)[0].id
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd missing.png\n")
    assert scenes.list_changed_settings(built, settings) == []  # what was built is still there
    with pytest.raises(IcyMoonError, match=r"missing\.png: there is no such file; check the albedo image of the mesh"):
        scenes.build_scene(scene, settings)
    assert scenes.find_built(scene).extra == built.extra
    assert len([m for m in bpy.data.meshes if m.name.startswith("Icy Moon Terrain")]) == 1
    (tmp_path / "a.mtl").unlink()
    with pytest.raises(IcyMoonError, match="has no images"):
        scenes.build_scene(scene, settings)
    assert len({first, second}) == 2


def test_an_edit_of_the_coordinates_is_seen(tmp_path):
    image = quarters(tmp_path / "quarters.png")
    path = WRITERS["a.obj"](tmp_path / "a.obj", *ground())
    built = scenes.build_scene(
        empty_scene(), described(path, {"set": "OWN", "mapping": "UV", "albedo_file": str(image)})
    )
    assert not built.edited
    name = built.extra
    built.terrain.data.uv_layers[UV_LAYER].data[7].uv = (0.3, 0.3)
    assert built.edited_parts() == {"terrain data"}
    assert built.extra != name
    bpy.data.materials["Icy Moon Surface"].node_tree.nodes["UV"].uv_map = "Other"
    assert "terrain materials" in built.edited_parts()


def test_ground_without_coordinates_is_refused(tmp_path):
    image = str(quarters(tmp_path / "quarters.png"))
    positions, faces, _ = ground()
    bare = obj(tmp_path / "bare.obj", positions, faces, None)
    np.save(tmp_path / "h.npy", np.zeros((5, 5)))
    heights = {"source": {"kind": "HEIGHT_MAP", "file": str(tmp_path / "h.npy"), "metres_per_pixel": 1.0}}
    own = {"set": "OWN", "mapping": "UV", "albedo_file": image}
    scene = empty_scene()
    built = scenes.build_scene(scene, complete())
    mark, meshes = built.extra, len(bpy.data.meshes)
    for settings, words in (
        (complete({"textures": own}), r"textures\.mapping is UV, but procedural ground.*OBJECT.*source\.kind"),
        (complete({"textures": {"set": "MESH"}}), r"textures\.set is MESH, but procedural ground"),
        (complete(heights, {"textures": own}), "but a height map has no UV"),
        (described(bare, own), r"bare\.obj: has no UV coordinates.*export it with them, or set textures\.mapping"),
        (described(bare, {"set": "MESH"}), r"bare\.obj: has no UV.*choose another textures\.set"),
        (
            complete({"textures": {"set": "OWN", "mapping": "UV"}, "source": {"kind": "MESH", "file": str(bare)}}),
            "has no UV",
        ),
    ):
        with pytest.raises(IcyMoonError, match=words):
            scenes.build_scene(scene, settings)
        assert (scenes.find_built(scene).extra, len(bpy.data.meshes)) == (mark, meshes)
    with pytest.raises(IcyMoonError, match=r"textures\.albedo_file.*textures\.set to MESH"):
        scenes.build_scene(
            scene, described(seen_by_obj(tmp_path / "a.obj", *ground()), {"set": "OWN", "mapping": "UV"})
        )
    # Without an image there is nothing to refuse.
    scenes.build_scene(scene, complete({"textures": {"mapping": "UV"}}))


def test_the_window_follows_and_says_what_it_cannot_show(tmp_path):
    image = quarters(tmp_path / "quarters.png")
    path = WRITERS["a.obj"](tmp_path / "a.obj", *ground())
    scene = empty_scene()
    plain = described(path, {})
    built = scenes.build_scene(scene, plain)
    shown = described(path, {"set": "MESH"})
    preview.show_settings(built, shown, 33)
    assert preview.read_notes(scene) == []
    made = scenes.find_built(scene)
    assert made.settings["textures"]["set"] == "MESH"
    assert not made.edited
    nodes = made.terrain.data.materials[0].node_tree.nodes
    assert nodes["UV"].uv_map == UV_LAYER
    assert Path(bpy.path.abspath(nodes["Albedo 0"].image.filepath)) == image
    bpy.context.view_layer.objects.active = made.terrain
    bpy.ops.object.mode_set(mode="EDIT")
    preview.show_settings(made, description.merged(shown, {"surface": {"albedo": 0.5}}), 33)
    assert any("leave Edit Mode" in note for note in preview.read_notes(scene))
    bpy.ops.object.mode_set(mode="OBJECT")
    preview.show_settings(made, description.merged(shown, {"surface": {"albedo": 0.6}}), 33)
    assert preview.read_notes(scene) == []
    procedural = scenes.build_scene(scene, complete())
    preview.show_settings(procedural, complete({"textures": {"set": "FROST", "mapping": "UV"}}), 33)
    assert any("textures.mapping is UV" in note for note in preview.read_notes(scene))
    procedural.terrain.data.uv_layers.new(name=UV_LAYER)  # by hand, which the settings do not say
    preview.show_settings(procedural, complete({"textures": {"set": "MESH"}}), 33)
    assert any("textures.set is MESH, but procedural" in note for note in preview.read_notes(scene))


def test_the_panel_greys_what_does_not_count(scene):
    group = scene.icymoon.textures

    def counts(*keys: str) -> set[str]:
        topic = TOPICS["textures"]
        return {key for key in keys if topic.is_shown(key, scene.icymoon) and topic.has_effect(key, scene.icymoon)}

    every = tuple(s.key for s in TOPICS["textures"].settings)
    files = {key for key in every if key.endswith("_file")}
    assert counts(*every) == {"set"}
    group.set = "FROST"
    assert counts(*every) == {"set", "mapping", "width_m", "repeat", "height_m"}
    group.set = "OWN"
    assert counts(*every) == set(every) - {"stand_in"}
    group.mapping = "UV"
    assert counts(*every) == {"set", "mapping", "height_m", *files}
    group.set, group.mapping = "MESH", "OBJECT"
    assert counts(*every) == {"set"}
