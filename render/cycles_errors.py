"""The reason why an operator of Blender failed, in one line."""

from __future__ import annotations


def first_line(error: Exception) -> str:
    """The first line of the reason why an operator of Blender failed."""
    lines = [line.removeprefix("Error: ").strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__
