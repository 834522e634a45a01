"""A scene that another Blender has built is taken over from its file as if it had been built here."""

from __future__ import annotations

import json
import time
from functools import partial
from pathlib import Path

import bpy
import pytest
from built_scenes import everything
from icymoon.nodes import build_scene as scenes
from icymoon.nodes.datablocks.fingerprint import read_parts
from icymoon.nodes.stored_build import read_build, read_build_in_steps, write_build
from icymoon.operators import refine_ground
from icymoon.render.build_worker import write_scene
from icymoon.settings.description import defaults, merged
from icymoon.support.errors import IcyMoonError
from pieces import count_pauses, stop_after, walk

KINDS = ("objects", "meshes", "lights", "cameras", "materials", "node_groups", "collections", "worlds", "images")


def make_settings(*changes):
    small: dict[str, dict[str, object]] = {
        "mesh": {"kind": "GRID"},
        "terrain": {"resolution": 17, "size_m": 6.0},
        "rocks": {"coverage": 0.05, "most": 9, "smallest_m": 0.2},
        "hapke": {"backend": "NODES"},
    }
    return merged(defaults(), small, *changes)


def describe(built) -> dict[str, object]:
    """All that a build leaves in a file: names, marks and records."""
    kept = {key: built.collection[key] for key in built.collection.keys() if isinstance(built.collection[key], str)}  # noqa: SIM118
    return {
        "names": {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in KINDS},
        "parts": read_parts(built.collection),
        "kept": {key: json.loads(value) if value.startswith(("[", "{")) else value for key, value in kept.items()},
        "order": [item.name for item in built.collection.all_objects],
        "site": built.site_m,
        "warnings": built.warnings,
        "edited": built.edited,
    }


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"textures": {"set": "FROST"}},
        {"excavation": {"path": "LINE", "cell_m": 0.05}, "lander": {"kind": "PARAMETRIC"}},
    ],
)
def test_a_scene_from_a_file_is_as_if_built_here(scene, tmp_path, more):
    settings, path = make_settings(more), tmp_path / "built.blend"
    made = scenes.build_scene(scene, settings)
    expected = describe(made)
    write_build(made, path)
    scenes.clear_scene(scene)
    taken = scenes.build_scene(scene, settings, take_over=partial(read_build, path))
    assert describe(taken) == expected
    assert not bpy.data.libraries
    if not more:
        again = scenes.build_scene(scene, settings, take_over=partial(read_build, path))  # over the first
        assert again.terrain == taken.terrain
        assert describe(again) == expected


def test_blender_reads_a_ground_without_edges_at_once(scene, tmp_path):
    """A piece holds the window for the time that Blender takes to read the file, and edges are half of a mesh."""
    path, settings = tmp_path / "built.blend", make_settings({"terrain": {"resolution": 129}})
    write_build(scenes.build_scene(scene, settings), path)
    scenes.clear_scene(scene)
    edges: list[int] = []

    def note() -> None:
        ground = next(mesh for mesh in bpy.data.meshes if "Terrain" in mesh.name)
        edges.append(len(ground.edges))

    made = walk(read_build_in_steps(path), note)
    assert edges[0] == 0
    assert edges[-1] == 2 * 129 * 128
    made.remove()
    count, made = count_pauses(read_build_in_steps(path))
    made.remove()
    before = everything()
    for pauses in range(1, count + 1):
        stop_after(read_build_in_steps(path), pauses)
        assert everything() == before


@pytest.mark.parametrize("suffix", [".blend", ".edges.npz"])
@pytest.mark.parametrize("left", [None, 0, 3000], ids=["gone", "empty", "cut"])
def test_a_damaged_file_is_named_and_leaves_nothing(scene, tmp_path, suffix, left):
    path = tmp_path / "built.blend"
    write_build(scenes.build_scene(scene, make_settings()), path)
    scenes.clear_scene(scene)
    damaged, before = path.with_suffix(suffix), everything()
    if left is None:
        damaged.unlink()
    else:
        damaged.write_bytes(damaged.read_bytes()[:left])
    with pytest.raises(IcyMoonError, match=rf"built\{suffix}: .* cannot be read \(.+\); build it again"):
        read_build(path)
    assert everything() == before


def test_an_edit_of_a_scene_from_a_file_is_found(scene, tmp_path):
    settings, path = make_settings(), tmp_path / "built.blend"
    write_build(scenes.build_scene(scene, settings), path)
    scenes.clear_scene(scene)
    taken = scenes.build_scene(scene, settings, take_over=partial(read_build, path))
    taken.terrain.data.vertices[3].co.z += 0.1
    assert taken.edited_parts() == {"terrain data"}


def test_the_program_tells_how_far_it_is(scene, tmp_path):
    told = []
    write_scene({"settings": make_settings()}, tmp_path / "built.blend", lambda kind, **facts: told.append(kind))
    assert told == ["progress", "progress", "done"]
    assert (tmp_path / "built.blend").is_file()


@pytest.mark.long
def test_another_blender_builds_the_same_scene(scene):
    settings = make_settings()
    expected = describe(scenes.build_scene(scene, settings))
    scenes.clear_scene(scene)
    job = refine_ground.start_building(settings)
    while job.poll():
        time.sleep(0.05)
    assert not job.failure
    path = Path(job.result["scene"])
    built = scenes.build_scene(scene, settings, take_over=partial(read_build, path))
    job.close()
    assert not path.parent.exists()
    assert describe(built) == expected
