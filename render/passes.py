"""Which images a render writes: radiance in one, truth in another.

Truth is rendered by itself because Cycles averages normals and value passes over samples; at one
sample every pass is taken at the pixel centre and nothing is blended at edges. Both renders are of the
same view layer, since Cycles would build its tree of triangles for each layer again.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy

from .. import compat
from ..labels import BEAUTY, INSTANCE_AOV, LIGHT_GROUPS, NORMAL_AOV

_SUFFIX = {"left": "_L", "right": "_R"}


def _only(layer: bpy.types.ViewLayer, *passes: str) -> None:
    """Switch exactly these passes of a view layer on."""
    for settings in (layer, layer.cycles):
        for prop in settings.bl_rna.properties:
            if prop.identifier.startswith("use_pass_"):
                setattr(settings, prop.identifier, prop.identifier in passes)


def apply(scene: bpy.types.Scene, rig: Mapping[str, Any]) -> None:
    """Give a scene one view layer, stereo views and file output: 32-bit multilayer OpenEXR, a file for each eye."""
    layer = scene.view_layers[0]
    layer.material_override = None
    layer.samples = 0  # as many as the scene says
    render = scene.render
    render.resolution_x, render.resolution_y = rig["width_px"], rig["height_px"]
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_multiview = True
    render.views_format = "STEREO_3D"
    for view in render.views:
        view.use = view.name in ("left", "right")
    compat.use_multilayer_exr(render.image_settings)
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "ZIP"
    render.image_settings.views_format = "INDIVIDUAL"
    render.use_file_extension = True
    render.use_overwrite, render.use_placeholder = True, False


def choose(scene: bpy.types.Scene, name: str, folder: Path, light_groups: bool) -> dict[str, Path]:
    """Let the next render be ``BEAUTY`` or ``TRUTH``, and return the files that it will write, by eye.

    With ``light_groups`` the radiance of each is a pass of its own too. The samples of radiance are the scene's.
    """
    layer = scene.view_layers[0]
    layer.name = name
    while layer.aovs:
        layer.aovs.remove(layer.aovs[0])
    compat.remove_light_groups(scene, layer)
    if name == BEAUTY:
        _only(layer, "use_pass_combined")
        for group in LIGHT_GROUPS if light_groups else ():
            layer.lightgroups.add(name=group)
    else:
        scene.cycles.samples = 1
        scene.cycles.use_denoising = False
        _only(layer, "use_pass_combined", "use_pass_z", "use_pass_normal", "use_pass_object_index",
              "use_pass_material_index")
        for aov_name, kind in ((NORMAL_AOV, "COLOR"), (INSTANCE_AOV, "VALUE")):
            aov = layer.aovs.add()
            aov.name, aov.type = aov_name, kind
    scene.render.filepath = str(folder / name)
    return {eye: folder / f"{name}{suffix}.exr" for eye, suffix in _SUFFIX.items()}
