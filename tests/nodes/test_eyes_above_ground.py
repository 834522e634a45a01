"""What is refused before it renders black: of the scene as it stands, in the window and headless."""

from __future__ import annotations

import bpy
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import eyes_above_ground
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.render.scene_source import ScenesFromSettings
from icymoon.render.worker import render_from, render_pairs
from icymoon.settings.user_files import hash_content
from icymoon.support.errors import IcyMoonError
from rendering import complete, empty_scene

#: The right eye is 36 mm under the ground, and rendered black.
UNDERGROUND = {
    "terrain": {"rms_slope_deg": 25.0},
    "rig": {"height_m": 0.1, "baseline_m": 0.3},
    "mesh": {"kind": "GRADED", "most": 20_000},
    "quality": {"samples": 1},
}
TALL = {
    "terrain": {"rms_slope_deg": 0.0},
    "rocks": {"coverage": 0.5, "smallest_m": 1.0, "largest_m": 1.0, "height_ratio": 3.0, "burial": 0.0},
}


def silent(*args, **facts):
    pass


@pytest.mark.parametrize("kind", ["GRADED", "GRID"])
def test_build_tells_and_render_refuses_in_the_same_sentence(tmp_path, kind):
    settings = complete(UNDERGROUND, {"mesh": {"kind": kind}})
    built = scenes.build_scene(empty_scene(), settings)
    (told,) = [text for text in built.warnings if "right eye" in text]
    assert "under the ground" in told
    with pytest.raises(IcyMoonError) as refused, ScenesFromSettings(silent) as stage:
        render_from(stage, expand_headings(settings), tmp_path, silent)
    assert str(refused.value) == told
    with pytest.raises(IcyMoonError, match=r"under the ground; raise rig\.height_m"):
        render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, silent)
    assert not list(tmp_path.glob("pairs/*"))


def test_one_bad_pair_is_set_aside_and_the_others_are_rendered(tmp_path):
    bad, good = (complete(UNDERGROUND, {"rig": {"heading_deg": heading}}) for heading in (0.0, 60.0))
    said = []
    pairs = [PlannedPair(pair.id, pair.settings, 0.0) for each in (bad, good) for pair in expand_headings(each)]
    with ScenesFromSettings(silent) as stage:
        render_from(stage, pairs, tmp_path, lambda kind, **facts: said.append((kind, facts)), keep_going=True)
    (error,) = [facts for kind, facts in said if kind == "error"]
    assert error["pair"] == pairs[0].id
    assert "right eye" in error["message"]
    assert [path.parent.name for path in tmp_path.glob("pairs/*/pair.json")] == [pairs[1].id]


def test_eyes_that_were_moved_by_hand_are_asked_of_the_scene():
    built = scenes.build_scene(empty_scene(), complete(TALL))
    assert not eyes_above_ground.find_reasons(built)
    camera = built.camera
    start = camera.location.copy()
    block = max(
        (item for item in bpy.data.objects if item.get("icymoon") == "rock"), key=lambda item: len(item.data.vertices)
    )
    camera.location = block.data.vertices[0].co  # the middle of the largest block
    assert any("left eye in a rock" in text for text in eyes_above_ground.find_reasons(built))
    camera.location = start
    camera.location.z = -0.2
    assert len(eyes_above_ground.find_reasons(built)) == 2
    camera.location.z = 3e-4
    assert any("0.0003 m above the ground" in text for text in eyes_above_ground.find_reasons(built))
    # An object of the person's own is none of the ground: a lander's mast may hold the camera.
    camera.location = start
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=start)
    assert not eyes_above_ground.find_reasons(built)


def test_turned_with_the_headings_of_a_standing_scene():
    """The rig of a built scene is turned about its left eye: the right one comes round to where a wall stands."""
    built = scenes.build_scene(
        empty_scene(),
        complete({"terrain": {"rms_slope_deg": 0.0, "size_m": 4.0}, "rig": {"height_m": 0.5, "baseline_m": 1.0}}),
    )
    mesh = built.terrain.data
    mesh.clear_geometry()
    # A ramp that rises to the west of the left eye, 45 degrees.
    mesh.from_pydata(
        [(-4, -4, 4), (0, -4, 0), (4, -4, 0), (-4, 4, 4), (0, 4, 0), (4, 4, 0)], [], [(0, 1, 4, 3), (1, 2, 5, 4)]
    )
    found = [bool(eyes_above_ground.find_reasons(built, turn)) for turn in (0.0, 90.0, 180.0, 270.0)]
    assert found == [False, False, True, False]


def box(low, high):
    """Corners and faces, seen from outside, of a box."""
    x, y, z = zip(low, high, strict=True)
    corners = [(x[k & 1], y[k >> 1 & 1], z[k >> 2]) for k in range(8)]
    return corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6)]


