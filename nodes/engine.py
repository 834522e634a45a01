"""Cycles renders all images, and what is built is set up for it."""

from __future__ import annotations

from .. import compat
from ..errors import IcyMoonError

_OFF = ("Cycles is switched off, and only Cycles renders what Icy Moon builds; enable the add-on Cycles Render Engine "
        "in Preferences ▸ Add-ons.")


def why_not() -> str:
    """Why nothing can be built or rendered here, in a sentence; empty if it can."""
    return "" if compat.has_cycles() else _OFF


def require() -> None:
    """Raise IcyMoonError if Cycles is switched off."""
    if why := why_not():
        raise IcyMoonError(why)
