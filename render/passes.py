"""Which images a render writes: radiance in one view layer, truth in another.

Truth needs its own layer because Cycles averages normals and value passes over samples; at one
sample every pass is taken at the pixel centre and nothing is blended at edges.
"""

from __future__ import annotations

import bpy

from .. import compat
from ..labels import BEAUTY, INSTANCE_AOV, LIGHT_GROUPS, NORMAL_AOV, TRUTH


def _only(layer: bpy.types.ViewLayer, *passes: str) -> None:
    """Switch exactly these passes of a view layer on."""
    for settings in (layer, layer.cycles):
        for prop in settings.bl_rna.properties:
            if prop.identifier.startswith("use_pass_"):
                setattr(settings, prop.identifier, prop.identifier in passes)


def apply(scene: bpy.types.Scene, light_groups: bool) -> None:
    """Give a scene the two view layers, stereo views and file output.

    With ``light_groups`` the light of each is a pass of its own too.

    A render writes ``_L.exr`` and ``_R.exr`` behind the scene's file path, 32-bit multilayer OpenEXR.
    """
    beauty = scene.view_layers[0]
    beauty.name = BEAUTY
    beauty.samples = 0  # as many as the scene says
    beauty.material_override = None
    _only(beauty, "use_pass_combined")
    for group in LIGHT_GROUPS if light_groups else ():
        beauty.lightgroups.add(name=group)
    truth = scene.view_layers.new(TRUTH)
    truth.samples = 1
    _only(truth, "use_pass_combined", "use_pass_z", "use_pass_normal", "use_pass_object_index",
          "use_pass_material_index")
    truth.cycles.use_denoising = False
    for name, kind in ((NORMAL_AOV, "COLOR"), (INSTANCE_AOV, "VALUE")):
        aov = truth.aovs.add()
        aov.name, aov.type = name, kind

    render = scene.render
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
