"""The sky over a site is printed as a render has it, and no wrong input gives a traceback."""

from __future__ import annotations

import json
from importlib.util import find_spec

import pytest
from icymoon.commands.cli import main
from icymoon.physics.light import ephemeris, spice
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset

PLACE = ["--body", "EUROPA", "--latitude", "10", "--longitude", "331", "--date", "2035-03-01T12:00"]


def facts(capsys, *words) -> list[dict]:
    assert main(["sky", *words, "--json"]) == 0
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_it_is_the_sky_of_the_settings(capsys):
    (found,) = facts(capsys, *PLACE)
    light = merged(
        defaults(),
        load_preset("bodies/europa"),
        {
            "light": {
                "directions_from": "DATE",
                "body": "EUROPA",
                "latitude_deg": 10.0,
                "longitude_deg": 331.0,
                "date_utc": "2035-03-01T12:00",
                "planet": True,
            }
        },
    ).light
    expected = describe_sky(compute_sky(light))
    for name in ("sun", "planet"):
        for key, value in expected[name].items():
            assert found[name][key] == pytest.approx(value), (name, key)


def test_a_body_brings_its_planet(capsys, monkeypatch):
    """Also with kernels and after the preset of another body, where Saturn was taken for Jupiter."""
    asked = []
    monkeypatch.setattr(
        spice,
        "find_positions",
        lambda _, body, parent, *site: asked.append((body, parent)) or ephemeris.find_positions(body, *site[:3]),
    )
    (wanted,) = facts(capsys, "--preset", "bodies/europa", *PLACE)
    for words in ([], ["--kernels", "any.tm"], ["--preset", "enceladus_fresh_snow"]):
        (found,) = facts(capsys, *PLACE, *words)
        assert found["planet"] == wanted["planet"], words
    facts(capsys, *PLACE, "--kernels", "any.tm", "--set", "light.parent=SATURN")
    assert asked == [("EUROPA", "JUPITER"), ("EUROPA", "SATURN")]


def test_what_the_planet_hides_lights_nothing(capsys):
    """As in pair.json, where irradiance and eclipse have the same keys."""
    in_shadow = [*PLACE[:-1], "2035-03-04T18:00"]
    (found,) = facts(capsys, *in_shadow)
    assert found["sun"]["eclipse"] == 1
    assert found["sun"]["elevation_deg"] > 50
    assert found["sun"]["irradiance_wm2"] == found["sun"]["ground_irradiance_wm2"] == 0
    assert found["sun"]["source"] == "DATE"
    assert main(["sky", *in_shadow]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "2035-03-04 18:00" in line)
    assert [row.split("│")[k].strip() for k in (4, 5, 6)] == ["0.000", "0.000", "100"]
    (night,) = facts(capsys, "--set", "light.sun_elevation_deg=-5")
    assert night["sun"]["irradiance_wm2"] == 0


def test_the_sky_of_another_body_than_the_grounds_has_a_fix_that_works(capsys):
    """Also where the radius is stated, which no preset changes; with a date, no angles are read."""
    for words in (
        ["--preset", "europa_rough_ice", "--set", "light.body=ENCELADUS"],
        ["--set", "terrain.body_radius_m=2631200"],
    ):
        words += ["--date", "2035-03-01T12:00"]
        assert main(["sky", *words]) == 1
        shown = capsys.readouterr().err
        assert "give --body ENCELADUS for the sky of Enceladus" in shown
        assert "ANGLES" not in shown
        (found,) = facts(capsys, *words, "--body", "ENCELADUS")
        assert found["body"] == "ENCELADUS"


@pytest.mark.parametrize(
    "words", [["--body", "PLUTO"], ["--latitude", "10"], ["--body", "EUROPA", "--longitude", "331"]]
)
def test_an_option_of_the_sky_of_a_date_is_refused_without_one(capsys, words):
    """It was accepted, and the sky was of other angles."""
    assert main(["sky", *words]) == 1
    assert f"{words[-2]} {words[-1]} has no effect without a date; give --date" in capsys.readouterr().err
    if words[1] != "PLUTO":
        (found,) = facts(capsys, *words, "--date", "2035-03-01T12:00")
        assert found["date_utc"] == "2035-03-01T12:00:00"


@pytest.mark.long
def test_a_table_goes_on_through_an_eclipse(capsys):
    """Jupiter hides the Sun once in a turn of 85.2 h over a site that faces it."""
    rows = facts(capsys, *PLACE, "--hours", "86", "--every", "0.5")
    assert len(rows) == 173
    assert (rows[0]["date_utc"], rows[-1]["date_utc"]) == ("2035-03-01T12:00:00", "2035-03-05T02:00:00")
    hidden = [row["sun"]["eclipse"] for row in rows]
    assert max(hidden) == 1
    assert 2 <= sum(share > 0 for share in hidden) <= 10  # hours of the shadow
    assert all(row["sun"]["ground_irradiance_wm2"] == 0 for row in rows if row["sun"]["eclipse"] == 1)


def test_a_date_is_printed_in_utc(capsys):
    (found,) = facts(capsys, *PLACE[:-1], "2035-03-01T12:00+00:00")
    assert found["date_utc"] == "2035-03-01T12:00:00"
    assert main(["sky", *PLACE]) == 0
    assert "2035-03-01 12:00 " in capsys.readouterr().out


def test_presets_and_angles_do_too(capsys):
    assert main(["sky", "--preset", "enceladus_fresh_snow"]) == 0
    assert "by angles" in capsys.readouterr().out
    (found,) = facts(capsys, "--set", "light.sun_elevation_deg=33")
    assert found["sun"]["elevation_deg"] == pytest.approx(33)
    assert found["date_utc"] is None


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--body", "EUROPA", "--date", "soon"], "write it as 2035-03-01T12:00:00"),
        (["--body", "EUROPA", "--date", "soon", "--hours", "3"], "write it as 2035-03-01T12:00:00"),
        (["--body", "MARS", "--date", "2035-03-01"], "light.body is 'MARS'"),
        ([*PLACE, "--hours", "nan"], "give numbers above 0"),
        ([*PLACE, "--hours", "1e9"], "at most 1000 rows"),
        ([*PLACE, "--hours", "5", "--every", "0"], "give numbers above 0"),
        (["--hours", "3"], "give --date"),
        ([*PLACE, "--latitude", "95"], "latitude_deg is 95"),
        # Without the package that reads kernels, the package is what is named.
        ([*PLACE, "--kernels", "/nowhere"], "/nowhere" if find_spec("spiceypy") else "install icymoon[ephemeris]"),
    ],
)
def test_wrong_input_is_a_sentence(capsys, words, text):
    assert main(["sky", *words]) == 1
    shown = capsys.readouterr().err
    assert text in shown
    assert len(shown.splitlines()) == 1
