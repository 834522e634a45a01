"""``icymoon check-plugin``: what a plug-in forgets is told."""

import sys

import pytest
from icymoon.commands.cli import main
from plugin_packages import MATCHER, add_package

#: A matcher that does what it should, by OpenCV.
GOOD = '''\
"""OpenCV's block matching."""
import cv2, numpy as np
ICYMOON_API = 1

def match(left, right, context):
    count = 16 * -(-(context.most_px + 1) // 16)
    if left.shape[1] <= count + 5:
        return np.full(left.shape, np.nan, np.float32)
    found = cv2.StereoSGBM.create(numDisparities=count, blockSize=5).compute(left, right) / np.float32(16)
    return np.where(found > 0, found, np.nan)
'''


@pytest.fixture
def check(tmp_path, monkeypatch, capsys):
    def run(kind, source, name="mine", **facts):
        add_package(tmp_path, monkeypatch, kind, name, source, **facts)
        status = main(["check-plugin", name])
        said = capsys.readouterr()
        assert "Traceback" not in said.err
        return status, said.out

    return run


def test_a_good_matcher_passes(check):
    status, out = check("matcher", GOOD)
    assert status == 0
    assert "matcher mine, icymoon-test-mine 1.0" in out
    assert "FAULT" not in out
    assert out.rstrip().endswith("It can be used.")


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("np.where(found > 0, found, np.nan)", "-np.where(found > 0, found, np.nan)", "the wrong sign"),
        ("/ np.float32(16)", "* np.float32(1)", "16 times too large"),
        ("np.where(found > 0, found, np.nan)", "np.where(found > 0, found, np.nan) / left.shape[1]", "normalised"),
        ("np.where(found > 0, found, np.nan)", "found * np.nan", "measured nothing"),
        ("np.where(found > 0, found, np.nan)", "found * 3 + 40", "wrong by more than 1 px in most"),
        ("np.where(found > 0, found, np.nan)", "found.astype(np.int32)", "the type int32; return float32"),
        ("np.where(found > 0, found, np.nan)", "np.where(found > 0, found, 500)", "outside 0 to 31 px"),
        ("np.where(found > 0, found, np.nan)", "found + np.random.rand()", "two results for the same images"),
        ("if left.shape[1] <= count + 5", "if left[40, 40] < 0", "failed (IndexError"),
        ('"""OpenCV\'s block matching."""', "", "has no docstring"),
        ("import cv2", "import bpy, cv2", "imports bpy"),
        ("ICYMOON_API = 1", "", "states ICYMOON_API = None"),
        ("def match(", "def mtach(", "has no function match"),
        ("def match(left, right, context)", "def match(left, right)", "failed (TypeError"),
    ],
)
def test_what_a_matcher_forgets_is_told(check, before, after, said, monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)
    monkeypatch.delitem(sys.modules, "bpy")  # and what comes in its place goes with the test
    if "bpy" in after:  # Blender itself would be loaded, which takes long
        after = "import sys, types; sys.modules['bpy'] = types.ModuleType('bpy')\nimport cv2"
    assert before in GOOD
    status, out = check("matcher", GOOD.replace(before, after))
    assert status == 1
    assert said in out
    assert "to correct." in out


def test_a_missing_licence_is_told(check):
    status, out = check("matcher", GOOD, licence="")
    assert status == 1
    assert "states no licence" in out


def test_options_are_tried_at_both_ends(check):
    source = GOOD.replace(
        "ICYMOON_API = 1",
        "ICYMOON_API = 1\nOPTIONS = {'window': {'default': 5, 'minimum': 0, 'maximum': 9, 'doc': 'px'}}",
    )
    source = source.replace("blockSize=5", "blockSize=5 // context.options['window']")
    status, out = check("matcher", source)
    assert status == 1
    assert "ZeroDivisionError" in out
    assert "window=9 raises no error" in out


def test_a_refused_one_says_why(check, capsys):
    status, _ = check("matcher", MATCHER, name="bm")
    assert status == 1


