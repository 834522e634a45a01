"""Place by Click: where a click hits the ground, what is placed there, and what is not."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.operators import place_on_ground
from icymoon.operators.session import session
from icymoon.settings.blender import scene_properties
from icymoon.support.errors import IcyMoonError
from icymoon.support.steps import finish
from mathutils import Vector
from stand_ins import stand_in

#: Pixels of the stand-in view per metre; its middle is the origin.
PER_M, MIDDLE = 50, (400, 300)


def region(kind: str, x: int, y: int, width: int, height: int) -> SimpleNamespace:
    return SimpleNamespace(type=kind, x=x, y=y, width=width, height=height)


@pytest.fixture
def screen(monkeypatch):
    """A 3D View that is looked down on from above, with a sidebar at its right, beside another editor."""
    monkeypatch.setattr(
        place_on_ground,
        "region_2d_to_origin_3d",
        lambda _, __, at: Vector(((at[0] - MIDDLE[0]) / PER_M, (at[1] - MIDDLE[1]) / PER_M, 50.0)),
    )
    monkeypatch.setattr(place_on_ground, "region_2d_to_vector_3d", lambda *_: Vector((0.0, 0.0, -1.0)))
    spaces = SimpleNamespace(active=SimpleNamespace(region_3d=object()))
    regions = [region("UI", 700, 100, 100, 600), region("WINDOW", 0, 100, 800, 600), region("TOOLS", 0, 100, 1, 600)]
    view = SimpleNamespace(type="VIEW_3D", regions=regions, spaces=spaces)
    return SimpleNamespace(areas=[SimpleNamespace(type="OUTLINER", regions=[]), view])


def test_a_click_finds_the_ground_through_objects_of_the_user(small, screen):
    bpy.ops.icymoon.build_scene()
    bpy.ops.mesh.primitive_plane_add(size=50.0, location=(0.0, 0.0, 10.0))
    context = SimpleNamespace(screen=screen, scene=small, evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get)
    place = place_on_ground.find_ground(context, MIDDLE[0] + PER_M, 100 + MIDDLE[1] - PER_M // 2)
    assert (place.x, place.y) == pytest.approx((1.0, -0.5), abs=1e-4)
    assert abs(place.z) < 5.0
    assert place_on_ground.find_ground(context, 750, 300) is None  # over the sidebar
    assert place_on_ground.find_ground(context, 10, 50) is None  # below the view
    assert bpy.ops.icymoon.place_on_ground(target="CAMERA", x_m=1.25, y_m=-0.5) == {"FINISHED"}
    assert (small.icymoon.rig.x_m, small.icymoon.rig.y_m) == (1.25, -0.5)


def test_a_click_finds_ground_that_lies_on_the_object_it_was_made_of(small, screen):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=9, y_subdivisions=9, size=30.0)
    bpy.ops.icymoon.object_as_ground()
    bpy.data.objects["Grid"].location.z = 1e-4  # as rounding may put it, so that the ray meets it first
    bpy.context.view_layer.update()
    context = SimpleNamespace(screen=screen, scene=small, evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get)
    for place_px in (0, 37, 113):
        place = place_on_ground.find_ground(context, MIDDLE[0] + place_px, 100 + MIDDLE[1] - place_px)
        assert place is not None
        assert tuple(place) == pytest.approx((place_px / PER_M, -place_px / PER_M, 0.0), abs=1e-4)
    assert place_on_ground.find_ground(context, MIDDLE[0] + 220, 100 + MIDDLE[1]) is not None
    bpy.data.objects["Icy Moon Terrain"].location.z = -3.0
    bpy.context.view_layer.update()
    place = place_on_ground.find_ground(context, MIDDLE[0] + 11, 100 + MIDDLE[1])
    assert place is not None
    assert place.z == pytest.approx(-3.0, abs=1e-4)


def test_a_trench_on_ground_from_a_file_is_refused_before_the_click(small, screen):
    bpy.ops.mesh.primitive_grid_add(size=30.0)
    bpy.ops.icymoon.object_as_ground()
    with pytest.raises(RuntimeError, match="Ground from a file cannot be dug"):
        bpy.ops.icymoon.place_on_ground("INVOKE_DEFAULT", target="TRENCH")
    with pytest.raises(RuntimeError, match="Ground from a file cannot be dug"):
        bpy.ops.icymoon.place_on_ground(target="TRENCH", x_m=0.0, y_m=1.0)
    assert small.icymoon.excavation.path == "NONE"


def test_what_cannot_be_placed_is_refused_before_the_click(small):
    bpy.ops.icymoon.build_scene()
    with pytest.raises(RuntimeError, match="Procedural ground has no site"):
        bpy.ops.icymoon.place_on_ground("INVOKE_DEFAULT", target="SITE")
    small.icymoon.excavation.path = "RECORDED"
    with pytest.raises(RuntimeError, match="The path of the scoop is recorded"):
        bpy.ops.icymoon.place_on_ground("INVOKE_DEFAULT", target="TRENCH")


def test_without_ground_the_button_is_grey(scene):
    assert not bpy.ops.icymoon.place_on_ground.poll()


def test_what_is_placed(scene):
    def place(target: str) -> object:
        return place_on_ground.make_placed(target, scene_properties.read_settings(scene.icymoon), 1.25, -2.0004)

    assert place("CAMERA") == {"rig": {"x_m": 1.25, "y_m": -2.0}}
    assert place("WORKSPACE") == {"workspace": {"east_m": 1.25, "north_m": -2.0, "cell_m": 0.02}}  # it had no cells
    scene.icymoon.workspace.cell_m = 0.05
    assert place("WORKSPACE") == {"workspace": {"east_m": 1.25, "north_m": -2.0}}
    trench = {"start_x_m": 1.25, "start_y_m": -2.0}
    assert place("TRENCH") == {"excavation": {**trench, "path": "LINE"}}
    scene.icymoon.excavation.path = "ARC"
    assert place("TRENCH") == {"excavation": trench}
    scene.icymoon.excavation.path = "RECORDED"
    with pytest.raises(IcyMoonError, match="The path of the scoop is recorded"):
        place("TRENCH")
    with pytest.raises(IcyMoonError, match="no site"):
        place("SITE")
    scene.icymoon.source.kind, scene.icymoon.source.origin_x_m = "HEIGHT_MAP", 100.0
    assert place("SITE") == {"source": {"origin_x_m": 101.25, "origin_y_m": -2.0}}


@pytest.mark.parametrize(
    ("kind", "value", "under", "result"),
    [
        ("LEFTMOUSE", "PRESS", Vector((3.0, 4.0, 0.0)), {"FINISHED"}),
        ("LEFTMOUSE", "PRESS", None, {"RUNNING_MODAL"}),
        ("LEFTMOUSE", "RELEASE", None, {"PASS_THROUGH"}),
        ("MIDDLEMOUSE", "PRESS", None, {"PASS_THROUGH"}),
        ("ESC", "PRESS", None, {"CANCELLED"}),
        ("RIGHTMOUSE", "PRESS", None, {"CANCELLED"}),
    ],
)
def test_the_view_can_be_turned_until_a_click_or_esc(monkeypatch, kind, value, under, result):
    monkeypatch.setattr(place_on_ground, "find_ground", lambda *_: under)
    ended = []
    waiting = stand_in(
        target="CAMERA", x_m=0.0, y_m=0.0, report=lambda *_: None, _end=ended.append, execute=lambda _: {"FINISHED"}
    )
    event = SimpleNamespace(type=kind, value=value, mouse_x=5, mouse_y=6)
    assert place_on_ground.ICYMOON_OT_place_on_ground.modal(waiting, bpy.context, event) == result
    assert len(ended) == (result in ({"FINISHED"}, {"CANCELLED"}))
    assert (waiting.x_m, waiting.y_m) == ((3.0, 4.0) if result == {"FINISHED"} else (0.0, 0.0))


def test_the_sidebar_keeps_the_place(small):
    bpy.ops.icymoon.build_scene()
    bpy.ops.icymoon.place_on_ground(target="WORKSPACE", x_m=0.172, y_m=5.664)
    assert session.find_end(small) == "Workspace placed: 0.17 m east, 5.66 m north"
    session.ended, session.ended_in = "", 0


def click(monkeypatch, place: Vector) -> set[str]:
    """What a click on a place of the ground returns while the user is asked for the start of the trench."""
    monkeypatch.setattr(place_on_ground, "find_ground", lambda *_: place)
    waiting = stand_in(target="TRENCH", _end=lambda _: None, execute=lambda _: {"FINISHED"})
    event = SimpleNamespace(type="LEFTMOUSE", value="PRESS", mouse_x=5, mouse_y=6)
    return place_on_ground.ICYMOON_OT_place_on_ground.modal(waiting, bpy.context, event)


def measure_lowest_m(x_m: float, y_m: float) -> float:
    """The lowest height, m, of the built ground within 0.6 m of a place."""
    mesh = scenes.find_built(bpy.context.scene).terrain.data
    near = [v.co.z for v in mesh.vertices if (v.co.x - x_m) ** 2 + (v.co.y - y_m) ** 2 < 0.6**2]
    return min(near)


def test_a_click_digs_the_trench(small, monkeypatch):
    small.icymoon.terrain.rms_slope_deg = 0.0
    bpy.ops.icymoon.build_scene()
    assert measure_lowest_m(0.0, 2.0) == pytest.approx(0.0, abs=1e-3)
    assert click(monkeypatch, Vector((0.0, 2.0, 0.0))) == {"CANCELLED"}
    assert small.icymoon.excavation.path == "LINE"
    assert measure_lowest_m(0.0, 2.0) < -0.02


def test_without_live_preview_a_click_only_sets_the_start(small, monkeypatch):
    bpy.ops.icymoon.build_scene()
    small.icymoon.live = False
    assert click(monkeypatch, Vector((0.0, 2.0, 0.0))) == {"FINISHED"}


def test_a_click_for_a_trench_reverts_no_edit_by_hand(small):
    bpy.ops.icymoon.build_scene()
    terrain = scenes.find_built(small).terrain
    terrain.data.vertices[0].co.z += 1.0
    terrain.data.update()
    height_m = terrain.data.vertices[0].co.z
    digging = stand_in(x_m=0.0, y_m=2.0, _scene_uid=small.session_uid)
    (told,) = finish(place_on_ground.ICYMOON_OT_dig_trench.make_steps(digging, bpy.context))
    assert told[0] == "WARNING"
    assert "edited by hand; press Build Scene to dig it" in told[1]
    assert terrain.data.vertices[0].co.z == height_m
