"""The user's own files replace stand-ins by name, and the user is told which."""

from __future__ import annotations

import pytest
from icymoon.render.plans.plan_file import read_plan
from icymoon.render.plans.stand_in_replacements import replace_stand_ins
from icymoon.settings.description import defaults, merged
from icymoon.support.errors import IcyMoonError

CASES = """
[plan]
title = "Mine"
{header}

[terrain]
resolution = 33

[mesh]
kind = "GRID"

[[sweep]]
kind = "cases"
case = [
  {{ textures = {{ set = "STAND_IN", stand_in = "GROUND_SNOW", width_m = 2.0 }} }},
  {{ textures = {{ set = "STAND_IN", stand_in = "FIRN", width_m = 0.8 }} }},
  {{ source.kind = "STAND_IN", source.stand_in = "SEAICE1", textures.set = "MESH" }},
]
"""


@pytest.fixture
def plan(tmp_path):
    (tmp_path / "own").mkdir()

    def read(*names: str, content: bytes = b"x", header: str = 'files = "own"'):
        for name in names:
            (tmp_path / "own" / name).write_bytes(content)
        (tmp_path / "plan.toml").write_text(CASES.format(header=header))
        return read_plan(tmp_path / "plan.toml")

    return read


def test_without_own_files_all_are_stand_ins_and_named(plan):
    made = plan(header="")
    texture, _, mesh = made.pairs()
    assert (texture.settings.textures.set, mesh.settings.source.kind) == ("STAND_IN", "STAND_IN")
    (sentence,) = made.describe_stand_ins()
    assert sentence.startswith(
        "3 of the pairs show stand-ins, made by code in place of files of the GUISS paper: "
        "2 textures (firn, ground_snow) and 1 meshes (seaice1)"
    )
    assert len({pair.id for pair in made.pairs()}) == 3


@pytest.mark.parametrize("name", ["ground_snow", "texture_07", "Ground_Snow_seylmwd", "GROUND_SNOW"])
def test_an_image_replaces_a_texture_with_the_maps_that_are_there(plan, tmp_path, name):
    before = [pair.id for pair in plan(header="").pairs()]
    made = plan(f"{name}.jpg", f"{name}_normal.png")
    texture, firn, mesh = made.pairs()
    own = texture.settings.textures
    assert (own.set, own.width_m) == ("OWN", 2.0)
    assert own.albedo_file == str(tmp_path / "own" / f"{name}.jpg")
    assert own.normal_file == str(tmp_path / "own" / f"{name}_normal.png")
    assert own.roughness_file == own.height_file == own.transmission_file == ""
    assert [firn.id, mesh.id] == before[1:]  # what is not replaced stays as it is
    assert texture.id != before[0]
    stand_ins, own_files = made.describe_stand_ins()
    assert stand_ins.startswith("2 of the pairs show stand-ins")
    assert own_files == (f"2 of your own files in {tmp_path / 'own'} replace stand-ins: {name}.jpg, {name}_normal.png.")


def test_a_mesh_without_images_shows_plain_ice(plan, tmp_path):
    made = plan("seaice1.obj", content=b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    settings = made.pairs()[2].settings
    assert (settings.source.kind, settings.source.file) == ("MESH", str(tmp_path / "own" / "seaice1.obj"))
    assert settings.textures.set == "NONE"


def test_a_mesh_with_an_image_shows_it(plan, tmp_path):
    (tmp_path / "own" / "seaice1.jpg").write_bytes(b"x")
    made = plan("seaice1.ply", content=b"ply\nformat ascii 1.0\ncomment TextureFile seaice1.jpg\nend_header\n")
    settings = made.pairs()[2].settings
    assert (settings.source.kind, settings.textures.set) == ("MESH", "MESH")


def test_two_files_of_one_name_are_refused(plan):
    with pytest.raises(IcyMoonError, match=r"plan.toml, line \d+: .*firn.jpg and firn.png both replace .*; keep one"):
        plan("firn.jpg", "firn.png").pairs()


def test_other_files_and_a_missing_folder_change_nothing(plan):
    before = [pair.id for pair in plan(header="").pairs()]
    assert [pair.id for pair in plan("firn.txt", "firnish.png", "firn_ao.png").pairs()] == before
    assert [pair.id for pair in plan(header='files = "nowhere"').pairs()] == before


def test_images_that_were_stated_for_another_set_are_not_mixed_in(tmp_path):
    shown = {"set": "STAND_IN", "stand_in": "POWDER_SNOW", "roughness_file": "old.png"}
    own = replace_stand_ins(merged(defaults(), {"textures": shown}), {"powder_snow": [tmp_path / "powder_snow.png"]})
    assert own["textures"]["albedo_file"] == str(tmp_path / "powder_snow.png")
    assert own["textures"]["roughness_file"] == ""
