"""The checks that every kind of plug-in must pass, with the fix of each fault."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from ..support.errors import IcyMoonError
from .installed import Plugin, load_plugin, read_summary

Made = TypeVar("Made")


@dataclass(frozen=True)
class Check:
    """One check: the condition ``what`` that must hold, and its ``fault``, empty if the condition holds."""

    what: str
    fault: str = ""


def check_making(what: str, make: Callable[[], Made]) -> tuple[Check, Made | None]:
    """Check that ``make`` succeeds; also return its result, or None if it raised IcyMoonError."""
    try:
        return Check(what), make()
    except IcyMoonError as error:
        return Check(what, str(error)), None


def check_call(what: str, act: Callable[..., Any], /, *arguments: object, **changes: object) -> Check:
    """Check that a call succeeds, with any result."""
    return check_making(what, partial(act, *arguments, **changes))[0]


def check_fault(what: str, act: Callable[[], str | None]) -> Check:
    """Make a check whose fault is the text that ``act`` returns, or the sentence of the error that it raises."""
    check, fault = check_making(what, act)
    return Check(what, check.fault or fault or "")


def check_package(plugin: Plugin) -> Iterator[Check]:
    """Check that a plug-in loads without Blender and declares its API version, purpose and licence."""
    blender_before = "bpy" in sys.modules
    first, loaded = check_making("it can be imported, and states ICYMOON_API", lambda: load_plugin(plugin))
    yield first
    if first.fault:
        return
    yield Check(
        "it does not import Blender",
        f"{plugin.title} imports bpy, which the Python of the evaluator does not have; leave it out."
        if "bpy" in sys.modules and not blender_before
        else "",
    )
    yield Check(
        "its first line states its purpose",
        ""
        if read_summary(loaded)
        else f"{plugin.title} has no docstring; begin it with a line that lists and reports show.",
    )
    yield Check(
        "its licence is stated",
        ""
        if plugin.licence
        else f'The package {plugin.package} states no licence; add license = "…" under [project], or nobody may '
        "use it.",
    )
