"""Properties that show another property of their group, such as with fewer decimals.

Knows no Blender, for the reason in ``change_announcements``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def make_mirror(name: str) -> dict[str, Callable[..., Any]]:
    """The functions ``get`` and ``set`` of a property that shows the property of this name."""

    def read(group: object) -> object:
        return getattr(group, name)

    def write(group: object, value: object) -> None:
        setattr(group, name, value)

    return {"get": read, "set": write}
