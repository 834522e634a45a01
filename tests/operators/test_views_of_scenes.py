"""A 3D View shows a built scene only while its window does, and looks as before in every other scene."""

from __future__ import annotations

import bpy
from edits import TINY
from icymoon.nodes import build_scene as scenes
from icymoon.operators import build
from icymoon.operators.session import session
from rendering import complete


def find_view():
    window = bpy.context.window_manager.windows[0]
    return window, next(area for area in window.screen.areas if area.type == "VIEW_3D")


def look() -> tuple[str, bool]:
    space = find_view()[1].spaces.active
    return space.region_3d.view_perspective, space.overlay.show_overlays


def test_another_scene_is_seen_as_before_and_the_built_one_again_as_it_was(scene):
    window, area = find_view()
    before = look()
    built = scenes.build_scene(scene, complete(TINY))
    with bpy.context.temp_override(window=window, area=area):
        build.show_scene(bpy.context, built)
    assert look() == ("CAMERA", False) != before
    other = window.scene = bpy.data.scenes.new("Other")
    build._follow_views()
    assert look() == before
    window.scene = scene
    build._follow_views()
    assert look() == ("CAMERA", False)
    window.scene = other
    build._follow_views()
    scenes.clear_scene(scene)
    window.scene = scene
    build._follow_views()
    assert look() == before
    assert session.views_before == {}


def test_a_view_that_a_file_brought_is_restored_when_its_scene_goes(scene, tmp_path):
    window, area = find_view()
    built = scenes.build_scene(scene, complete(TINY))
    with bpy.context.temp_override(window=window, area=area):
        build.show_scene(bpy.context, built)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "lit.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "lit.blend"))
    assert look() == ("CAMERA", False)
    bpy.ops.icymoon.clear_scene()
    assert look() == ("PERSP", True)
    space = find_view()[1].spaces.active
    assert (space.shading.type, space.local_view, session.views_before) == ("SOLID", None, {})


def test_the_build_says_how_many_objects_of_the_user_the_view_hides(scene):
    """As Blender's default cube; the objects themselves stay as they are."""
    window, area = find_view()
    for name in ("Cube", "Monument"):
        scene.collection.objects.link(bpy.data.objects.new(name, bpy.data.meshes.new(name)))
    built = scenes.build_scene(scene, complete(TINY))
    with bpy.context.temp_override(window=window, area=area):
        hidden = build.show_scene(bpy.context, built)
        cube, space = bpy.data.objects["Cube"], area.spaces.active
        assert (hidden, cube.visible_get(viewport=space)) == (2, False)
        assert (cube.hide_viewport, cube.hide_get()) == (False, False)
        assert built.terrain.visible_get(viewport=space)
        assert build.show_scene(bpy.context, built) == 0  # they are hidden already
    assert build.describe_build(built, 2).endswith("; this view hides 2 objects of your own, numpad / shows all")
    assert "of your own" not in build.describe_build(built, 0)
    scenes.clear_scene(scene)
    build._follow_views()
    assert cube.visible_get(viewport=space)
