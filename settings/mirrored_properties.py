"""Properties that show another property of their group, for example with fewer decimals.

This module does not use Blender, for the reason in ``change_announcements``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def make_mirror(name: str) -> dict[str, Callable[..., Any]]:
    """Make the functions ``get`` and ``set`` of a property that shows the property ``name`` of the same group."""

    def read(group: object) -> object:
        return getattr(group, name)

    def write(group: object, value: object) -> None:
        setattr(group, name, value)

    return {"get": read, "set": write}
