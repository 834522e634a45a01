"""A verb waits for its own modules alone."""

from __future__ import annotations

import argparse
import subprocess
import sys

import pytest
from icymoon.commands import cli
from icymoon.stereo import cli as stereo

#: What the command line needs before a verb runs. A name more here is a wait for whoever asks for help.
BEFORE_A_VERB = {
    "",
    "__main__",
    "commands",
    "commands.cli",
    "support",
    *(
        f"support.{name}"
        for name in ("bundled_wheels", "errors", "files", "foreign_bytes", "printer", "system", "terminal", "version")
    ),
}
PROGRAM = (
    "import sys\nfrom icymoon.__main__ import main\n"
    "try:\n    main(sys.argv[1:])\nexcept SystemExit:\n    pass\n"
    "print(*sys.modules, file=sys.stderr)"
)


def loaded(*words: str) -> set[str]:
    """The modules that a command has loaded in the end."""
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, timeout=120, check=True
    )
    return set(ended.stderr.splitlines()[-1].split())


@pytest.mark.parametrize("words", [["--help"], ["--version"], [], ["prests"], ["--help", "prests"]], ids=" ".join)
def test_help_loads_no_verb(words):
    modules = loaded(*words)
    assert {name[len("icymoon.") :] for name in modules if f"{name}.".startswith("icymoon.")} <= BEFORE_A_VERB
    assert not {"numpy", "rich", "importlib.metadata"} & modules


@pytest.mark.parametrize(
    ("words", "own", "others"),
    [
        (["presets"], {"commands.print_settings"}, {"render", "stereo", "commands.batch", "commands.quality"}),
        (["validate", "--help"], {"commands.validate"}, {"settings", "render", "stereo", "commands.print_settings"}),
        (["verify", "--help"], {"commands.batch"}, {"stereo", "commands.plan", "commands.print_settings"}),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_verb_loads_no_other(words, own, others):
    modules = loaded(*words)
    assert {f"icymoon.{name}" for name in own} <= modules
    assert not {f"icymoon.{name}" for name in others} & modules


def test_help_names_the_verbs_of_the_evaluator():
    (verbs,) = [action for action in stereo.make_parser()._actions if isinstance(action, argparse._SubParsersAction)]
    assert tuple(verbs.choices) == cli.STEREO_VERBS
