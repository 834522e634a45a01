"""Objects that stand in for others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any


def stand_in(**attributes: object) -> Any:
    """An object with these attributes, to be given where something of another type is expected."""
    return SimpleNamespace(**attributes)
