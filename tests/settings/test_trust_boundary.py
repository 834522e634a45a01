"""The trust boundary: no description, whatever it comes from, names a program or what is loaded as one."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from icymoon.render.plans import frozen_plan
from icymoon.render.plans.plan_file import read_plan
from icymoon.settings import description, preset_files, toml_text
from icymoon.settings.table import list_all_settings
from icymoon.settings.topics import trust_boundary
from icymoon.settings.topics.declaration import Setting
from icymoon.stereo.matchers import complete_options, list_matcher_names, load_matcher
from icymoon.stereo.matchers.lidar_options import LIDAR_OPTIONS
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.matchers.options import Option
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT

MODULES = {name: load_matcher(name) for name in list_matcher_names()}
OPTIONS = [(name, option) for name, module in MODULES.items() for option in module.OPTIONS]
OPTIONS += [("sgbm+lidar", option) for option in LIDAR_OPTIONS]
EVIL = "external:command=/bin/sh -c evil {left} {right} {out}"
REFUSED = f"dataset.methods names a ({'|'.join(trust_boundary.LOADING_OPTIONS)}), which only you may"


def test_every_text_says_what_it_may_name():
    texts = {f"{topic}.{s.key}": s.trust for topic, s in list_all_settings() if s.kind == "text"}
    assert len(texts) > 5
    assert set(texts.values()) == set(trust_boundary.CLASSES)
    with pytest.raises(ValueError, match="must have a class of trust"):
        Setting(label="Program", default="", description="Something that is run", effect="run")
    with pytest.raises(ValueError, match="no other setting may have one"):
        Setting(label="Number", default=1, description="Something that is counted", effect="run", trust="read")


@pytest.mark.parametrize("text", ["", "none", "-9999", "1e20", " 5 ", "-0.0"])
def test_a_mark_is_a_number_or_nothing(text):
    assert trust_boundary.find_text_fault("mark", text) == ""


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "x", "None", "1,5", " ", "sh -c evil"])
def test_what_is_no_finite_number_is_no_mark(text):
    assert trust_boundary.find_text_fault("mark", text).startswith(f"is {text!r}, which is not a number")


@pytest.mark.parametrize("text", ["", "0", "+5", "-145244.57981808594", "-0.00012345678901234567", "360.0"])
def test_a_coordinate_has_every_digit_that_programs_print(text):
    assert trust_boundary.find_text_fault("coordinate", text) == ""


@pytest.mark.parametrize("text", ["33E", "33,5", "-1.45e5", "nan", " 5", "5 m"])
def test_what_is_no_coordinate_is_told_how_to_write_one(text):
    fault = trust_boundary.find_text_fault("coordinate", text)
    assert fault.startswith(f"is {text!r}, which is not a coordinate; write digits")


@pytest.mark.parametrize("text", ["1305031102.1753040001", "now"])
def test_a_time_is_refused_with_the_digits_that_it_may_have(text):
    assert "12 digits before the point and 9 after it" in trust_boundary.find_text_fault("decimal", text)


def test_of_a_long_mark_the_first_forty_letters_are_shown():
    assert trust_boundary.find_text_fault("mark", 99 * "x").startswith(f"is {40 * 'x'!r}, ")


@pytest.mark.parametrize("kind", ["name", "read", "written"])
def test_a_text_that_is_only_read_may_be_any(kind):
    assert trust_boundary.find_text_fault(kind, EVIL) == trust_boundary.find_text_fault(kind, "x") == ""


def test_a_matcher_has_no_text_but_those_that_descriptions_may_not_set():
    with pytest.raises(ValueError, match="LOADING_OPTIONS"):
        Option("script", "", "Something that is run")
    with pytest.raises(ValueError, match="LOADING_OPTIONS"):
        Option("command", 3, "Something that is counted", 0, 5)
    assert {option.key for _, option in OPTIONS if option.range == "text"} == set(trust_boundary.LOADING_OPTIONS)


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=[f"{name}.{option.key}" for name, option in OPTIONS])
def test_a_description_may_set_an_option_exactly_if_it_names_no_program(name, option):
    described = {"dataset": {"methods": f"bm, {name}:{option.key}={option.default or 'x'}"}}
    if option.range == "text":
        with pytest.raises(IcyMoonError, match=REFUSED):
            description.check(described, "scene.toml")
    else:
        assert description.check(described, "scene.toml") == described


def _in_a_settings_file(folder):
    (folder / "scene.toml").write_text(toml_text.to_toml({"dataset": {"methods": EVIL}}), encoding="utf-8")
    preset_files.load(folder / "scene.toml")


def _in_a_plan(folder):
    (folder / "plan.toml").write_text(
        '[plan]\ntitle = "Evil"\n' + toml_text.to_toml({"dataset": {"methods": EVIL}}), encoding="utf-8"
    )
    read_plan(folder / "plan.toml").pairs()


def _in_an_override(folder):
    description.override(f"dataset.methods={EVIL}")


@pytest.mark.parametrize("read", [_in_a_settings_file, _in_a_plan, _in_an_override])
def test_it_is_refused_wherever_it_comes_from(read, tmp_path):
    with pytest.raises(IcyMoonError, match=REFUSED):
        read(tmp_path)


def test_it_is_left_out_of_what_an_earlier_version_has_stored(tmp_path):
    """A data set with it can still be rendered and measured, as everything in it but how to run."""
    stored = description.merged(description.defaults(), {"dataset": {"methods": EVIL}})
    header = {
        "format": frozen_plan.FORMAT,
        "version": frozen_plan.VERSION,
        "pairs": 1,
        "plan": "",
        "icymoon": "0.1.0",
        "settings": stored,
    }
    line = {"id": "0" * 12, "changes": {"dataset": {"methods": EVIL}}}
    (tmp_path / frozen_plan.PLAN).write_text(json.dumps(header) + "\n" + json.dumps(line) + "\n", encoding="utf-8")
    assert frozen_plan.read_frozen_plan(tmp_path).pairs[0].settings == description.defaults()
    assert description.restore_settings(stored, "pair.json") == description.defaults()


#: What may stand around the name of an option without changing it, for str.strip: spaces of all kinds.
SPACES = ["", " ", "\t", "\n", "\r\n", "\v", "\f", "\x1c", "\x85", "\u00a0", "\u2003", "\u2028", "\u3000"]


@pytest.mark.parametrize("key", trust_boundary.LOADING_OPTIONS)
@pytest.mark.parametrize("space", SPACES, ids=ascii)
def test_a_space_hides_no_program(key, space):
    """The evaluator takes spaces off; a gate that did not would let ``external: command=sh`` through."""
    for text in (
        f"external:{space}{key}=sh",
        f"external:{key}{space}=sh",
        f"own:mine:{space}{key}=sh",
        f"bm,{space}external{space}:{space}{key}{space}=sh",
        f"external:timeout_s=5:{space}{key}",
        f"{space}external:{key}{space}",
    ):
        assert f"names a {key}," in trust_boundary.find_text_fault("matchers", text), ascii(text)
        with pytest.raises(IcyMoonError, match=f"names a {key},"):
            description.check({"dataset": {"methods": text}}, "scene.toml")


@pytest.mark.parametrize(
    "text",
    [
        "external:COMMAND=sh",
        "external:Command=sh",
        "external:\uff43ommand=sh",
        "external:command\0=sh",
        "external:com\u00admand=sh",
        "external:\u200bcommand=sh",
        "external:\ufeffcommand=sh",
        "external:comm\u0430nd=sh",
        "external:'command'=sh",
        "external;command=sh",
        "external\uff1acommand=sh",
        "external:command\uff1dsh",
        "external:--command=sh",
        "external:external.command=sh",
        "EXTERNAL:x=sh",
        "own:../mine",
        "own:mine\0",
        "own:mine\n",
        "own:",
        "own",
        "own::",
        ":::",
        ",,,",
        "own:own:mine",
        "own: mine",
        "own:mine :timeout_s=5",
        "external",
        "external:timeout_s=5",
        "onnx:mod\0el=a",
        "igev:check point=a",
    ],
    ids=ascii,
)
def test_a_name_that_only_looks_like_one_loads_nothing(text):
    """Whether the gate passes it or not: nobody reads it as the name of a program."""
    assert loaded_by(text) == []


def loaded_by(text: str) -> list[str]:
    """Programs and checkpoints that the evaluator would load for a list of matchers that the gate passes."""
    try:
        given = description.check({"dataset": {"methods": text}}, "test").dataset.methods
        methods = parse_methods(given, own=["mine:external:command=sh mine {left} {right} {out}"])
    except IcyMoonError:
        return []
    found = [
        (method, key, str(value))
        for method in methods
        for key, value in method.options.items()
        if key in trust_boundary.LOADING_OPTIONS
    ]
    return [
        value
        for method, key, value in found
        if value and not (method.label.startswith("own:mine") and value == "sh mine {left} {right} {out}")
    ]


_key = st.sampled_from([*trust_boundary.LOADING_OPTIONS, "Command", "timeout_s", "window", "preset", "grey"])
_space = st.sampled_from(SPACES)
_option = st.tuples(
    _space,
    _key,
    _space,
    st.sampled_from(["=", "==", "", "\uff1d"]),
    _space,
    st.sampled_from(["sh {left} {right} {out}", "7", "", "guiss"]),
).map("".join)
_method = st.tuples(
    _space,
    st.sampled_from([*MODULES, "own", "own:mine", ""]),
    _space,
    st.lists(_option, max_size=3).map(lambda options: "".join(f":{option}" for option in options)),
).map("".join)


@given(st.one_of(st.lists(_method, max_size=3).map(",".join), st.text(max_size=60)))
def test_no_list_that_passes_the_gate_loads_a_program(text):
    assert loaded_by(text) == []


_pieces = st.sampled_from(
    [
        "external",
        "igev",
        "own",
        "mine",
        "bm",
        ":",
        ",",
        "=",
        " ",
        "\t",
        "\u00a0",
        "command",
        "checkpoint",
        "model",
        "COMMAND",
        "sh {left} {right} {out}",
        "timeout_s=5",
        "window=7",
        "'",
        '"',
    ]
)


@given(st.lists(_pieces, max_size=12).map("".join))
def test_what_passes_the_gate_gives_the_evaluator_no_program(text):
    """The gate and the evaluator must split a list alike, or what one passes over the other would run."""
    try:
        description.check({"dataset": {"methods": text}}, "test")
    except IcyMoonError:
        return
    try:
        methods = parse_methods(text, own=["mine:external:command=sh mine {left} {right} {out}"])
    except IcyMoonError:
        return
    for method in methods:
        assert method.label.startswith("own:mine") or not any(
            method.options.get(key) for key in trust_boundary.LOADING_OPTIONS
        )
        assert method.options.get("command", "sh mine {left} {right} {out}") == "sh mine {left} {right} {out}"


def test_one_s_own_matcher_is_named_and_takes_harmless_options_from_a_description():
    own = [r"mine:external:command=sh C:\run,me.sh {left} {right} {out}", "mine:external:format=pfm"]
    described = description.check({"dataset": {"methods": "bm,own:mine:timeout_s=5"}}, "scene.toml")
    bm, mine = parse_methods(described.dataset.methods, own=own)
    assert (bm.name, bm.options) == ("bm", complete_options("bm", {}))
    assert (mine.label, mine.name) == ("own:mine:timeout_s=5", "external")
    stated = {"command": r"sh C:\run,me.sh {left} {right} {out}", "format": "pfm", "timeout_s": 5}
    assert mine.options == complete_options("external", stated)
    assert trust_boundary.list_own_names("bm, own:a:x=1,own:b,own,own:a") == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "own", "said"),
    [
        ("own:mine", [], "no matcher own:mine on this machine \\(none is set up\\)"),
        ("own:mine", ["yours:bm"], "no matcher own:mine on this machine \\(known are yours\\)"),
        ("own", ["yours:bm"], "no matcher own: "),
        ("own:mine", ["mine:magic"], "NAME:METHOD:KEY=VALUE"),
        ("own:mine", ["a b:bm"], "NAME:METHOD:KEY=VALUE"),
        ("own:mine", ["mine:bm", "mine:sgbm"], "is already bm"),
        ("own:mine", ["mine:bm:window"], "key=value"),
    ],
)
def test_what_is_no_matcher_of_one_s_own_is_said_in_a_sentence(text, own, said):
    with pytest.raises(IcyMoonError, match=said):
        parse_methods(text, own=own)


def test_what_the_window_gives_to_processes_has_passed_the_gate():
    """Unchecked settings are read where they are shown, and matchers go to the evaluator through one function."""
    texts = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "operators").glob("*.py")}
    # presets.py puts those of quality back, varied_settings.py shows values, and render_variations.py counts pairs; all
    # check what they start.
    # view_exposure.py sets how bright the view is, no more. view_resolution.py, build.py and build_in_pieces.py only
    # compare them, change_and_build.py puts those back that it has changed, and appended_scenes.py keeps the data set
    # of this file.
    assert {name for name, text in texts.items() if "read_unchecked(" in text} == {
        "appended_scenes.py",
        "build.py",
        "build_in_pieces.py",
        "live_preview.py",
        "change_and_build.py",
        "presets.py",
        "render_variations.py",
        "varied_settings.py",
        "view_exposure.py",
        "view_resolution.py",
    }
    # results.py only compares them with those that were measured, render_variations.py only draws their field, and
    # sidebar_text.py only tells where that field is.
    assert {name for name, text in texts.items() if '"methods"' in text or "dataset.methods" in text} == {
        "evaluate.py",
        "render_variations.py",
        "results.py",
        "sidebar_text.py",
    }