def test_an_unknown_one_names_the_nearest(check, capsys):
    check("matcher", MATCHER, name="twelve")
    assert main(["check-plugin", "twelv"]) == 1
    assert "No plug-in 'twelv' is installed in this Python; did you mean 'twelve'?" in capsys.readouterr().err
    assert main(["check-plugin"]) == 0
    assert "matcher twelve, icymoon-test-twelve 1.0" in capsys.readouterr().out
    assert main(["check-plugin", "icymoon-test-twelve"]) == 1  # by the name of its package; it measures no plane


def expect_fault(check, kind: str, good: str, bad: str, said: str) -> None:
    """A good plug-in passes, and a bad one fails with a sentence."""
    assert check(kind, good)[0] == 0
    status, out = check(kind, bad, name="other", package="another")
    assert status == 1
    assert said in out


#: A landform that does what it should.
WAVES = '''\
"""Waves."""
import numpy as np
ICYMOON_API = 1
SETTINGS = {"height_m": {"default": 0.0, "minimum": 0.0, "maximum": 5.0, "label": "Height", "doc": "Height"}}

def height(x, y, settings):
    return settings["height_m"] * np.sin(x + settings["seed"] % 7)

def finest_m(settings):
    return 3.0
'''


def test_a_good_landform_passes(check):
    status, out = check("landform", WAVES)
    assert (status, "FAULT" in out) == (0, False)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("np.sin(x + ", "np.sin(x - x.mean() + ", "in another order or number"),
        ("np.sin(x + ", "np.sin(x + np.random.rand() + ", "other heights for the same points"),
        ("np.sin(x + ", "0 * np.sin(x + ", "is level where height_m is 1"),
        ("np.sin(x + ", "np.log(x + ", "NaN or infinite"),
        ("np.sin(x + ", "1 + int(0 * ", "returned float for points"),
        ("def finest_m", "def finest", "has no finest_m"),
        ("return 3.0", "return -1", "smallest length of -1 m"),
        ("return 3.0", "return settings['spacing']", "KeyError"),
        ('"default": 0.0', '"default": 2.0', "0 turns it off"),
        ("np.sin(x + ", "np.sin(x / (5.0 - settings['height_m']) + ", "NaN or infinite"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_a_landform_forgets_is_told(check, before, after, said):
    assert before in WAVES
    status, out = check("landform", WAVES.replace(before, after))
    assert status == 1
    assert said in out


METRIC = '''\
"""Mean error."""
import numpy as np
ICYMOON_API = 1
UNIT = "px"

def measure(found):
    error = abs(found.disparity_px - found.true_disparity_px)
    return float(np.nanmean(error)) if np.isfinite(error).any() else float("nan")
'''


@pytest.mark.filterwarnings("ignore:Mean of empty slice")
@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("np.nanmean", "np.mean", "returned NaN or infinity for a map with errors and gaps"),
        ("if np.isfinite(error).any()", "+ error[np.isfinite(error)][0] if error.size", "IndexError"),
        ("return float(np.nanmean(error))", "return 'low'", "returned str"),
        ("float(np.nanmean(error))", "np.random.rand()", "two numbers for the same map"),
        ('"px"', '"pixels"', "states UNIT = 'pixels'"),
        ('"px"', "None", "states UNIT = None"),
    ],
)
def test_what_a_metric_forgets_is_told(check, before, after, said):
    expect_fault(check, "metric", METRIC, METRIC.replace(before, after), said)


EXPORT = '''\
"""Text."""
ICYMOON_API = 1

def write_pair(pair, folder):
    (folder / "a.txt").write_text(f"{pair.name} {pair.left.ndim}")
'''


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("{pair.name}", "{__import__('time').perf_counter()}", "other bytes for the same pair"),
        ("{pair.left.ndim}", "{pair.semantic_left.max()}", "failed (AttributeError"),
        ("{pair.left.ndim}", "{pair.left[:, :].reshape(119, 161)}", "failed (ValueError"),
        ("folder / ", "folder / 'b' / ", "failed (FileNotFoundError"),
        ("(folder /", "pass  # (folder /", "wrote no file"),
    ],
)
def test_what_an_export_forgets_is_told(check, before, after, said):
    expect_fault(check, "export", EXPORT, EXPORT.replace(before, after), said)
