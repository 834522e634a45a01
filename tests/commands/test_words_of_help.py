"""A word that help names as a value is one: tried by running it."""

from __future__ import annotations

import argparse
import os
import re

import numpy as np
from icymoon.commands import cli, run_validation
from icymoon.render.workers.assign_cards import ALL_CARDS, ENVIRONMENT, choose_cards
from icymoon.stereo import cli as stereo
from icymoon.support.errors import IcyMoonError
from pairs import write_pair

#: Words of help that stand for what happens without the option; beside numbers they are no value.
WORDS = ("all", "none")
#: The options that take a text and whose help names such a word; each has a test below.
TRIED = {
    ("evaluate", "--methods", "none"),
    ("trade", "--groups", "all"),
    ("gallery", "--only", "all"),
    ("validate", "--only", "all"),
    ("stand-ins", "names", "all"),
    *((verb, "--cards", "all") for verb in ("render", "batch", "work", "reproduce", "study", "twin")),
}


def options_of(parser: argparse.ArgumentParser, verb: str = ""):
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, sub in action.choices.items():
                yield from options_of(sub, name)
        elif action.help and action.nargs != 0 and action.type in (None, str):
            yield verb, (action.option_strings or [action.dest])[0], action.help


def test_each_such_word_is_tried():
    found = {
        (verb, option, word)
        for parser in (cli.make_parser(), stereo.make_parser())
        for verb, option, text in options_of(parser)
        for word in WORDS
        if re.search(rf"(?:[(;] ?|or ){word}(?:[),]| that the)", text)
    }
    assert found == TRIED


def test_all_stand_ins_and_scenes_and_comparisons(capsys, monkeypatch):
    def refuse(only, *_):
        raise IcyMoonError(f"chosen: {only}.")

    monkeypatch.setattr(run_validation, "choose_comparisons", refuse)

    def said(*words):
        status = cli.main([str(word) for word in words])
        return status, capsys.readouterr()

    assert said("stand-ins", "all") == said("stand-ins")
    for words in (["gallery", "--only"], ["validate", "--only"], ["trade", "--out", "x", "--groups"]):
        ways = [said(*words[:-1], "--blender", "no/blender"), said(*words, "all", "--blender", "no/blender")]
        assert ways[0] == ways[1]
        assert "'all'" not in ways[1][1].err


def test_all_cards_are_all_whatever_the_environment_names(monkeypatch):
    monkeypatch.setenv(ENVIRONMENT, "CUDA:1")
    assert choose_cards("").numbers == (1,)
    assert choose_cards("all") == ALL_CARDS
    assert ENVIRONMENT not in os.environ


def test_no_methods_beside_predictions(tmp_path, capsys):
    folder = write_pair(tmp_path / "pairs" / "0123456789ab")
    assert stereo.main(["truth", str(folder), "--out", str(tmp_path / "truth")]) == 0
    made = tmp_path / "mine"
    made.mkdir()
    with np.load(tmp_path / "truth" / folder.name / "truth.npz") as truth:
        np.save(made / f"{folder.name}.npy", truth["disparity_left"])
    words = ["evaluate", str(folder), "--predictions", f"mine={made}", "--out", str(tmp_path / "report")]
    assert stereo.main([*words, "--methods", "none"]) == 0
    assert not list((tmp_path / "report").rglob("*bm*"))
    assert stereo.main(["evaluate", str(folder), "--methods", "none", "--out", str(tmp_path / "other")]) == 1
    assert "--methods is empty; choose from" in capsys.readouterr().err
