"""Which images a render writes: radiance in one, truth in another.

Truth is rendered by itself because Cycles averages normals and value passes over samples; at one
sample every pass is taken at the pixel centre and nothing is blended at edges. Both renders are of the
same view layer, since Cycles would build its tree of triangles for each layer again.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..support.blender import compat
from ..support.labels import BAKED_AOVS, BAKED_ERROR_AOVS, BEAUTY, INSTANCE_AOV, LIGHT_GROUPS, NORMAL_AOV, TRUTH

_SUFFIX = {"left": "_L", "right": "_R"}


def _enable_passes(layer: bpy.types.ViewLayer, *passes: str) -> None:
    """Switch exactly these passes of a view layer on."""
    for settings in (layer, layer.cycles):
        for prop in settings.bl_rna.properties:
            if prop.identifier.startswith("use_pass_"):
                setattr(settings, prop.identifier, prop.identifier in passes)


def prepare_scene(scene: bpy.types.Scene, light_groups: bool, baked: bool = False) -> None:
    """Set up a new scene for all its renders: stereo views, file output (32-bit multilayer OpenEXR, a file for each
    eye), value passes, with ``baked`` also for baked light and its error and, with ``light_groups``, a pass for each
    group.

    The passes must stay as they are as long as Cycles keeps the scene: its shaders write them without asking again
    whether they are wanted.
    """
    layer = scene.view_layers[0]
    layer.material_override = None
    layer.samples = 0  # as many as the scene has
    light = (
        [
            (names[group], kind)
            for names, kind in ((BAKED_AOVS, "COLOR"), (BAKED_ERROR_AOVS, "VALUE"))
            for group in names
            if light_groups or group == "Sun"
        ]
        if baked
        else []
    )
    for name, kind in ((NORMAL_AOV, "COLOR"), (INSTANCE_AOV, "VALUE"), *light):
        aov = layer.aovs.add()
        aov.name, aov.type = name, kind
    for group in LIGHT_GROUPS if light_groups else ():
        layer.lightgroups.add(name=group)

    render = scene.render
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_multiview = True
    render.views_format = "STEREO_3D"
    for view in render.views:
        view.use = view.name in ("left", "right")
    compat.use_multilayer_exr(render.image_settings)
    render.image_settings.color_depth = "32"
    # These files are read once, changed and removed; a pair's files are compressed as they are put together.
    render.image_settings.exr_codec = "NONE"
    render.image_settings.views_format = "INDIVIDUAL"
    render.use_file_extension = True
    render.use_overwrite, render.use_placeholder = True, False


#: Passes of the truth that Cycles takes from the first sample, so they may come with the radiance, by
#: ``quality.truth``; and all passes of the truth. It averages normals and value passes over samples.
_FIRST_SAMPLE: dict[str, tuple[str, ...]] = {
    "DEPTH": ("use_pass_z",),
    "SEMANTIC": ("use_pass_z", "use_pass_material_index"),
    "FULL": (),
}
_TRUTH_PASSES = _FIRST_SAMPLE | {
    "FULL": ("use_pass_z", "use_pass_normal", "use_pass_object_index", "use_pass_material_index")
}


def choose_layer(scene: bpy.types.Scene, name: str, stem: Path, truth: str) -> dict[str, Path]:
    """Let the next render be ``BEAUTY`` or ``TRUTH``, and return the files, by eye, that it will write at ``stem``; of
    a camera that is no pair the one file, with an empty name.

    ``truth`` is the wanted truth, as in ``quality.truth``. All but FULL comes with the radiance.
    """
    layer = scene.view_layers[0]
    layer.name = name
    if name == BEAUTY:
        _enable_passes(layer, "use_pass_combined", *_FIRST_SAMPLE[truth])
    else:
        scene.cycles.samples = 1
        scene.cycles.max_bounces = 0  # light after the first hit is not used
        scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
        _enable_passes(layer, "use_pass_combined", *_TRUTH_PASSES[truth])
    scene.render.filepath = str(stem)
    suffixes = _SUFFIX if scene.render.use_multiview else {"": ""}
    return {eye: stem.with_name(f"{stem.name}{suffix}.exr") for eye, suffix in suffixes.items()}


#: Passes that renders have and nobody needs: those that mean something in the other render only, the colour of the
#: truth's one sample, the image before the denoiser, and baked light, which has been added to the image.
UNWANTED = {
    *(f"{BEAUTY}.{name}" for name in (NORMAL_AOV, INSTANCE_AOV)),
    f"{TRUTH}.Combined",
    *(f"{layer}.{name}" for layer in (BEAUTY, TRUTH) for name in BAKED_AOVS.values()),
    *(f"{TRUTH}.{name}" for name in BAKED_ERROR_AOVS.values()),
    *(f"{TRUTH}.Combined_{group}" for group in LIGHT_GROUPS),
    f"{BEAUTY}.Noisy Image",
}
