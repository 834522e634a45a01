"""One line states what the view does not show as the render does."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from icymoon.operators.sidebar_text import wrap_lines
from icymoon.panels.view_line import LONGEST, describe_view

TYPES = [item.identifier for item in bpy.types.View3DShading.bl_rna.properties["type"].enum_items_static]
ENGINES = ("CYCLES", "BLENDER_EEVEE", "BLENDER_EEVEE_NEXT", "BLENDER_WORKBENCH")
_LIGHTS = ("use_scene_lights", "use_scene_world", "use_scene_lights_render", "use_scene_world_render")


def view(kind: str, lit: bool = True) -> SimpleNamespace:
    """A view with this shading, with the names that Blender has."""
    assert set(_LIGHTS) <= set(bpy.types.View3DShading.bl_rna.properties.keys())
    return SimpleNamespace(shading=SimpleNamespace(type=kind, **dict.fromkeys(_LIGHTS, lit)))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", TYPES)
def test_only_the_view_that_cycles_lights_is_as_the_pair(kind, engine):
    traced = kind == "RENDERED" and engine == "CYCLES"
    assert ("as the pair" in describe_view(view(kind), engine)) == traced
    assert "as the pair" not in describe_view(view(kind, lit=False), engine)


def test_what_is_missing_is_named():
    assert "shadows" in describe_view(view("SOLID"), "CYCLES")
    assert "exposure" in describe_view(view("SOLID"), "CYCLES")
    assert "EEVEE" in describe_view(view("MATERIAL"), "CYCLES")  # whatever renders the scene
    assert "not the light" in describe_view(view("MATERIAL", lit=False), "CYCLES")
    assert "no Sun" in describe_view(view("RENDERED"), "BLENDER_WORKBENCH")


def test_a_view_that_is_not_yet_as_the_pair_says_so():
    coarse = describe_view(view("RENDERED"), "CYCLES", "", coarse=True)
    assert coarse == describe_view(view("RENDERED"), "CYCLES", "") + ", half resolution"
    covered = describe_view(view("RENDERED"), "CYCLES", "", coarse=True, covered=True)
    assert "picture of the scene" in covered
    assert "as the pair" not in covered
    assert "picture" not in describe_view(view("SOLID"), "CYCLES", covered=True)  # there it is not drawn
    assert "planetshine" in describe_view(view("RENDERED"), "CYCLES", "", without_planetshine=True)
    assert "planetshine" not in describe_view(view("SOLID"), "CYCLES", "", without_planetshine=True)


def test_the_room_for_the_line_is_enough_while_a_setting_is_dragged():
    """Noise and resolution follow within a second; none of these lines may be longer than the room."""
    for exposed in ("", "other", "estimated"):
        line = describe_view(view("RENDERED"), "CYCLES", exposed, coarse=True, coarse_ground=True)
        assert len(wrap_lines(line, icon=True)) <= len(wrap_lines(LONGEST, icon=True))


def test_the_line_names_coarse_ground():
    assert "coarse ground" in describe_view(view("RENDERED"), "CYCLES", "", coarse_ground=True)
    assert "coarse ground" not in describe_view(view("RENDERED"), "CYCLES", "")
