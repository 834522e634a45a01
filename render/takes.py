"""The renders that a pair takes: one, or two or three whose files are joined.

With Open Shading Language Cycles writes no value passes, so truth is rendered without it. And a surface that
asks where the light comes from has its law for one source, and one light group for what it gives by itself; so by day
Sun and planet are rendered one after the other, and their sum is the image.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ..errors import IcyMoonError
from ..files import disk_errors
from ..labels import BEAUTY, TRUTH
from ..nodes import sunlight
from ..nodes.fingerprint import TAG, instanced
from ..nodes.lights import ROLES
from ..nodes.scene import Built
from .exr_check import is_whole
from .exr_join import join
from .pair import EYES

#: What Blender ends the files of the two eyes with.
SUFFIX = dict(zip(EYES, ("_L", "_R"), strict=True))


def _asking(built: Built) -> list[bpy.types.Material]:
    """The materials that ask where the light comes from."""
    return [material for material in built.materials if sunlight.asks(material)]


def _lights(scene: bpy.types.Scene, built: Built) -> list[tuple[tuple[str, ...], str]]:
    """What to render one after the other: the roles to leave out, and the light group of what surfaces give by
    themselves; nothing if all lights go together.

    A denoised image is rendered at once: its parts would be denoised apart.
    """
    if (not scene.view_layers[0].lightgroups or built.planetshine is None or scene.cycles.use_denoising
            or not _asking(built)):
        return []
    if built.sun.data.energy > 0:
        return [(("planetshine",), "Sun"), (("sun", *(role for role in ROLES if role != "planetshine")), "Planet")]
    return [((), "Planet")]


def count(scene: bpy.types.Scene, built: Built) -> int:
    """How often the radiance layer is rendered."""
    return max(1, len(_lights(scene, built)))


@contextmanager
def _only(built: Built, dark: tuple[str, ...], group: str) -> Iterator[None]:
    """Objects of the roles ``dark`` are left out, and what surfaces give by themselves is in a light group."""
    sun = sunlight.Sun.from_lamp(built.sun, built.sun.matrix_world)
    with ExitStack() as undo:
        def lend(block: Any, name: str, value: Any) -> None:
            undo.callback(setattr, block, name, getattr(block, name))
            setattr(block, name, value)

        undo.callback(lambda: sunlight.aim(_asking(built), sun, built.planetshine))
        for item in list(built.collection.all_objects):
            if item.get(TAG) in dark:
                lend(item, "hide_render", True)
            for each in (item, *instanced(item)) if item.get(TAG) in ("terrain", "rock") else ():
                if each.lightgroup:
                    lend(each, "lightgroup", group)
        sunlight.aim(_asking(built), replace(sun, irradiance_wm2=(0.0, 0.0, 0.0)) if "sun" in dark else sun,
                     built.planetshine)
        yield


@contextmanager
def _without_osl(scene: bpy.types.Scene) -> Iterator[None]:
    """Open Shading Language is off, and what is made of it, which rays would pass through then, is a plain surface."""
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


def _render(scene: bpy.types.Scene, layers: tuple[str, ...], stem: Path) -> None:
    scene.render.filepath = str(stem)
    for layer in scene.view_layers:
        layer.use = layer.name in layers
    bpy.ops.render.render(write_still=True, scene=scene.name)
    for suffix in SUFFIX.values():
        written = stem.with_name(f"{stem.name}{suffix}.exr")
        if not is_whole(written):
            raise IcyMoonError(f"Blender could not write the whole image {written}; the disk is full or the folder may "
                               "not be written to.")


def render(scene: bpy.types.Scene, built: Built, stem: Path, layers: tuple[str, ...]) -> None:
    """Render these view layers of a scene that has its passes into ``<stem>_L.exr`` and ``<stem>_R.exr``.

    Raises RuntimeError if Cycles cannot, IcyMoonError if the images cannot be written whole.
    """
    osl, lights = scene.cycles.shading_system, _lights(scene, built)
    if BEAUTY not in layers:
        with _without_osl(scene) if osl else nullcontext():
            _render(scene, layers, stem)
        return
    truth, planet = (stem.with_name(f"{stem.name}_{name}") for name in ("truth", "planet"))
    for number in range(max(1, len(lights))):
        with _only(built, *lights[number]) if lights else nullcontext():
            _render(scene, (BEAUTY,) if osl or number else layers, (stem, planet)[number])
    truth_apart = osl and TRUTH in layers
    if truth_apart:
        with _without_osl(scene):
            _render(scene, (TRUTH,), truth)
    for suffix in SUFFIX.values() if truth_apart or len(lights) > 1 else ():
        image, of_truth, of_planet = (of.with_name(f"{of.name}{suffix}.exr") for of in (stem, truth, planet))
        with disk_errors("write", image):
            join(image, of_truth if truth_apart else None, of_planet if len(lights) > 1 else None)
