"""A view in shadow is told with its fix, and so is an object around the camera."""

from __future__ import annotations

import time

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.operators import live_preview, shadow_warning, sidebar_text
from icymoon.operators.session import session
from icymoon.physics.light.directions import direction_toward
from icymoon.render.tree_tracer import TreeTracer
from icymoon.settings.description import defaults, merged
from mathutils import Vector
from panel_drawing import drawn, texts
from thread_asks import list_asks_of_threads

LOW_SUN = {"light": {"sun_elevation_deg": 8.0, "sun_azimuth_deg": 300.0}}


def advise(shares: list[float], **light: object) -> str:
    settings = merged(defaults(), {"light": {**LOW_SUN["light"], **light}})
    return shadow_warning.advise_on_shadow(settings, np.array(shares))


def test_a_dark_view_is_told_with_the_azimuth_that_lights_most():
    said = advise([0.02, 0.4, 0.9, 0.1])
    assert said.startswith("98 % of the ground in view is in shadow; set light.sun_azimuth_deg to 120° (90 % lit)")
    shown = sidebar_text.replace_keys_by_labels(said)
    assert "Sun Azimuth to 120°" in shown
    assert "light." not in shown


@pytest.mark.parametrize("shares", [[0.06, 1.0], [float("nan")] * 4, [1.0] * 4])
def test_a_view_that_is_lit_or_unknown_is_not_warned_of(shares):
    assert advise(shares) == ""


def test_where_no_azimuth_helps_the_sun_is_too_low():
    assert advise([0.0] * 4).endswith("raise light.sun_elevation_deg, now 8°.")
    assert "date" in advise([0.0, 1.0], directions_from="DATE")


def test_the_button_turns_the_sun_to_the_azimuth_of_the_sentence():
    find = lambda shares, **light: shadow_warning.find_lit_azimuth(  # noqa: E731
        merged(defaults(), {"light": {**LOW_SUN["light"], **light}}), np.array(shares)
    )
    assert find([0.02, 0.4, 0.9, 0.1]) == 120.0
    assert find([0.0, 0.9, 0.1], sun_azimuth_deg=239.9) == 0.0, "not 360"
    for shares in ([0.06, 1.0], [float("nan")] * 4, [0.0] * 4):
        assert find(shares) is None
    assert find([0.0, 1.0], directions_from="DATE") is None


def test_the_suns_begin_with_the_present_one_and_go_round():
    suns = shadow_warning.list_suns(direction_toward(300.0, 8.0))
    assert suns[0] == pytest.approx(direction_toward(300.0, 8.0))
    assert suns[len(suns) // 2] == pytest.approx(direction_toward(120.0, 8.0))
    assert np.ptp(suns[:, 2]) < 1e-12


def test_a_built_scene(small):
    """Its rays meet what Blender's own ray meets; an object around its camera is named; the status names the panel."""
    bpy.ops.icymoon.build_scene()
    scene = bpy.context.scene
    built = scenes.find_built(scene)
    eye = shadow_warning.make_small_eye(built, built.settings)
    middle = eye.directions(np.array([eye.rows // 2 * eye.columns + eye.columns // 2]))
    tracer = TreeTracer(shadow_warning.read_ground(built))
    along = tracer.intersect(eye.position, middle, 1e-3, np.inf).along[0]
    matrix, start = built.terrain.matrix_world.inverted(), built.camera.matrix_world.translation
    met, place, *_ = built.terrain.ray_cast(matrix @ start, matrix.to_3x3() @ Vector(middle[0]))
    assert met
    assert along * np.linalg.norm(middle) == pytest.approx((place - matrix @ start).length, rel=1e-4)

    status = live_preview.list_lines(scene)
    session.shadow_notes[scene.session_uid] = "98 % of the ground in view is in shadow; raise it.", None
    assert live_preview.list_lines(scene) == [*status, shadow_warning.BRIEF]
    assert "Turn Sun" not in texts(drawn(bpy.types.ICYMOON_PT_light))
    session.shadow_notes[scene.session_uid] = "98 % of the ground in view is in shadow; set it.", 120.0
    assert "Turn Sun to 120°" in texts(drawn(bpy.types.ICYMOON_PT_light))
    session.shadow_notes.clear()

    bpy.ops.mesh.primitive_cube_add(size=4.0, location=start)
    cube = bpy.context.active_object
    bpy.context.view_layer.update()
    assert live_preview.list_lines(scene) == [*status, f"{cube.name} encloses the camera: move or hide it"]
    cube.location.x += 10.0
    bpy.context.view_layer.update()
    assert live_preview.list_lines(scene) == status


def test_its_thread_asks_blender_nothing(small, monkeypatch):
    """It runs on while another file is opened, and Blender then frees what it would read."""
    small.icymoon.light.sun_elevation_deg = 0.5
    bpy.ops.icymoon.build_scene()
    asked = list_asks_of_threads(monkeypatch)
    monkeypatch.setattr(shadow_warning, "has_window", lambda: True)
    shadow_warning.schedule_check(small)
    while shadow_warning._trace_next() is not None:
        time.sleep(0.001)
    assert asked == []
    assert session.shadow_notes[small.session_uid]
