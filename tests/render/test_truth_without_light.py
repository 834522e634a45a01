"""Truth rendered without light, and depth without surfaces, against the same with them."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.render import render_pair, truth_without_light
from icymoon.render.pairs.pair_folder import EYES, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.support.blender import compat
from mathutils import Matrix
from rendering import complete, empty_scene

TWO = {"rig": {"width_px": 48, "height_px": 36}, "dataset": {"headings": 2}, "quality": {"truth_by": "CYCLES"}}
ROCKS = {"rocks": {"coverage": 0.2, "smallest_m": 0.2, "largest_m": 0.8}}
CLEAR = {
    "rocks": {"own_surface": True},
    "rock_surface": {"model": "PRINCIPLED", "transmission": 1.0, "transmitted": "THROUGH", "roughness": 0.05},
}
DAY_AND_NIGHT = {"light": {"planet": True, "planet_elevation_deg": 40.0}}
#: Surfaces of a pane in front of the camera, and whether they must be kept.
PANES = {
    "": False,
    "ShaderNodeBsdfDiffuse": False,
    "ShaderNodeBsdfTransparent": True,
    "ShaderNodeBsdfPrincipled": True,
    "ShaderNodeVolumeAbsorption": True,
}


def add_pane(built: Built, kind: str) -> bpy.types.Material:
    """Put a pane of a surface before the camera; half of the light passes a Principled one."""
    material = bpy.data.materials.new("Pane")
    tree = compat.ensure_nodes(material)
    tree.nodes.clear()
    output, surface = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new(kind)
    tree.links.new(surface.outputs[0], output.inputs["Volume" if "Volume" in kind else "Surface"])
    if "Principled" in kind:
        surface.inputs["Alpha"].default_value = 0.25
    mesh = bpy.data.meshes.new("Pane")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    pane = bpy.data.objects.new("Pane", mesh)
    built.collection.objects.link(pane)
    pane.matrix_world = built.camera.matrix_world @ Matrix.Translation((0.0, 0.0, -1.0)) @ Matrix.Scale(0.1, 4)
    return material


def shoot(folder: Path, pane: str, *parts: dict) -> list[Array]:
    """All that two pairs of a scene contain, and the links and lamps that the scene has afterwards."""
    settings = complete(TWO, *parts)
    built = build_scene(empty_scene(), settings)
    if pane:
        add_pane(built, pane)
    found = []
    for made in render_pairs(built, expand_headings(settings), folder, 1, 0.0, lambda *a, **k: None):
        pair = read_pair(made)
        for eye in EYES:
            view = read_view(pair.image(eye), eye)
            found += [each for each in vars(view).values() if isinstance(each, np.ndarray)]
    left = [
        sum(len(each.node_tree.links) for each in bpy.data.materials if each.node_tree),
        *(lamp.energy for lamp in bpy.data.lights),
    ]
    return [*found, np.array(left)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("pane", "parts"),
    [
        *((pane, (ROCKS,)) for pane in PANES),
        ("", (ROCKS, CLEAR)),
        ("", (ROCKS, DAY_AND_NIGHT)),
        ("", ({"mesh": {"kind": "GRADED"}}, {"hapke": {"backend": "NODES"}, "surface": {"model": "HAPKE"}})),
    ],
)
def test_nothing_changes(tmp_path, monkeypatch, pane, parts):
    """To the bit, in both of two pairs, as the scene is kept between their renders."""
    without = shoot(tmp_path / "without", pane, *parts)
    for name in ("switch_lights_off", "remove_surfaces"):
        monkeypatch.setattr(truth_without_light, name, lambda what: nullcontext())
    for one, other in zip(without, shoot(tmp_path / "with", pane, *parts), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("pane", "kept"), list(PANES.items())[1:])
def test_what_rays_may_pass_keeps_its_surface(pane, kept):
    built = build_scene(empty_scene(), complete(TWO))
    output = add_pane(built, pane).node_tree.get_output_node("CYCLES")
    ground = built.terrain.data.materials[0].node_tree.get_output_node("CYCLES")
    with truth_without_light.remove_surfaces(built.materials):
        assert any(socket.links for socket in output.inputs) == kept
        assert not ground.inputs["Surface"].links
    assert any(socket.links for socket in output.inputs)
    assert ground.inputs["Surface"].links


def test_all_is_back_after_a_failure(tmp_path, monkeypatch):
    def fail(*_):
        raise ValueError("no depth")

    settings = complete(TWO)
    built = build_scene(empty_scene(), settings)
    before = [(lamp.name, lamp.energy) for lamp in bpy.data.lights]
    monkeypatch.setattr(render_pair.cycles_occlusion, "read_disparity", fail)
    with pytest.raises(render_pair.IcyMoonError, match="cannot be joined"):
        render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    assert before == [(lamp.name, lamp.energy) for lamp in bpy.data.lights]
    assert any(energy > 0 for _, energy in before)
    assert built.terrain.data.materials[0].node_tree.get_output_node("CYCLES").inputs["Surface"].links


@pytest.mark.parametrize("most", [0, 16])
def test_surfaces_are_taken_off_where_it_saves_time(tmp_path, monkeypatch, most):
    taken = []
    monkeypatch.setattr(truth_without_light, "MAX_TRIANGLES_PER_PIXEL", most)
    monkeypatch.setattr(truth_without_light, "remove_surfaces", lambda what: nullcontext(taken.append(len(what))))
    settings = complete(TWO)
    render_pairs(
        build_scene(empty_scene(), settings), expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None
    )
    assert [bool(each) for each in taken] == [most > 0] * 2
