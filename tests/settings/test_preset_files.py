"""Presets and settings files: any encoding, strict reading, a source for every number."""

from __future__ import annotations

import codecs

import pytest
from icymoon.settings import preset_files, toml_text
from icymoon.support.errors import IcyMoonError


#: As editors and PowerShell's > write text: the encodings that Python knows by these names put a mark first.
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_a_file_is_read_whatever_wrote_it(tmp_path, encoding, newline):
    file = tmp_path / "scene.toml"
    text = '# 5 µm of snow\n[preset]\ntitle = "Größe Ω 月"\n[terrain]\nsize_m = 12.0\n'
    file.write_bytes(text.replace("\n", newline).encode(encoding))
    assert preset_files.load(file) == {"terrain": {"size_m": 12.0}}
    assert preset_files.read_header(file, "scene")[0] == "Größe Ω 月"
    assert toml_text.read_toml_and_text(file)[1] == text


def test_big_endian_text_is_read_too(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_bytes(codecs.BOM_UTF16_BE + "[terrain]\nsize_m = 12.0\n".encode("utf-16-be"))
    assert preset_files.load(file) == {"terrain": {"size_m": 12.0}}


@pytest.mark.parametrize(
    "content", ["[terrain]  # 5 µm".encode("cp1252"), codecs.BOM_UTF16_LE + b"[", codecs.BOM_UTF8 + b"\xff"]
)
def test_a_file_that_is_not_text_shows_how_to_save_it(tmp_path, content):
    file = tmp_path / "scene.toml"
    file.write_bytes(content)
    with pytest.raises(IcyMoonError, match=r"scene\.toml: is not valid TOML \(byte \d+ is not text; save it as UTF-8"):
        preset_files.load(file)


def test_a_file_with_a_mistake_is_named_with_the_mistake(tmp_path):
    for content, word in (
        ("[terrain]\nsize_m = ", "TOML"),
        ("[terrain]\nsizes = 1", "terrain.sizes"),
        ("terrain = 3", "[terrain]"),
        ("[preset]\ntitel = 'x'", "title"),
    ):
        file = tmp_path / "scene.toml"
        file.write_text(content)
        with pytest.raises(IcyMoonError, match=r"scene\.toml") as caught:
            preset_files.load(file)
        assert word in str(caught.value)
    with pytest.raises(IcyMoonError, match="cannot be read"):
        preset_files.load(tmp_path / "absent.toml")


def test_presets_load_and_every_number_has_a_source():
    assert {"scenes/enceladus_fresh_snow", "scenes/europa_rough_ice"} <= set(preset_files.preset_names())
    for name in preset_files.preset_names():
        preset_files.load_preset(name)
        raw = toml_text.read_toml(preset_files.find_preset(name))
        stated = {
            f"{topic}.{key}"
            for topic, values in raw.items()
            if topic not in ("preset", "sources", "measured")
            for key in values
        }
        assert stated == set(raw["sources"]), name
        assert all(preset_files.read_preset_header(name)), name


def test_an_unknown_preset_names_the_nearest():
    with pytest.raises(IcyMoonError, match="europa_rough_ice"):
        preset_files.find_preset("scenes/europa_ruff_ice")
    with pytest.raises(IcyMoonError):
        preset_files.find_preset("../pyproject")
