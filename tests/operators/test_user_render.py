"""F12 after Build Scene, in Blender's default file."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.nodes.build_scene import find_collection
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.stereo.images.exr import read_view


@pytest.fixture
def default_file():
    """Blender's own default file, whose cube encloses the camera and whose lamp lights the ice."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    group = scene.icymoon
    group.mesh.kind, group.terrain.resolution = "GRID", 129
    group.rig.width_px, group.rig.height_px = 96, 72
    group.quality.samples, group.quality.denoiser = 64, "NONE"
    return scene


def values(scene):
    return {
        name: getattr(getattr(scene, group), name)
        for group, name in (
            ("render", "engine"),
            ("render", "resolution_x"),
            ("render", "use_compositing"),
            ("cycles", "samples"),
            ("cycles", "sample_clamp_indirect"),
            ("cycles", "use_light_tree"),
            ("cycles", "use_denoising"),
            ("cycles", "preview_samples"),
        )
    }


@pytest.mark.slow
@pytest.mark.parametrize("model", [pytest.param("LAMBERT", marks=pytest.mark.long), "HAPKE"])
def test_f12_is_what_the_left_eye_of_a_pair_sees(default_file, tmp_path, model):
    scene = default_file
    scene.icymoon.surface.model = model
    scene.icymoon.dataset.folder = str(tmp_path)
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(tmp_path / "f12.exr")
    bpy.ops.render.render(write_still=True)
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    (folder,) = (tmp_path / "pairs").iterdir()
    radiance = read_view(read_pair(folder).image("left")).radiance
    image = bpy.data.images.load(str(tmp_path / "f12.exr"))
    assert tuple(image.size) == radiance.shape[1::-1] == (96, 72)
    pixels = np.array(image.pixels).reshape(72, 96, -1)[::-1, :, :3]
    # Two renders of 64 paths, averaged over squares of 24 pixels: noise of a per cent.
    ours, theirs = (each.reshape(3, 24, 4, 24, 3).mean(axis=(1, 3)) for each in (radiance, pixels))
    np.testing.assert_allclose(theirs, ours, rtol=0.05)
    assert np.median(np.abs(theirs / ours - 1)) < 0.02
    assert pixels.mean() == pytest.approx(radiance.mean(), rel=0.01)


def test_clear_gives_the_user_s_render_back(default_file):
    scene = default_file
    before = values(scene)
    bpy.ops.icymoon.build_scene()
    assert scene.render.engine == "CYCLES"
    assert scene.cycles.preview_samples == 64 < before["preview_samples"]  # so that the view rests
    assert {item.name for item in scene.objects if item.hide_render} >= {"Cube", "Light"}
    assert scene.camera.name not in ("Camera", "Cube")
    scene.cycles.samples = 77  # the user's own choice after the build
    bpy.ops.icymoon.build_scene()
    assert scene.cycles.samples == 77
    bpy.data.objects["Cube"].name = "Renamed"
    bpy.ops.icymoon.clear_scene()
    assert find_collection(scene) is None
    assert values(scene) == before | {"samples": 77}
    assert not bpy.data.objects["Light"].hide_render
    assert not bpy.data.objects["Renamed"].hide_render
    assert not any(key.startswith("icymoon") for item in bpy.data.objects for key in dict(item))


@pytest.mark.usefixtures("default_file")
def test_what_the_user_hides_or_adds_is_left_as_it_is():
    bpy.data.objects["Cube"].hide_render = True
    bpy.ops.icymoon.build_scene()
    bpy.ops.icymoon.clear_scene()
    assert bpy.data.objects["Cube"].hide_render
    bpy.ops.icymoon.build_scene()
    bpy.ops.mesh.primitive_cube_add()
    added = bpy.context.object
    bpy.ops.icymoon.build_scene()
    assert not added.hide_render
