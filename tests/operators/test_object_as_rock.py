"""Use Selected Object as Rock: the rocks of the built scene have the modelled shape, and an error changes nothing."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.operators import live_preview, object_as_rock
from icymoon.operators.render import find_dataset_folder
from icymoon.operators.session import session
from icymoon.settings.blender import scene_properties
from icymoon.support.errors import IcyMoonError


def add_cone(open_: bool = False) -> bpy.types.Object:
    """A cone of five sides, 1 m wide and 0.5 m high, open below or closed."""
    end = "NOTHING" if open_ else "TRIFAN"
    bpy.ops.mesh.primitive_cone_add(vertices=5, radius1=0.5, depth=0.5, end_fill_type=end, location=(40.0, 0.0, 0.0))
    return bpy.context.active_object


def test_rocks_have_the_shape_of_the_object(small):
    small.icymoon.rocks.coverage = 0.0
    add_cone()
    assert bpy.ops.icymoon.object_as_rock() == {"FINISHED"}
    rocks = small.icymoon.rocks
    assert (rocks.family, rocks.elongation) == ("OWN", 1.0)
    assert rocks.coverage > 0
    width = 2 * np.sqrt(2.5 * 0.25 * np.sin(2 * np.pi / 5) / np.pi)  # of a circle of a pentagon's area
    assert rocks.height_ratio == pytest.approx(0.5 / width, rel=0.01)
    assert Path(bpy.path.abspath(rocks.shape_file)).is_file()
    collection = scenes.find_collection(small)
    shapes = [item for item in bpy.data.objects if item.get("icymoon") == "rock shape"]
    assert collection is not None
    assert shapes
    assert {(len(item.data.vertices), len(item.data.polygons)) for item in shapes} == {(7, 10)}


def test_an_open_mesh_is_refused_and_nothing_changes(small):
    add_cone(open_=True)
    before = small.icymoon.rocks.family, small.icymoon.rocks.coverage
    with pytest.raises(RuntimeError, match=f"Error: {bpy.context.object.name}: .* must be closed"):
        bpy.ops.icymoon.object_as_rock()
    assert not list(find_dataset_folder(scene_properties.read_settings(small.icymoon)).rglob("*.obj"))
    assert (small.icymoon.rocks.family, small.icymoon.rocks.coverage) == before
    assert scenes.find_built(small) is None


class Operator(object_as_rock.RockOperator):
    """An operator as Blender holds it after the button was pressed."""

    bl_label = "Use Selected Object"

    def report(self, kind: set[str], message: str, /) -> None:
        pass


def test_in_a_window_the_scene_is_built_in_pieces_and_stays_usable(small, monkeypatch):
    """The fine ground was built at once, and the window waited for it."""
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    monkeypatch.setattr(live_preview, "update_scene", lambda scene: pytest.fail("the build shows the rocks"))
    before = scene_properties.read_settings(small.icymoon).rocks
    add_cone()
    operator = Operator()
    job = operator.start(bpy.context)
    assert session.building is job
    assert small.icymoon.rocks.family == "OWN"
    job.run_to_end()
    built = scenes.find_built(small)
    assert built.settings.rocks.family == "OWN"
    assert built.preview, "the fine ground follows"
    monkeypatch.undo()
    operator.take_back(small)
    assert scene_properties.read_settings(small.icymoon).rocks == before
    session.stop_building()


def test_a_build_that_fails_leaves_the_rocks_as_they_were(small):
    before = scene_properties.read_settings(small.icymoon).rocks
    add_cone()
    operator = Operator()
    operator.start(bpy.context)
    assert operator.fail(IcyMoonError("There is not enough memory.")) == {"CANCELLED"}
    assert scene_properties.read_settings(small.icymoon).rocks == before
    session.stop_building()
