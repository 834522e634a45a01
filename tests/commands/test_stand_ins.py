"""The list of stand-ins, their files in a folder of the user, and where a pair says that it shows one."""

from __future__ import annotations

import pytest
from icymoon.commands import cli
from icymoon.commands.sources import STAND_IN, find_origins
from icymoon.paper_stand_ins import cached_files
from icymoon.paper_stand_ins.texture_maps import make_maps
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.topics.stand_ins import MESHES, TEXTURES


def test_all_are_listed_with_the_papers_names(capsys):
    assert cli.main(["stand-ins"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 25
    names = [(item.stem, item.paper) for item in TEXTURES] + [(item.stem, item.paper) for item in MESHES]
    for line, (stem, paper) in zip(lines, names, strict=True):
        assert line.startswith(stem)
        assert paper in line


def test_one_is_written_to_a_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(cached_files, "make_maps", lambda key: make_maps(key, size=64))
    assert cli.main(["stand-ins", "FIRN", "--out", str(tmp_path)]) == 0
    assert {path.name for path in (tmp_path / "firn").iterdir()} == {
        "firn_albedo.png",
        "firn_roughness.png",
        "firn_normal.png",
        "firn_height.png",
        "made.json",
    }
    assert capsys.readouterr().out.startswith(f"{tmp_path / 'firn'}: 0.8 m wide, 1024 pixels, height image of ")


def test_a_misspelt_name_is_one_sentence(capsys):
    assert cli.main(["stand-ins", "powder_sno"]) == 1
    assert "There is no stand-in 'powder_sno'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("shown", "name", "paper"),
    [
        ({"textures": {"set": "STAND_IN", "stand_in": "FIRN"}}, "textures.stand_in", "Snow009B"),
        ({"source": {"kind": "STAND_IN", "stand_in": "SEAICE1"}}, "source.stand_in", "seaice1"),
    ],
)
def test_sources_name_a_stand_in(shown, name, paper):
    settings = merged(defaults(), check(shown, "test"))
    found = {origin.name: origin for origin in find_origins(settings)}
    assert found[name].preset == STAND_IN
    assert f"made by code, in place of {paper} of the GUISS paper" in found[name].source
    assert name not in {origin.name for origin in find_origins(defaults()) if origin.preset == STAND_IN}
