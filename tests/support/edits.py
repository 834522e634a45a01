"""Changes that a user makes to a built scene by hand."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.datablocks import fingerprint
from rendering import complete, empty_scene

Undo = Callable[[], Any]
TINY: dict[str, Any] = {
    "terrain": {"resolution": 9},
    "rocks": {"coverage": 0.02, "smallest_m": 0.5, "most": 5},
    "light": {"planet": True, "planet_elevation_deg": 40.0},
}


def swap(struct: Any, name: str, value: Any) -> Undo:
    """Set a property; what is returned sets it back. A vertex may lie elsewhere by then, so a function may find it."""
    find = struct if callable(struct) else lambda: struct
    before = getattr(find(), name)
    before = tuple(before) if hasattr(before, "__len__") and not isinstance(before, str) else before
    setattr(find(), name, value)
    return lambda: setattr(find(), name, before)


def put_in(name: str, data: Any) -> bpy.types.Object:
    item = bpy.data.objects.new(name, data)
    collection = scenes.find_collection(bpy.context.scene)
    assert collection is not None
    collection.objects.link(item)
    return item


def removal(*blocks: Any) -> Undo:
    return lambda: bpy.data.batch_remove(blocks)


def cube_mesh(name: str = "Lander") -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(name)
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    mesh.uv_layers.new(name="UVMap")
    mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    return mesh


def packed_image(name: str, grey: float) -> bpy.types.Image:
    image = bpy.data.images.new(name, 4, 4)
    image.pixels.foreach_set(np.full(64, grey, np.float32))
    image.pack()
    return image


def group_of(name: str, kind: str, value: float) -> bpy.types.NodeTree:
    """A node group with a number in it."""
    group = bpy.data.node_groups.new(name, kind)
    group.nodes.new("ShaderNodeValue").outputs[0].default_value = value
    return group


def painted() -> bpy.types.Material:
    """A material with nodes of many kinds, a group in a group among them."""
    material = bpy.data.materials.new("Paint")
    material.use_nodes = True
    tree = material.node_tree
    for kind in (
        "TexNoise",
        "ValToRGB",
        "RGBCurve",
        "TexImage",
        "RGB",
        "Group",
        "Script",
        "Mapping",
        "TexVoronoi",
        "FloatCurve",
        "Attribute",
        "ObjectInfo",
    ):
        tree.nodes.new(f"ShaderNode{kind}").name = kind
    tree.nodes["TexImage"].image = packed_image("Decal", 0.5)
    outer = bpy.data.node_groups.new("Outer", "ShaderNodeTree")
    outer.nodes.new("ShaderNodeGroup").node_tree = group_of("Inner", "ShaderNodeTree", 0.25)
    tree.nodes["Group"].node_tree = outer
    text = bpy.data.texts.new("Shader")
    text.write("shader a() {}")
    tree.nodes["Script"].script = text
    tree.links.new(tree.nodes["RGB"].outputs[0], tree.nodes["RGBCurve"].inputs["Color"])
    return material


def populate() -> None:
    """Put into the built scene an object of every kind that may be in a picture."""
    lander = put_in("Lander", cube_mesh())
    lander.data.materials.append(painted())
    lander.shape_key_add(name="Basis")
    lander.shape_key_add(name="Bent")
    lander.modifiers.new("Subdivision", "SUBSURF")
    hook = lander.modifiers.new("Displace", "DISPLACE")
    hook.vertex_group = lander.vertex_groups.new(name="Legs").name
    lander.vertex_groups["Legs"].add([0, 1], 0.5, "REPLACE")
    nodes = lander.modifiers.new("Geometry", "NODES")
    geometry = group_of("Geometry", "GeometryNodeTree", 1.0)
    size = geometry.nodes.new("ShaderNodeVectorMath")
    size.name, size.mute = "Muted", True
    geometry.interface.new_socket("Amount", in_out="INPUT", socket_type="NodeSocketFloat")
    nodes.node_group = geometry
    shapes = bpy.data.collections.new("Shapes")
    for name in "AB":
        shapes.objects.link(bpy.data.objects.new(f"Shape {name}", cube_mesh(f"Shape {name}")))
    shapes.objects["Shape B"].data.vertices[0].co.x = -3
    info = nodes.node_group.nodes.new("GeometryNodeCollectionInfo")
    info.name, info.inputs["Collection"].default_value = "Info", shapes
    base = bpy.data.objects.new("Base", None)  # outside the collection, but what stands in it is attached to it
    bpy.context.scene.collection.objects.link(base)
    lander.parent = base
    lander.constraints.new("COPY_LOCATION").target = base
    for kind in ("POINT", "SPOT", "AREA", "SUN"):
        put_in(f"Lamp {kind}", bpy.data.lights.new(f"Lamp {kind}", kind))
    curve = bpy.data.curves.new("Cable", "CURVE")
    curve.splines.new("BEZIER").bezier_points.add(1)
    curve.splines.new("POLY").points.add(1)
    put_in("Cable", curve)
    put_in("Label", bpy.data.curves.new("Label", "FONT"))
    blob = bpy.data.metaballs.new("Blob")
    blob.elements.new()
    put_in("Blob", blob)
    put_in("Cage", bpy.data.lattices.new("Cage"))
    put_in("Dust", bpy.data.volumes.new("Dust"))
    put_in("Cloud", bpy.data.pointclouds.new("Cloud"))
    put_in("Fur", bpy.data.hair_curves.new("Fur"))
    instance = put_in("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", shapes
    put_in("Eye", bpy.data.cameras.new("Eye"))


@pytest.fixture(scope="module")
def built(registered: None) -> scenes.Built:
    scene = empty_scene()
    scenes.build_scene(scene, complete(TINY))
    populate()
    bpy.context.view_layer.update()
    found = scenes.find_built(scene)
    assert found is not None
    return found


def the(name: str) -> Any:
    return bpy.data.objects[name]


def node(name: str) -> Any:
    return bpy.data.materials["Paint"].node_tree.nodes[name]


def added_lamp(built: scenes.Built) -> Undo:
    item = put_in("New Lamp", bpy.data.lights.new("New Lamp", "POINT"))
    return removal(item, item.data)


def added_empty(built: scenes.Built) -> Undo:
    return removal(put_in("New Empty", None))


def linked_duplicate(built: scenes.Built) -> Undo:
    item = built.terrain.copy()
    built.collection.objects.link(item)
    return removal(item)


def removed_rocks(built: scenes.Built) -> Undo:
    rocks = next(c for c in built.collection.children)
    item = rocks.objects[0]
    rocks.objects.unlink(item)
    return lambda: rocks.objects.link(item)


def ramp_element(built: scenes.Built) -> Undo:
    elements = node("ValToRGB").color_ramp.elements
    element = elements.new(0.5)
    return lambda: elements.remove(element)


def curve_point(built: scenes.Built) -> Undo:
    return swap(node("RGBCurve").mapping.curves[3].points[0], "location", (0.0, 0.3))


def image_of_node(built: scenes.Built) -> Undo:
    other = packed_image("Other", 0.25)
    back = swap(node("TexImage"), "image", other)
    return lambda: (back(), bpy.data.images.remove(other))


def packed_pixels(built: scenes.Built) -> Undo:
    image = bpy.data.images["Decal"]

    def fill(grey: float) -> None:
        image.pixels.foreach_set(np.full(64, grey, np.float32))
        image.pack()

    fill(0.75)
    return lambda: fill(0.5)


def muted_link(built: scenes.Built) -> Undo:
    return swap(node("RGBCurve").inputs["Color"].links[0], "is_muted", True)


def removed_link(built: scenes.Built) -> Undo:
    tree = node("RGB").id_data
    tree.links.remove(node("RGBCurve").inputs["Color"].links[0])
    return lambda: tree.links.new(node("RGB").outputs[0], node("RGBCurve").inputs["Color"])


def edited_script(built: scenes.Built) -> Undo:
    text = bpy.data.texts["Shader"]
    text.write("// more")

    def back() -> None:
        text.clear()
        text.write("shader a() {}")

    return back


def moved_vertex(built: scenes.Built) -> Undo:
    return swap(lambda: built.terrain.data.vertices[7], "co", (9.0, 9.0, 9.0))


def _use_mesh(item: bpy.types.Object, mesh: bpy.types.Mesh) -> None:
    """Give an object a mesh, and remove the one that it has."""
    other, item.data = item.data, mesh
    bpy.data.meshes.remove(other)


def loose_edge(built: scenes.Built) -> Undo:
    """In a mesh that stands in for the lander's, since no edge can be removed by itself."""
    mesh = the("Lander").data
    copy = mesh.copy()
    copy.edges.add(1)
    copy.edges[-1].vertices = 0, 7
    the("Lander").data = copy
    return partial(_use_mesh, the("Lander"), mesh)


