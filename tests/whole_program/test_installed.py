"""The extension as a person has it: the zip, installed in Blender, used, disabled, removed."""

from __future__ import annotations

import os

import pytest
from blender_program import run_main
from extension_zip import build

PROGRAM = """
    import os, sys, traceback
    from pathlib import Path
    import bpy

    archive, dataset = sys.argv[1:]

    def traces():
        handlers = {name: len(found) for name in dir(bpy.app.handlers)
                    if isinstance(found := getattr(bpy.app.handlers, name), list)}
        return (set(dir(bpy.types)), set(dir(bpy.ops.icymoon)), set(bpy.types.Scene.bl_rna.properties.keys()),
                set(bpy.types.WindowManager.bl_rna.properties.keys()), handlers,
                [len(getattr(bpy.types, name).draw._draw_funcs) for name in MENUS])

    MENUS = ("TOPBAR_MT_render", "VIEW3D_MT_mesh_add", "STATUSBAR_HT_header")

    def main():
        for name in MENUS:
            getattr(bpy.types, name).append(lambda self, context: None)  # so that there is a list of functions
        before = traces()
        bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
        add_on = bpy.context.preferences.addons["bl_ext.user_default.icymoon"]
        assert add_on.preferences.bl_rna.properties["evaluator"]
        assert "icymoon" not in sys.modules, "the installed extension used the checkout"
        operators = bpy.ops.icymoon
        assert operators.load_preset(preset="scenes/europa_rough_ice") == {"FINISHED"}
        group = bpy.context.scene.icymoon
        group.terrain.resolution, group.quality.samples = 65, 2
        group.rig.width_px, group.rig.height_px = 160, 120
        group.dataset.folder = dataset
        for step in (operators.build_scene, operators.render_pair, operators.evaluate):
            assert step() == {"FINISHED"}, step
        assert list(Path(dataset).glob("pairs/*/pair.json"))
        assert (Path(dataset) / "evaluation_scene" / "report.html").is_file()
        assert operators.add_preset(title="Mine") == {"FINISHED"}
        (mine,) = Path(os.environ["BLENDER_USER_RESOURCES"]).rglob("mine.toml")
        assert ".user" in mine.parts, "it is among the extension's own files, which an upgrade replaces"
        bpy.context.window_manager.icymoon_scene_preset = "scenes/europa_chaos"  # loads the pictures
        assert group.preset == "scenes/europa_chaos"
        assert operators.load_preset(preset="own/mine") == {"FINISHED"}
        assert group.rig.width_px == 160
        assert operators.add_block() == {"FINISHED"}
        bpy.ops.preferences.addon_disable(module="bl_ext.user_default.icymoon")
        assert traces() == before, [a ^ b if isinstance(a, set) else (a, b) for a, b in zip(traces(), before)]
        bpy.ops.preferences.addon_enable(module="bl_ext.user_default.icymoon")
        assert hasattr(bpy.types.Scene, "icymoon")
        repository = next(k for k, r in enumerate(bpy.context.preferences.extensions.repos)
                          if r.module == "user_default")
        bpy.ops.extensions.package_uninstall(repo_index=repository, pkg_id="icymoon")
        assert traces() == before, "uninstalling leaves traces"
        left = [path for path in Path(os.environ["BLENDER_USER_RESOURCES"]).rglob("*") if "icymoon" in path.name]
        assert not left, f"uninstalling leaves {left}"
        assert not [name for name in bpy.context.preferences.addons.keys() if "icymoon" in name]
    """


@pytest.mark.long
@pytest.mark.heavy
def test_the_zip_installs_works_and_goes_without_a_trace(tmp_path):
    archive = tmp_path / "icymoon.zip"
    build(archive)
    run_main(PROGRAM, archive, tmp_path, os.environ)
