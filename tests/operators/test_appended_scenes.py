"""Files that hold a built scene for another file, or were saved by an older version; the sequences test the rest."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from edits import TINY
from icymoon.nodes import before_build
from icymoon.nodes import build_scene as scenes
from icymoon.operators import appended_scenes
from icymoon.settings.blender import scene_properties
from icymoon.support.blender import compat
from rendering import complete, empty_scene, on_height_map

QUALITY = {"quality": {"samples": 7}}


def save(folder, *parts, old=False):
    """A file with a built scene, whose path is returned; ``old``: as versions before 0.4 have written it."""
    folder.mkdir(exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "site.blend"))
    scene = bpy.context.scene
    mine = scene.camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    scene.collection.objects.link(mine)
    scene.view_settings.exposure = 1.5
    scene_properties.write_settings(scene.icymoon, complete(TINY, *parts))
    built = scenes.build_scene(scene, scene_properties.read_settings(scene.icymoon))
    if old:
        for name in (before_build.CAMERA, before_build.WORLD, before_build.VIEW, before_build.OSL):
            built.collection[name] = scene[name]
            del scene[name]
    bpy.ops.wm.save_mainfile()
    return folder / "site.blend"


def append(path):
    empty_scene()
    bpy.ops.wm.append(directory=f"{path}/Collection/", filename="Icy Moon")
    appended_scenes.adopt_appended()  # before Blender 4.3 a timer does it
    return scenes.find_built(bpy.context.scene)


def test_a_file_of_an_older_version_gives_back_what_there_was_before_its_build(tmp_path):
    empty_scene()
    path = save(tmp_path, old=True)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    assert before_build.VIEW in scene
    assert before_build.VIEW not in scenes.find_collection(scene)
    scenes.clear_scene(scene)
    assert scene.camera == bpy.data.objects["Mine"]
    assert scene.view_settings.exposure == 1.5
    assert scene.world is None
    assert before_build.VIEW not in scene


@pytest.mark.parametrize("old", [False, True])
def test_what_is_appended_has_its_settings_and_gives_back_the_view_of_its_new_file(tmp_path, old):
    empty_scene()
    built = append(save(tmp_path, QUALITY, old=old))
    scene = bpy.context.scene
    assert scenes.list_changed_settings(built, scene_properties.read_settings(scene.icymoon)) == []
    assert scene.icymoon.quality.samples == 7
    assert (scene.camera, built.edited) == (built.camera, False)
    scenes.clear_scene(scene)
    assert (scene.camera, scene.world, scene.view_settings.exposure) == (None, None, 0.0)


def test_files_beside_the_file_that_was_appended_from_are_found(tmp_path):
    empty_scene()
    heights = tmp_path / "site" / "heights.npy"
    heights.parent.mkdir()
    np.save(heights, np.zeros((33, 33), np.float32))
    part = on_height_map(heights, 8.0)
    part["source"]["file"] = "//heights.npy"
    bpy.ops.wm.save_as_mainfile(filepath=str(heights.with_name("site.blend")))
    built = append(save(heights.parent, part))
    assert bpy.context.scene.icymoon.source.file == str(heights)
    assert scenes.list_changed_settings(built, scene_properties.read_settings(bpy.context.scene.icymoon)) == []


def test_older_blenders_look_for_what_was_appended(monkeypatch, tmp_path):
    empty_scene()
    asked: list[object] = []
    monkeypatch.setattr(appended_scenes, "call_later", asked.append)
    save(tmp_path)
    appended_scenes._look_for_appended()
    assert asked == []
    scene = bpy.context.scene
    del scene[before_build.VIEW]
    appended_scenes._look_for_appended()
    assert asked == [appended_scenes.adopt_appended]
    assert compat.has_append_handler() == (bpy.app.version >= (4, 3, 0))
