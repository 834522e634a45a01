"""Which graphics cards a worker gets: by number, one for each, and a sentence for one that is not there."""

import os

import pytest
from icymoon.render.workers.assign_cards import (
    ENVIRONMENT,
    Cards,
    add_cards,
    choose_card_numbers,
    choose_cards,
    choose_worker_cards,
    parse_cards,
    read_chosen_cards,
)
from icymoon.support.errors import IcyMoonError

FOUND = ["Card A", "Card B", "Card C"]


@pytest.mark.parametrize(
    ("text", "cards"),
    [
        ("", Cards()),
        ("  ", Cards()),
        ("0", Cards("", (0,))),
        ("2, 0", Cards("", (2, 0))),
        ("1,1,0", Cards("", (1, 0))),
        ("cuda:1", Cards("CUDA", (1,))),
        ("OPTIX:0,1", Cards("OPTIX", (0, 1))),
    ],
)
def test_cards_are_read_as_they_are_written(text, cards):
    assert parse_cards(text) == cards
    assert parse_cards(str(cards)) == cards


@pytest.mark.parametrize("text", ["x", "-1", "0;1", "0,", ",", "CUDA", "CUDA:", "VULKAN:0", "1.5", "9999", "0" * 5000])
def test_what_is_no_number_of_a_card_is_refused_with_the_place_it_stands_in(text):
    with pytest.raises(IcyMoonError, match=r"^HERE is .*icymoon doctor"):
        parse_cards(text, "HERE")


def test_the_option_comes_before_the_environment_and_reaches_what_is_started(monkeypatch):
    monkeypatch.setenv(ENVIRONMENT, "2")
    assert choose_cards("") == read_chosen_cards() == Cards("", (2,))
    assert choose_cards("HIP:0,1") == Cards("HIP", (0, 1))
    assert os.environ[ENVIRONMENT] == "HIP:0,1"


def test_the_environment_is_refused_by_its_name(monkeypatch):
    monkeypatch.setenv(ENVIRONMENT, "some")
    with pytest.raises(IcyMoonError, match=f"^{ENVIRONMENT} is 'some'"):
        read_chosen_cards()


def test_each_of_several_workers_has_a_card_and_every_card_a_worker():
    cards = Cards("CUDA", (0, 2))
    assert [choose_worker_cards(cards, place, 3).numbers for place in range(3)] == [(0,), (2,), (0,)]
    assert choose_worker_cards(cards, 0, 3).backend == "CUDA"
    assert choose_worker_cards(cards, 0, 1) == cards  # one worker has them all
    assert choose_worker_cards(Cards(), 1, 2) == Cards()


def test_a_worker_finds_its_cards_and_the_rest_of_the_environment():
    assert add_cards({"A": "b"}, Cards("", (1,))) == {"A": "b", ENVIRONMENT: "1"}
    assert add_cards(None, Cards("", (1,))) == {**os.environ, ENVIRONMENT: "1"}
    assert add_cards(None, Cards()) is None


def test_all_cards_are_used_unless_some_are_named():
    assert choose_card_numbers(Cards(), FOUND) == [0, 1, 2]
    assert choose_card_numbers(Cards("", (2, 0)), FOUND) == [2, 0]
    assert choose_card_numbers(Cards(), []) == []


def test_a_card_that_is_not_there_is_named_beside_those_that_are():
    with pytest.raises(IcyMoonError, match=r"no graphics card 3; .*0: Card A, 1: Card B, 2: Card C"):
        choose_card_numbers(Cards("", (0, 3)), FOUND)
    with pytest.raises(IcyMoonError, match=r"no graphics card 0; .*\(none\)"):
        choose_card_numbers(Cards("", (0,)), [])
