"""The trust boundary: what a description may name, and what only the user may.

A scene, a .blend file, a settings file, a preset, a plan, a job, a data set and a pair are descriptions. They come
from anyone and are data: they name numbers, choices, files that are read as data and a folder that is written to.
They name no command, program, interpreter or checkpoint. Those come from the preferences of the add-on, from the
command line and from environment variables, which are the user's own.

Every setting that is a text states one of ``CLASSES``, and ``fault`` reports what none of that class may hold.
``settings.check`` asks it of every description, whatever it came from. What a text of a matcher may name is in
``LOADS``, and ``stereo.matchers.options.Option`` admits no other text. Imports nothing but the standard library.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

#: What a text in a description may be. None of them is a program.
CLASSES = {"name": "A name or a date that is looked up", "read": "A file that is read as data",
           "written": "A folder that results are written to",
           "matchers": "Names of matchers with their numbers and choices, no program or file"}
#: Options of matchers that name what is run or loaded; only the user gives them.
LOADS = ("command", "checkpoint")
#: Begins the name of a matcher that the user has set up, as in own:mine.
OWN = "own"
OWN_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")


def listed(text: str) -> list[tuple[str, list[str]]]:
    """(name, options) of each matcher in a list such as ``bm,sgbm:window=7``, as every reader of it must split it."""
    labels = (label.strip() for label in text.split(","))
    return [(parts[0], parts[1:]) for parts in (label.split(":") for label in labels if label)]


def own_names(text: str) -> list[str]:
    """Names of the user's own matchers in a list of matchers, each once."""
    return list(dict.fromkeys(options[0] for name, options in listed(text) if name == OWN and options))


def fault(kind: str, text: str) -> str:
    """Why a description may not hold this text, which is of one of ``CLASSES``; empty if it may."""
    if kind != "matchers":
        return ""
    loaded = next(iter(_loaded(option for _, options in listed(text) for option in options)), "")
    if not loaded:
        return ""
    return (f"names a {loaded}, which only you may, not a scene or a file: add it under Own Matchers in the "
            f"preferences of Icy Moon and write {OWN}:NAME, or give it to a command line's --methods.")


def _loaded(options: Iterable[str]) -> Iterable[str]:
    return (key for key in (option.partition("=")[0].strip() for option in options) if key in LOADS)
