"""A .blend file of a stranger: what it stores as text is a sentence, and Build Scene builds over it."""

from __future__ import annotations

import bpy
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.built_scene import EXCAVATION, FINGERPRINT, GROUND, NOTES, PREVIEW, SETTINGS, STATISTICS
from icymoon.operators.user_render import NOTE, restore_render
from icymoon.support.errors import IcyMoonError
from rendering import complete, empty_scene

HOSTILE = [
    "",
    "[",
    "{",
    "[" * 10**5,
    '{"a":' * 10**5,
    "1" * 5000,
    '{"a": NaN}',
    '{"a": 1e999}',
    "3",
    "null",
    '"text"',
    "\0",
    '{"a": 1}',
    "[1]",
    "[[[]]]",
    '{"a": "\\ud800"}',
    3,
    2.5,
    [1, 2],
    {"a": 1},
    b"bytes",
]
READERS = {
    SETTINGS: lambda scene: scenes.find_built(scene),
    FINGERPRINT: lambda scene: scenes.find_built(scene).edited,
    GROUND: lambda scene: scenes.find_built(scene).ground,
    STATISTICS: lambda scene: scenes.find_built(scene).statistics,
    EXCAVATION: lambda scene: scenes.find_built(scene).excavation,
    PREVIEW: lambda scene: scenes.find_built(scene).preview,
    NOTES: preview.read_notes,
    NOTE: lambda scene: restore_render(scene, scenes.find_collection(scene)),
}


@pytest.fixture(scope="module")
def built():
    scene = empty_scene()
    scenes.build_scene(scene, complete())
    return scene


@pytest.mark.parametrize("key", READERS)
def test_what_a_blend_file_stores_is_read_or_a_sentence(built, key):
    collection = scenes.find_collection(built)
    before = collection.get(key)
    refused = []
    for value in HOSTILE:
        collection[key] = value
        try:
            READERS[key](built)
        except IcyMoonError as error:
            refused.append(str(error))
    if before is None:
        del collection[key]
    else:
        collection[key] = before
    assert len(refused) >= 15
    assert all("press Build Scene" in each and len(each) < 600 for each in refused)
    READERS[key](built)


@pytest.mark.parametrize("key", [SETTINGS, FINGERPRINT, GROUND, STATISTICS, EXCAVATION, PREVIEW, NOTES])
def test_build_scene_builds_over_what_is_damaged(key):
    scene = empty_scene()
    scenes.build_scene(scene, complete())
    scenes.find_collection(scene)[key] = "["
    scenes.build_scene(scene, complete())
    READERS[key](scene)
    assert bpy.context.scene == scene
