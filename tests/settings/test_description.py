"""Settings: one spelling, strict loading, errors a person can act on."""

from __future__ import annotations

import codecs
import hashlib
import json
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.errors import IcyMoonError
from icymoon.settings import description as settings
from icymoon.settings import pair_ids
from icymoon.settings.table import EFFECTS, TOPICS, all_settings
from olddata import upgrade_all


def _values(setting):
    if setting.kind == "bool":
        return st.booleans()
    if setting.kind == "choice":
        return st.sampled_from([c[0] for c in setting.choices])
    if setting.kind == "text":
        return st.text(max_size=30)
    if setting.kind == "list":
        return st.lists(st.fixed_dictionaries({s.key: _values(s) for s in setting.entries}), max_size=2)
    if setting.kind == "int":
        return st.integers(int(setting.minimum), int(setting.maximum))
    return st.floats(setting.minimum, setting.maximum)


_descriptions = st.fixed_dictionaries({
    topic.key: st.fixed_dictionaries({s.key: _values(s) for s in topic.settings}) for topic in TOPICS.values()})


@given(_descriptions)
def test_toml_gives_back_what_was_written(description):
    canonical = settings.check(description, "test")
    assert settings.check(tomllib.loads(settings.to_toml(canonical)), "test") == canonical


@given(_descriptions)
def test_canonical_form_is_single_precision_and_stable(description):
    once = settings.check(description, "test")
    assert settings.check(once, "test") == once
    for topic, setting in all_settings():
        if setting.kind == "float":
            assert once[topic][setting.key] == pytest.approx(description[topic][setting.key], rel=1.2e-7, abs=1e-44)


@pytest.mark.parametrize("bound", ["minimum", "maximum"])
def test_a_limit_may_be_stated_as_single_precision_has_it(bound):
    """What Blender says of a property that is at its end is not beyond it."""
    for topic, setting in all_settings():
        if setting.kind == "float":
            value = getattr(setting, bound)
            in_blender = settings.check({topic: {setting.key: float(np.float32(value))}}, "test")
            assert in_blender == settings.check({topic: {setting.key: value}}, "test")


@pytest.mark.parametrize("value", ["1e39", "-1e39", "nan", "inf", "1e999", "1" + "0" * 400, "-1" + "0" * 400, "0.0099"])
@pytest.mark.parametrize("key", ["size_m", "resolution"])
@pytest.mark.filterwarnings("error")
def test_a_number_that_nothing_holds_is_refused_by_name(key, value):
    with pytest.raises(IcyMoonError, match=rf"terrain\.{key} "):
        settings.override(f"terrain.{key}={value}")


@pytest.mark.parametrize("text", ["terrain.size_m = 1" + "0" * 5000, "a = " + "[" * 10_000], ids=["digits", "depth"])
def test_a_file_that_no_parser_takes_is_refused_by_name(tmp_path, text):
    file = tmp_path / "scene.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"scene\.toml: is not valid TOML"):
        settings.load(file)
    with pytest.raises(IcyMoonError, match=r"--set"):
        settings.override(text.replace(" ", "").replace("a=", "terrain.size_m="))


#: As editors and PowerShell's > write text: the encodings that Python knows by these names put a mark first.
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_a_file_is_read_whatever_wrote_it(tmp_path, encoding, newline):
    file = tmp_path / "scene.toml"
    text = '# 5 µm of snow\n[preset]\ntitle = "Größe Ω 月"\n[terrain]\nsize_m = 12.0\n'
    file.write_bytes(text.replace("\n", newline).encode(encoding))
    assert settings.load(file) == {"terrain": {"size_m": 12.0}}
    assert settings.header_of(file, "scene")[0] == "Größe Ω 月"
    assert settings.toml_and_text(file)[1] == text


