"""The settings of a scene: dictionaries at run time, known to mypy, and how a setting is declared."""

from __future__ import annotations

import copy
import json
import keyword
import pickle
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Literal

import icymoon
import pytest
from icymoon.settings import description, preset_files
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.declaration import Parts, Table, choice
from icymoon.settings.topics.ground import TerrainLayer, TerrainSettings
from icymoon.settings.topics.light import LightSettings
from icymoon.settings.topics.scene import ENTRIES, TABLES, Settings, typed
from icymoon.settings.topics.surfaces import RockSurfaceSettings, SurfaceSettings

LAYERED = {"terrain": {"layers": [{"amplitude_m": 0.5}]}}


def test_a_choice_whose_type_and_choices_differ_is_found():
    with pytest.raises(ValueError, match=r"Odd\.kind: its type and its choices differ"):
        type(
            "Odd",
            (Table,),
            {
                "__annotations__": {"kind": Literal["A", "B"]},
                "kind": choice("Kind", "A", "", "run", ("B", "", ""), ("A", "", "")),
            },
        )


def test_a_type_has_the_same_settings_under_another_name():
    assert RockSurfaceSettings.fields == SurfaceSettings.fields
    assert (RockSurfaceSettings.topic.key, SurfaceSettings.topic.key) == ("rock_surface", "surface")
    assert RockSurfaceSettings.topic.label != SurfaceSettings.topic.label


def test_sections_come_with_the_last_for_few_scenes_and_ticks_in_headers():
    light = LightSettings.topic
    assert [section.key for section in light.sections] == ["planet", "stars", "lamps", "balance", "advanced"]
    assert "planet" not in light.keys_in(light.sections[0])
    assert "planet_albedo" in light.keys_in(light.sections[0])
    assert light.main_keys[0] == "directions_from"


def test_no_setting_has_a_name_that_a_dictionary_uses_itself():
    keys = {*TOPICS, *(part.key for topic in TOPICS.values() for s in topic.settings for part in (s, *s.entries))}
    assert not {key for key in keys if hasattr(dict, key) or keyword.iskeyword(key) or not key.isidentifier()}


def is_typed(settings: Settings) -> bool:
    """Whether a description, its tables and the entries of their lists are of their types."""
    return type(settings) is Settings and all(
        type(values) is TABLES[topic]
        and all(type(entry) is kind for key, kind in ENTRIES.get(topic, {}).items() for entry in values.get(key, []))
        for topic, values in settings.items()
    )


@pytest.mark.parametrize(
    "made",
    [
        lambda whole: whole,
        lambda whole: description.merged(whole, {"rig": {"width_px": 64}}),
        lambda whole: description.merged({"rig": {"width_px": 64}}, json.loads(json.dumps(whole))),
        lambda whole: description.check(json.loads(json.dumps(whole)), "a test"),
        lambda whole: description.restore_settings(json.loads(json.dumps(whole)), "a test"),
        lambda whole: description.changed(whole, description.defaults()),
        lambda whole: preset_files.load_preset("europa_rough_ice"),
        lambda whole: description.override("rig.width_px=64"),
        lambda whole: typed(json.loads(json.dumps(whole))),
        copy.copy,
        copy.deepcopy,
        lambda whole: whole.copy(),
        lambda whole: whole | {"rig": whole.rig | {"x_m": 1.0}},
        lambda whole: pickle.loads(pickle.dumps(whole)),  # noqa: S301  our own bytes
    ],
)
def test_what_comes_out_is_typed(made):
    whole = description.merged(description.defaults(), description.check(LAYERED, "a test"))
    assert is_typed(whole)
    assert is_typed(made(whole))


def test_a_key_is_read_and_set_as_an_attribute():
    settings = description.merged(description.defaults(), description.check(LAYERED, "a test"))
    settings.terrain.hurst = 0.5
    assert settings.terrain.hurst == settings.terrain.hurst == 0.5
    assert settings.terrain.layers[0].amplitude_m == 0.5
    assert settings == json.loads(json.dumps(settings))
    assert not hasattr(settings.terrain, "hurzt")
    with pytest.raises(AttributeError, match="TerrainSettings has no hurst"):
        _ = TerrainSettings().hurst


def test_to_merge_changes_nothing_that_was_merged():
    part: Parts = {"terrain": {"layers": [TerrainLayer(amplitude_m=1.0)]}}
    merged = description.merged(part)
    merged.terrain.layers[0].amplitude_m = 2.0
    merged.terrain.hurst = 0.9
    assert part == {"terrain": {"layers": [{"amplitude_m": 1.0}]}}


#: A line of code, and whether it is right.
LINES = {
    "settings.terrain.hurst + 1.0": True,
    "settings.terrain.hurzt": False,
    "settings.terain": False,
    'settings.mesh.kind == "GRID"': True,
    'settings.mesh.kind = "GRID"': True,
    'settings.mesh.kind = "GIRD"': False,
    "settings.rig.width_px = 64": True,
    "settings.rig.width_px = 0.5": False,
    "settings.rig.widht_px = 64": False,
    "settings.terrain.layers[0].basis": True,
    "settings.terrain.layers[0].base": False,
    'settings["terrain"]["hurst"]': True,
    "settings.rock_surface.albedo": True,
    "settings.rock_surface.copy().albedo": True,
    "settings.rock_surface.copy(1).albedo": False,
}
#: A file of each kind that mypy checks, and the line that its function begins with. Only a test needs no annotations.
PLACES = {
    "render/used.py": "def use(folder: str) -> None:",
    "benchmarks/used.py": "def use(folder: str) -> None:",
    "tests/test_used.py": "def test_use(tmp_path):",
    "tests/stereo/test_used.py": "def test_use(tmp_path):",
    "tests/support/shared.py": "def use(folder: str) -> None:",
    "docs/make/drawn.py": "def use(folder: str) -> None:",
}


@pytest.fixture(scope="module")
def complaints(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """What mypy, as this project configures it, has against each of ``LINES`` in each of ``PLACES``; empty for
    nothing."""
    pytest.importorskip("mypy")
    folder, source = tmp_path_factory.mktemp("checkout"), Path(icymoon.__file__).parent
    shutil.copyfile(source / "pyproject.toml", folder / "pyproject.toml")
    shutil.copytree(source / "settings" / "topics", folder / "settings" / "topics")
    (folder / "settings" / "__init__.py").touch()
    (folder / "__init__.py").touch()
    (folder / ".types").mkdir()
    (folder / ".types" / "icymoon").symlink_to("..", target_is_directory=True)
    for place, begin in PLACES.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        head = ["from icymoon.settings.topics.scene import Settings", begin, "    settings = Settings()"]
        (folder / place).write_text("\n".join([*head, *(f"    {line}" for line in LINES)]), encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-m", "mypy"],
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=300,
        check=False,
    )
    said = ended.stdout.splitlines()
    assert said[-1].startswith("Found"), ended.stdout + ended.stderr
    return {
        place: [
            next((each for each in said if f"{place}:{number}:" in each), "") for number, _ in enumerate(LINES, start=4)
        ]
        for place in PLACES
    }


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("place", PLACES)
def test_mypy_finds_a_misspelt_key_and_a_wrong_value(complaints, place):
    assert [not said for said in complaints[place]] == list(LINES.values()), complaints[place]