def turned_faces(built: scenes.Built) -> Undo:
    mesh = built.terrain.data
    mesh.flip_normals()
    return lambda: mesh.flip_normals()


def face_material(built: scenes.Built) -> Undo:
    return swap(lambda: the("Lander").data.polygons[2], "material_index", 1)


def flat_face(built: scenes.Built) -> Undo:
    return swap(lambda: built.terrain.data.polygons[3], "use_smooth", False)


def sharp_edge(built: scenes.Built) -> Undo:
    return swap(lambda: built.terrain.data.edges[3], "use_edge_sharp", True)


def custom_normals(built: scenes.Built) -> Undo:
    mesh = built.terrain.data
    copy = mesh.copy()
    copy.normals_split_custom_set([(1.0, 0.0, 0.0)] * len(mesh.loops))
    built.terrain.data = copy
    return partial(_use_mesh, built.terrain, mesh)


def colour_attribute(built: scenes.Built) -> Undo:
    return swap(lambda: the("Lander").data.color_attributes["Paint"].data[3], "color", (1.0, 0.0, 0.0, 1.0))


def attribute_of_the_ground(built: scenes.Built) -> Undo:
    mesh = built.terrain.data
    mesh.attributes.new("mine", "FLOAT", "FACE")
    return lambda: mesh.attributes.remove(mesh.attributes["mine"])


