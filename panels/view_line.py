"""Differences of the 3D View from a render of the pair, in one line for each kind of shading."""

from __future__ import annotations

import bpy

#: A text about as long as the longest line that changes while the user works on a scene.
LONGEST = "Rendered view, auto exposure: as the pair, but for noise, half resolution, coarse ground"
#: Texts on the comparison with a pair, by the result of ``view_exposure.describe_exposure``.
_COMPARISON_TEXTS = {
    "": "as the pair, but for noise",
    "automatic": "as the pair, but for noise",
    "other": "as the pair, but for exposure and noise",
    "estimated": "as the pair, exposure estimated",
}


def describe_view(
    space: bpy.types.Space,
    engine: str,
    exposed: str = "other",
    coarse: bool = False,
    covered: bool = False,
    without_planetshine: bool = False,
    coarse_ground: bool = False,
) -> str:
    """Describe how the picture in a 3D View differs from a pair, for a scene with this render engine; empty without a
    view.

    ``exposed`` is a key of ``_COMPARISON_TEXTS``. A ``coarse`` view has larger pixels than the user has chosen. A
    ``covered`` view shows the picture by which the scene was chosen. A view ``without_planetshine`` leaves out
    planetshine that is too faint to see. On ``coarse_ground`` the smallest relief is missing.
    """
    if space is None:
        return ""
    shading = space.shading
    if shading.type == "WIREFRAME":
        return "Wireframe view: no light, no surfaces"
    if shading.type == "SOLID":
        return "Solid view: no Sun, shadows or exposure"
    name, lit = (
        ("Rendered view", shading.use_scene_lights_render and shading.use_scene_world_render)
        if shading.type == "RENDERED"
        else ("Material Preview", shading.use_scene_lights and shading.use_scene_world)
    )
    if shading.type == "RENDERED" and engine == "BLENDER_WORKBENCH":
        return f"{name} by Workbench: no Sun, no shadows"
    if not lit:
        return f"{name}: not the light of the scene"
    if shading.type == "RENDERED" and engine == "CYCLES":
        if covered:
            return f"{name}: a picture of the scene until it is clear"
        name += ", auto exposure" if exposed == "automatic" else ""
        return (
            f"{name}: {_COMPARISON_TEXTS[exposed]}{', half resolution' if coarse else ''}"
            f"{', coarse ground' if coarse_ground else ''}"
            f"{', no faint planetshine' if without_planetshine else ''}"
        )
    return f"{name} by EEVEE: approximate light and shadows"
