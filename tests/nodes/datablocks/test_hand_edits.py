"""Edits by hand: each gives the pair another id or is refused, taking it back gives the id back, and what no picture
shows changes nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import edits
import numpy as np
import pytest
from edits import (
    EDITS,
    TINY,
    node,
    packed_image,
    populate,
    swap,
    the,
)
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.datablocks.array_marks import mark_array
from icymoon.nodes.datablocks.marks import BlockHasher
from icymoon.nodes.datablocks.stored_properties import LEFT_OUT, OF_THE_VIEW, why_left_out
from icymoon.support.errors import IcyMoonError
from rendering import complete, empty_scene

built = edits.built  # a fixture


def unsaved_paint(built):
    image = bpy.data.images["Decal"]
    image.pixels[0] = 0.9
    image.update()
    return image.reload  # as it is packed


def excluded_collection(built):
    layer = bpy.context.view_layer.layer_collection.children["Icy Moon"].children["Icy Moon Rocks"]
    return swap(layer, "exclude", True)


def particles(built):
    modifier = the("Lander").modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = modifier.particle_system.settings
    return lambda: (the("Lander").modifiers.remove(modifier), bpy.data.particles.remove(settings))


def cloth(built):
    modifier = the("Lander").modifiers.new("Cloth", "CLOTH")
    return lambda: the("Lander").modifiers.remove(modifier)


def movie(built):
    return swap(bpy.data.images["Decal"], "source", "MOVIE")


def python_driver(built):
    curve = the("Lamp POINT").driver_add("location", 0)
    curve.driver.expression = "__import__('time').time()"
    return lambda: the("Lamp POINT").animation_data_clear()


def simulated(built):
    tree = bpy.data.node_groups["Geometry"]
    made = tree.nodes.new("GeometryNodeSimulationOutput")
    return lambda: tree.nodes.remove(made)


REFUSED = {
    "unsaved_paint": (unsaved_paint, "save or pack"),
    "excluded_collection": (excluded_collection, "excluded"),
    "particles": (particles, "cache"),
    "cloth": (cloth, "cache"),
    "movie": (movie, "movie"),
    "python_driver": (python_driver, "Python"),
    "simulated": (simulated, "outside the scene"),
}


@pytest.mark.ci_takes(20)
@pytest.mark.parametrize("name", EDITS)
def test_an_edit_gives_another_id_and_taking_it_back_the_first(built, name):
    before = built.extra
    back = EDITS[name](built)
    bpy.context.view_layer.update()
    after = built.extra
    back()
    bpy.context.view_layer.update()
    assert after != before
    assert built.extra == before


@pytest.mark.parametrize("name", REFUSED)
def test_what_no_mark_tells_apart_is_refused(built, name):
    edit, said = REFUSED[name]
    before = built.extra
    back = edit(built)
    with pytest.raises(IcyMoonError, match=said):
        _ = built.extra
    back()
    assert built.extra == before


def test_the_frame_of_what_does_not_move_does_not_count(built):
    before = built.extra
    built.scene.frame_set(11)
    assert built.extra == before


def test_an_image_file_counts_by_its_content(built, tmp_path):
    material = node("TexImage")

    def write(name: str, grey: float) -> Path:
        image = packed_image("Temporary", grey)
        image.filepath_raw, image.file_format = str(tmp_path / name), "PNG"
        image.save()
        bpy.data.images.remove(image)
        return tmp_path / name

    file = write("a.png", 0.2)
    before, image = material.image, bpy.data.images.load(str(file))
    try:
        material.image = image
        first = built.extra
        image.filepath = str(file.rename(tmp_path / "b.png"))
        assert built.extra == first
        write("b.png", 0.3)
        assert built.extra != first
        (tmp_path / "b.png").unlink()
        with pytest.raises(IcyMoonError, match=re.escape("b.png")):
            _ = built.extra
    finally:
        material.image = before
        bpy.data.images.remove(image)


def test_edits_of_the_built_parts_are_no_longer_what_the_settings_say(registered):
    """Each of the same edits, without anything added: a scene as built has no mark at all."""
    scene = empty_scene()
    built = scenes.build_scene(scene, complete(TINY))
    assert built.extra == ""
    for name in (
        "moved_vertex",
        "flat_face",
        "sharp_edge",
        "turned_faces",
        "attribute_of_the_ground",
        "surface_of_a_rock",
        "modifier_on_the_ground",
        "hidden_collection",
        "removed_rocks",
        "kind of noise of the ground",
        "displacement",
        "not rendered",
        "sun's colour",
        "sun's shadow",
        "delta",
        "holdout",
        "near end of the camera",
    ):
        back = EDITS[name](built)
        assert built.edited, name
        assert built.extra, name
        back()
        assert not built.edited, name
        assert built.extra == "", name


def toggles(built) -> None:
    """What people do to the window and the outliner all day."""
    terrain, scene = built.terrain, bpy.context.scene
    terrain.name, terrain.data.name, terrain.data.materials[0].name = "Ground", "Ground", "Ice"
    built.sun.name = built.sun.data.name = "Helios"
    built.collection.name = "My Moon"
    for item in built.collection.all_objects:
        item.select_set(not item.select_get())
    bpy.context.view_layer.objects.active = terrain
    terrain.hide_set(True)
    terrain.hide_set(False)
    terrain.hide_viewport = terrain.show_wire = terrain.show_name = True
    terrain.display_type = "BOUNDS"
    terrain.hide_viewport = False
    terrain.data.materials[0].diffuse_color = (1.0, 0.0, 0.0, 1.0)
    built.collection.children[0].color_tag = "COLOR_01"
    tree = terrain.data.materials[0].node_tree
    for each in tree.nodes:
        each.location.x += 50.0
        each.select = not each.select
        each.hide = True
    tree.nodes.active = tree.nodes[-1]
    scene.frame_set(7)
    scene.cycles.samples = 17
    scene.render.engine = "BLENDER_WORKBENCH"
    built.camera.data.show_passepartout = False
    built.camera.data.display_size = 5.0
    scene.world.color = (1.0, 0.0, 0.0)
    bpy.context.view_layer.update()


def moved_in_the_outliner(built) -> None:
    child = bpy.data.collections.new("Mine")
    built.collection.children.link(child)
    child.objects.link(built.terrain)
    built.collection.objects.unlink(built.terrain)


def edit_mode(built) -> None:
    bpy.context.view_layer.objects.active = built.terrain
    edited = built.edited
    bpy.ops.object.mode_set(mode="EDIT")
    assert built.edited == edited
    bpy.ops.object.mode_set(mode="OBJECT")


def looked_at(built) -> None:
    built.terrain.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    for block in (built.terrain, built.terrain.data, built.sun.data, built.camera.data):
        for prop in block.bl_rna.properties:
            getattr(block, prop.identifier)


@pytest.mark.parametrize("act", [toggles, moved_in_the_outliner, edit_mode, looked_at])
@pytest.mark.parametrize("by_hand", [False, True])
def test_what_no_picture_shows_is_no_edit(registered, act, by_hand):
    built = scenes.build_scene(empty_scene(), complete(TINY))
    if by_hand:
        populate()
    before = built.extra
    act(built)
    assert built.extra == before
    assert built.edited == by_hand


def test_a_changed_mesh_in_edit_mode_is_an_edit_before_it_is_left(registered):
    built = scenes.build_scene(empty_scene(), complete(TINY))
    bpy.context.view_layer.objects.active = built.terrain
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0.0, 0.0, 1.0))
    assert built.edited_parts() == {"terrain data"}
    inside = built.extra
    bpy.ops.object.mode_set(mode="OBJECT")
    assert built.extra == inside


def test_undo_brings_the_id_back(registered):
    scenes.build_scene(empty_scene(), complete(TINY))
    bpy.ops.ed.undo_push(message="Build")
    the("Icy Moon Sun").data.energy *= 2
    bpy.ops.ed.undo_push(message="Edit")
    edited = scenes.find_built(bpy.context.scene).extra
    bpy.ops.ed.undo()
    assert scenes.find_built(bpy.context.scene).extra == ""
    bpy.ops.ed.redo()
    assert scenes.find_built(bpy.context.scene).extra == edited != ""


def test_the_id_is_that_of_the_saved_file(registered, tmp_path):
    scene = empty_scene()
    scenes.build_scene(scene, complete(TINY))
    populate()
    the("Lamp POINT").keyframe_insert("location", frame=3)
    scene.frame_set(5)
    before, name = scenes.find_built(scene).extra, scene.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), copy=True)
    for _ in range(2):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"), load_ui=False, use_scripts=False)
        found = scenes.find_built(bpy.data.scenes[name])
        assert found.extra == before
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.data.scenes[name].frame_set(6)
    # A lamp with keys, though they hold it in its place.
    assert scenes.find_built(bpy.data.scenes[name]).extra != before


@pytest.mark.parametrize("marks", ['{"terrain data": "0"}', '{"maker": "1 4.2", "terrain data": "0"}', "{}"])
def test_marks_of_another_version_ask_for_a_build(registered, marks):
    built = scenes.build_scene(empty_scene(), complete(TINY))
    kept = built.collection["icymoon_fingerprint"]
    built.collection["icymoon_fingerprint"] = marks
    with pytest.raises(IcyMoonError, match="press Build Scene"):
        _ = built.edited
    with pytest.raises(IcyMoonError, match="press Build Scene"):
        _ = built.extra
    built = scenes.build_scene(bpy.context.scene, complete(TINY))
    assert built.extra == ""
    assert json.loads(built.collection["icymoon_fingerprint"]).keys() == json.loads(kept).keys()


@pytest.mark.parametrize("dtype", [np.float32, np.int32, np.bool_, np.int16])
def test_the_mark_of_an_array_tells_every_change(dtype):
    random_numbers = np.random.default_rng(4)
    values = random_numbers.integers(0, 2, 40_000).astype(dtype)
    first = mark_array(values)
    assert mark_array(values.copy()) == first
    for _ in range(50):
        other = values.copy()
        raw = other.view(np.uint8)
        some = random_numbers.integers(0, len(raw), 2)
        raw[some] ^= np.uint8(1 << random_numbers.integers(0, 8))
        if not np.array_equal(raw, values.view(np.uint8)):
            assert mark_array(other) != first
    assert mark_array(values[:-1]) != first
    assert mark_array(np.roll(values, 1)) != first


def test_two_changed_signs_do_not_cancel():
    values = np.linspace(1.0, 2.0, 10_000, dtype=np.float32)
    first = mark_array(values)
    for a, b in ((1, 3), (0, 2), (11, 5001)):
        other = values.copy()
        other[[a, b]] *= -1
        assert mark_array(other) != first


#: What leads nowhere that a picture shows, or back to where one came from, or into arrays, which are tested above.
NOWHERE = {
    "rna_type",
    "id_data",
    "original",
    "library",
    "override_library",
    "preview",
    "asset_data",
    "bl_rna",
    "library_weak_reference",
    "render_slots",
    "pixels",
    "vertices",
    "edges",
    "loops",
    "polygons",
    "attributes",
    "color_attributes",
    "uv_layers",
    "vertex_colors",
    "vertex_normals",
    "polygon_normals",
    "corner_normals",
    "loop_triangles",
    "loop_triangle_polygons",
    "position_data",
    "curve_offset_data",
    "normals",
    "texture_mesh",
    "uv_layer_clone",
    "uv_layer_stencil",
    "texco_mesh",
}
ELSEWHERE = (bpy.types.Scene, bpy.types.World, bpy.types.Library)
#: Where a structure is: its data-block, and the names and numbers that lead to it.
Place = tuple[Any, tuple[Any, ...]]


def at(place: Place) -> Any:
    struct, steps = place
    for step in steps:
        struct = struct[step] if isinstance(step, int) else getattr(struct, step)
    return struct


def reachable(start: list[Any]) -> dict[tuple[str, str], list[Place]]:
    """Where structures are that all pointers and collections of RNA lead to, by their kind and the name of a property
    that can be set: three of each at most."""
    found: dict[tuple[str, str], list[Place]] = {}
    waiting: list[Place] = [(block, ()) for block in start]
    seen = set()
    while waiting:
        place = waiting.pop(0)
        struct = at(place)
        key = (struct.as_pointer(), type(struct))
        if key in seen or isinstance(struct, ELSEWHERE):
            continue
        seen.add(key)
        for prop in struct.bl_rna.properties:
            name = prop.identifier
            if (
                name in NOWHERE
                or getattr(prop, "is_deprecated", False)
                or (why_left_out(type(struct), name) and name not in ("nodes", "links", "inputs", "outputs"))
            ):
                continue
            if not prop.is_readonly and prop.type != "COLLECTION":
                same = found.setdefault((type(struct).bl_rna.identifier, name), [])
                same += [place] * (len(same) < 3)
            value = getattr(struct, name, None) if prop.type in ("POINTER", "COLLECTION") else None
            if prop.type == "POINTER" and value is not None:
                waiting.append((value, ()) if isinstance(value, bpy.types.ID) else (place[0], (*place[1], name)))
            elif prop.type == "COLLECTION" and value is not None:
                waiting += [
                    (item, ()) if isinstance(item, bpy.types.ID) else (place[0], (*place[1], name, k))
                    for k, item in enumerate(list(value)[:3])
                    if item is not None
                ]
    return found


def others(struct: Any, name: str) -> list[Any]:
    """Other values of a property, of which one may be allowed."""
    prop, value = struct.bl_rna.properties[name], getattr(struct, name)
    if prop.type == "POINTER":
        return [
            None,
            *(
                block
                for kind in ("objects", "materials", "collections", "images", "meshes", "textures")
                for block in list(getattr(bpy.data, kind))[:9]
                if block != value
            ),
        ]
    if getattr(prop, "is_array", False):
        first = value[0]
        if hasattr(first, "__len__"):
            return [[[first[0] + 0.5, *first[1:]], *value[1:]]]
        return [[not first if prop.type == "BOOLEAN" else first + step, *value[1:]] for step in (1, -1)]
    if prop.type == "ENUM":
        return [
            {item.identifier} if prop.is_enum_flag else item.identifier
            for item in prop.enum_items
            if {item.identifier} != value and item.identifier != value
        ]
    return {
        "BOOLEAN": lambda: [not value],
        "INT": lambda: [value + 1, value - 1],
        "FLOAT": lambda: [value + 0.37, value - 0.37, value / 2],
        "STRING": lambda: [f"{value}x"],
    }[prop.type]()


def plain(value: Any) -> Any:
    if isinstance(value, (str, set, bpy.types.bpy_struct)) or not hasattr(value, "__len__"):
        return value
    return tuple(plain(item) for item in value)


def changed_by(place: Place, name: str, marked: Callable[[], str]) -> bool | None:
    """Whether another value of a property gives another mark; None if it takes none."""
    before, first, told = plain(getattr(at(place), name)), marked(), None
    for value in others(at(place), name):
        with suppress(TypeError, ValueError, AttributeError, RuntimeError):
            setattr(at(place), name, value)
            if plain(getattr(at(place), name)) != before:
                told = marked() != first
        with suppress(TypeError, ValueError, AttributeError, RuntimeError):
            setattr(at(place), name, before)
        if told is not None:
            return told
    return None


def test_every_property_changes_the_mark_or_is_left_out_with_a_reason(registered):
    """Whatever Blender adds counts, unless someone has said why it does not."""

    def mark(block: bpy.types.ID) -> str:
        return BlockHasher({}).mark(block)

    built = scenes.build_scene(empty_scene(), complete(TINY))
    populate()
    settable = reachable(list(built.collection.all_objects))
    results: dict[bool | None, list[str]] = {True: [], False: [], None: []}
    for (kind, name), places in sorted(settable.items()):
        if name.startswith(("bl_", "socket_type")) or (kind == "Material" and name in OF_THE_VIEW):
            continue
        told = (changed_by(place, name, partial(mark, place[0])) for place in places)
        results[next((each for each in told if each is not None), None)].append(f"{kind}.{name}")
    assert results[False] == []
    assert len(results[True]) > 400  # of 568 that count in 5.0


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="the properties of 5.0 are what is listed")
def test_nothing_is_left_out_that_no_blender_knows():
    """A misspelt name would leave out nothing."""
    of_other_versions = {
        "Action.groups",
        "GeometryNodesModifierInterface.panels",
        "Bone.select",
        "Bone.select_head",
        "Bone.select_tail",
        "Material.shadow_method",
        "Mesh.use_remesh_preserve_paint_mask",
        "Mesh.use_remesh_preserve_sculpt_face_sets",
        "Mesh.use_remesh_preserve_vertex_colors",
    }
    known = {
        kind: {prop.identifier for prop in getattr(bpy.types, kind).bl_rna.properties}
        for kinds in LEFT_OUT.values()
        for kind in kinds
        if hasattr(bpy.types, kind)
    }
    unknown = {
        f"{kind}.{name}"
        for kinds in LEFT_OUT.values()
        for kind, names in kinds.items()
        for name in names.split()
        if name not in known.get(kind, ())
    }
    assert unknown <= of_other_versions
