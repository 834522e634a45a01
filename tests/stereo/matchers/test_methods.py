"""Lists of methods as the window changes them."""

import pytest
from icymoon.stereo.matchers import MATCHERS, NEEDS, TITLES
from icymoon.stereo.matchers.methods import names_method, toggle_method


@pytest.mark.parametrize(("text", "name", "toggled"), [
    ("bm,sgbm", "jplv", "bm,sgbm,jplv"), ("bm,sgbm", "sgbm", "bm"), ("", "bm", "bm"), ("bm", "bm", ""),
    (" bm , sgbm:window=7 ,", "bm", "sgbm:window=7"), ("sgbm:window=7,sgbm:window=9", "sgbm", ""),
    ("sgbm_wls", "sgbm", "sgbm_wls,sgbm"), ("own:mine", "own:mine2", "own:mine,own:mine2"),
    ("own:mine:scale=2,bm", "own:mine", "bm")])
def test_a_matcher_is_taken_out_with_its_options_or_put_at_the_end(text, name, toggled):
    assert toggle_method(text, name) == toggled
    assert names_method(text, name) != names_method(toggled, name)


def test_every_matcher_without_setting_up_has_a_title():
    assert set(TITLES) == set(MATCHERS) - {"external"}
    assert set(NEEDS) <= set(TITLES)
