"""Stand-ins as files: whole or not there, whatever happens while they are written, and made again where changed."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile_arrays import put
from icymoon.formats import ply
from icymoon.formats.mesh_images import choose_images
from icymoon.paper_stand_ins import cached_files
from icymoon.paper_stand_ins.reconstructions import Reconstruction
from icymoon.paper_stand_ins.shown_items import RECIPE_NUMBER
from icymoon.paper_stand_ins.texture_maps import make_maps
from icymoon.settings.topics.stand_ins import find_mesh_item, find_texture_item
from icymoon.support import cache_folder, files
from icymoon.support.errors import IcyMoonError


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache_folder.FOLDER_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(cached_files, "make_maps", lambda key: make_maps(key, size=64))
    return tmp_path / "cache" / "stand_ins" / str(RECIPE_NUMBER)


def test_a_texture_is_made_once_and_made_again_if_a_file_was_changed(folder):
    found = cached_files.find_texture_files("GROUND_SNOW")
    assert set(found) == {"albedo", "roughness", "normal", "transmission"}
    assert {path.parent for path in found.values()} == {folder / "ground_snow"}
    assert (folder / "ground_snow" / "ground_snow_height.png").is_file()
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in (folder / "ground_snow").iterdir()}
    assert cached_files.find_texture_files("GROUND_SNOW") == found
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in (folder / "ground_snow").iterdir()} == before
    for spoil in (lambda path: path.write_bytes(path.read_bytes()[:100]), lambda path: path.unlink()):
        spoil(found["normal"])
        cached_files.find_texture_files("GROUND_SNOW")
        assert {path: path.read_bytes() for path in before} == {path: data for path, (data, _) in before.items()}


def test_the_height_image_has_the_stated_relief():
    folder = cached_files.make_files(find_texture_item("SUNCUPS"))
    height_m = make_maps("SUNCUPS", size=64).height_m
    assert cached_files.read_relief_m(folder) == pytest.approx(np.ptp(height_m))


def test_a_photograph_shows_one_image_and_has_the_others_beside_it(folder):
    assert set(cached_files.find_texture_files("CRACKED_ICE")) == {"albedo"}
    assert {path.stem.removeprefix("cracked_ice_") for path in (folder / "cracked_ice").glob("*.png")} == {
        "albedo",
        "roughness",
        "normal",
        "height",
    }


def test_a_mesh_file_says_what_it_is_and_names_its_image(folder, monkeypatch):
    positions, uv = np.arange(12.0).reshape(4, 3), np.linspace(0, 1, 8).reshape(4, 2)
    monkeypatch.setattr(
        cached_files,
        "reconstruct",
        lambda key: Reconstruction(positions, np.array([[0, 1, 2], [0, 2, 3]]), uv, np.full((8, 8, 3), 0.5)),
    )
    path = cached_files.find_mesh_file("SEAICE1")
    assert path == folder / "seaice1" / "seaice1.ply"
    assert b"comment stand-in for seaice1" in path.read_bytes()
    assert ply.read_vertices(path) == pytest.approx(positions)
    assert ply.read_properties(path, "s", "t") == pytest.approx(uv)
    assert choose_images(path)["albedo"].file == folder / "seaice1" / "seaice1.png"


def test_what_a_killed_process_leaves_is_not_taken(tmp_path):
    """Killed at a moment of its work that differs from try to try, a process leaves whole files, parts, or nothing; the
    next one returns whole files only."""
    code = (
        "import sys; from icymoon.paper_stand_ins import cached_files, shown_items, texture_maps;"
        "make = texture_maps.make_maps; cached_files.make_maps = lambda key: make(key, size=64);"
        "print('go', flush=True); cached_files.make_files(shown_items.find_texture_item('FIRN'))"
    )
    whole = cached_files.make_files(find_texture_item("FIRN"), tmp_path / "whole")
    known = {path.name: path.read_bytes() for path in whole.iterdir()}
    folder = cached_files.find_folder(find_texture_item("FIRN"))
    for delay in (0.0, 0.02, 0.05, 0.1):
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
        assert process.stdout.readline() == b"go\n"
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        process.wait()
        found = cached_files.find_texture_files("FIRN")
        assert {path.name: path.read_bytes() for path in found.values()}.items() <= known.items()
        assert (folder / "made.json").read_bytes() == known["made.json"]
        for path in folder.iterdir():
            path.unlink()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda record: record.write_bytes(b""),
        lambda record: record.write_bytes(b"[" * 50_000),
        lambda record: record.write_text("{}"),
        lambda record: put(record, "pipe"),
        lambda record: put(record, "device"),
        lambda record: change(record, sha256={}),
        lambda record: change(record, recipe=RECIPE_NUMBER + 1),
        lambda record: change(record, height_m=None),
        lambda record: change(record, sha256={"../x": "0" * 64}),
        lambda record: change(record, sha256={"made.json": "0" * 64}),
        lambda record: change(record, recipe=10**400),
        lambda record: forget(record, "firn_normal.png"),
        lambda record: put(record.with_name("firn_normal.png"), "pipe"),
        lambda record: put(record.with_name("firn_normal.png"), "device"),
    ],
)
def test_a_record_or_an_image_that_is_none_is_made_again(folder, spoil):
    """In bounded time: the checksum of a pipe or a device would never be known."""
    cached_files.find_texture_files("FIRN")
    record = folder / "firn" / "made.json"
    before = {path.name: path.read_bytes() for path in record.parent.iterdir()}
    spoil(record)
    cached_files.find_texture_files("FIRN")
    assert {path.name: path.read_bytes() for path in record.parent.iterdir()} == before


def change(record: Path, **entries: Any) -> None:
    record.write_text(json.dumps(json.loads(record.read_text()) | entries))


def forget(record: Path, name: str) -> None:
    """As a record of fewer images, one of which is gone."""
    known = json.loads(record.read_text())["sha256"]
    del known[name]
    (record.parent / name).unlink()
    change(record, sha256=known)


@pytest.mark.parametrize("done", [0, 2])
def test_an_interruption_between_the_files_leaves_no_record(folder, monkeypatch, done):
    writes = []

    def write(path, how):
        writes.append(path)
        if len(writes) > done:
            raise KeyboardInterrupt
        files.write_bytes(path, how)

    monkeypatch.setattr(cached_files, "write_bytes", write)
    with pytest.raises(KeyboardInterrupt):
        cached_files.find_texture_files("FIRN")
    assert not (folder / "firn" / "made.json").exists()
    assert not list((folder / "firn").glob("*.part"))
    monkeypatch.undo()


def test_an_old_part_is_removed_and_a_new_one_is_somebody_elses(folder):
    (folder / "firn").mkdir(parents=True)
    old, new = folder / "firn" / "a.png.host-1-1.part", folder / "firn" / "b.png.host-2-1.part"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1.0, 1.0))
    cached_files.find_texture_files("FIRN")
    assert not old.exists()
    assert new.exists()


def test_a_folder_that_may_not_be_written_to_is_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv(cache_folder.FOLDER_VARIABLE, str(tmp_path / "file"))
    with pytest.raises(IcyMoonError) as error:
        cached_files.find_texture_files("FIRN")
    assert re.fullmatch(r"Cannot write to \S+: a part of this path is a file.*ICYMOON_CACHE.*\)\.", str(error.value))


def test_a_full_disk_is_one_sentence(folder, monkeypatch):
    def write_bytes(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    with pytest.raises(IcyMoonError, match=r"^Cannot write \S+: the disk is full; free some space.*ICYMOON_CACHE.*\.$"):
        cached_files.find_texture_files("FIRN")
    assert not list((folder / "firn").iterdir())


def test_only_known_names_are_paths():
    for make in (find_texture_item, find_mesh_item):
        with pytest.raises(KeyError):
            make("../../x")
