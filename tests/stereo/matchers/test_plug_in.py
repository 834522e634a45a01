"""Matchers of plug-ins beside ours."""

import json

import numpy as np
import pytest
from icymoon.stereo.check_plugin import make_textured_pair
from icymoon.stereo.cli import main
from icymoon.stereo.matchers import check_options, list_matcher_names, list_option_keys, match
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.matchers.search_range import SearchRange
from icymoon.support.errors import IcyMoonError
from pairs import write_pair
from plugin_packages import MATCHER, add_package

IMAGE = np.zeros((20, 40), np.uint8)


def matcher(body: str, above: str = "") -> str:
    return (
        f'"""A matcher."""\nimport numpy as np\nICYMOON_API = 1\n{above}\n'
        f"def match(left, right, context):\n    {body}\n"
    )


@pytest.fixture
def add(tmp_path, monkeypatch):
    return lambda name, source, **facts: add_package(tmp_path / "site", monkeypatch, "matcher", name, source, **facts)


def test_it_is_told_its_options_and_what_to_search(add):
    add(
        "told",
        matcher(
            "return np.where(left == 0, context.options['shift'] + context.most_px, np.nan)",
            'OPTIONS = {"shift": {"default": 0.5, "minimum": 0.0, "maximum": 1.0, "doc": "Shift, px"}}',
        ),
    )
    image = IMAGE.copy()
    image[3] = 9
    disparity, valid, info = match("told", image, image, {"shift": "0.25"}, ranges={"auto": SearchRange(2, 17, "rig")})
    assert np.isnan(disparity[3]).all()
    assert (disparity[valid] == 17.25).all()
    assert (info["search"].least_px, info["search"].most_px, info["search"].source) == (2, 17, "rig")
    assert info["facts"] == {"plug_in": "icymoon-test-told 1.0"}
    assert info["options"]["shift"] == 0.25
    _, _, info = match("told", image, image, {"disparities": "32", "min_disparity": "4"})
    assert (info["search"].least_px, info["search"].most_px, info["search"].source) == (4, 35, "stated")


def test_it_cannot_change_the_images(add):
    add("vandal", matcher("left[:] = 255; right[:] = 255; return np.ones(left.shape)"))
    left = IMAGE.copy()
    match("vandal", left, left)
    assert not left.any()


def test_it_sees_colour_only_if_it_asks_for_it(add):
    bands = "return np.full(left.shape[:2], float(left.ndim))"
    add("grey", matcher(bands))
    add("colour", matcher(bands, "COLOUR = True"))
    image = np.zeros((20, 40, 3), np.uint8)
    assert match("grey", image, image)[0][0, 0] == 2
    assert match("colour", image, image)[0][0, 0] == 3


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("return None", r"returned NoneType; return a numpy array"),
        ("return [[1.0]]", "returned list"),
        ("return np.zeros((40, 20))", r"the shape \(40, 20\) for images of \(20, 40\)"),
        ("return np.ones((20, 40, 1))", "the shape"),
        ("return np.ones(left.shape, np.int16)", "the type int16; return float32 in px, with NaN"),
        ("return np.ones(left.shape, complex)", "the type complex128"),
        ("return np.full(left.shape, np.nan)", "odd gave no pixel a number"),
        ("return -np.ones(left.shape)", "odd gave no pixel a positive number"),
        ("return left[1000]", r"failed \(IndexError: .*, plugin_of_a_test_\d+\.py line 6\)"),
        ("raise SystemExit(3)", r"failed \(SystemExit: 3"),
        ("raise Exception('two\\nlines')", r"failed \(Exception: two lines, "),
    ],
)
def test_what_it_does_wrong_is_one_sentence(add, body, said):
    add("odd", matcher(body))
    with pytest.raises(IcyMoonError, match=said) as raised:
        match("odd", IMAGE, IMAGE)
    assert "odd" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("[]", "OPTIONS that are not a dictionary"),
        ("{'a b': {'default': 1, 'doc': ''}}", "has a name that cannot be used"),
        ("{'disparities': {'default': 16, 'minimum': 0, 'maximum': 99, 'doc': ''}}", "has a name that cannot be used"),
        ("{'grey': {'default': 'x', 'choices': ['x'], 'doc': ''}}", "has a name that cannot be used"),
        ("{'a': 3}", "at least a default and a doc"),
        ("{'a': {'default': 3}}", "at least a default and a doc"),
        ("{'a': {'default': 3, 'doc': ''}}", "a number without minimum"),
        ("{'a': {'default': 3, 'doc': '', 'minimum': 0, 'maximum': 2}}", "not between minimum and maximum"),
        ("{'a': {'default': 3, 'doc': '', 'min': 0}}", "has 'min'; an option has default, doc"),
        ("{'a': {'default': 'x', 'doc': ''}}", "is a text; state its choices. Only command, checkpoint"),
        ("{'a': {'default': 'x', 'doc': '', 'choices': ['y']}}", "not one of the choices"),
        ("{'a': {'default': 3, 'doc': '', 'minimum': 'x', 'maximum': 9}}", "cannot be used"),
        ("{'a': {'default': None, 'doc': ''}}", "the default None; give a number"),
    ],
)
def test_a_badly_declared_option_is_named(add, options, said):
    add("badly", matcher("return left", f"OPTIONS = {options}"))
    with pytest.raises(IcyMoonError, match=f"The matcher badly .*{said}"):
        check_options("badly", {})


