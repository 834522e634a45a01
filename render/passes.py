"""The passes of each render: one render has the radiance, another one the truth.

Truth needs a separate render because Cycles averages normals and value passes over samples. With one sample each pass
is taken at the pixel centre, and edges are not blended. Both renders use the same view layer, since Cycles builds its
tree of triangles for each layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from ..support.blender import compat
from ..support.labels import (
    BAKED_AOVS,
    BAKED_ERROR_AOVS,
    BEAUTY,
    INSTANCE_AOV,
    LAMP_GROUPS,
    LIGHT_GROUPS,
    NORMAL_AOV,
    TRUTH,
)

_FILE_SUFFIX_BY_EYE = {"left": "_L", "right": "_R"}


def _enable_only(layer: bpy.types.ViewLayer, *passes: str) -> None:
    """Enable only these passes of a view layer."""
    for settings in (layer, layer.cycles):
        for prop in settings.bl_rna.properties:
            if prop.identifier.startswith("use_pass_"):
                setattr(settings, prop.identifier, prop.identifier in passes)


def prepare_scene(scene: bpy.types.Scene, light_groups: bool, baked: bool = False, lamps: Sequence[str] = ()) -> None:
    """Set up a new scene for all its renders: stereo views, file output (32-bit multilayer OpenEXR, a file for each
    eye), value passes, with ``baked`` also for baked light and its error and, with ``light_groups``, a pass for each
    group, also for the groups of ``lamps``.

    The passes must stay the same as long as Cycles keeps the scene, since its shaders go on writing them.
    """
    layer = scene.view_layers[0]
    layer.material_override = None
    layer.samples = 0  # 0: as many as the scene has
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
    for group in (*LIGHT_GROUPS, *lamps) if light_groups else ():
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
    # These files are read once, changed and removed. The pair's own files are compressed when they are written.
    render.image_settings.exr_codec = "NONE"
    render.image_settings.views_format = "INDIVIDUAL"
    render.use_file_extension = True
    render.use_overwrite, render.use_placeholder = True, False


#: Passes of the truth by ``quality.truth``: first the passes that Cycles takes from the first sample, which may come
#: with the radiance; then all passes. Cycles averages normals and value passes over samples.
_FIRST_SAMPLE_PASSES: dict[str, tuple[str, ...]] = {
    "DEPTH": ("use_pass_z",),
    "SEMANTIC": ("use_pass_z", "use_pass_material_index"),
    "FULL": (),
}
_TRUTH_PASSES = _FIRST_SAMPLE_PASSES | {
    "FULL": ("use_pass_z", "use_pass_normal", "use_pass_object_index", "use_pass_material_index")
}


def choose_layer(scene: bpy.types.Scene, name: str, stem: Path, truth: str) -> dict[str, Path]:
    """Prepare the next render of ``BEAUTY`` or ``TRUTH``, and return the files, by eye, that it will write at ``stem``;
    for a single camera one file, with an empty name.

    ``truth`` is as in ``quality.truth``. All truth but FULL comes with the radiance.
    """
    layer = scene.view_layers[0]
    layer.name = name
    if name == BEAUTY:
        _enable_only(layer, "use_pass_combined", *_FIRST_SAMPLE_PASSES[truth])
    else:
        scene.cycles.samples = 1
        scene.cycles.max_bounces = 0  # light after the first hit has no effect on truth
        scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
        _enable_only(layer, "use_pass_combined", *_TRUTH_PASSES[truth])
    scene.render.filepath = str(stem)
    suffixes = _FILE_SUFFIX_BY_EYE if scene.render.use_multiview else {"": ""}
    return {eye: stem.with_name(f"{stem.name}{suffix}.exr") for eye, suffix in suffixes.items()}


#: Passes that are dropped: passes of one render that have a meaning only in the other, the colour of the truth's one
#: sample, the image before the denoiser, and baked light, which the image already contains.
UNWANTED_PASSES = {
    *(f"{BEAUTY}.{name}" for name in (NORMAL_AOV, INSTANCE_AOV)),
    f"{TRUTH}.Combined",
    *(f"{layer}.{name}" for layer in (BEAUTY, TRUTH) for name in BAKED_AOVS.values()),
    *(f"{TRUTH}.{name}" for name in BAKED_ERROR_AOVS.values()),
    *(f"{TRUTH}.Combined_{group}" for group in (*LIGHT_GROUPS, *LAMP_GROUPS)),
    f"{BEAUTY}.Noisy Image",
}
