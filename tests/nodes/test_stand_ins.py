"""Scenes that show stand-ins: built without any file of the user, and saying so."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.paper_stand_ins import cached_files
from icymoon.paper_stand_ins.reconstructions import Reconstruction
from icymoon.paper_stand_ins.texture_maps import make_maps
from icymoon.settings.topics.stand_ins import find_texture_item
from icymoon.support import cache_folder
from rendering import complete, empty_scene


@pytest.fixture(autouse=True)
def small(tmp_path, monkeypatch):
    """Stand-ins that are made quickly, in an empty cache."""
    monkeypatch.setenv(cache_folder.FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(cached_files, "make_maps", lambda key: make_maps(key, size=64))
    places = np.array([[-8.0, -8, 0], [8, -8, 0], [8, 8, 1], [-8, 8, 0]])
    monkeypatch.setattr(
        cached_files,
        "reconstruct",
        lambda key: Reconstruction(
            places, np.array([[0, 1, 2], [0, 2, 3]]), places[:, :2] / 16 + 0.5, np.full((64, 64, 3), 0.25)
        ),
    )


def built(**settings):
    return scenes.build_scene(empty_scene(), complete(settings))


@pytest.mark.parametrize("key", ["CRACKED_ICE", "SUNCUPS"])
def test_a_texture_shows_the_maps_of_the_papers_item(key, tmp_path):
    found = built(textures={"set": "STAND_IN", "stand_in": key})
    used = {node.image.name for node in found.materials[0].node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"}
    assert used == {f"{key.lower()}_{kind}.png" for kind in find_texture_item(key).kinds}
    warning = next(sentence for sentence in found.warnings if key in sentence)
    assert "made by code, in place of" in warning


def test_a_mesh_shows_its_image_and_is_as_large_as_stated():
    found = built(source={"kind": "STAND_IN", "stand_in": "ATHABASCA"}, textures={"set": "MESH"})
    assert found.terrain.dimensions.x == pytest.approx(16.0)
    images = {node.image for node in found.materials[0].node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"}
    assert {image.name for image in images} == {"athabasca.png"}
    assert any("ATHABASCA" in sentence for sentence in found.warnings)
    assert found.content  # counts in the id, but not by the bytes of this machine


def test_the_recipe_counts_in_the_id_and_the_file_does_not(monkeypatch):
    one = built(textures={"set": "STAND_IN", "stand_in": "FIRN"}).content
    monkeypatch.setattr(cached_files, "make_maps", lambda key: make_maps(key, seed=1, size=64))
    assert built(textures={"set": "STAND_IN", "stand_in": "FIRN"}).content == one
    monkeypatch.setattr("icymoon.settings.user_files.RECIPE_NUMBER", 99)
    assert built(textures={"set": "STAND_IN", "stand_in": "FIRN"}).content != one
