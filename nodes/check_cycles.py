"""Checks whether Cycles is enabled. Cycles renders all images, and built scenes need its settings."""

from __future__ import annotations

from ..support.blender import compat
from ..support.errors import IcyMoonError

_DISABLED_MESSAGE = (
    "Cycles is switched off, but Icy Moon renders with it; enable the add-on Cycles Render Engine in Preferences ▸ "
    "Add-ons."
)


def why_unavailable() -> str:
    """Return a sentence on why this Blender cannot build and render; empty if it can."""
    return "" if compat.has_cycles() else _DISABLED_MESSAGE


def require_cycles() -> None:
    """Raise IcyMoonError if Cycles is switched off."""
    if why := why_unavailable():
        raise IcyMoonError(why)