def test_a_value_out_of_range_is_refused_as_for_ours(add):
    add("told", matcher("return left", 'OPTIONS = {"w": {"default": 3, "minimum": 1, "maximum": 9, "doc": "px"}}'))
    assert list_option_keys("told") == ["preset", "disparities", "numDisparities", "min_disparity", "minDisparity", "w"]
    with pytest.raises(IcyMoonError, match=r"told.w is 10, outside 1 to 9"):
        parse_methods("told:w=10")


def test_it_stands_in_the_list_and_in_the_report(add, tmp_path, capsys):
    add("twelve", MATCHER)
    assert "twelve" in list_matcher_names()
    assert main(["methods"]) == 0
    assert "twelve: Twelve everywhere. (plug-in, icymoon-test-twelve 1.0)" in capsys.readouterr().out
    write_pair(tmp_path / "data" / "pairs" / "0123456789ab")
    out = tmp_path / "report"
    evaluate = ["evaluate", str(tmp_path / "data"), "--methods", "bm,twelve", "--out", str(out)]
    assert main(evaluate) == 0
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert [entry["method"] for entry in report["summary"]] == ["bm", "twelve"]
    assert report["provenance"]["methods"][1]["facts"] == [{"plug_in": "icymoon-test-twelve 1.0"}]
    (row,) = (row for row in report["rows"] if row["method"] == "twelve")
    assert row["coverage"] == 1.0
    assert "icymoon-test-twelve 1.0" in (out / "report.html").read_text(encoding="utf-8")


def test_check_reports_them_for_the_window(add, capsys):
    add("twelve", MATCHER)
    add("bm", MATCHER)
    assert main(["check"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["matchers"] == {"twelve": "icymoon-test-twelve 1.0"}
    assert len(told["refused"]) == 1
    assert "The matcher bm of the package" in told["refused"][0]


def test_a_row_is_computed_again_when_the_source_has_changed(add, tmp_path):
    """Its version need not: who writes a matcher changes it many times."""
    from icymoon.stereo.fusion.match_prepared import list_method_inputs

    add("twelve", MATCHER)
    (method,) = parse_methods("twelve")
    before = list_method_inputs(method)
    assert before == list_method_inputs(method)
    (module,) = (tmp_path / "site").glob("*.py")
    module.write_text(MATCHER.replace("12.0", "13.0"), encoding="utf-8")
    assert before != list_method_inputs(method)
    assert "icymoon-test-twelve 1.0" in before


@pytest.mark.long
def test_one_that_fails_stops_no_other(add, tmp_path, capsys):
    add("odd", matcher("raise ValueError('no idea')"))
    write_pair(tmp_path / "data" / "pairs" / "0123456789ab")
    assert main(["evaluate", str(tmp_path / "data"), "--methods", "odd,bm", "--out", str(tmp_path / "out")]) == 1
    told = capsys.readouterr().err
    assert "The matcher odd of the package icymoon-test-odd 1.0 failed (ValueError: no idea" in " ".join(told.split())
    assert "Traceback" not in told
    rows = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))["rows"]
    assert [row["status"] for row in rows] == ["failed", "ok"]


def test_one_that_is_refused_says_why_where_it_is_named(add, capsys):
    add("sgbm", MATCHER)
    assert main(["methods"]) == 1
    assert "The matcher sgbm of the package icymoon-test-sgbm 1.0 is refused" in capsys.readouterr().err
    add("twice", MATCHER, package="first")
    add("twice", MATCHER, package="second")
    with pytest.raises(IcyMoonError, match=r"The matcher twice is refused: first 1.0 and second 1.0 both add it"):
        parse_methods("twice")


def test_the_pair_of_the_trial_has_the_truth_that_it_states():
    """By our own matcher, which finds it to a tenth of a pixel."""
    left, right, truth = make_textured_pair()
    disparity, valid, _ = match("sgbm", left, right, {"disparities": "32"})
    assert valid.mean() > 0.7
    assert np.median(np.abs(disparity - truth)[valid]) < 0.1
