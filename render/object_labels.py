"""Labels objects that the user added to the scene, for the time of a render.

A lander that the user puts into the collection "Icy Moon" has no labels, unless the user gave pass indices to it or to
its materials. A render gives it an instance label and a semantic label, and resets them at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy

from ..nodes.datablocks.fingerprint import TAG
from ..support.blender import compat
from ..support.errors import IcyMoonError
from ..support.labels import FIRST_OBJECT_INSTANCE, LANDER, LAST_OBJECT_INSTANCE


def _list_materials(item: bpy.types.Object) -> set[bpy.types.Material]:
    slots = [slot.material for slot in item.material_slots]
    return {m.original for m in (*slots, *item.data.materials) if m is not None}


def _find_user_objects(scene: bpy.types.Scene) -> dict[bpy.types.Object, set[bpy.types.Material]]:
    """Find the objects with a surface that the builders did not make, each with all its materials, in the order of
    their names.

    Objects of collection instances and of geometry nodes count too, as do the materials that a modifier sets.
    """
    layer = scene.view_layers[0]
    layer.update()
    found: dict[bpy.types.Object, set[bpy.types.Material]] = {}

    def add_object(item: bpy.types.Object) -> None:
        if TAG not in item.original and hasattr(item.data, "materials"):
            found.setdefault(item.original, set()).update(_list_materials(item))

    for instance in layer.depsgraph.object_instances:
        add_object(instance.object)  # the instance is invalid at the next turn: Blender crashes if it is kept
    for item in scene.objects:
        add_object(item)
    return dict(sorted(found.items(), key=lambda entry: entry[0].name))


def _make_grey_material() -> bpy.types.Material:
    """Make a material like Cycles' material for surfaces without one: diffuse, 0.8."""
    material = bpy.data.materials.new("Icy Moon Unlabelled")
    tree = compat.ensure_nodes(material)
    tree.nodes.clear()
    surface, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
    surface.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1.0)
    surface.inputs["Roughness"].default_value = 0.0
    tree.links.new(surface.outputs[0], output.inputs["Surface"])
    material.pass_index = LANDER
    return material


@contextmanager
def label_temporarily(scene: bpy.types.Scene) -> Iterator[None]:
    """Give each surface in the scene a semantic label, and each object an instance label, until the end of the ``with``
    block.

    Pass indices that the user set are kept. Raises IcyMoonError if there are more objects than labels.
    """
    objects = _find_user_objects(scene)
    taken = {item.pass_index for item in (*scene.objects, *objects)}
    free = (label for label in range(FIRST_OBJECT_INSTANCE, LAST_OBJECT_INSTANCE + 1) if label not in taken)
    with ExitStack() as undo:
        grey = _make_grey_material()
        undo.callback(bpy.data.materials.remove, grey)

        def set_index(datablock: bpy.types.bpy_struct, name: str, value: object) -> None:
            undo.callback(setattr, datablock, name, getattr(datablock, name))
            setattr(datablock, name, value)

        for item, materials in objects.items():
            if item.pass_index == 0:
                label = next(free, None)
                if label is None:
                    raise IcyMoonError(
                        f"The collection Icy Moon contains more objects of yours than the {LAST_OBJECT_INSTANCE} "
                        "instance labels; join some of them."
                    )
                set_index(item, "pass_index", label)
            for material in materials:
                if material.pass_index == 0:
                    set_index(material, "pass_index", LANDER)
            for slot in item.material_slots:
                if slot.material is None:
                    set_index(slot, "material", grey)
            if not materials and not item.material_slots:
                item.data.materials.append(grey)
                undo.callback(item.data.materials.pop)
        yield
