"""The trust boundary: settings that a file may contain, and settings that only the user may give.

Scenes, .blend files, settings files, presets, plans, jobs, data sets and pairs contain settings. Anyone may have
written them, so they are data: numbers, choices, files that are read as data, and a folder that is written to. They
must not name a command, program, interpreter or checkpoint. These come only from the user: from the preferences of the
add-on, from the command line and from environment variables.

Every setting that is a text has one of ``CLASSES``, and ``find_text_fault`` finds text that its class forbids.
``description.check`` calls it for all settings from any origin. ``LOADING_OPTIONS`` has the options of matchers that
name programs and checkpoints, and ``stereo.matchers.options.Option`` allows no other text. Imports no other module of
Icy Moon.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

#: Classes of texts in settings. None of them is a program.
CLASSES = {"name": "A name or a date that is looked up", "read": "A file that is read as data",
           "written": "A folder for results", "mark": "A number that marks missing values",
           "decimal": "A number with all of its digits", "coordinate": "A place with all of its digits",
           "factors": "Numbers of at least 0, one for each lamp",
           "matchers": "Names of matchers with their numbers and choices, no program or file"}
#: Options of matchers that name a program to run or a file to load; only the user gives them.
LOADING_OPTIONS = ("command", "checkpoint", "python", "model", "returns")
#: Text of a mark that states that no value is missing.
NO_MARK = "none"
#: A number with up to 12 digits before the point and 9 after it, so that a time may be stated to the nanosecond.
DECIMAL_PATTERN = re.compile(r"-?[0-9]{1,12}(\.[0-9]{1,9})?")
#: A number of up to 12 digits before the point and 20 after it, as Python and PROJ print coordinates on a map.
COORDINATE_PATTERN = re.compile(r"[+-]?[0-9]{1,12}(\.[0-9]{1,20})?")
#: Numbers of at least 0 with up to 6 digits before the point and 9 after it, with commas between them.
FACTORS_PATTERN = re.compile(r"[0-9]{1,6}(\.[0-9]{1,9})?(, ?[0-9]{1,6}(\.[0-9]{1,9})?)*")
#: Prefix of a matcher that the user has set up, as in own:mine.
OWN_PREFIX = "own"
#: Start of the range points in a method: ``lidar`` alone or after a matcher.
_LIDAR_PART = re.compile(r"(^|\+)lidar(?=:|$)")
OWN_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")


def split_methods(text: str) -> list[tuple[str, list[str]]]:
    """Split a list of matchers such as ``bm,sgbm:window=7`` into (name, options). Every reader must use this function.
    """
    labels = (label.strip() for label in text.split(","))
    return [(parts[0], parts[1:]) for parts in (label.split(":") for label in labels if label)]


def split_lidar(label: str) -> tuple[str, str | None]:
    """Split ``sgbm:window=7+lidar:points=100`` into its matcher and the options of its range points, which are None
    without any; the matcher is empty for ``lidar`` alone. Every reader must use this function."""
    found = _LIDAR_PART.search(label)
    return (label, None) if found is None else (label[: found.start()], label[found.end() :].removeprefix(":"))


def split_option(text: str) -> tuple[str, str, str]:
    """Split an option ``a=b`` into ('a', '=', 'b') without spaces. Every reader must use this function."""
    key, equals, value = (part.strip() for part in text.partition("="))
    return key, equals, value


def list_own_names(text: str) -> list[str]:
    """Names of the user's own matchers in a list of matchers, without repetitions."""
    found = (options[0] for name, options in split_methods(text) if name == OWN_PREFIX and options)
    return list(dict.fromkeys(split_lidar(name)[0] for name in found))


def find_text_fault(kind: str, text: str) -> str:
    """The reason why settings may not contain this text of class ``kind`` (of ``CLASSES``), as the end of a sentence;
    empty if they may.
    """
    if kind == "mark" and text not in ("", NO_MARK) and not _is_finite(text):
        return f"is {text[:40]!r}, which is not a number; give one such as -9999, {NO_MARK}, or an empty text."
    if kind == "decimal" and text and not DECIMAL_PATTERN.fullmatch(text):
        return (f"is {text[:40]!r}, which is not a number of up to 12 digits before the point and 9 after it; give one "
                "such as 1305031102.175304, or an empty text.")
    if kind == "coordinate" and text and not COORDINATE_PATTERN.fullmatch(text):
        return (f"is {text[:40]!r}, which is not a coordinate; write digits with a point, as in -145244.5798, without "
                "a unit, an exponent or a letter of the compass.")
    if kind == "factors" and text and not FACTORS_PATTERN.fullmatch(text):
        return (f"is {text[:40]!r}, which is not a list of numbers of at least 0; write a number for each lamp, as in "
                "1, 0.5.")
    if kind != "matchers":
        return ""
    loaded = next(iter(_list_loading_options(option for _, options in split_methods(text) for option in options)), "")
    if not loaded:
        return ""
    return (f"names a {loaded}, which only you may, not a scene or a file: add it under Own Matchers in the "
            f"preferences of Icy Moon and write {OWN_PREFIX}:NAME, or give it to a command line's --methods.")


def _is_finite(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _list_loading_options(options: Iterable[str]) -> Iterable[str]:
    return (key for key, _, _ in map(split_option, options) if key in LOADING_OPTIONS)
