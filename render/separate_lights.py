"""Renders the lights of a scene one by one.

With Open Shading Language Cycles writes no value passes, so truth is rendered without it. A surface whose nodes use the
direction of the light can follow only one source, and gives its own light to one light group. So Sun, planet and lamps
are rendered one after the other, and the image is their sum.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

import bpy

from ..nodes.build_scene import Built
from ..nodes.datablocks.fingerprint import TAG, find_instanced_objects
from ..nodes.light.scene_lights import ROLES
from ..nodes.surface import sun_inputs


@dataclass(frozen=True)
class LightPass:
    """The light in one render of an image: the omitted roles; the light group of the light that surfaces emit, None for
    the group of the scene; and the lamp that surfaces follow if neither Sun nor planet shines."""

    dark: tuple[str, ...] = ()
    group: str | None = None
    lamp: bpy.types.Object | None = None


def _find_sun_materials(built: Built) -> list[bpy.types.Material]:
    """Find the materials whose nodes use the direction of the light."""
    return [material for material in built.materials if sun_inputs.has_one_light_source(material)]


def list_light_passes(scene: bpy.types.Scene, built: Built) -> list[LightPass]:
    """List the renders whose sum is the image.

    A denoised image is one render, since its parts would be denoised one by one.
    """
    lamps = {lamp[TAG]: lamp for lamp in built.lamps}
    if (
        not scene.view_layers[0].lightgroups
        or (built.planetshine is None and not lamps)
        or scene.cycles.use_denoising
        or not _find_sun_materials(built)
    ):
        return [LightPass()]
    groups = {"sun": "Sun"} if built.sun.data.energy > 0 else {}
    groups |= {"planetshine": "Planet"} if built.planetshine is not None else {}
    groups |= {role: lamp.lightgroup for role, lamp in lamps.items()}
    found: list[LightPass] = []
    for role, group in groups.items():
        # The first one has the visible planet, the rings and the stars too.
        others = ("sun", *ROLES) if found else tuple(groups)
        found.append(LightPass(tuple(each for each in others if each != role), group, lamps.get(role)))
    return found


@contextmanager
def use_light(built: Built, light: LightPass) -> Iterator[None]:
    """Limit the scene to this light, until the end of the ``with`` block."""
    if light.group is None:
        yield
        return
    sun = sun_inputs.Sun.from_lamp(built.sun, built.sun.matrix_world)
    with ExitStack() as undo:

        def set_value(datablock: bpy.types.bpy_struct, name: str, value: object) -> None:
            undo.callback(setattr, datablock, name, getattr(datablock, name))
            setattr(datablock, name, value)

        undo.callback(
            lambda: sun_inputs.set_light_inputs(_find_sun_materials(built), sun, built.planetshine, built.lamps)
        )
        for item in list(built.collection.all_objects):
            if item.get(TAG) in light.dark:
                set_value(item, "hide_render", True)
            for each in (item, *find_instanced_objects(item)) if item.get(TAG) in ("terrain", "rock") else ():
                if each.lightgroup:
                    set_value(each, "lightgroup", light.group)
        if light.lamp is not None:
            sun_inputs.set_light_inputs(_find_sun_materials(built), sun_inputs.Sun.of_lamp(light.lamp), None)
        else:
            shining = replace(sun, irradiance_wm2=(0.0, 0.0, 0.0)) if "sun" in light.dark else sun
            sun_inputs.set_light_inputs(_find_sun_materials(built), shining, built.planetshine)
        yield


@contextmanager
def disable_osl(scene: bpy.types.Scene) -> Iterator[None]:
    """Switch Open Shading Language off, as truth needs, until the end of the ``with`` block. Surfaces with OSL would
    then transmit rays, so they become plain surfaces.
    """
    if not scene.cycles.shading_system:
        yield
        return
    with ExitStack() as undo:
        for material in bpy.data.materials:
            tree = material.node_tree
            if tree is None or not any(node.bl_idname == "ShaderNodeScript" for node in tree.nodes):
                continue
            output = tree.get_output_node("CYCLES")
            if output is not None and output.inputs["Surface"].links:
                undo.callback(tree.links.new, output.inputs["Surface"].links[0].from_socket, output.inputs["Surface"])
                plain = tree.nodes.new("ShaderNodeBsdfDiffuse")
                undo.callback(tree.nodes.remove, plain)
                tree.links.new(plain.outputs[0], output.inputs["Surface"])
        scene.cycles.shading_system = False
        undo.callback(setattr, scene.cycles, "shading_system", True)
        yield
