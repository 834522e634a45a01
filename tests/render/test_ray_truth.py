"""Truth by rays of our own against the truth that Cycles renders of the same scenes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.rays import engine
from icymoon.render import displaced_vertices
from icymoon.render.pairs.pair_folder import EYES, Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import Settings, typed
from icymoon.stereo.images.exr import read_truth
from icymoon.stereo.trade.measure_variants import scale_view
from icymoon.support.blender import compat
from icymoon.support.labels import FIRST_ROCK_INSTANCE
from mathutils import Matrix
from rendering import complete, empty_scene

ROCKS = {"coverage": 0.2, "smallest_m": 0.2, "largest_m": 0.8}
ROUGH = {"grain_amplitude_m": 0.05, "grain_size_m": 0.4}
WIDE = {"rig": {"width_px": 128, "height_px": 96}}
Change = Callable[[Built], object]


def shoot(folder: Path, settings: Settings, change: Change | None = None) -> list[Pair]:
    """The pairs of a built scene, which ``change`` has changed by hand."""
    built = build_scene(empty_scene(), settings)
    if change is not None:
        change(built)
    made = render_pairs(built, expand_headings(settings, built.extra), folder, 1, 0.0, lambda *a, **k: None)
    return [read_pair(each) for each in made]


def both(folder: Path, settings: Settings, change: Change | None = None) -> list[tuple[Pair, Pair]]:
    """The pairs by rays, each with the same by Cycles."""
    by_cycles = typed(description.merged(settings, {"quality": {"truth_by": "CYCLES"}}))
    found = [shoot(folder / name, each, change) for name, each in (("rays", settings), ("cycles", by_cycles))]
    assert [pair.data["truth"]["by"] for pair in found[0]] == ["Embree"] * len(found[0])
    assert {pair.data["truth"]["by"] for pair in found[1]} == {"Cycles"}
    assert [pair.id for pair in found[0]] == [pair.id for pair in found[1]]
    return list(zip(*found, strict=True))


def check_same(ours: Pair, cycles: Pair) -> None:
    """Both truths agree, but for single pixels whose centre is at an edge to single precision."""
    for eye in EYES:
        mine, other = (read_truth(pair.truth(eye), eye) for pair in (ours, cycles))
        seen = np.isfinite(other.depth)
        assert np.mean(np.isfinite(mine.depth) != seen) < 2e-3
        where = seen & np.isfinite(mine.depth)
        disparity = [ours.camera.disparity(view.depth[where]) for view in (mine, other)]
        assert where.any()
        assert np.median(np.abs(mine.depth[where] / other.depth[where] - 1)) < 2e-6
        assert np.mean(np.abs(disparity[0] - disparity[1]) > 0.01) < 2e-3
        assert np.mean(mine.semantic != other.semantic) < 2e-3
        assert np.mean(mine.instance != other.instance) < 2e-3
        ground = where & (other.semantic < 4)  # the planet has no facets that shine
        other_facet = np.abs(mine.normal[ground] - other.normal[ground]).max(axis=-1) > 1e-3
        assert other_facet.mean() < 5e-3
        assert (mine.hidden is None) == (other.hidden is None)
        if other.hidden is not None:
            assert np.mean(mine.hidden != other.hidden) < 0.02  # Cycles finds them between four rays


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    "parts",
    [
        [{}],
        [{"rocks": ROCKS}],
        [{"surface": {**ROUGH, "relief": "DISPLACEMENT"}}],
        [{"mesh": {"kind": "GRADED"}, "surface": ROUGH, "rocks": ROCKS}],
        [{"rig": {"toe_in_deg": 2.0, "overscan": 0.1}, "rocks": ROCKS}],
        [{"rig": {"principal_x_px": 9.3, "principal_y_px": -7.25, "overscan": 0.05}, "rocks": ROCKS}],
        [{"rig": {"focus_distance_m": 3.0}, "sensor": {"f_number": 2.0}, "rocks": ROCKS}],
        [{"quality": {"truth": "DEPTH"}, "rig": {"toe_in_deg": 1.0}}],
        [{"quality": {"truth": "SEMANTIC"}, "rig": {"toe_in_deg": 1.0}, "rocks": ROCKS}],
    ],
    ids=["plain", "rocks", "displaced", "graded", "toed", "off_axis", "blurred", "depth", "semantic"],
)
def test_truth_is_the_same_by_rays_and_by_cycles(tmp_path, parts):
    for ours, cycles in both(tmp_path, complete(WIDE, *parts)):
        if complete(*parts).quality.truth == "FULL":
            check_same(ours, cycles)
            continue
        for eye in EYES:
            mine, other = (read_truth(pair.truth(eye), eye) for pair in (ours, cycles))
            assert mine.depth == pytest.approx(other.depth, rel=1e-4, nan_ok=True)
            assert (mine.semantic is None) == (other.semantic is None)


@pytest.mark.parametrize(
    "preset",
    [
        pytest.param("gallery/saturn_light", marks=pytest.mark.long),
        pytest.param("gallery/trench", marks=pytest.mark.long),
        "workspace_europa_lander",
    ],
)
def test_planet_trench_and_lander_are_the_same_by_rays_and_by_cycles(tmp_path, preset):
    made = description.merged(
        description.defaults(), preset_files.load_preset(preset if "/" in preset else f"scenes/{preset}")
    )
    small = typed(
        description.merged(
            scale_view(made, 128 / made["rig"]["width_px"]),
            {
                "quality": {"samples": 1, "denoiser": "NONE", "threads": 2, "indirect": "TRACED"},
                "dataset": {"headings": 2},
            },
        )
    )
    pairs = both(tmp_path, small)
    for ours, cycles in pairs:  # the second heading turns the lander's head
        check_same(ours, cycles)
    if preset == "gallery/saturn_light":
        assert any((read_truth(ours.truth("left"), "left").semantic == 4).any() for ours, _ in pairs)


def add_block(built: Built, place: Matrix, kind: str = "MESH") -> bpy.types.Object:
    """Put an object of the user's before the camera."""
    if kind == "MESH":
        data = bpy.data.meshes.new("Block")
        data.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0.5), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    else:
        data = bpy.data.curves.new("Wire", "CURVE")
        data.dimensions, data.bevel_depth = "3D", 0.2
        data.splines.new("POLY").points.add(1)
        data.splines[0].points[1].co = (1.0, 0.0, 0.0, 1.0)
    item = bpy.data.objects.new("Block", data)
    built.collection.objects.link(item)
    item.matrix_world = built.camera.matrix_world @ Matrix.Translation((0.0, 0.0, -2.0)) @ place
    return item


