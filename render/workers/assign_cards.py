"""Assigns the graphics cards that a worker renders on. Imports no Blender.

A scene states only that it is rendered on graphics cards, since other machines have other cards. The cards are named by
``--cards``, by the environment variable ``ICYMOON_CARDS``, or, in the window, in the preferences of Blender.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...support.errors import IcyMoonError
from ...support.files import shorten
from ...support.terminal import ALL_WORD

ENVIRONMENT = "ICYMOON_CARDS"
#: Cycles' names of the programming interfaces of graphics cards; the first one with a card is used.
BACKENDS = ("OPTIX", "CUDA", "HIP", "METAL", "ONEAPI")
_CARDS_TEXT = re.compile(rf"(?:({'|'.join(BACKENDS)}):)?([0-9]{{1,3}}(?:,[0-9]{{1,3}})*)", re.IGNORECASE)


@dataclass(frozen=True)
class Cards:
    """The cards to render on: numbers of one of BACKENDS, as ``icymoon doctor`` lists them. An empty backend means any,
    and empty numbers mean all cards.
    """

    backend: str = ""
    numbers: tuple[int, ...] = ()

    def __str__(self) -> str:
        return f"{self.backend}{':' if self.backend else ''}{','.join(map(str, self.numbers))}"


ALL_CARDS = Cards()


def parse_cards(text: str, origin: str = "--cards") -> Cards:
    """Parse a text such as ``0,2`` or ``CUDA:1`` as cards. Raises IcyMoonError for other texts; ``origin`` names the
    source of the text.
    """
    if text.strip().lower() in ("", ALL_WORD):
        return Cards()
    stated = _CARDS_TEXT.fullmatch(text.replace(" ", ""))
    if not stated:
        raise IcyMoonError(
            f"{origin} is {shorten(text)!r}; write numbers of graphics cards as icymoon doctor lists "
            "them, as in 0,2 or CUDA:1, or all."
        )
    return Cards((stated[1] or "").upper(), tuple(dict.fromkeys(int(number) for number in stated[2].split(","))))


def read_chosen_cards() -> Cards:
    """Read the cards that the environment of this process names. Raises IcyMoonError if its text is invalid."""
    return parse_cards(os.environ.get(ENVIRONMENT, ""), ENVIRONMENT)


def choose_cards(text: str) -> Cards:
    """Choose the cards that ``--cards`` names, or else the environment. They are stored in the environment for
    processes that start later.

    Raises IcyMoonError if the text is invalid.
    """
    cards = parse_cards(text) if text.strip() else read_chosen_cards()
    if cards.numbers:
        os.environ[ENVIRONMENT] = str(cards)
    elif text.strip():
        os.environ.pop(ENVIRONMENT, None)
    return cards


def choose_worker_cards(cards: Cards, place: int, workers: int) -> Cards:
    """Choose the cards of one of several ``workers``: of several cards, the workers get one each, in rotation."""
    if workers < 2 or len(cards.numbers) < 2:
        return cards
    return Cards(cards.backend, (cards.numbers[place % len(cards.numbers)],))


def add_cards(environment: Mapping[str, str] | None, cards: Cards) -> Mapping[str, str] | None:
    """Return an environment that names ``cards`` to a worker; unchanged without chosen cards. The environment None is
    our own."""
    if not cards.numbers:
        return environment
    return {**(os.environ if environment is None else environment), ENVIRONMENT: str(cards)}


def choose_card_numbers(cards: Cards, found: Sequence[str]) -> list[int]:
    """Choose the numbers of the cards to use among the cards that Cycles has ``found``, by name. Raises IcyMoonError if
    one is missing."""
    absent = [number for number in cards.numbers if number >= len(found)]
    if absent:
        there = ", ".join(f"{number}: {name}" for number, name in enumerate(found)) or "none"
        raise IcyMoonError(
            f"Cycles finds no graphics card {absent[0]}; choose an existing one by --cards or {ENVIRONMENT} ({there})."
        )
    return list(cards.numbers) or list(range(len(found)))