def keyed_shape(built: scenes.Built) -> Undo:
    return swap(lambda: the("Lander").data.shape_keys.key_blocks["Bent"].data[0], "co", (5.0, 5.0, 5.0))


def weight(built: scenes.Built) -> Undo:
    group = the("Lander").vertex_groups["Legs"]
    group.add([0], 1.0, "REPLACE")
    return lambda: group.add([0], 0.5, "REPLACE")


def input_of_nodes(built: scenes.Built) -> Undo:
    modifier = the("Lander").modifiers["Geometry"]
    name = modifier.node_group.interface.items_tree["Amount"].identifier
    if hasattr(modifier, "properties"):  # from 5.2 on
        return swap(getattr(modifier.properties.inputs, name), "value", 3.0)
    modifier[name] = 3.0
    return lambda: modifier.__setitem__(name, 0.0)


def modifier_on_the_ground(built: scenes.Built) -> Undo:
    modifier = built.terrain.modifiers.new("Wave", "SIMPLE_DEFORM")
    return lambda: built.terrain.modifiers.remove(modifier)


def constraint_on_the_sun(built: scenes.Built) -> Undo:
    constraint = built.sun.constraints.new("COPY_ROTATION")
    constraint.target = the("Base")
    return lambda: built.sun.constraints.remove(constraint)


def parented_sun(built: scenes.Built) -> Undo:
    return swap(built.sun, "parent", the("Base"))


def linked_light(built: scenes.Built) -> Undo:
    collection = bpy.data.collections.new("Lit")
    collection.objects.link(the("Lander"))
    back = swap(the("Lamp POINT").light_linking, "receiver_collection", collection)
    return lambda: (back(), bpy.data.collections.remove(collection))


def driven(built: scenes.Built) -> Undo:
    curve = the("Lamp POINT").driver_add("location", 0)
    curve.driver.expression = "2 + 3"

    def back() -> None:
        the("Lamp POINT").animation_data_clear()
        the("Lamp POINT").location = 0, 0, 0

    return back


