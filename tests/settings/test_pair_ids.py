"""Ids of pairs: what counts in them, and that no new version changes one."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import pytest
from descriptions import DESCRIPTIONS
from hypothesis import given
from icymoon.errors import IcyMoonError
from icymoon.settings import description as settings
from icymoon.settings import pair_ids
from icymoon.settings.table import TOPICS, Value, all_settings
from olddata import upgrade_all


def test_the_digest_counts_what_changes_pixels_and_nothing_else():
    base = settings.defaults()
    other: Value
    for topic, setting in all_settings():
        if setting.kind == "bool":
            other = not setting.default
        elif setting.kind == "choice":
            other = setting.choices[-1][0] if setting.default == setting.choices[0][0] else setting.choices[0][0]
            other = "DISPLACEMENT" if setting.key == "relief" else other  # bump is what REAL renders here
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


#: Checksum of what ids are made of since the first version: the id of a pair depends on every letter and on the order.
FIRST = "70cd178c3f77f6c77093317a1089032e8c3a876736ebd893c4ed2f8ff4c3b24f"


def schema_faults() -> list[str]:
    """Where the table of settings and ``settings/pair_ids.json`` do not agree, each with the fix."""
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


def test_every_setting_states_the_value_of_older_versions():
    assert schema_faults() == []


def test_what_ids_are_made_of_has_not_changed_since_the_first_version():
    frozen = json.dumps([pair_ids.SCHEMA["counted"], pair_ids.SCHEMA["not_counted"],
                         pair_ids.SCHEMA["entries"]["terrain.layers"]])
    assert hashlib.sha256(frozen.encode()).hexdigest() == FIRST


def _of_the_first_version(described, extra: str) -> str:
    """The id as version 0.1.0 made it."""
    counted = [[name, described[name.split(".")[0]][name.split(".")[1]]] for name in pair_ids.SCHEMA["counted"]]
    return hashlib.sha256(json.dumps([counted, extra]).encode()).hexdigest()[:12]


@given(DESCRIPTIONS)
def test_an_id_is_that_of_the_first_version_as_long_as_nothing_later_is_used(description):
    described = settings.merged(settings.check(description, "test"), *(
        {topic: {key: pair_ids.SCHEMA["later"][name]}} for name in pair_ids.SCHEMA["later"]
        for topic, _, key in [name.partition(".")]), *(
        {topic: {"relief": "BUMP"}} for topic in ("surface", "rock_surface")))  # the first version had no REAL
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


def test_a_setting_that_is_new_or_missing_is_named_with_the_fix(monkeypatch):
    quality = TOPICS["quality"]
    extra = replace(quality["truth"], key="extra")
    monkeypatch.setitem(TOPICS, "quality", replace(quality, settings=(extra, *quality.settings[1:])))
    assert [fault.split(" is ")[0] for fault in schema_faults()] == ["quality.extra", "quality.samples"]
    assert "later" in schema_faults()[0]
    assert "gone" in schema_faults()[1]


def test_a_setting_that_counted_must_still_count(monkeypatch):
    rig = TOPICS["rig"]
    monkeypatch.setitem(TOPICS, "rig", replace(rig, settings=tuple(
        replace(s, effect="response") if s.key == "baseline_m" else s for s in rig.settings)))
    assert [fault.split()[0] for fault in schema_faults()] == ["rig.baseline_m"]


def test_a_setting_may_be_renamed_and_no_id_changes(monkeypatch):
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


def test_a_setting_may_be_removed_and_no_id_changes(monkeypatch):
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
    with pytest.raises(IcyMoonError, match=r"hollows\.elongation is 2\.0, but this version supports only 1\.0"):
        settings.check(old, "scene.toml")


def test_real_relief_that_is_not_in_the_mesh_has_the_id_of_bump():
    """It renders the same pixels. Rough ice near the camera has it in the mesh."""
    ids = {(relief, height): settings.digest(settings.merged(settings.defaults(), {
        "surface": {"relief": relief, "grain_amplitude_m": height}, "rock_surface": {"relief": relief}}))
        for relief in ("BUMP", "REAL", "DISPLACEMENT") for height in (0.001, 0.02)}
    assert ids["REAL", 0.001] == ids["BUMP", 0.001] != ids["DISPLACEMENT", 0.001]
    assert len({ids[relief, 0.02] for relief in ("BUMP", "REAL", "DISPLACEMENT")}) == 3
