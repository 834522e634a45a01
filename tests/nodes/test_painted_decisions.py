"""Decisions shown on the ground: colours of the cells under the vertices, site and reach, and no trace afterwards."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import bpy
import numpy as np
import pytest
from icymoon.nodes import painted_decisions, painted_errors
from icymoon.nodes.datablocks.array_marks import read_property
from icymoon.nodes.datablocks.fingerprint import find_instanced_objects, read_parts
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings.blender import scene_properties
from icymoon.stereo.decide import decide_pairs
from icymoon.stereo.decisions.dem import Grid
from icymoon.stereo.decisions.map_colours import colour_cells
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.stored_maps import HEIGHT_ERROR, SLOPE, SUITABILITY, StoredMap, read_map
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.steps import Steps, finish
from pieces import stop_after, walk
from rendering import render

SCENE = {
    "rig": {"width_px": 160, "height_px": 120},
    "terrain": {"resolution": 257, "size_m": 8.0},
    "rocks": {"coverage": 0.1, "smallest_m": 0.2},
}
ROWS, COLUMNS, CELL_M = 20, 30, 0.1


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A rendered pair and its scene."""
    pair, built = render(tmp_path_factory.mktemp("decided"), SCENE)
    scene_properties.write_settings(bpy.context.scene.icymoon, pair.settings)
    bpy.context.scene.icymoon.dataset.folder = str(pair.folder.parent.parent)
    return pair, built


@pytest.fixture(autouse=True)
def nothing_left():
    """A failed test leaves nothing for the next."""
    yield
    painted_errors.clear_painted(bpy.context.scene)


