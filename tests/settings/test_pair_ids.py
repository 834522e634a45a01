"""Ids of pairs: what counts in them, and that no new version changes one."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import pytest
from descriptions import DESCRIPTIONS
from hypothesis import given
from hypothesis import settings as examples
from icymoon.settings import description as settings
from icymoon.settings import pair_ids
from icymoon.settings.table import TOPICS, list_all_settings
from icymoon.settings.topics.declaration import Value
from olddata import upgrade_all


@pytest.mark.long
def test_an_id_counts_what_changes_pixels_and_nothing_else():
    base = settings.defaults()
    other: Value
    for topic, setting in list_all_settings():
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
        changed = pair_ids.make_pair_id(settings.merged(base, {topic: {setting.key: other}})) != pair_ids.make_pair_id(
            base
        )
        counts = setting.effect not in ("response", "run") and setting.subtype != "FILE_PATH"
        assert changed == counts, f"{topic}.{setting.key}"
    assert pair_ids.make_pair_id(base, "lander") != pair_ids.make_pair_id(base)


#: Checksum of the settings of the first release: the id of a pair depends on every letter and on the order.
FIRST = "70cd178c3f77f6c77093317a1089032e8c3a876736ebd893c4ed2f8ff4c3b24f"


def test_the_settings_of_the_first_release_are_a_closed_list():
    """A newer setting states ``since``. None of these may move, leave, or count otherwise."""
    others = [f"{topic}.{s.key}" for topic, s in list_all_settings() if not s.since and not pair_ids.affects_pixels(s)]
    layer = [s.key for s in TOPICS["terrain"]["layers"].entries if not s.since]
    frozen = json.dumps([pair_ids.list_first_settings(), others, layer])
    assert hashlib.sha256(frozen.encode()).hexdigest() == FIRST


def test_the_value_of_older_versions_is_valid():
    assert [
        s.key
        for topic, s in list_all_settings()
        for s in (s, *s.entries)
        if settings._check_value(s, s.old_value, f"{topic}.{s.key}", "test", False) != s.old_value
    ] == []


def _of_the_first_version(described, extra: str) -> str:
    """The id as version 0.1.0 made it."""
    counted = [[name, described[name.split(".")[0]][name.split(".")[1]]] for name in pair_ids.list_first_settings()]
    return hashlib.sha256(json.dumps([counted, extra]).encode()).hexdigest()[:12]


@examples(max_examples=25)  # of hundreds of numbers each
@given(DESCRIPTIONS)
def test_an_id_is_that_of_the_first_version_as_long_as_nothing_later_is_used(description):
    described = settings.merged(
        settings.check(description, "test"),
        *({topic: {s.key: s.old_value}} for topic, s in list_all_settings() if s.since),
        *({topic: {"relief": "BUMP"}} for topic in ("surface", "rock_surface")),
    )  # the first version had no REAL
    with pytest.MonkeyPatch.context() as patch:
        expected = _of_the_first_version(described, "f/2.0 None s")
        assert pair_ids.make_pair_id(described, "f/2.0 None s") == expected
        upgrade_all(patch)
        later = settings.restore_settings(described, "pair.json")
        assert pair_ids.make_pair_id(later, "f/2.0 None s") == expected
        used = settings.merged(later, {"quality": {"extra_pass": True}})
        also = settings.merged(used, {"rig": {"wobble_deg": 0.1}})
        hums = settings.merged(later, {"sensor": {"hum_e": 5.0}})
        assert len({pair_ids.make_pair_id(each, "f/2.0 None s") for each in (later, used, also)}) == 3
        assert pair_ids.make_pair_id(hums, "f/2.0 None s") == expected


def test_newer_settings_may_stand_in_any_order(monkeypatch):
    """They may be declared between others later; only those of the first release have a place."""
    changes = {"surface": {"frost_share": 0.1, "bubble_share": 0.2}, "hills": {"rms_slope_deg": 1.0, "hurst": 0.9}}
    described = settings.merged(settings.defaults(), changes)
    first, newer = pair_ids.list_counted_values(described)
    assert dict(newer) == {f"{topic}.{key}": value for topic, those in changes.items() for key, value in those.items()}
    for name, topic in TOPICS.items():
        newer_ones = [s for s in topic.settings if s.since]
        monkeypatch.setitem(
            TOPICS, name, replace(topic, settings=(*newer_ones[::-1], *(s for s in topic.settings if not s.since)))
        )
    assert pair_ids.list_counted_values(described) == [first, newer]


def test_what_is_added_to_the_tables_of_a_list_counts_where_it_is_used(monkeypatch):
    layers = {"terrain": {"layers": [{"amplitude_m": 0.5}, {"scale_m": 1.0}]}}
    old = settings.merged(settings.defaults(), settings.check(layers, "test"))
    upgrade_all(monkeypatch)
    stored, fresh = (
        settings.restore_settings(old, "pair.json"),
        settings.merged(settings.restore_settings(old, "pair.json"), settings.check(layers, "test")),
    )
    assert [layer["skew"] for layer in stored.terrain.layers] == [0.0, 0.0]
    assert [layer["skew"] for layer in fresh.terrain.layers] == [0.5, 0.5]
    ids = {
        pair_ids.make_pair_id(
            settings.merged(
                stored,
                {
                    "terrain": {
                        "layers": [
                            layer | {"skew": skew} for layer, skew in zip(stored.terrain.layers, skews, strict=True)
                        ]
                    }
                },
            )
        )
        for skews in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
    }
    assert len(ids) == 4


def test_a_setting_may_be_renamed_and_no_id_changes(monkeypatch):
    old = settings.merged(settings.defaults(), {"surface": {"albedo": 0.5}})
    was = pair_ids.make_pair_id(old)
    surface = TOPICS["surface"]
    monkeypatch.setitem(
        TOPICS,
        "surface",
        replace(
            surface, settings=tuple(replace(s, key="whiteness") if s.key == "albedo" else s for s in surface.settings)
        ),
    )
    monkeypatch.setitem(pair_ids.RENAMED_SETTINGS, "surface.albedo", "surface.whiteness")
    now = settings.restore_settings(old, "pair.json")
    assert now.surface["whiteness"] == 0.5
    assert "albedo" not in now.surface
    assert pair_ids.make_pair_id(now) == was
    assert settings.override("surface.albedo=0.4") == {"surface": {"whiteness": 0.4}}


def test_real_relief_that_is_not_in_the_mesh_has_the_id_of_bump():
    """It renders the same pixels. Rough ice near the camera has it in the mesh."""
    ids = {
        (relief, height): pair_ids.make_pair_id(
            settings.merged(
                settings.defaults(),
                {"surface": {"relief": relief, "grain_amplitude_m": height}, "rock_surface": {"relief": relief}},
            )
        )
        for relief in ("BUMP", "REAL", "DISPLACEMENT")
        for height in (0.001, 0.02)
    }
    assert ids["REAL", 0.001] == ids["BUMP", 0.001] != ids["DISPLACEMENT", 0.001]
    assert len({ids[relief, 0.02] for relief in ("BUMP", "REAL", "DISPLACEMENT")}) == 3


@pytest.mark.parametrize(
    ("topic", "height_m", "bump"),
    [("surface", 0.001, True), ("surface", 0.02, False), ("rock_surface", 0.001, True), ("rock_surface", 0.02, True)],
)
def test_real_relief_of_rocks_is_never_in_the_mesh_and_that_of_the_ground_is_if_it_is_rough(topic, height_m, bump):
    rough = settings.merged(
        settings.defaults(),
        {name: {"relief": "BUMP", "grain_amplitude_m": height_m} for name in ("surface", "rock_surface")},
    )
    real = settings.merged(rough, {topic: {"relief": "REAL"}})
    assert (pair_ids.make_pair_id(real) == pair_ids.make_pair_id(rough)) == bump
