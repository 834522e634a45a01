"""Lists of methods as the window changes them, and methods with names of the user's."""

import shlex
import sys

import pytest
from icymoon.stereo.matchers import (
    check_options,
    get_matcher_needs,
    list_matcher_names,
    list_matcher_titles,
    list_set_ups,
)
from icymoon.stereo.matchers.methods import describe_method, names_method, parse_methods, toggle_method
from icymoon.support.errors import IcyMoonError


@pytest.mark.parametrize(
    ("text", "name", "toggled"),
    [
        ("bm,sgbm", "jplv", "bm,sgbm,jplv"),
        ("bm,sgbm", "sgbm", "bm"),
        ("", "bm", "bm"),
        ("bm", "bm", ""),
        (" bm , sgbm:window=7 ,", "bm", "sgbm:window=7"),
        ("sgbm:window=7,sgbm:window=9", "sgbm", ""),
        ("sgbm_wls", "sgbm", "sgbm_wls,sgbm"),
        ("own:mine", "own:mine2", "own:mine,own:mine2"),
        ("own:mine:scale=2,bm", "own:mine", "bm"),
    ],
)
def test_a_matcher_is_taken_out_with_its_options_or_put_at_the_end(text, name, toggled):
    assert toggle_method(text, name) == toggled
    assert names_method(text, name) != names_method(toggled, name)


def test_every_matcher_has_a_title_or_is_set_up_with_a_file_or_program():
    assert {name for name in list_matcher_names() if get_matcher_needs(name)} <= set(list_matcher_titles())
    assert {name for name, _ in list_set_ups()} >= set(list_matcher_names()) - set(list_matcher_titles())
    for name in set(list_matcher_names()) - set(list_matcher_titles()):
        with pytest.raises(IcyMoonError, match="is empty"):
            check_options(name, {})


def test_a_named_method_has_its_name_alone_as_label():
    command = f"{shlex.quote(sys.executable)} a,b:c {{left}} {{right}} {{out}}"
    methods = parse_methods(
        "bm",
        ["bm.window=21"],
        named=["wide=bm:disparities=128:blockSize=9", f"mynet=external:timeout_s=5:command={command}:format=pfm"],
    )
    assert [method.label for method in methods] == ["bm", "wide", "mynet"]
    assert methods[1].options["window"] == 9  # its own, by OpenCV's name, over that of --option
    assert methods[1].options["disparities"] == 128
    stated = {"timeout_s": 5, "format": "pfm", "command": command}
    assert methods[2].options == check_options("external", stated)


def test_named_methods_alone_are_enough():
    (method,) = parse_methods("", named=["mine=bm"])
    assert (method.label, method.name, method.options) == ("mine", "bm", check_options("bm", {}))


@pytest.mark.parametrize(
    ("named", "said"),
    [
        (["mine"], "write it as NAME=MATCHER"),
        (["=bm"], "write it as NAME=MATCHER"),
        (["a b=bm"], "letters, digits, - and _"),
        (["a" * 41 + "=bm"], "at most 40"),
        (["sgbm=bm"], "sgbm is the name of a matcher"),
        (["own=bm"], "own is the name of a matcher"),
        (["a=bm", "a=sgbm"], "names a twice"),
        (["a=bmm:window=7"], "Unknown matcher 'bmm', did you mean 'bm'"),
        (["a="], "Unknown matcher ''"),
        (["a=bm:windw=7"], "Unknown option bm.windw"),
        (["a=bm:window"], "--method a window: write it as key=value"),
        (["a=bm:window=7:8"], "bm.window must be a whole"),
    ],
)
def test_a_bad_named_method_is_refused_in_one_sentence(named, said):
    with pytest.raises(IcyMoonError, match=said):
        parse_methods("bm", named=named)


@pytest.mark.parametrize(
    ("label", "shown"),
    [
        ("bm", "StereoBM"),
        ("bm:window=7", "StereoBM window=7"),
        ("sgbm:window=7:disparities=64", "SGBM window=7 disparities=64"),
        ("mynet", "mynet"),
        ("own:bm", "own:bm"),
        (r"onnx:model=C:\net.onnx", r"onnx model=C:\net.onnx"),
    ],
)
def test_the_window_names_methods_as_its_ticks_do(label, shown):
    assert describe_method(label) == shown