def keyed(built: scenes.Built) -> Undo:
    the("Lamp POINT").keyframe_insert("location", frame=1)

    def back() -> None:
        action = the("Lamp POINT").animation_data.action
        the("Lamp POINT").animation_data_clear()
        bpy.data.actions.remove(action)

    return back


def material_of_the_ground(built: scenes.Built) -> Undo:
    return swap(built.terrain.material_slots[0], "material", bpy.data.materials["Paint"])


def material_of_an_object(built: scenes.Built) -> Undo:
    slot = built.terrain.material_slots[0]
    slot.link = "OBJECT"
    slot.material = bpy.data.materials["Paint"]

    def back() -> None:
        slot.material = None
        slot.link = "DATA"

    return back


def renamed_shape(built: scenes.Built) -> Undo:
    """Geometry nodes pick from a collection by the order of names."""
    return swap(the("Shape A"), "name", "Shape C")


def random_by_name(built: scenes.Built) -> Undo:
    tree = node("RGB").id_data
    link = tree.links.new(node("ObjectInfo").outputs["Random"], node("RGBCurve").inputs["Fac"])
    before = built.extra
    the("Lander").name = "Rover"
    assert built.extra != before

    def back() -> None:
        bpy.data.objects["Rover"].name = "Lander"
        tree.links.remove(link)

    return back


def hidden_collection(built: scenes.Built) -> Undo:
    return swap(built.collection.children[0], "hide_render", True)


def surface_of_a_rock(built: scenes.Built) -> Undo:
    rock = next(item for item in built.collection.all_objects if item.get(fingerprint.TAG) == "rock")
    shape = next(iter(fingerprint.find_instanced_objects(rock)))
    return swap(lambda: shape.data.vertices[0], "co", (7.0, 0.0, 0.0))


def on(get: Callable[[Any], Any], name: str, value: Any) -> Callable[[Any], Undo]:
    return lambda built: swap(lambda: get(built), name, value)


