"""The paper's matchers: with its options, at other sizes, and without a checkpoint."""

from __future__ import annotations

from importlib.util import find_spec

import pytest
from icymoon.stereo.matchers import complete_options
from icymoon.stereo.paper.methods import find_methods
from icymoon.support.errors import IcyMoonError

#: icynet, where one of its two libraries is.
OWN = ["icynet"] if any(map(find_spec, ("torch", "onnxruntime"))) else []


@pytest.fixture(autouse=True)
def _no_checkpoints(monkeypatch, tmp_path):
    monkeypatch.setenv("ICYMOON_CHECKPOINTS", str(tmp_path))


def test_at_the_papers_size_it_is_the_papers_stereobm():
    methods, missing = find_methods(1.0, [])
    assert [method.label for method in methods] == ["bm", "jplv", *OWN]
    assert methods[0].options == complete_options("bm", {"preset": "guiss"})
    assert {"dsmnet", "igev"} <= set(missing) <= {"dsmnet", "igev", "icynet"}
    assert all("no checkpoint" in missing[name] for name in ("dsmnet", "igev"))
    assert all(why.endswith(".") for why in missing.values())


def test_window_and_range_follow_the_size():
    """The same part of the ground in the window, and at least the same depths in the range."""
    for scale in (0.1, 0.25, 0.5, 0.75):
        chosen = complete_options("bm", find_methods(scale, [])[0][0].options)
        assert chosen["window"] % 2 == 1
        assert chosen["window"] == 5 or abs(chosen["window"] - 49 * scale) <= 1
        assert chosen["min_disparity"] <= 4 * scale + 0.5
        assert chosen["min_disparity"] + chosen["disparities"] >= 99 * scale
        assert chosen["texture_threshold"] == 18


def test_options_are_of_a_matcher_of_the_paper_and_are_not_forgiven():
    methods, _ = find_methods(1.0, ["bm.window=21"])
    assert complete_options("bm", methods[0].options)["window"] == 21
    with pytest.raises(IcyMoonError, match="no matcher 'sgbm'"):
        find_methods(1.0, ["sgbm.window=5"])
    with pytest.raises(IcyMoonError, match=r"no checkpoint at .*gone"):
        find_methods(1.0, ["igev.checkpoint=/gone.pth"])


def test_a_network_with_a_checkpoint_runs_as_in_the_paper(tmp_path):
    pytest.importorskip("torch")
    for name in ("igev", "dsmnet"):
        (tmp_path / f"{name}.pth").write_bytes(b"")
    methods, missing = find_methods(1.0, [])
    assert [method.label for method in methods] == ["bm", "jplv", "dsmnet", "igev", "icynet"]
    assert not missing
    assert complete_options("igev", methods[3].options)["iterations"] == 256
    assert complete_options("dsmnet", methods[2].options)["crop_height"] == 384
    # Its crop is for images of the paper's size.
    assert complete_options("dsmnet", find_methods(0.5, [])[0][2].options)["crop_height"] == 0
