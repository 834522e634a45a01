"""What error may be added: its limits, its words, and when it is kept."""

from __future__ import annotations

import pytest
from icymoon.render.cost.error_tolerance import BAD_1, PX, Tolerance, combine_verdicts, make_tolerance, parse_fraction
from icymoon.support.errors import IcyMoonError

NOTHING = {"epe_px": 0.0, "wrong_or_missing": 0.0}


def test_without_a_wish_it_is_two_hundredths_of_a_pixel():
    assert make_tolerance(None, None) == Tolerance(0.02, None)
    assert (PX, BAD_1) == (0.02, 0.005)
    assert make_tolerance(None, 0.01) == Tolerance(None, 0.01)
    assert make_tolerance(0.5, 0.01) == Tolerance(0.5, 0.01)


@pytest.mark.parametrize(
    ("px", "bad_1", "fine"),
    [
        (1e-4, None, True),
        (0.99e-4, None, False),
        (10.0, None, True),
        (10.01, None, False),
        (None, 1e-5, True),
        (None, 0.99e-5, False),
        (None, 0.5, True),
        (None, 0.501, False),
        (0.02, 0.501, False),
        (10.01, 0.01, False),
        (float("nan"), None, False),
        (None, float("nan"), False),
    ],
)
def test_its_limits_themselves_may_be_asked_for(px, bad_1, fine):
    if fine:
        assert make_tolerance(px, bad_1) == Tolerance(px, bad_1)
    else:
        with pytest.raises(IcyMoonError, match="cannot be searched for"):
            make_tolerance(px, bad_1)


def test_what_is_refused_is_named_in_the_unit_that_it_is_given_in():
    with pytest.raises(IcyMoonError, match=r"of 20 px cannot.* 0\.0001 to 10 px\."):
        make_tolerance(20.0, None)
    with pytest.raises(IcyMoonError, match=r"of 60 % bad-1 cannot.* 0\.001 % to 50 %"):
        make_tolerance(None, 0.6)


def test_it_is_shown_and_searched_for_by_what_is_limited_alone():
    assert str(Tolerance(0.02, None)) == "0.02 px"
    assert str(Tolerance(None, 0.005)) == "0.5 % bad-1"
    assert str(Tolerance(0.02, 0.005)) == "0.02 px and 0.5 % bad-1"
    assert Tolerance(0.02, None).limits == {"epe_px": 0.02}
    assert Tolerance(None, 0.005).limits == {"wrong_or_missing": 0.005}
    assert Tolerance(0.02, 0.005).limits == {"epe_px": 0.02, "wrong_or_missing": 0.005}


@pytest.mark.parametrize(
    ("loss", "doubt", "kept"),
    [
        (0.5, 0.0, True),
        (0.25, 0.25, True),
        (0.25, 0.26, None),
        (0.75, 0.25, False),
        (0.75, 0.26, None),
        (0.51, 0.0, False),
        (0.25, None, None),
        (None, None, False),
        (None, 0.0, False),
    ],
)
def test_a_loss_is_told_from_its_limit_if_it_is_a_doubt_away(loss, doubt, kept):
    one = Tolerance(0.5, None)
    assert one.allows({**NOTHING, "epe_px": loss}, {**NOTHING, "epe_px": doubt}) is kept
    assert one.allows({**NOTHING, "epe_px": loss, "wrong_or_missing": 9.0}, {**NOTHING, "epe_px": doubt}) is kept


@pytest.mark.parametrize(
    ("verdicts", "all_of_them"),
    [((), True), ((True, True), True), ((True, None), None), ((None, False), False), ((False, True), False)],
)
def test_all_hold_unless_one_fails_or_cannot_be_told(verdicts, all_of_them):
    assert combine_verdicts(iter(verdicts)) is all_of_them


@pytest.mark.parametrize(("text", "value"), [("0.5%", 0.005), (" 0.5 % ", 0.005), ("0.005", 0.005), ("100%", 1.0)])
def test_a_share_is_a_fraction_or_in_per_cent(text, value):
    assert parse_fraction(text) == pytest.approx(value)
    for bad in ("", "%", "half", "1%%"):
        with pytest.raises(ValueError, match="float"):
            parse_fraction(bad)
