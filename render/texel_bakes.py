"""Bakes light by Cycles to texels within the facets of a mesh, see ``physics.light.baked_texels``."""

from __future__ import annotations

from contextlib import ExitStack

import bpy
import numpy as np

from ..physics.light import baked_texels
from ..support.arrays import Array
from ..support.labels import BAKED_ATTRIBUTES
from .mesh_arrays import read_corners


def lay_out_mesh_texels(mesh: bpy.types.Mesh, lit: Array) -> baked_texels.Texels:
    """Lay out the texels of the facets around the vertices of a mesh that are ``lit``."""
    starts, counts, corners, areas = read_facets(mesh)
    wanted = np.logical_or.reduceat(lit[corners], starts) if len(starts) else np.zeros(0, bool)
    return baked_texels.lay_out_texels(starts, counts, corners, areas, wanted)


def read_facets(mesh: bpy.types.Mesh) -> tuple[Array, Array, Array, Array]:
    """Read the facets of a mesh: for each facet its first corner, number of corners and area in m² (last in the tuple),
    and for each corner its vertex."""
    count = len(mesh.polygons)
    starts, corners, areas = np.empty(count, np.int32), read_corners(mesh), np.empty(count, np.float32)
    mesh.polygons.foreach_get("loop_start", starts)
    mesh.polygons.foreach_get("area", areas)
    return starts, np.diff(starts, append=len(corners)), corners, areas


def add_target_image(mesh: bpy.types.Mesh, found: baked_texels.Texels, undo: ExitStack) -> bpy.types.Image:
    """Add an image with the texels of a mesh. Their positions are the mesh's active texture coordinates until
    ``undo``."""
    name, before = f"{BAKED_ATTRIBUTES['Sun']}_target", mesh.uv_layers.active_index
    undo.callback(setattr, mesh.uv_layers, "active_index", before)
    mesh.uv_layers.new(name=name, do_init=False)
    undo.callback(lambda: mesh.uv_layers.remove(mesh.uv_layers[name]))
    mesh.uv_layers[name].uv.foreach_set("vector", found.places.reshape(-1))
    mesh.uv_layers.active = mesh.uv_layers[name]
    image = bpy.data.images.new(name, found.side, found.side, alpha=True, float_buffer=True, is_data=True)
    undo.callback(bpy.data.images.remove, image)
    return image


def direct_bake_to_image(tree: bpy.types.NodeTree, image: bpy.types.Image, undo: ExitStack) -> None:
    """Direct a bake of a surface to an image, until ``undo``."""
    before, node = tree.nodes.active, tree.nodes.new("ShaderNodeTexImage")
    node.image = image

    def remove_node() -> None:
        tree.nodes.remove(node)
        tree.nodes.active = before

    undo.callback(remove_node)
    tree.nodes.active = node


def read_texels(image: bpy.types.Image) -> Array:
    """Read the texels (n, 4) of an image; the last number is 0 where nothing was baked."""
    texels = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(texels)
    return texels.reshape(-1, 4)


def run_bake(scene: bpy.types.Scene, item: bpy.types.Object, **what: object) -> str:
    """Bake ``what`` of an object to its target. Returns the reason in parentheses, for a sentence, if Cycles failed;
    else empty."""
    layer = scene.view_layers[0]
    layer.objects.active = item
    item.select_set(True, view_layer=layer)
    with bpy.context.temp_override(
        scene=scene,
        view_layer=layer,
        active_object=item,
        object=item,
        selected_objects=[item],
        selected_editable_objects=[item],
    ):
        try:
            done = bpy.ops.object.bake(
                **what,
                target="IMAGE_TEXTURES",
                save_mode="INTERNAL",
                use_clear=True,
                margin=0,
                use_selected_to_active=False,
            )
        except RuntimeError as error:
            return f" ({str(error).removeprefix('Error: ').strip().splitlines()[0]})"
    return "" if done == {"FINISHED"} else " (it was cancelled)"
