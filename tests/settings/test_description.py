"""Descriptions: one spelling, strict checks, errors that the user can act on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from descriptions import DESCRIPTIONS
from hypothesis import given
from hypothesis import settings as examples
from icymoon.settings import description as settings
from icymoon.settings import preset_files
from icymoon.settings.table import list_all_settings
from icymoon.settings.topics.declaration import EFFECTS
from icymoon.support.errors import IcyMoonError


@examples(max_examples=25)  # of hundreds of numbers each
@given(DESCRIPTIONS)
def test_canonical_form_is_single_precision_and_stable(description):
    once = settings.check(description, "test")
    assert settings.check(once, "test") == once
    for topic, setting in list_all_settings():
        if setting.kind == "float":
            # As pytest.approx, which takes twenty times as long.
            value, written = once[topic][setting.key], description[topic][setting.key]
            assert math.isclose(value, written, rel_tol=1.2e-7, abs_tol=1e-44), (topic, setting.key)


@pytest.mark.parametrize("bound", ["minimum", "maximum"])
def test_a_limit_may_be_stated_as_single_precision_has_it(bound):
    """What Blender says of a property that is at its end is not beyond it."""
    for topic, setting in list_all_settings():
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


@pytest.mark.parametrize("path", [r"C:\Users\me\dem.tif", r"D:\maps\dem.tif"])
def test_a_path_of_windows_in_double_quotes_is_told_how_to_be_written(tmp_path, path):
    file = tmp_path / "scene.toml"
    file.write_text(f'[source]\nfile = "{path}"\n', encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"; write paths with / or in single quotes\.$"):
        preset_files.load(file)


@pytest.mark.parametrize("text", ["terrain.size_m = 1" + "0" * 5000, "a = " + "[" * 10_000], ids=["digits", "depth"])
def test_a_file_that_no_parser_takes_is_refused_by_name(tmp_path, text):
    file = tmp_path / "scene.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"scene\.toml: is not valid TOML"):
        preset_files.load(file)
    with pytest.raises(IcyMoonError, match=r"--set"):
        settings.override(text.replace(" ", "").replace("a=", "terrain.size_m="))


@pytest.mark.parametrize("date", ["2035-03-01T12:00:00+02:00", "2035-03-01T12:00:00", "2035-03-01"])
def test_a_date_without_quotes_is_shown_as_it_stands_in_the_file(tmp_path, date):
    file = tmp_path / "scene.toml"
    file.write_text(f"[light]\ndate_utc = {date}\n", encoding="utf-8")
    with pytest.raises(IcyMoonError) as caught:
        preset_files.load(file)
    assert str(caught.value) == f"{file}: light.date_utc must be a text in quotes, not {date}."


def test_every_setting_says_what_it_is():
    for topic, setting in list_all_settings():
        assert len(setting.description) > 15, f"{topic}.{setting.key}"
        assert setting.effect in EFFECTS
        if setting.kind in ("int", "float"):
            low, high = setting.soft or (setting.minimum, setting.maximum)
            assert math.isfinite(setting.minimum)
            assert math.isfinite(setting.maximum)
            assert setting.minimum <= low < high <= setting.maximum, f"{topic}.{setting.key}"
    settings.check(settings.defaults(), "defaults")


@pytest.mark.parametrize(
    ("text", "words"),
    [
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
    ],
)
def test_a_wrong_override_names_the_key_and_the_fix(text, words):
    with pytest.raises(IcyMoonError) as caught:
        settings.override(text)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("terrain.size_m=30", 30.0),
        ("rocks.most=3", 3),
        ("sensor.shot_noise=false", False),
        ("quality.denoiser=OIDN", "OIDN"),
        ("dataset.methods=bm,sgbm", "bm,sgbm"),
        ("dataset.folder=/a b/c", "/a b/c"),
    ],
)
def test_an_override_reads_its_value_by_the_settings_type(text, expected):
    (value,) = next(iter(settings.override(text).values())).values()
    assert value == expected
    assert type(value) is type(expected)


@pytest.mark.parametrize(
    ("given", "kept"), [(-9999, "-9999"), (-9999.5, "-9999.5"), ("0", "0"), ("none", "none"), ("", "")]
)
def test_a_mark_of_missing_heights_is_a_number_or_its_text(given, kept):
    assert settings.check({"source": {"missing": given}}, "test")["source"]["missing"] == kept


@pytest.mark.parametrize("given", ["low", "nan", "inf", True])
def test_another_mark_is_refused(given):
    with pytest.raises(
        IcyMoonError, match=r"source\.missing (is '.*', which is not a number; give one|must be a text)"
    ):
        settings.check({"source": {"missing": given}}, "test")