def test_big_endian_text_is_read_too(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_bytes(codecs.BOM_UTF16_BE + "[terrain]\nsize_m = 12.0\n".encode("utf-16-be"))
    assert settings.load(file) == {"terrain": {"size_m": 12.0}}


@pytest.mark.parametrize("content", ["[terrain]  # 5 µm".encode("cp1252"), codecs.BOM_UTF16_LE + b"[",
                                     codecs.BOM_UTF8 + b"\xff"])
def test_a_file_that_is_no_text_says_how_to_save_it(tmp_path, content):
    file = tmp_path / "scene.toml"
    file.write_bytes(content)
    with pytest.raises(IcyMoonError, match=r"scene\.toml: is not valid TOML \(byte \d+ is no text; save it as UTF-8"):
        settings.load(file)


def test_every_setting_says_what_it_is():
    for topic, setting in all_settings():
        assert len(setting.description) > 15, f"{topic}.{setting.key}"
        assert setting.effect in EFFECTS
        if setting.kind in ("int", "float"):
            low, high = setting.soft or (setting.minimum, setting.maximum)
            assert math.isfinite(setting.minimum)
            assert math.isfinite(setting.maximum)
            assert setting.minimum <= low < high <= setting.maximum, f"{topic}.{setting.key}"
    settings.check(settings.defaults(), "defaults")


@pytest.mark.parametrize(("text", "words"), [
    ("terrain.sizem=3", ("terrain.sizem", "size_m")),
    ("terain.size_m=3", ("terain", "terrain")),
    ("terrain.size_m=-1", ("terrain.size_m", "-1 m", "0.01 to 100000 m")),
    ("terrain.size_m=nan", ("terrain.size_m", "outside")),
    ("terrain.size_m=inf", ("terrain.size_m", "outside")),
    ("terrain.size_m=twenty", ("terrain.size_m", "a number")),
    ("terrain.size_m=true", ("terrain.size_m", "a number")),
    ("rig.width_px=640.5", ("rig.width_px", "a whole number")),
    ("sensor.shot_noise=1", ("sensor.shot_noise", "true or false")),
    ("quality.denoiser=OID", ("quality.denoiser", "OIDN")),
    ("size", ("topic.key=value",)),
])
def test_a_wrong_override_names_the_key_and_the_mend(text, words):
    with pytest.raises(IcyMoonError) as caught:
        settings.override(text)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(("text", "expected"), [
    ("terrain.size_m=30", 30.0), ("rocks.most=3", 3), ("sensor.shot_noise=false", False),
    ("quality.denoiser=OIDN", "OIDN"), ("dataset.methods=bm,sgbm", "bm,sgbm"), ("dataset.folder=/a b/c", "/a b/c"),
])
def test_an_override_reads_its_value_by_the_settings_type(text, expected):
    (value,) = next(iter(settings.override(text).values())).values()
    assert value == expected
    assert type(value) is type(expected)


def test_a_file_with_a_mistake_is_named_with_the_mistake(tmp_path):
    for content, word in (("[terrain]\nsize_m = ", "TOML"), ("[terrain]\nsizes = 1", "terrain.sizes"),
                          ("terrain = 3", "[terrain]"), ("[preset]\ntitel = 'x'", "title")):
        file = tmp_path / "scene.toml"
        file.write_text(content)
        with pytest.raises(IcyMoonError, match=r"scene\.toml") as caught:
            settings.load(file)
        assert word in str(caught.value)
    with pytest.raises(IcyMoonError, match="cannot be read"):
        settings.load(tmp_path / "absent.toml")


def test_presets_load_and_every_number_has_a_source():
    assert {"scenes/enceladus_fresh_snow", "scenes/europa_rough_ice"} <= set(settings.preset_names())
    for name in settings.preset_names():
        settings.load(settings.preset_path(name))
        raw = settings.read_toml(settings.preset_path(name))
        stated = {f"{topic}.{key}" for topic, values in raw.items() if topic not in ("preset", "sources", "measured")
                  for key in values}
        assert stated == set(raw["sources"]), name
        assert all(settings.preset_header(name)), name


def test_an_unknown_preset_names_the_nearest():
    with pytest.raises(IcyMoonError, match="europa_rough_ice"):
        settings.preset_path("scenes/europa_ruff_ice")
    with pytest.raises(IcyMoonError):
        settings.preset_path("../pyproject")


def test_the_digest_counts_what_changes_pixels_and_nothing_else():
    base = settings.defaults()
    for topic, setting in all_settings():
        if setting.kind == "bool":
            other = not setting.default
        elif setting.kind == "choice":
            other = setting.choices[-1][0] if setting.default == setting.choices[0][0] else setting.choices[0][0]
        elif setting.kind == "text":
            other = f"{setting.default}x"
        elif setting.kind == "list":
            other = [{s.key: s.default for s in setting.entries}]
        else:
            other = setting.maximum if setting.default != setting.maximum else setting.minimum
        changed = settings.digest(settings.merged(base, {topic: {setting.key: other}})) != settings.digest(base)
        counts = setting.effect not in ("response", "run") and setting.subtype != "FILE_PATH"
        assert changed == counts, f"{topic}.{setting.key}"
    assert settings.digest(base, "lander") != settings.digest(base)


#: Checksum of what ids are made of since the first version: what pairs are called hangs on every letter and the order.
FIRST = "70cd178c3f77f6c77093317a1089032e8c3a876736ebd893c4ed2f8ff4c3b24f"


def schema_faults() -> list[str]:
    """Where the table of settings and ``settings/pair_ids.json`` do not agree, each with the mend."""
    table = pair_ids.SCHEMA
    first = {table["renamed"].get(name, name): name in table["counted"]
             for name in (*table["counted"], *table["not_counted"])}
    there = {f"{topic}.{setting.key}": setting for topic, setting in all_settings()}
    parts = {f"{name}.{part.key}": part for name, setting in there.items() for part in setting.entries}
    known = {*first, *table["later"], *(f"{name}.{part}" for name, keys in table["entries"].items() for part in keys)}
    return [
        *(f'{name} is new: add it to pair_ids.json under "later", with the value that renders what was rendered before '
          "there was it, and if it is a list its keys under entries." for name in sorted({*there, *parts} - known)),
        *(f'{name} is no setting any more: add it to settings/pair_ids.json under "renamed" or "gone".'
          for name in sorted(known - there.keys() - parts.keys() - table["gone"].keys())),
        *(f"{name} counted in ids: {counted}; its effect may not change that." for name, counted in first.items()
          if name in there and pair_ids.counts(there[name]) != counted),
        *(f"{name}: its value in settings/pair_ids.json is {value!r}, which is not canonical." for name, value in
          table["later"].items() if not _is_canonical(name, {**there, **parts}.get(name), value))]


def _is_canonical(name, setting, value) -> bool:
    return setting is None or settings._checked(setting, value, name, "settings/pair_ids.json", False) == value


def test_every_setting_says_what_was_done_before_there_was_it():
    assert schema_faults() == []


def test_what_ids_are_made_of_has_not_changed_since_the_first_version():
    frozen = json.dumps([pair_ids.SCHEMA["counted"], pair_ids.SCHEMA["not_counted"],
                         pair_ids.SCHEMA["entries"]["terrain.layers"]])
    assert hashlib.sha256(frozen.encode()).hexdigest() == FIRST


def _of_the_first_version(described, extra: str) -> str:
    """The id as version 0.1.0 made it."""
    counted = [[name, described[name.split(".")[0]][name.split(".")[1]]] for name in pair_ids.SCHEMA["counted"]]
    return hashlib.sha256(json.dumps([counted, extra]).encode()).hexdigest()[:12]


@given(_descriptions)
def test_an_id_is_that_of_the_first_version_as_long_as_nothing_later_is_used(description):
    described = settings.check(description, "test")
    with pytest.MonkeyPatch.context() as patch:
        expected = _of_the_first_version(described, "f/2.0 None s")
        assert settings.digest(described, "f/2.0 None s") == expected
        upgrade_all(patch)
        assert schema_faults() == []
        later = settings.restored(described, "pair.json")
        assert settings.digest(later, "f/2.0 None s") == expected
        used = settings.merged(later, {"quality": {"extra_pass": True}})
        also = settings.merged(used, {"rig": {"wobble_deg": 0.1}})
        hums = settings.merged(later, {"sensor": {"hum_e": 5.0}})
        assert len({settings.digest(each, "f/2.0 None s") for each in (later, used, also)}) == 3
        assert settings.digest(hums, "f/2.0 None s") == expected


def test_what_is_added_to_the_tables_of_a_list_counts_where_it_is_used(monkeypatch):
    layers = {"terrain": {"layers": [{"amplitude_m": 0.5}, {"scale_m": 1.0}]}}
    old = settings.merged(settings.defaults(), settings.check(layers, "test"))
    upgrade_all(monkeypatch)
    stored, fresh = (settings.restored(old, "pair.json"), settings.merged(
        settings.restored(old, "pair.json"), settings.check(layers, "test")))
    assert [layer["skew"] for layer in stored.terrain.layers] == [0.0, 0.0]
    assert [layer["skew"] for layer in fresh.terrain.layers] == [0.5, 0.5]
    ids = {settings.digest(settings.merged(stored, {"terrain": {"layers": [
        layer | {"skew": skew} for layer, skew in zip(stored.terrain.layers, skews, strict=True)]}}))
        for skews in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))}
    assert len(ids) == 4


