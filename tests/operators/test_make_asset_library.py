"""Make Asset Library and Remove Asset Library: the folder, and Blender's list of asset libraries."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
from icymoon.formats import asset_library
from icymoon.formats.asset_library import has_library
from icymoon.operators import make_asset_library, preferences
from icymoon.panels import menu

#: Stands in for the Blender that makes the library: installs a file and reports it, as ``render.asset_worker`` does.
WORKER = """
import json, sys
from collections.abc import Iterator
from pathlib import Path
from icymoon.formats.asset_library import install_library
made = Path(sys.argv[1]).parent / "made"
(made / "rigs").mkdir(parents=True, exist_ok=True)
(made / "rigs" / "guiss.blend").touch()
print(json.dumps({"type": "done", "assets": len(install_library(made, Path(sys.argv[1])))}))
"""


def libraries() -> list[tuple[str, str]]:
    return [(each.name, each.path) for each in bpy.context.preferences.filepaths.asset_libraries]


@pytest.fixture
def folder(monkeypatch, tmp_path) -> Iterator[Path]:
    """The folder of the asset library of an installed extension."""
    monkeypatch.setattr(preferences, "find_extension_folder", lambda create=True: tmp_path)
    monkeypatch.setattr(
        make_asset_library, "blender_command", lambda program, verb, *words: [sys.executable, "-c", WORKER, *words]
    )
    before = libraries()
    yield tmp_path / "assets"
    known = bpy.context.preferences.filepaths.asset_libraries
    for each in [each for each in known if (each.name, each.path) not in before]:
        known.remove(each)


def test_the_library_is_listed_once_and_goes_again(folder):
    before = libraries()
    assert not bpy.ops.icymoon.remove_asset_library.poll()
    for _ in range(2):
        assert bpy.ops.icymoon.make_asset_library() == {"FINISHED"}
        assert libraries() == [*before, ("Icy Moon", str(folder))]
    assert preferences.find_asset_libraries()[0].import_method == "APPEND"
    assert bpy.context.preferences.is_dirty, "Blender saves its preferences only if they are marked as changed"
    assert bpy.ops.icymoon.remove_asset_library() == {"FINISHED"}
    assert libraries() == before
    assert not folder.exists()


def test_a_library_of_the_user_with_the_same_name_stays(folder, tmp_path):
    known = bpy.context.preferences.filepaths.asset_libraries
    known.new(name="Icy Moon", directory=str(tmp_path / "mine"))
    before = libraries()
    bpy.ops.icymoon.make_asset_library()
    assert len(libraries()) == len(before) + 1
    bpy.ops.icymoon.remove_asset_library()
    assert libraries() == before


def test_a_library_that_the_user_renamed_is_not_listed_again(folder):
    bpy.ops.icymoon.make_asset_library()
    preferences.find_asset_libraries()[0].name = "Ice"
    listed = libraries()
    bpy.ops.icymoon.make_asset_library()
    assert libraries() == listed


def test_a_failed_library_is_not_listed(folder, monkeypatch):
    before = libraries()
    monkeypatch.setattr(make_asset_library, "blender_command", lambda *_: [sys.executable, "-c", "print('no memory')"])
    with pytest.raises(RuntimeError, match=r"Make Asset Library ended without a result .*: no memory"):
        bpy.ops.icymoon.make_asset_library()
    assert libraries() == before
    assert not preferences.has_assets()


def test_a_folder_with_files_of_the_user_stays_listed(folder):
    bpy.ops.icymoon.make_asset_library()
    (folder / "mine.blend").touch()
    assert bpy.ops.icymoon.remove_asset_library() == {"FINISHED"}
    assert [path.name for path in folder.iterdir()] == ["mine.blend"]
    assert preferences.find_asset_libraries()


def test_a_record_that_is_not_ours_is_reported(folder):
    bpy.ops.icymoon.make_asset_library()
    (folder / asset_library.RECORD_FILE).write_text('{"made_with": "0", "files": ["../made/rigs/guiss.blend"]}')
    with pytest.raises(RuntimeError, match="is not an asset"):
        bpy.ops.icymoon.remove_asset_library()
    assert (folder.parent / "made" / "rigs" / "guiss.blend").is_file()


def test_without_an_extension_there_is_one_sentence(monkeypatch):
    with pytest.raises(RuntimeError, match="does not run as an installed extension"):
        bpy.ops.icymoon.make_asset_library()


def test_the_library_is_listed_while_the_extension_is_enabled(folder):
    before = libraries()
    bpy.ops.icymoon.make_asset_library()
    made = libraries()
    preferences.unregister()
    assert (libraries(), has_library(folder)) == (before, True)
    preferences.register()
    assert libraries() == made
    bpy.ops.icymoon.remove_asset_library()
    preferences.unregister()
    preferences.register()
    assert libraries() == before


def test_the_asset_browser_offers_to_make_it_until_it_is_there(folder):
    drawn: list[str] = []
    layout = SimpleNamespace(operator=lambda name, **_: drawn.append(name))
    menu._draw_assets(SimpleNamespace(layout=layout), bpy.context)
    assert drawn == ["icymoon.make_asset_library"]
    bpy.ops.icymoon.make_asset_library()
    menu._draw_assets(SimpleNamespace(layout=layout), bpy.context)
    assert len(drawn) == 1
