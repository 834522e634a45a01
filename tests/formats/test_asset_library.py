"""The folder of an asset library: what is written, replaced and removed, and what is left alone."""

from __future__ import annotations

import json
import uuid
from pathlib import Path

import pytest
from icymoon.formats import asset_library
from icymoon.support.errors import IcyMoonError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "assets"


def install(tmp_path: Path, folder: Path, *names: str, content: str = "asset") -> None:
    made = tmp_path / f"made {content}"
    for name in names:
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        (made / name).write_text(content)
    asset_library.install_library(made, folder)


def files_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def list_in_record(folder: Path, *names: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / asset_library.RECORD_FILE).write_text(json.dumps({"made_with": "0.1.0", "files": list(names)}))


def test_blender_reads_the_catalogs():
    lines = [line for line in asset_library.make_catalogs_text().splitlines() if line and not line.startswith("#")]
    assert lines[0] == "VERSION 1"
    entries = [line.split(":") for line in lines[1:]]
    assert [path for _, path, _ in entries] == [
        "Icy Moon",
        "Icy Moon/Scenes",
        "Icy Moon/Surfaces",
        "Icy Moon/Rigs",
        "Icy Moon/Lights",
        "Icy Moon/Skies",
    ]
    assert [asset_library.catalog_id(kind) for kind in ("gallery", "surfaces", "rigs", "bodies", "skies")] == [
        str(uuid.UUID(number)) for number, *_ in entries[1:]
    ]


def test_a_second_library_replaces_the_first_and_what_is_gone_from_it(tmp_path, folder):
    install(tmp_path, folder, "scenes/one.blend", "rigs/old.blend")
    install(tmp_path, folder, "scenes/one.blend", "rigs/new.blend", content="newer")
    assert files_in(folder) == {
        "scenes/one.blend",
        "rigs/new.blend",
        asset_library.RECORD_FILE,
        "blender_assets.cats.txt",
    }
    assert (folder / "scenes" / "one.blend").read_text() == "newer"
    assert asset_library.has_library(folder)


def test_files_of_the_user_are_left_alone(tmp_path, folder):
    install(tmp_path, folder, "scenes/one.blend", "rigs/one.blend")
    own = folder / "scenes" / "mine.blend"
    own.write_text("mine")
    install(tmp_path, folder, "scenes/two.blend", content="newer")
    assert own.read_text() == "mine"
    assert asset_library.uninstall_library(folder) == [own]
    assert files_in(folder) == {"scenes/mine.blend"}
    assert not asset_library.has_library(folder)
    own.unlink()
    assert asset_library.uninstall_library(folder) == []
    assert not folder.exists()


@pytest.mark.parametrize(
    "name",
    [
        "../precious.blend",
        "scenes/../../precious.blend",
        "/precious.blend",
        "scenes/precious.txt",
        "other/precious.blend",
        "scenes/a\n.blend",
    ],
)
def test_a_record_that_names_other_files_removes_nothing(tmp_path, folder, name):
    install(tmp_path, folder, "scenes/one.blend")
    precious = tmp_path / "precious.blend"
    precious.write_text("precious")
    list_in_record(folder, "scenes/one.blend", name)
    for act in (lambda: asset_library.uninstall_library(folder), lambda: install(tmp_path, folder, "scenes/two.blend")):
        with pytest.raises(IcyMoonError, match="is not an asset; delete the folder by hand"):
            act()
    assert precious.is_file()
    assert (folder / "scenes" / "one.blend").is_file()


@pytest.mark.parametrize("link", ["", "scenes"])
def test_links_are_not_followed(tmp_path, folder, link):
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "scenes").mkdir(parents=True)
    (elsewhere / "one.blend").write_text("precious")
    (elsewhere / "scenes" / "one.blend").write_text("precious")
    if link:
        folder.mkdir()
    (folder / link).symlink_to(elsewhere)
    list_in_record(folder, "scenes/one.blend")
    for act in (lambda: asset_library.uninstall_library(folder), lambda: install(tmp_path, folder, "scenes/one.blend")):
        with pytest.raises(IcyMoonError, match="is a link"):
            act()
    assert (elsewhere / "one.blend").read_text() == (elsewhere / "scenes" / "one.blend").read_text() == "precious"


@pytest.mark.parametrize("text", ["", "[]", '{"files": []}', '{"made_with": "1", "files": [1]}', "\0"])
def test_a_broken_record_is_reported(folder, text):
    folder.mkdir()
    (folder / asset_library.RECORD_FILE).write_text(text)
    with pytest.raises(IcyMoonError, match="delete the folder by hand"):
        asset_library.uninstall_library(folder)


def test_a_full_disk_leaves_the_library_that_was_there(tmp_path, folder, monkeypatch):
    install(tmp_path, folder, "scenes/one.blend", "scenes/two.blend")

    def refuse(source, target):
        target.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(asset_library.shutil, "copyfile", refuse)
    with pytest.raises(IcyMoonError, match="the disk is full"):
        install(tmp_path, folder, "scenes/one.blend", "scenes/three.blend", content="newer")
    assert {path.read_text() for path in asset_library.find_files(folder)} == {"asset"}
    assert files_in(folder) == {
        "scenes/one.blend",
        "scenes/two.blend",
        asset_library.RECORD_FILE,
        "blender_assets.cats.txt",
    }
