"""The four matchers of the GUISS paper with their options, icynet, and the reasons why some matchers cannot run
here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from ...support.errors import IcyMoonError
from ...support.suggestions import suggest_nearest
from ..matchers.bm import PRESETS
from ..matchers.methods import Method, parse_methods
from .printed import PRINTED_METHODS, TABLE_METHODS

#: Step of StereoBM's number of disparities, px, and its least window.
_DISPARITIES_STEP_PX, _MIN_WINDOW = 16, 5


def find_methods(scale: float, options: Sequence[str]) -> tuple[list[Method], dict[str, str]]:
    """Find the matchers that can run, and by name a sentence with the reason for each matcher that cannot.

    ``scale`` is the size of the images over the paper's; StereoBM's window and range are scaled with it. ``options``
    are ``matcher.key=value``. Raises IcyMoonError for a wrong option, and if a matcher cannot run although it is given
    an option.
    """
    names = [method.matcher for method in TABLE_METHODS]
    for text in options:
        if (name := text.partition(".")[0]) not in names:
            raise IcyMoonError(f"--option {text}: the tables have no matcher {name!r}, {suggest_nearest(name, names)}")
    found: list[Method] = []
    missing: dict[str, str] = {}
    for name in names:
        own = [text for text in options if text.startswith(f"{name}.")]
        try:
            (method,) = parse_methods(_describe_matcher(name, scale), own)
        except IcyMoonError as error:
            if own:
                raise
            missing[name] = str(error)
            continue
        found.append(replace(method, label=name))
    return found, missing


def _describe_matcher(name: str, scale: float) -> str:
    """Write a matcher with the paper's options, as ``--methods`` takes it.

    JPLV, whose options the paper does not print, and methods that the paper lacks have our options.
    """
    is_printed = name != "jplv" and any(method.matcher == name for method in PRINTED_METHODS)
    if not is_printed or (scale != 1 and name == "dsmnet"):  # DSMNet's crop is for images of the paper's size
        return name
    if scale == 1 or name == "igev":
        return f"{name}:preset=guiss"
    preset = PRESETS["guiss"]
    window = max(_MIN_WINDOW, 2 * round(scale * (preset["window"] - 1) / 2) + 1)
    disparities = _DISPARITIES_STEP_PX * math.ceil(scale * preset["disparities"] / _DISPARITIES_STEP_PX)
    least = round(scale * preset["min_disparity"])
    return f"bm:preset=guiss:window={window}:disparities={disparities}:min_disparity={least}"
