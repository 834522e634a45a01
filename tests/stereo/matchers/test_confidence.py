"""The confidence of a matcher's result: what may come in, by which rule it becomes one order, and who states one."""

import json

import jpl_images
import numpy as np
import pytest
from icymoon.stereo.adapters import icymoon_serve
from icymoon.stereo.matchers import jpl_correlator as jpl
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.result import CONFIDENCE, CONFIDENCE_KINDS, ERROR_PX, LOGIT, Confidence
from icymoon.support.errors import IcyMoonError
from plugin_packages import add_package

VALID = np.array([[True, True, False], [True, False, True]])
NAN, INF = np.nan, np.inf


def test_each_kind_becomes_a_confidence_by_its_rule():
    values = np.array([[0.0, 1.0, NAN], [0.25, 7.0, 0.5]])
    plain = Confidence(values).check("x", VALID)
    assert (plain.dtype, plain.tolist()) == (np.float32, [[0, 1, 0], [0.25, 0, 0.5]])  # 0 where nothing is measured
    error = np.array([[0.0, np.log(4), NAN], [INF, -3.0, 1.0]])
    assert Confidence(error, ERROR_PX).check("x", VALID)[VALID] == pytest.approx([1, 0.25, 0, np.exp(-1)])
    logit = np.array([[0.0, np.log(3), NAN], [-1e30, 0.0, 1e30]])
    assert Confidence(logit, LOGIT).check("x", VALID)[VALID] == pytest.approx([0.5, 0.75, 0, 1])
    assert Confidence(values.astype(np.float16)[None, ..., None]).check("x", VALID).tolist() == plain.tolist()
    assert not Confidence(values).check("x", np.zeros_like(VALID)).any()


@pytest.mark.parametrize(
    ("values", "kind", "said"),
    [
        (
            np.ones((3, 2)),
            CONFIDENCE,
            r"a confidence of the shape \(3, 2\) for images of \(2, 3\); give a number",
        ),
        (np.ones((2, 3, 2)), CONFIDENCE, "the shape"),
        ("sure", CONFIDENCE, "x states a confidence of str; give an array of numbers"),
        (np.full((2, 3), NAN), CONFIDENCE, r"no confidence \(NaN\) for 4 measured pixels; give 0"),
        (np.full((2, 3), 1.01), CONFIDENCE, "confidences from 1.01 to 1.01; give numbers from 0 to 1"),
        (np.full((2, 3), INF), CONFIDENCE, "from inf to inf; give numbers"),
        (np.full((2, 3), -0.5), CONFIDENCE, "from -0.5 to -0.5"),
        (np.full((2, 3), -0.5), ERROR_PX, "an expected error of -0.5 px; give 0 or more"),
        (np.full((2, 3), NAN), LOGIT, r"\(NaN\)"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(values, kind, said):
    with pytest.raises(IcyMoonError, match=said) as raised:
        Confidence(values, kind).check("x", VALID)
    assert "\n" not in str(raised.value)


IMAGE = np.zeros((20, 40), np.uint8)
PLUG_IN = '''"""A matcher."""
import numpy as np
ICYMOON_API = 1
SPARSE = True
{}
def match(left, right, context):
    found = np.full(left.shape, 3.0)
    found[0] = np.nan
    return found, {{}}{}
'''


def ask_plugin(tmp_path, monkeypatch, above, more):
    add_package(tmp_path / "site", monkeypatch, "matcher", "sure", PLUG_IN.format(above, more))
    return match("sure", IMAGE, IMAGE)[2]["confidence"]


def test_a_plug_in_may_return_one_and_need_not(tmp_path, monkeypatch):
    assert ask_plugin(tmp_path, monkeypatch, "", "") is None
    assert ask_plugin(tmp_path / "b", monkeypatch, "CONFIDENCE = 0.9", "") is None  # a constant of its own
    assert ask_plugin(tmp_path / "c", monkeypatch, "", ", None") is None
    found = ask_plugin(tmp_path / "d", monkeypatch, "CONFIDENCE = 'error_px'", ", np.full(left.shape, np.log(2))")
    np.testing.assert_allclose(found[1:], 0.5, rtol=1e-6)
    assert not found[0].any()


@pytest.mark.parametrize(
    ("above", "more", "said"),
    [
        ("", ", 2 * np.ones(left.shape)", "sure states confidences from 2 to 2"),
        ("CONFIDENCE = 'px'", ", np.ones(left.shape)", "CONFIDENCE = 'px'; state one of confidence, error_px, logit"),
        ("", ", np.ones(left.shape), 4", "returned 4 values; return disparity, facts and confidence"),
    ],
)
def test_what_a_plug_in_does_wrong_is_one_sentence(tmp_path, monkeypatch, above, more, said):
    with pytest.raises(IcyMoonError, match=said):
        ask_plugin(tmp_path, monkeypatch, above, more)


def test_the_confidence_of_the_wls_filter_is_the_array_that_it_keeps():
    left, right, _ = jpl_images.pair(60, 90, 5, 128, 20, slope=4)
    _, valid, info = match("sgbm_wls", left, right, {"disparities": 32})
    np.testing.assert_allclose(info["confidence"], np.where(valid, info["arrays"]["confidence"] / 255, 0), atol=1e-7)
    assert np.ptp(info["confidence"]) > 0.5
    assert match("sgbm", left, right, {"disparities": 32})[2]["confidence"] is None


@pytest.mark.parametrize("level", [0, 1])
def test_the_confidence_of_jplv_is_the_error_that_its_uncertainty_limits(level):
    """A limit keeps exactly the matches of a smaller expected error."""
    left, right, _ = jpl_images.pair(60, 90, 5, 128, 20, slope=4)
    options = {"max_disparity": 40, "pyramid_level": level, "blob_size": 0}
    _, valid, info = match("jplv", left, right, options)
    error_px = -np.log(info["confidence"][valid])
    limit = int(np.median(error_px) * jpl.ONE / 2**level)
    if level == 0:
        kept = match("jplv", left, right, options | {"uncertainty": limit})[1]
        np.testing.assert_array_equal(kept[valid], error_px * jpl.ONE < limit * (1 - 1e-6))
    assert np.ptp(error_px) > 0.01
    assert (info["confidence"][~valid] == 0).all()


def test_a_resident_program_writes_one_only_if_it_is_asked(tmp_path):
    files = {key: str(tmp_path / f"{key}.npy") for key in ("left", "right", "out", "confidence")}
    for eye in ("left", "right"):
        np.save(files[eye], np.zeros((2, 3, 3), np.uint8))

    def answer(found, **request):
        return icymoon_serve._answer_request(lambda *images: found, {**request, **files})

    disparity = np.ones((2, 3))
    assert "confidence" not in answer(disparity)
    assert answer((disparity, [[0, 0.5, 1], [1, 1, 1]]))["confidence"] in CONFIDENCE_KINDS
    assert np.load(files["confidence"]).tolist() == [[0, 0.5, 1], [1, 1, 1]]
    json.dumps(answer((disparity, disparity)))
    with pytest.raises(ValueError, match="returned 3 values"):
        answer((disparity, disparity, disparity))
    del files["confidence"]  # an older Icy Moon
    assert "confidence" not in answer((disparity, disparity))
