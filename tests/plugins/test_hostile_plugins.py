"""Plug-ins that fail in every way: one sentence that names the package, and the program goes on."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.plugins.installed import find_installed
from icymoon.stereo.matchers import describe_matcher, match
from icymoon.support.errors import IcyMoonError
from plugin_packages import add_package

IMAGE = np.random.default_rng(0).integers(0, 256, (20, 30)).astype(np.uint8)
HEAD = "import numpy as np, sys\nICYMOON_API = 1\n"
GOOD = "def match(left, right, context): return np.ones(left.shape)\n"
OPTION = HEAD + GOOD + "OPTIONS = {'a': %s}\n"
#: Sources of which nothing can be used.
UNUSABLE = {
    "exits": "import sys; sys.exit(3)",
    "base": "raise BaseException('x')",
    "syntax": "def (",
    "controls": "raise ValueError('a\\0\\x1b[2J\\u202e')",
    "long": "raise ValueError('x' * 10**6)",
    "mute": "class E(Exception):\n    def __str__(self): raise RuntimeError('no')\nraise E()",
    "recursion": "def f(): f()\nf()",
    "memory": "raise MemoryError()",
    "absent": "import nowhere_at_all",
    "text_api": "ICYMOON_API = '1'",
    "no_api": "",
    "no_function": HEAD,
    "number": HEAD + "match = 3",
    "options": HEAD + GOOD + "OPTIONS = 3",
    "key": HEAD + GOOD + "OPTIONS = {1: 2}",
    "mapping": HEAD + GOOD + "class M(dict):\n    def items(self): raise ValueError('no')\nOPTIONS = M(a=1)",
    "nan": OPTION % "{'default': float('nan'), 'minimum': 0, 'maximum': 1, 'doc': 'x'}",
    "infinite": OPTION % "{'default': 1, 'minimum': 0, 'maximum': float('inf'), 'doc': 'x'}",
    "digits": OPTION % "{'default': 10**400, 'minimum': 0, 'maximum': 10**500, 'doc': 'x'}",
    "step": OPTION % "{'default': 1, 'minimum': 0, 'maximum': 5, 'step': 0, 'doc': 'x'}",
    "words": OPTION % "{'default': 1, 'minimum': 'x', 'maximum': 5, 'doc': 'x'}",
    "choices": OPTION % "{'default': 'x', 'choices': 5, 'doc': 'x'}",
    "text": OPTION % "{'default': 'x', 'doc': 'x'}",
    "colour": HEAD + GOOD + "class C:\n    def __bool__(self): raise ValueError('no')\nCOLOUR = C()",
}
#: Results of ``match`` that are no map of disparities.
RESULTS = {
    "none": "None",
    "shape": "np.ones((30, 20))",
    "flat": "np.ones(600)",
    "empty": "np.ones((0, 0))",
    "whole": "left",
    "objects": "np.full(left.shape, None)",
    "complex": "np.ones(left.shape, complex)",
    "list": "left.tolist()",
    "flags": "left > 3",
    "exits": "sys.exit(0)",
    "stops": "next(iter(()))",
    "zero": "1 / 0",
    "deep": "match(left, right, 0)",
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_what_cannot_be_used_is_a_sentence(name, tmp_path, monkeypatch):
    add_package(tmp_path, monkeypatch, "matcher", name, UNUSABLE[name])
    for act in (lambda: describe_matcher(name), lambda: match(name, IMAGE, IMAGE, {})):
        with pytest.raises(IcyMoonError, match=f"matcher {name} of the package icymoon-test") as caught:
            act()
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 700


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_that_is_no_map_is_a_sentence(name, tmp_path, monkeypatch):
    add_package(
        tmp_path, monkeypatch, "matcher", name, f"{HEAD}def match(left, right, context): return {RESULTS[name]}\n"
    )
    with pytest.raises(IcyMoonError, match=f"The matcher {name} of the package"):
        match(name, IMAGE, IMAGE, {})


@pytest.mark.parametrize(
    ("name", "result", "value"),
    [
        ("half", "np.ones(left.shape, 'f2')", 1),
        ("long", "np.ones(left.shape, np.longdouble)", 1),
        ("shared", "np.broadcast_to(np.float64(3), left.shape)", 3),
        ("turned", "np.ones(left.shape[::-1]).T", 1),
        ("other", "np.ones(left.shape).view(type('A', (np.ndarray,), {'astype': None}))", 1),
        ("ruins", "(left.fill(0), right.fill(0), np.ones(left.shape))[2]", 1),
    ],
)
def test_a_map_of_any_kind_is_taken_as_it_is(name, result, value, tmp_path, monkeypatch):
    add_package(tmp_path, monkeypatch, "matcher", name, f"{HEAD}def match(left, right, context): return {result}\n")
    before = IMAGE.copy()
    disparity = match(name, IMAGE, IMAGE, {})[0]
    np.testing.assert_array_equal(disparity, np.full(IMAGE.shape, value, np.float32))
    np.testing.assert_array_equal(IMAGE, before)


def test_masked_pixels_are_no_measurement(tmp_path, monkeypatch):
    add_package(
        tmp_path,
        monkeypatch,
        "matcher",
        "masked",
        f"{HEAD}def match(left, right, context):\n"
        "    return np.ma.array(np.ones(left.shape), mask=np.arange(30) < 5 + 0 * left)\n",
    )
    found = match("masked", IMAGE, IMAGE, {})[0]
    assert np.isnan(found[:, :5]).all()
    assert (found[:, 5:] == 1).all()


def test_a_word_about_itself_steers_no_terminal(tmp_path, monkeypatch):
    add_package(tmp_path, monkeypatch, "matcher", "first", f"'''\\x1b[2Jhi'''\n{HEAD}{GOOD}")
    add_package(tmp_path, monkeypatch, "matcher", "second", f"{HEAD}{GOOD}__doc__ = 5\n")
    assert describe_matcher("first").startswith(r"first: \x1b[2Jhi (plug-in")
    assert describe_matcher("second").startswith("second:")


def test_two_of_one_name_are_refused_and_a_damaged_package_hides_no_other(tmp_path, monkeypatch):
    for package in ("one", "two"):
        add_package(tmp_path / package, monkeypatch, "matcher", "twice", HEAD + GOOD, package=package)
    add_package(tmp_path, monkeypatch, "matcher", "whole", HEAD + GOOD)
    broken = tmp_path / "broken-1.0.dist-info"
    broken.mkdir()
    (broken / "METADATA").write_bytes(b"\xff\xfe\0")
    (broken / "entry_points.txt").write_bytes(b"[icymoon.matchers]\nq\x1b[2J = \xff\n[[[\n")
    found = find_installed("matcher")
    assert "both add it" in found.refused["twice"]
    assert "whole" in found.usable