def test_objects_of_the_user_are_met_as_they_stand(tmp_path):
    """One that is mirrored and stretched, and two instances of a collection with another."""

    def change(built: Built) -> None:
        add_block(built, Matrix.Diagonal((-0.3, 0.1, 0.2, 1.0)) @ Matrix.Rotation(0.7, 4, "X"))
        inner = bpy.data.collections.new("Inner")
        block = add_block(built, Matrix.Diagonal((0.1, 0.1, 0.1, 1.0)))
        built.collection.objects.unlink(block)
        inner.objects.link(block)
        for x in (-0.5, 0.5):
            empty = bpy.data.objects.new("Two", None)
            empty.instance_type, empty.instance_collection = "COLLECTION", inner
            built.collection.objects.link(empty)
            empty.matrix_world = Matrix.Translation((x, 0.0, 0.3))

    ((ours, cycles),) = both(tmp_path, complete(WIDE), change)
    check_same(ours, cycles)
    assert len(np.unique(read_truth(ours.truth("left"), "left").instance)) >= 3


def test_rocks_that_are_hidden_in_renders_are_not_met(tmp_path):
    def change(built: Built) -> None:
        assert built.rocks is not None
        built.rocks.hide_render = True

    ((ours, cycles),) = both(tmp_path, complete(WIDE, {"rocks": ROCKS}), change)
    check_same(ours, cycles)
    assert read_truth(ours.truth("left"), "left").instance.max() < FIRST_ROCK_INSTANCE


def pane(built: Built) -> None:
    """A pane that lets half of the light pass."""
    material = bpy.data.materials.new("Pane")
    tree = compat.ensure_nodes(material)
    shader = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    shader.inputs["Alpha"].default_value = 0.25
    add_block(built, Matrix.Scale(0.2, 4)).data.materials.append(material)


def finer(built: Built) -> None:
    modifier = add_block(built, Matrix.Scale(0.2, 4)).modifiers.new("Finer", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 2


def unseen(built: Built) -> None:
    add_block(built, Matrix.Scale(0.2, 4)).visible_camera = False


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (pane, "the object Block may let rays pass"),
        (finer, "the object Block has another mesh in renders"),
        (unseen, "the camera does not see the object Block"),
        (lambda built: add_block(built, Matrix.Scale(0.2, 4), "CURVE"), "the object Block has no mesh"),
    ],
)
def test_cycles_renders_the_truth_of_what_rays_would_not_meet_and_the_pair_states_why(tmp_path, change, why):
    (pair,) = shoot(tmp_path, complete({}), change)
    assert pair.data["truth"]["by"] == "Cycles"
    assert why in pair.data["truth"]["why"]
    assert read_truth(pair.truth("left"), "left").hidden is not None


