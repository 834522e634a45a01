"""The asset library as Blender reads it: names, catalogs, pictures, and what is dropped from it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.formats import asset_library
from icymoon.nodes import assets
from icymoon.nodes.build_scene import build_scene, clear_scene
from icymoon.nodes.datablocks.fingerprint import TAG
from icymoon.nodes.datablocks.marks import BlockHasher
from icymoon.operators.render import plan_pairs
from icymoon.render.asset_worker import make_library
from icymoon.render.workers.job_commands import python_command
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.support.arrays import Array
from rendering import complete, empty_scene

NAMES = (
    "gallery/block_field",
    "scenes/europa_rough_ice",
    "surfaces/rough_ice",
    "surfaces/hapke_europa_dark_lineae",
    "rigs/guiss",
    "rigs/mer_navcam",
    "lights/guiss_europa",
    "bodies/enceladus",
)
SKY = assets.SKY
KINDS = {
    "gallery": "collections",
    "scenes": "collections",
    "surfaces": "materials",
    "rigs": "objects",
    "lights": "collections",
    "bodies": "collections",
}
SMALL: Parts = {"mesh": {"kind": "GRID"}, "terrain": {"resolution": 17}, "rocks": {"most": 20}}


@pytest.fixture(scope="module")
def library(registered, tmp_path_factory) -> Path:
    """A library with two assets of each kind, whose ground is small."""
    folder = tmp_path_factory.mktemp("library") / "assets"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(assets, "_ASSET_SETTINGS", {**assets._ASSET_SETTINGS, **SMALL})
        messages: list[dict] = []
        make_library(folder, (*NAMES, SKY), lambda kind, **facts: messages.append({"type": kind, **facts}))
    assert [m["fraction"] for m in messages[:-1]] == [k / (1 + len(NAMES)) for k in range(1 + len(NAMES))]
    assert messages[-1] == {"type": "done", "assets": 1 + len(NAMES)}
    return folder


def append(library: Path, name: str):
    """Append the asset of a preset, as the Asset Browser does."""
    with bpy.data.libraries.load(str(library / f"{name}.blend"), assets_only=True) as (there, wanted):
        found = {kind: list(getattr(there, kind)) for kind in set(KINDS.values())}
        for kind, names in found.items():
            setattr(wanted, kind, list(names))
    title = preset_files.read_preset_header(name)[0]
    assert found == {**{kind: [] for kind in KINDS.values()}, KINDS[name.split("/")[0]]: [title]}
    return getattr(bpy.data, KINDS[name.split("/")[0]])[title]


@pytest.mark.parametrize("name", NAMES)
def test_blender_finds_each_asset_with_its_facts(library, name):
    empty_scene()
    block = append(library, name)
    facts, kind = block.asset_data, name.split("/")[0]
    assert f"{facts.catalog_id}:{asset_library.CATALOGS[kind]}:" in (library / "blender_assets.cats.txt").read_text()
    assert facts.author == assets.AUTHOR
    assert facts.license == assets.LICENSE
    assert facts.description.endswith(f"Preset {name}")
    assert len(facts.description.encode()) > 30
    assert {"Icy Moon"} < {tag.name for tag in facts.tags}
    image = bpy.data.images.load(str(preset_files.find_preview(name)))
    assert tuple(block.preview.image_size) == tuple(image.size)
    shown, expected = np.empty(len(image.pixels), np.float32), np.empty(len(image.pixels), np.float32)
    block.preview.image_pixels_float.foreach_get(shown)
    image.pixels.foreach_get(expected)
    np.testing.assert_allclose(shown, expected, atol=1 / 255)
    ours = [each for each in bpy.data.user_map() if not isinstance(each, bpy.types.Scene)]
    assert not [key for each in ours for key in each.keys() if key.startswith(TAG)]  # noqa: SIM118 - no mapping
    assert not [
        image
        for image in bpy.data.images
        if image.source == "FILE"
        and not image.packed_file
        and image.filepath != bpy.path.abspath(str(preset_files.find_preview(name)))
    ]


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("surfaces/")])
def test_a_surface_is_the_material_that_build_scene_makes(library, name):
    built = build_scene(empty_scene(), description.merged(assets.make_asset_settings(name), SMALL))
    appended, made = append(library, name), built.terrain.data.materials[0]
    trees = {made.node_tree, appended.node_tree}
    assert len(trees) == 2
    assert len({BlockHasher({}, trees).mark(tree) for tree in trees}) == 1
    pixels = []
    for material in (made, appended):
        built.terrain.data.materials[0] = material
        pixels.append(_picture(built.scene))
    assert pixels[0].std() > 0.01
    np.testing.assert_array_equal(pixels[0], pixels[1])


def test_the_sky_is_a_black_world(library):
    scene = empty_scene()
    with bpy.data.libraries.load(str(library / f"{SKY}.blend"), assets_only=True) as (there, wanted):
        wanted.worlds = list(there.worlds)
    (world,) = wanted.worlds
    assert asset_library.CATALOGS["skies"] in (library / "blender_assets.cats.txt").read_text()
    assert world.asset_data.catalog_id == asset_library.catalog_id("skies")
    assert world.preview.image_size[0] > 0
    assert not [key for key in world.keys() if key.startswith(TAG)]  # noqa: SIM118 - no mapping
    scene.world, scene.camera = world, bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    assert _picture(scene).reshape(-1, 4)[:, :3].max() < 1.5 / 255  # Blender dithers


def _picture(scene: bpy.types.Scene) -> Array:
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 24, 18, 100
    scene.render.image_settings.file_format = "PNG"
    scene.view_settings.exposure = -4.0
    scene.render.filepath = os.path.join(bpy.app.tempdir, "asset.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath, check_existing=False)
    values = np.array(image.pixels[:])
    bpy.data.images.remove(image)
    return values


def test_a_rig_has_the_lens_and_the_baseline_of_its_preset(library):
    empty_scene()
    mast, rig = append(library, "rigs/mer_navcam"), assets.make_asset_settings("rigs/mer_navcam").rig
    camera = mast["camera"]
    bpy.context.scene.collection.objects.link(mast)
    bpy.context.scene.collection.objects.link(camera)
    mast.location = 3.0, 4.0, 5.0
    bpy.context.view_layer.update()
    assert tuple(camera.matrix_world.translation) == pytest.approx((3.0, 4.0, 5.0 + rig.height_m))
    up_of_view = -camera.matrix_world.col[2][2]  # a camera looks along its -z
    assert up_of_view == pytest.approx(-np.sin(np.radians(rig.pitch_deg)), abs=1e-6)
    assert camera.data.lens == pytest.approx(rig.focal_length_mm)
    assert camera.data.sensor_width == pytest.approx(rig.sensor_width_mm)
    assert camera.data.stereo.interocular_distance == pytest.approx(rig.baseline_m)
    assert camera.data.stereo.convergence_mode == "PARALLEL"
    assert camera.data.stereo.pivot == "LEFT"
    assert f"{rig.width_px} x {rig.height_px} px" in mast.asset_data.description


def test_a_landscape_and_a_light_are_whole(library):
    empty_scene()
    landscape = append(library, "gallery/block_field")
    assert {item.type for item in landscape.all_objects} == {"MESH", "LIGHT", "CAMERA"}
    assert set(bpy.data.objects) == set(landscape.all_objects), "Blender puts others into the scene by themselves"
    rocks = next(item for item in landscape.all_objects if item.modifiers)
    bpy.context.scene.collection.children.link(landscape)
    shown = [(each.object.name, each.is_instance) for each in bpy.context.evaluated_depsgraph_get().object_instances]
    assert len([name for name, of_rocks in shown if of_rocks]) == len(rocks.data.vertices) > 0
    assert not [name for name, of_rocks in shown if not of_rocks and "Shape" in name]
    light = append(library, "bodies/enceladus")
    lamps = [item.data for item in light.all_objects if item.type == "LIGHT"]
    assert max(lamp.energy for lamp in lamps) == pytest.approx(
        assets.make_asset_settings("bodies/enceladus").light.sun_irradiance_wm2
    )
    assert not [item for item in light.all_objects if item.constraints]


def test_what_is_dropped_is_the_users_and_changes_no_pair(library):
    settings = complete({"terrain": {"resolution": 9}})
    scene = empty_scene()
    built = build_scene(scene, settings)
    pairs, parts = [pair.id for pair in plan_pairs(scene, settings)], set(built.collection.all_objects)
    mast = append(library, "rigs/guiss")
    camera = mast["camera"]
    landscape = append(library, "gallery/block_field")
    cube = bpy.data.objects.new("Cube", bpy.data.meshes.new("Cube"))
    cube.data.materials.append(append(library, "surfaces/rough_ice"))
    for item in (mast, camera, cube):
        scene.collection.objects.link(item)
    scene.collection.children.link(landscape)
    theirs = {mast, camera, cube, *landscape.all_objects}
    names = {item.name for item in theirs}
    assert [pair.id for pair in plan_pairs(scene, settings)] == pairs
    again = build_scene(scene, settings)
    assert set(again.collection.all_objects) == parts
    assert not again.edited
    assert [pair.id for pair in plan_pairs(scene, settings)] == pairs
    clear_scene(scene)
    assert set(scene.objects) == theirs
    assert {item.name for item in theirs} == names
    assert cube.data.materials[0] is not None
    assert landscape.objects[0].data.materials[0].node_tree is not None
    built_anew = build_scene(scene, settings)  # beside a camera and a landscape, none of which is taken for its own
    assert not theirs & set(built_anew.collection.all_objects)
    assert [pair.id for pair in plan_pairs(scene, settings)] == pairs


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_whole_library_is_small_and_complete(tmp_path):
    folder = tmp_path / "assets"
    subprocess.run(python_command(sys.executable, "assets", str(folder)), check=True, stdout=subprocess.DEVNULL)
    files = asset_library.find_files(folder)
    assert {path.relative_to(folder).with_suffix("").as_posix() for path in files} == set(assets.list_asset_names())
    assert sum(path.stat().st_size for path in files) < 50e6
    for name in set(assets.list_asset_names()) - {SKY}:
        empty_scene()
        assert append(folder, name).preview.image_size[0] > 100