@pytest.mark.parametrize(
    ("low", "high", "admitted"),
    [((-3.0, -3.0, 1.0), (3.0, 3.0, 1.2), True), ((0.5, -1.0, -0.5), (3.0, 1.0, 2.0), False)],
    ids=["under a roof", "in a cliff"],
)
def test_a_roof_over_the_eyes_is_open_and_a_cliff_about_one_is_not(low, high, admitted):
    built = scenes.build_scene(
        empty_scene(), complete({"terrain": {"rms_slope_deg": 0.0}, "rig": {"height_m": 0.5, "baseline_m": 1.0}})
    )
    ground = [(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)]
    corners, faces = box(low, high)
    built.terrain.data.clear_geometry()
    built.terrain.data.from_pydata([*ground, *corners], [], [(0, 1, 2, 3), *(tuple(4 + k for k in f) for f in faces)])
    assert bool(eyes_above_ground.find_reasons(built)) != admitted


def write_head(folder, **cameras):
    """A head of small pinholes at positions in the frames of their names."""
    text = "".join(
        f'[[camera]]\nname = "{name}"\nmodel = "PINHOLE"\nwidth_px = 16\nheight_px = 12\nfield_deg = 60\n'
        f'frame = "{frame}"\nposition_m = {list(map(float, position))}\n'
        for name, (frame, position) in cameras.items()
    )
    (folder / "head.toml").write_text(text, encoding="utf-8")
    return {"rig": {"head_file": str(folder / "head.toml")}}


@pytest.mark.parametrize("kind", ["GRADED", "GRID"])
def test_a_camera_of_a_head_in_a_rock_is_refused_by_its_name(tmp_path, kind):
    tall = complete(TALL, {"mesh": {"kind": kind, "most": 20_000}})
    scenes.build_scene(empty_scene(), tall)
    block = max(
        (item for item in bpy.data.objects if item.get("icymoon") == "rock"), key=lambda item: len(item.data.vertices)
    )
    x, y, z = block.data.vertices[0].co  # the middle of the largest block
    head = write_head(tmp_path, inside=("ZERO", (x, y, z)), above=("ZERO", (x, y, z + 9)), free=("RIG", (0.1, 0, 0)))
    settings = complete(TALL, {"mesh": {"kind": kind, "most": 20_000}}, head)
    pairs = expand_headings(settings, hash_content(settings))
    with pytest.raises(IcyMoonError) as refused, ScenesFromSettings(silent) as stage:
        render_from(stage, pairs, tmp_path, silent)
    assert str(refused.value).endswith(
        "head.toml: the camera inside is in a rock; change its position_m, or the rocks."
    )
    built = scenes.build_scene(empty_scene(), settings)
    with pytest.raises(IcyMoonError, match="the camera inside is in a rock"):
        render_pairs(built, pairs, tmp_path, 1, 0.0, silent)
    assert not list(tmp_path.glob("pairs/*"))


def test_a_camera_of_a_head_turns_with_the_rig_and_is_found_under_a_slope(tmp_path):
    """A ramp rises to the west from the left eye, 45 degrees. A camera of the rig comes round to where it stands; one
    that stands on the ground stays."""
    head = write_head(tmp_path, aside=("RIG", (1, 0, 0)), there=("ZERO", (1, 0, 0.5)))
    rig = {"height_m": 0.5, "baseline_m": 0.1}
    built = scenes.build_scene(
        empty_scene(), complete({"terrain": {"rms_slope_deg": 0.0, "size_m": 4.0}, "rig": rig}, head)
    )
    mesh = built.terrain.data
    mesh.clear_geometry()
    mesh.from_pydata(
        [(-4, -4, 4), (0, -4, 0), (4, -4, 0), (-4, 4, 4), (0, 4, 0), (4, 4, 0)], [], [(0, 1, 4, 3), (1, 2, 5, 4)]
    )
    found = [eyes_above_ground.find_reasons(built, turn) for turn in (0.0, 90.0, 180.0, 270.0)]
    assert [len(each) for each in found] == [0, 0, 1, 0]
    assert found[2][0].endswith("head.toml: the camera aside is 0.5 m under the ground; raise its position_m.")


@pytest.mark.parametrize(
    ("parts", "names"),
    [
        (
            {"rocks": {"coverage": 0.3, "smallest_m": 50.0, "largest_m": 50.0}, "terrain": {"size_m": 5.0}},
            ("rocks.coverage",),
        ),
        (
            {
                "surface": {"model": "HAPKE"},
                "hapke": {"w": 1.0, "filling_factor": 0.75},
                "light": {"directions_from": "DATE", "date_utc": "1850-01-01"},
            },
            ("hapke.w", "light.date_utc"),
        ),
    ],
)
def test_what_needs_no_scene_is_refused_before_anything_is_made(parts, names):
    scene = empty_scene()
    with pytest.raises(IcyMoonError) as refused:
        scenes.build_scene(scene, complete(parts))
    assert all(name in str(refused.value) for name in names)
    assert not len(bpy.data.meshes)
    assert not len(bpy.data.materials)


def test_the_pair_says_what_to_know_of_it(tmp_path):
    settings = complete(
        {
            "mesh": {"kind": "GRID"},
            "terrain": {"resolution": 2, "size_m": 2000.0, "rms_slope_deg": 0.0},
            "quality": {"samples": 1},
            "rig": {"width_px": 16, "height_px": 16},
        }
    )
    built = scenes.build_scene(empty_scene(), settings)
    (folder,) = render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, silent)
    (told,) = read_pair(folder).data["advice"]
    assert told in built.warnings
    assert "1e-4" in told