EDITS: dict[str, Callable[[Any], Undo]] = {
    edit.__name__: edit
    for edit in (
        added_lamp,
        added_empty,
        linked_duplicate,
        removed_rocks,
        ramp_element,
        curve_point,
        image_of_node,
        packed_pixels,
        muted_link,
        removed_link,
        edited_script,
        moved_vertex,
        loose_edge,
        turned_faces,
        face_material,
        flat_face,
        sharp_edge,
        custom_normals,
        colour_attribute,
        attribute_of_the_ground,
        keyed_shape,
        weight,
        input_of_nodes,
        modifier_on_the_ground,
        constraint_on_the_sun,
        parented_sun,
        linked_light,
        driven,
        keyed,
        material_of_the_ground,
        material_of_an_object,
        renamed_shape,
        random_by_name,
        hidden_collection,
        surface_of_a_rock,
    )
} | {
    "lamp of 500 W": on(lambda b: the("Lamp POINT").data, "energy", 500.0),
    "lamp's radius": on(lambda b: the("Lamp POINT").data, "shadow_soft_size", 2.0),
    "spot": on(lambda b: the("Lamp SPOT").data, "spot_size", 0.2),
    "area": on(lambda b: the("Lamp AREA").data, "shape", "DISK"),
    "lamp's kind": on(lambda b: the("Lamp AREA").data.cycles, "is_portal", True),
    "sun's shadow": on(lambda b: b.sun.data, "use_shadow", False),
    "sun's colour": on(lambda b: b.sun.data, "color", (1.0, 0.0, 0.0)),
    "kind of noise": on(lambda b: node("TexNoise"), "noise_type", "RIDGED_MULTIFRACTAL"),
    "kind of noise of the ground": on(
        lambda b: next(n for n in b.terrain.data.materials[0].node_tree.nodes if n.bl_idname == "ShaderNodeTexNoise"),
        "noise_dimensions",
        "4D",
    ),
    "ramp's colour": on(lambda b: node("ValToRGB").color_ramp.elements[0], "color", (1.0, 0.0, 0.0, 1.0)),
    "ramp's interpolation": on(lambda b: node("ValToRGB").color_ramp, "interpolation", "EASE"),
    "float curve": on(lambda b: node("FloatCurve").mapping.curves[0].points[0], "location", (0.0, 0.5)),
    "value of an output": on(lambda b: node("RGB").outputs[0], "default_value", (0.1, 0.2, 0.3, 1.0)),
    "group in a group": on(lambda b: bpy.data.node_groups["Inner"].nodes[0].outputs[0], "default_value", 0.5),
    "muted node": on(lambda b: node("RGBCurve"), "mute", True),
    "value that a muted node passes on": on(
        lambda b: bpy.data.node_groups["Geometry"].nodes["Muted"].inputs[0], "default_value", (3.0, 1.0, 1.0)
    ),
    "colour space": on(lambda b: bpy.data.images["Decal"].colorspace_settings, "name", "Non-Color"),
    "texture mapping": on(lambda b: node("TexImage").texture_mapping, "scale", (2.0, 1.0, 1.0)),
    "interpolation": on(lambda b: node("TexImage"), "interpolation", "Closest"),
    "displacement": on(lambda b: b.terrain.data.materials[0], "displacement_method", "BOTH"),
    "transparent shadow": on(lambda b: bpy.data.materials["Paint"], "use_transparent_shadow", False),
    "levels of subdivision": on(lambda b: the("Lander").modifiers["Subdivision"], "render_levels", 4),
    "modifier not rendered": on(lambda b: the("Lander").modifiers["Subdivision"], "show_render", False),
    "not rendered": on(lambda b: b.terrain, "hide_render", True),
    **{
        f"visible_{ray}": on(lambda b: the("Lander"), f"visible_{ray}", False)
        for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow")
    },
    "holdout": on(lambda b: b.terrain, "is_holdout", True),
    "shadow catcher": on(lambda b: b.terrain, "is_shadow_catcher", True),
    "light group": on(lambda b: the("Lander"), "lightgroup", "Sun"),
    "pass index": on(lambda b: the("Lander"), "pass_index", 7),
    "colour of an object": on(lambda b: the("Lander"), "color", (1.0, 0.0, 0.0, 1.0)),
    "place": on(lambda b: the("Lander"), "location", (0.0, 0.0, 1e-3)),
    "delta": on(lambda b: b.terrain, "delta_location", (0.0, 0.0, 1.0)),
    "quaternion": on(lambda b: the("Lander"), "rotation_quaternion", (0.0, 1.0, 0.0, 0.0)),
    "place of the parent": on(lambda b: the("Base"), "location", (0.0, 0.0, 1.0)),
    "constraint's influence": on(lambda b: the("Lander").constraints[0], "influence", 0.5),
    "value of a shape": on(lambda b: the("Lander").data.shape_keys.key_blocks["Bent"], "value", 0.5),
    "point of a curve": on(lambda b: the("Cable").data.splines[0].bezier_points[1], "co", (0.0, 1.0, 0.0)),
    "bevel of a curve": on(lambda b: the("Cable").data, "bevel_depth", 0.1),
    "text": on(lambda b: the("Label").data, "body", "ESA"),
    "metaball": on(lambda b: the("Blob").data.elements[0], "radius", 3.0),
    "lattice": on(lambda b: the("Cage").data.points[0], "co_deform", (1.0, 1.0, 1.0)),
    "near end of the camera": on(lambda b: b.camera.data, "clip_start", 1.0),
    "place of the camera": on(lambda b: b.camera, "location", (1.0, 2.0, 3.0)),
    "instanced": on(lambda b: the("Shape A").data.vertices[0], "co", (4.0, 4.0, 4.0)),
    "offset of an instance": on(lambda b: bpy.data.collections["Shapes"], "instance_offset", (1.0, 0.0, 0.0)),
    "motion blur of an object": on(lambda b: the("Lander").cycles, "use_motion_blur", False),
}
