"""The landform of a plug-in in Blender: its properties, its panel, and its scene opened without the package."""

import subprocess
import sys

import bpy
import pytest
from icymoon.settings.blender import scene_properties
from icymoon.support.blender import compat
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT
from plugin_packages import install_project

EXAMPLE = ROOT / "docs" / "examples" / "icymoon-wave-landform"
IN_BLENDER = """
import os, sys
sys.path.append(sys.argv[1])
import bpy, icymoon
from icymoon.settings.blender import scene_properties
from icymoon.settings.pair_ids import make_pair_id
icymoon.register()
scene = bpy.context.scene
plain = make_pair_id(scene_properties.read_settings(scene.icymoon))
scene.icymoon.landform_waves.height_m = 0.5
settings = scene_properties.read_settings(scene.icymoon)
assert settings["landform_waves"]["made_by"] == "icymoon-wave-landform 1.0.0", settings["landform_waves"]
assert scene_properties.read_for_display(scene.icymoon) == settings  # so that nothing looks changed
assert make_pair_id(settings) != plain
panel = bpy.types.ICYMOON_PT_landform_waves
assert (panel.bl_label, panel.bl_parent_id) == ("Frost Waves", "ICYMOON_PT_landforms")
assert scene.icymoon.landform_waves.bl_rna.properties["height_m"].description.startswith("Height of the highest crests")
assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])
icymoon.unregister()
print("as it should be", flush=True)
os._exit(0)
"""


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A scene that was saved where the example is installed."""
    folder = tmp_path_factory.mktemp("landform")
    install_project(EXAMPLE, folder / "site")
    done = subprocess.run(
        [sys.executable, "-c", IN_BLENDER, str(folder / "site"), str(folder / "scene.blend")],
        capture_output=True,
        text=True,
        check=False,
        timeout=110,
    )
    assert "as it should be" in done.stdout, done.stderr
    return folder / "scene.blend"


@pytest.mark.long
def test_it_is_refused_where_the_package_is_not_installed_and_not_left_out(saved):
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    group = bpy.context.scene.icymoon
    assert not hasattr(group, "landform_waves")
    assert compat.read_stored_groups(group)["landform_waves"]["height_m"] == 0.5
    with pytest.raises(
        IcyMoonError,
        match="This scene has settings of landform_waves, a landform of a package that is "
        "not installed in this Blender; install it, or make a new scene",
    ):
        scene_properties.read_settings(group)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene_properties.read_settings(bpy.context.scene.icymoon)
