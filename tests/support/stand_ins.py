"""Objects that stand in for others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any


def stand_in(**attributes: object) -> Any:
    """An object with these attributes, to be given where something of another type is expected."""
    return SimpleNamespace(**attributes)


class Process:
    """A process of a job that has messages left for some looks, and then its result."""

    left, cancelled, stops = False, False, 0

    def __init__(self, looks: int, returncode: int = 0, cause: str = "") -> None:
        self.looks, self.returncode, self.cause = looks, returncode, cause

    @property
    def running(self) -> bool:
        return self.looks > 0

    def poll(self) -> list[dict[str, object]]:
        self.looks -= 1
        return [] if self.looks else [{"type": "result"}]

    def cancel(self) -> None:
        self.cancelled = True

    def stop(self) -> None:
        self.stops += 1
        self.cancelled = self.cancelled or self.running