def test_a_setting_that_is_new_or_missing_is_named_with_the_mend(monkeypatch):
    quality = TOPICS["quality"]
    extra = replace(quality["truth"], key="extra")
    monkeypatch.setitem(TOPICS, "quality", replace(quality, settings=(extra, *quality.settings[1:])))
    assert [fault.split(" is ")[0] for fault in schema_faults()] == ["quality.extra", "quality.samples"]
    assert "later" in schema_faults()[0]
    assert "gone" in schema_faults()[1]


def test_a_setting_that_counted_goes_on_to_count(monkeypatch):
    rig = TOPICS["rig"]
    monkeypatch.setitem(TOPICS, "rig", replace(rig, settings=tuple(
        replace(s, effect="response") if s.key == "baseline_m" else s for s in rig.settings)))
    assert [fault.split()[0] for fault in schema_faults()] == ["rig.baseline_m"]


def test_a_setting_may_get_another_name_and_no_id_changes(monkeypatch):
    old = settings.merged(settings.defaults(), {"surface": {"albedo": 0.5}})
    was = settings.digest(old)
    surface = TOPICS["surface"]
    monkeypatch.setitem(TOPICS, "surface", replace(surface, settings=tuple(
        replace(s, key="whiteness") if s.key == "albedo" else s for s in surface.settings)))
    monkeypatch.setitem(pair_ids.SCHEMA["renamed"], "surface.albedo", "surface.whiteness")
    assert schema_faults() == []
    now = settings.restored(old, "pair.json")
    assert now.surface["whiteness"] == 0.5
    assert "albedo" not in now.surface
    assert settings.digest(now) == was
    assert settings.override("surface.albedo=0.4") == {"surface": {"whiteness": 0.4}}


def test_a_setting_may_go_and_no_id_changes(monkeypatch):
    """Pairs of another value than the one that is left stay what they are; no scene may ask for it any more."""
    old = settings.merged(settings.defaults(), {"hollows": {"elongation": 2.0}})
    ids = [settings.digest(each) for each in (settings.defaults(), old)]
    hollows = TOPICS["hollows"]
    monkeypatch.setitem(TOPICS, "hollows", replace(hollows, settings=tuple(
        s for s in hollows.settings if s.key != "elongation")))
    monkeypatch.setitem(pair_ids.SCHEMA["gone"], "hollows.elongation", 1.0)
    assert schema_faults() == []
    assert settings.digest(settings.defaults()) == ids[0]
    assert settings.digest(settings.restored(old, "pair.json")) == ids[1]
    assert settings.check({"hollows": {"elongation": 1.0}}, "scene.toml") == {}
    with pytest.raises(IcyMoonError, match=r"hollows\.elongation is 2\.0, and there is nothing but 1\.0 any more"):
        settings.check(old, "scene.toml")
