"""Landforms of plug-ins in descriptions: what is stated, what is refused, and ids, with the package and without it."""

import json
import subprocess
import sys
import tomllib

import pytest
from icymoon.settings.description import check, defaults, merged, restore_settings
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.table import TOPICS
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT
from plugin_packages import install_project

EXAMPLE = ROOT / "docs" / "examples" / "icymoon-wave-landform"
RELEASE = "icymoon-wave-landform 1.0.0"
STORED = {
    "height_m": 0.5,
    "spacing_m": 1.5,
    "azimuth_deg": 90.0,
    "covered_share": 0.6000000238418579,
    "made_by": RELEASE,
}


@pytest.fixture(scope="module")
def with_plugin(tmp_path_factory):
    """Runs Python where the example is installed: the table of settings is made once a process."""
    site = tmp_path_factory.mktemp("site")
    install_project(EXAMPLE, site)

    def run(code):
        program = (
            "import json, sys; sys.path.append(sys.argv[1])\nfrom icymoon.support.errors import IcyMoonError\n"
            "from icymoon.settings.description import *\nfrom icymoon.settings.pair_ids import make_pair_id\n"
            "from icymoon.settings.table import TOPICS\n"
            "from icymoon.settings.toml_text import to_toml\n"
            "def said(act):\n    try:\n        act()\n    except IcyMoonError as error:\n"
            "        return str(error)\n" + code
        )
        done = subprocess.run(
            [sys.executable, "-c", program, str(site)], capture_output=True, text=True, check=False, timeout=100
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="module")
def there(with_plugin):
    """What a process with the plug-in finds, all in one."""
    return with_plugin("""
on = merged(defaults(), override("landform_waves.height_m=0.5"))
off = merged(on, override("landform_waves.height_m=0"))
stored = json.loads(json.dumps(on))
other = json.loads(json.dumps(on)); other["landform_waves"]["made_by"] = "icymoon-wave-landform 0.9"
print(json.dumps({
    "default": make_pair_id(defaults()), "on": make_pair_id(on), "off": make_pair_id(off),
    "table": on["landform_waves"], "off_table": off["landform_waves"],
    "restored": make_pair_id(restore_settings(stored, "pair.json")),
    "restored_other": restore_settings(other, "pair.json")["landform_waves"]["made_by"],
    "id_other": make_pair_id(restore_settings(other, "pair.json")),
    "old": restore_settings({"terrain": {"size_m": 20.0}}, "pair.json")["landform_waves"]["height_m"],
    "spacing_alone": make_pair_id(merged(defaults(), override("landform_waves.spacing_m=3"))),
    "spacing": make_pair_id(merged(on, override("landform_waves.spacing_m=3"))),
    "stated": said(lambda: check({"landform_waves": {"height_m": 1.0, "made_by": other["landform_waves"]["made_by"]}},
                                 "a.toml")),
    "range": said(lambda: override("landform_waves.height_m=11")),
    "key": said(lambda: override("landform_waves.hight_m=1")),
    "labels": [[s.key, s.label, s.unit, s.effect] for s in TOPICS["landform_waves"].settings],
    "toml": to_toml(on), "toml_off": to_toml(off),
    "parent": TOPICS["landform_waves"].parent,
}))""")


def test_installing_one_changes_no_id(there):
    assert there["default"] == there["off"] == there["spacing_alone"] == make_pair_id(defaults())


def test_a_description_with_one_names_its_package_and_version(there):
    assert there["table"]["made_by"] == RELEASE
    assert there["off_table"]["made_by"] == ""


def test_the_id_depends_on_its_settings_and_on_its_release(there):
    assert len({there["default"], there["on"], there["spacing"], there["id_other"]}) == 4
    assert there["restored"] == there["on"]


def test_another_release_is_refused_where_it_is_stated_and_kept_where_it_was_stored(there):
    assert there["stated"] == (
        f"a.toml: landform_waves was made by icymoon-wave-landform 0.9, and {RELEASE} is "
        "installed; install icymoon-wave-landform 0.9, or leave landform_waves.made_by out for "
        f"the ground of {RELEASE}."
    )
    assert there["restored_other"] == "icymoon-wave-landform 0.9"


def test_settings_as_text_have_it_only_where_it_is_on(there):
    """So that whoever lacks the package can read those of any other scene."""
    stated = tomllib.loads(there["toml"])
    assert stated.pop("landform_waves") == there["table"]
    off = tomllib.loads(there["toml_off"])
    assert off == stated
    assert make_pair_id(check(off, "scene.toml")) == there["default"]


def test_its_settings_are_checked_and_shown_as_ours_are(there):
    assert "landform_waves.height_m is 11 m, outside 0 to 10 m" in there["range"]
    assert "did you mean 'height_m'" in there["key"]
    assert there["labels"] == [
        ["height_m", "Height", "m", "geometry"],
        ["spacing_m", "Spacing", "m", "geometry"],
        ["azimuth_deg", "Azimuth (°)", "deg", "geometry"],
        ["covered_share", "Covered Share", "1", "geometry"],
        ["made_by", "Made By", "", "geometry"],
    ]
    assert there["parent"] == TOPICS["ridges"].parent
    assert there["old"] == 0.0


def test_without_the_package_a_pair_can_be_read_and_has_its_id(there):
    table = json.loads(json.dumps(there["table"]))
    found = restore_settings({**defaults(), "landform_waves": table}, "pair.json")
    assert found["landform_waves"] == table
    assert make_pair_id(found) == there["on"]
    assert make_pair_id(merged(found, {"sensor": {"bits": 8}})) == there["on"]


def test_without_the_package_one_that_was_off_is_none():
    found = restore_settings({**defaults(), "landform_waves": STORED | {"height_m": 0.0, "made_by": ""}}, "pair.json")
    assert "landform_waves" not in found
    assert make_pair_id(found) == make_pair_id(defaults())


@pytest.mark.parametrize("values", [{"height_m": 1.0}, STORED, {}])
def test_without_the_package_a_description_of_a_user_is_refused(values):
    with pytest.raises(
        IcyMoonError,
        match=r"^scene\.toml: landform_waves is of a plug-in that is not installed in the "
        "Python that builds scenes; install its package there, or remove the table",
    ):
        check({"landform_waves": values}, "scene.toml")


@pytest.mark.parametrize(
    "values",
    [
        STORED | {"made_by": 3},
        STORED | {"made_by": "x" * 300},
        STORED | {"height_m": "import os"},
        STORED | {"height_m": [1.0]},
        STORED | {"height_m": float("nan")},
        STORED | {"height_m": None},
    ],
)
def test_a_damaged_table_is_refused(values):
    with pytest.raises(IcyMoonError, match=r"^pair\.json: \[landform_waves\] is damaged"):
        restore_settings({"landform_waves": values}, "pair.json")


def test_a_name_from_a_file_imports_nothing(tmp_path, monkeypatch):
    """Not even a module that is there, and that the file names."""
    (tmp_path / "landform_evil.py").write_text("raise SystemExit('it was run')")
    (tmp_path / "evil.py").write_text("raise SystemExit('it was run')")
    monkeypatch.syspath_prepend(str(tmp_path))
    restore_settings({"landform_evil": {"height_m": 1.0, "made_by": "evil 1.0"}}, "pair.json")
    with pytest.raises(IcyMoonError, match="not installed"):
        check({"landform_evil": {"height_m": 1.0, "made_by": "evil 1.0"}}, "a.toml")