@pytest.mark.long
def test_blenders_trees_find_the_same_truth_where_there_is_no_embree(tmp_path, monkeypatch):
    """Of rocks on ground that its material moves. Other pixels are those whose ray meets an edge to single precision,
    1e-7 of a pixel wide."""
    settings = complete(WIDE, {"rocks": ROCKS, "surface": {**ROUGH, "relief": "DISPLACEMENT"}})
    (ours,) = shoot(tmp_path / "embree", settings)
    monkeypatch.setattr(engine, "load_library", lambda folders: None)
    monkeypatch.setattr(compat, "list_library_folders", lambda: (tmp_path,))  # what is found in a folder is kept
    (others,) = shoot(tmp_path / "trees", settings)
    assert [pair.data["truth"] for pair in (ours, others)] == [{"by": "Embree"}, {"by": "BVHTree"}]
    for eye in EYES:
        mine, other = (read_truth(pair.truth(eye), eye) for pair in (ours, others))
        assert len(np.unique(mine.instance)) > 3
        for one, two in (
            (mine.depth, other.depth),
            (mine.normal, other.normal),
            (mine.instance, other.instance),
            (mine.semantic, other.semantic),
            (mine.hidden, other.hidden),
        ):
            assert np.sum(np.abs(one.astype(float) - two) > 1e-6 * np.abs(two)) <= 2


def test_truth_that_comes_with_the_light_needs_no_rays(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "load_library", pytest.fail)
    (pair,) = shoot(tmp_path, complete({"quality": {"truth": "DEPTH"}}))
    assert "truth" not in pair.data


def test_rays_leave_nothing_in_the_file(tmp_path):
    settings = complete({"surface": {**ROUGH, "relief": "DISPLACEMENT"}, "rocks": ROCKS})
    built = build_scene(empty_scene(), settings)
    kinds = ("scenes", "objects", "meshes", "materials", "node_groups", "collections")
    before = [sorted(getattr(bpy.data, kind).keys()) for kind in kinds]
    render_pairs(built, expand_headings(settings, built.extra), tmp_path, 1, 0.0, lambda *a, **k: None)
    assert [sorted(getattr(bpy.data, kind).keys()) for kind in kinds] == before


@pytest.mark.long
def test_geometry_nodes_move_vertices_as_a_bake_of_cycles_tells(monkeypatch):
    """Fine relief that is real, with a crust: on a graded mesh, of which a part moves."""
    settings = complete(
        {
            "mesh": {"kind": "GRADED"},
            "surface": {
                **ROUGH,
                "model": "PRINCIPLED",
                "grain_patchiness": 0.5,
                "crust_share": 0.4,
                "crust_height_m": 0.01,
            },
        }
    )
    built = build_scene(empty_scene(), settings)
    mesh, place = built.terrain.data, np.array(built.terrain.matrix_world)
    at_rest = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", at_rest)
    whole, groups = displaced_vertices.displace_corners(mesh, place)
    some, _ = displaced_vertices.displace_corners(mesh, place, still_m=settings.surface.grain_size_m)
    monkeypatch.setattr(displaced_vertices, "_find_heights", lambda *a: None)
    baked, same = displaced_vertices.displace_corners(mesh, place)
    assert np.array_equal(groups, same)
    assert np.array_equal(whole, some)
    share = np.mean(np.abs(whole - at_rest.reshape(-1, 3)).max(axis=1) > 1e-5)
    assert 0.02 < share < 1
    assert np.abs(whole - baked).max() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("preset", [name for name in preset_files.preset_names() if name.startswith("scenes/")])
def test_the_truth_of_each_scene_is_the_same_by_rays_and_by_cycles(tmp_path, preset):
    made = description.merged(description.defaults(), preset_files.load_preset(preset))
    small = typed(
        description.merged(
            scale_view(made, 160 / made["rig"]["width_px"]),
            {"quality": {"samples": 1, "denoiser": "NONE", "threads": 2, "indirect": "TRACED"}},
        )
    )
    for ours, cycles in both(tmp_path, small):
        check_same(ours, cycles)
