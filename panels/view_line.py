"""What the 3D View shows otherwise than a render of the pair, in one line for each way of shading."""

from __future__ import annotations

from typing import Any


def view_line(space: Any, engine: str) -> str:
    """How what a 3D View shows differs from a pair, if the scene has this render engine; empty without a view."""
    if space is None:
        return ""
    shading = space.shading
    if shading.type == "WIREFRAME":
        return "Wireframe view: no light, no surfaces"
    if shading.type == "SOLID":
        return "Solid view: no Sun, shadows or exposure"
    name, lit = (("Rendered view", shading.use_scene_lights_render and shading.use_scene_world_render)
                 if shading.type == "RENDERED" else
                 ("Material Preview", shading.use_scene_lights and shading.use_scene_world))
    if shading.type == "RENDERED" and engine == "BLENDER_WORKBENCH":
        return f"{name} by Workbench: no Sun, no shadows"
    if not lit:
        return f"{name}: not the light of the scene"
    if shading.type == "RENDERED" and engine == "CYCLES":
        return f"{name}: as the pair, but for exposure and noise"
    return f"{name} by EEVEE: approximate light and shadows"