def made(kind: str = SUITABILITY) -> StoredMap:
    """A map of the middle of the ground, with a value of its own for each cell."""
    values = np.linspace(-1, 1, ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    reach = np.zeros((ROWS, COLUMNS), bool)
    reach[2:8, 5:25] = True
    return StoredMap(
        kind, Grid(CELL_M, ROWS, COLUMNS, -1.5, 1.0), values, np.full((ROWS, COLUMNS), 0.2), reach, (3, 7), 0.3, 10.0
    )


def paint(built, stored: StoredMap, title: str) -> bpy.types.Collection:
    return finish(painted_decisions.paint_decisions(lambda: built, stored, title))


def colours(mesh) -> Array:
    return np.rint(
        255 * read_property(mesh.attributes[painted_errors.COLOUR].data, "color_srgb", width=4).reshape(-1, 4)[:, :3]
    )


def positions(mesh) -> Array:
    return read_property(mesh.vertices, "co", width=3).reshape(-1, 3).astype(np.float64)


def blocks() -> list[int]:
    return [
        len(data)
        for data in (bpy.data.objects, bpy.data.meshes, bpy.data.curves, bpy.data.materials, bpy.data.collections)
    ]


def test_vertices_have_the_colours_of_their_cells(shown):
    _, built = shown
    stored = made()
    paint(built, stored, "bm")
    x, y, _ = read_property(built.terrain.data.vertices, "co", width=3).reshape(-1, 3).astype(np.float64).T
    within = (np.abs(x) < 1.49) & (np.abs(y) < 0.99)
    assert within.sum() > 1000
    row, column = ((1.0 - y) // CELL_M).astype(int), ((x + 1.5) // CELL_M).astype(int)
    clear = within & (np.abs((x + 1.5) / CELL_M % 1 - 0.5) < 0.49) & (np.abs((1.0 - y) / CELL_M % 1 - 0.5) < 0.49)
    painted = colours(built.terrain.data)
    np.testing.assert_array_equal(painted[clear], colour_cells(stored)[row[clear], column[clear]])
    assert (painted[(np.abs(x) > 1.51) | (np.abs(y) > 1.01)] == 60).all()
    (field,) = (item for item in built.collection.all_objects if item.get("icymoon") == "rock")
    for shape in find_instanced_objects(field):
        assert (colours(shape.data) == 60).all()


def test_the_site_and_the_reach_lie_where_they_were_decided(shown):
    _, built = shown
    site, reach = sorted(paint(built, made(), "bm").objects, key=lambda item: item.name)
    assert (site.name, reach.name) == ("Chosen Site", "Reach")
    thick_m = 0.0065  # half a line, and rounding
    place = positions(site.data)
    centre = np.array((-1.5 + 7.5 * CELL_M, 1.0 - 3.5 * CELL_M, 0.21))
    np.testing.assert_allclose(place.mean(axis=0), centre, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm((place - centre)[:, :2], axis=1), 0.15, atol=thick_m)
    np.testing.assert_allclose(place[:, 2], 0.21, atol=thick_m)
    assert len(site.data.polygons) >= 100  # with a thickness, or it is hidden with the overlays
    place = positions(reach.data)
    # The line is as wide at the corners as between them.
    np.testing.assert_allclose(
        place.min(axis=0)[:2], np.array((-1.5 + 5 * CELL_M, 1.0 - 8 * CELL_M)) - 0.006, atol=1e-5
    )
    np.testing.assert_allclose(
        place.max(axis=0)[:2], np.array((-1.5 + 25 * CELL_M, 1.0 - 2 * CELL_M)) + 0.006, atol=1e-5
    )
    for item in (site, reach):  # closed: two faces meet at each edge
        assert set(Counter(edge for face in item.data.polygons for edge in face.edge_keys).values()) == {2}
    assert site.hide_render
    assert reach.hide_render
    told = {text for text, _ in painted_decisions.make_legend(bpy.context.scene)}
    assert {"Chosen site, magenta ring", "Reach of the arm, cyan line"} <= told
    for item, colour in ((site, (255, 0, 188)), (reach, (0, 243, 255))):  # as the view shows them in each Blender
        assert (colours(item.data) == colour).all()
    ring = len(site.data.polygons)
    for verdict, text in (
        ("guaranteed", "Guaranteed site, magenta ring"),
        ("abstains", "Abstains from this site, crossed-out ring"),
        ("unlike", "Unlike ground, no guarantee, crossed-out ring"),
    ):
        stored = replace(made(), guarantee=verdict)
        collection = paint(built, stored, "bm")
        told = {text for text, _ in painted_decisions.make_legend(bpy.context.scene)}
        assert text in told
        assert not any(text.startswith("Chosen") for text in told)
        site = next(item for item in collection.objects if item.name.startswith("Chosen"))
        assert (len(site.data.polygons) > ring) == (verdict != "guaranteed")
        within = np.linalg.norm((positions(site.data) - centre)[:, :2], axis=1)
        assert within.max() < 0.15 + 2 * thick_m
        assert set(Counter(edge for face in site.data.polygons for edge in face.edge_keys).values()) == {2}
    none = paint(built, replace(made(), chosen=None, reach=None), "bm")
    assert not none.objects
    assert "Reach" not in bpy.data.meshes
    assert not any(text.startswith(("Chosen", "Reach")) for text, _ in painted_decisions.make_legend(bpy.context.scene))


def test_what_is_no_ground_is_dark(shown):
    """A mesh without colours is white in Blender 5.2, which has a meaning where errors are painted."""
    _, built = shown
    mesh = bpy.data.meshes.new("Lander")
    mesh.from_pydata([(0, 0, 1), (1, 0, 1), (0, 1, 1)], [], [(0, 1, 2)])
    item = bpy.data.objects.new("Lander", mesh)
    built.collection.objects.link(item)
    try:
        paint(built, made(), "bm")
        assert (colours(mesh) == 60).all()
        painted_errors.clear_painted(bpy.context.scene)
        assert not mesh.color_attributes
    finally:
        bpy.data.batch_remove([item, mesh])


@pytest.mark.heavy
def test_nothing_that_is_rendered_or_identified_changes(shown, tmp_path):
    pair, built = shown
    scene, mesh = bpy.context.scene, built.terrain.data
    there = blocks()
    before = read_parts(built.collection), built.extra, set(mesh.attributes.keys()), mesh.attributes.default_color_name
    paint(built, made(), "bm")
    assert (read_parts(built.collection), built.extra) == before[:2]
    assert not built.edited
    (planned,) = expand_headings(pair.settings, built.extra)
    assert planned.id == pair.id
    render_pairs(built, [planned], tmp_path, 1, 0.0, lambda *a, **k: None)
    assert painted_errors.find_painted(scene) is None  # a material of the user's could read it
    assert set(mesh.attributes.keys()) == before[2]
    assert mesh.attributes.default_color_name == before[3]
    assert blocks() == there


def test_a_ground_elsewhere_is_refused_and_what_is_shown_stays(shown):
    _, built = shown
    paint(built, made(), "first")
    with pytest.raises(IcyMoonError, match="No vertex of the ground"):
        paint(built, replace(made(), grid=Grid(CELL_M, ROWS, COLUMNS, 99.0, 0.0)), "second")
    assert painted_decisions.make_legend(bpy.context.scene)[0][0] == "Suitability by first"
    painted_errors.clear_painted(bpy.context.scene)
    assert painted_decisions.make_legend(bpy.context.scene) == ()


def test_the_last_piece_alone_shows_decisions_and_nothing_is_left_before(shown):
    _, built = shown
    before = blocks(), set(built.terrain.data.attributes.keys())
    attributes: list[set[str]] = []

    def begin() -> Steps[bpy.types.Collection]:
        return painted_decisions.paint_decisions(lambda: built, made(), "bm")

    walk(begin(), lambda: attributes.append(set(built.terrain.data.attributes.keys())))
    assert attributes
    assert all(each == before[1] for each in attributes)
    assert painted_errors.COLOUR in built.terrain.data.attributes
    painted_errors.clear_painted(bpy.context.scene)
    for pauses in range(1, len(attributes) + 1):
        stop_after(begin(), pauses)
        assert (blocks(), set(built.terrain.data.attributes.keys())) == before, f"after {pauses} pauses"


@pytest.mark.heavy
def test_from_a_pair_to_the_button(shown):
    """Decisions on the rendered pair, each map by its button, in place of each other, and removed without a trace."""
    pair, built = shown
    scene, folder = bpy.context.scene, pair.folder.parent.parent / "decisions"
    assert not bpy.ops.icymoon.paint_decisions.poll()
    decide_pairs([pair.folder], parse_methods("bm"), folder, read_rules(), cell_m=0.05)
    there = blocks()
    for kind, title in ((SUITABILITY, "Suitability"), (SLOPE, "Slope"), (HEIGHT_ERROR, "Height error")):
        assert bpy.ops.icymoon.paint_decisions(method="bm", map=kind) == {"FINISHED"}
        lines = painted_decisions.make_legend(scene)
        assert lines[0][0] == f"{title} by StereoBM"
        shares = [text.rpartition(": ")[2].removesuffix(" %") for text, _ in lines if text.endswith(" %")]
        assert sum(map(float, shares)) == pytest.approx(100, abs=0.2)
        icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()
        assert {icon for _, icon in lines} <= set(icons)
        assert painted_errors.make_legend(scene) == ()
        scene.icymoon.error_range_m = 0.5  # these colours have no range
        stored = read_map(folder, pair.id, "bm", kind)
        seen = {tuple(colour) for colour in colours(built.terrain.data)}
        assert len(seen & {tuple(colour) for colour in colour_cells(stored).reshape(-1, 3).astype(float)}) > 1
    assert bpy.ops.icymoon.paint_decisions(method="true depth") == {"FINISHED"}
    assert painted_decisions.make_legend(scene)[0][0] == "Suitability by true depth"
    with pytest.raises(RuntimeError, match="no decisions by SGBM"):
        bpy.ops.icymoon.paint_decisions(method="sgbm")
    assert bpy.ops.icymoon.hide_decisions() == {"FINISHED"}
    assert not bpy.ops.icymoon.hide_decisions.poll()
    assert blocks() == there
    was = scene.icymoon.terrain.rms_slope_deg
    scene.icymoon.terrain.rms_slope_deg = was + 1
    with pytest.raises(RuntimeError, match=r"terrain.rms_slope_deg has changed .* press Build Scene first"):
        bpy.ops.icymoon.paint_decisions()
    scene.icymoon.terrain.rms_slope_deg = was
