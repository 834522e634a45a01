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


@pytest.mark.parametrize(("before", "after", "said"), [
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
    ("def match(left, right, context)", "def match(left, right)", "failed (TypeError")])
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
    source = GOOD.replace("ICYMOON_API = 1", "ICYMOON_API = 1\nOPTIONS = {'window': {'default': 5, 'minimum': 0, "
                          "'maximum': 9, 'doc': 'px'}}")
    source = source.replace("blockSize=5", "blockSize=5 // context.options['window']")
    status, out = check("matcher", source)
    assert status == 1
    assert "ZeroDivisionError" in out
    assert "window=9 is no error" in out


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
