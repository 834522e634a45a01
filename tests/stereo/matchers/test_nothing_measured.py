"""A matcher that measures everywhere and gives no number is an error; one that may reject every pixel is not."""

import shlex
import sys

import numpy as np
import pytest
from icymoon.stereo.matchers import match
from icymoon.support.errors import IcyMoonError
from plugin_packages import add_package

IMAGE = np.zeros((20, 30), np.uint8)


@pytest.mark.parametrize(("value", "what"), [("np.nan", "has no finite number"), ("-3.0", "disparities are negative")])
def test_a_program_without_a_number_is_an_error(value, what, tmp_path):
    script = tmp_path / "program.py"
    script.write_text(f"import sys, numpy as np\nnp.save(sys.argv[3], np.full((20, 30), {value}))")
    command = f"{shlex.quote(sys.executable)} {shlex.quote(str(script))} {{left}} {{right}} {{out}}"
    with pytest.raises(IcyMoonError, match=f"external.command wrote a disparity map that cannot be used: .*{what}"):
        match("external", IMAGE, IMAGE, {"command": command})


@pytest.mark.parametrize(("value", "what"), [(np.nan, "a number"), (-3.0, "a positive number")])
def test_a_network_without_a_number_is_an_error(value, what, tmp_path, monkeypatch):
    source = f"""
        import numpy as np
        ICYMOON_API = 1
        TITLE = "My Network"
        def match(left, right, context):
            return np.full(left.shape, float("{value}"))
    """
    add_package(tmp_path, monkeypatch, "matcher", "mine", source)
    with pytest.raises(IcyMoonError, match=f"My Network gave no pixel {what}; its checkpoint or program is damaged"):
        match("mine", IMAGE, IMAGE)


@pytest.mark.parametrize("method", ["bm", "sgbm", "sgbm_wls", "jplv"])
def test_a_dark_image_is_none(method):
    assert not match(method, np.zeros((60, 200), np.uint8), np.zeros((60, 200), np.uint8))[1].any()
