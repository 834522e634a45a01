"""Errors whose sentences are meant for the user."""

from __future__ import annotations


class IcyMoonError(Exception):
    """One sentence: the fault, its place, and the fix.

    Operators turn it into a report, the command line into a line on stderr and exit code 1; any other exception is a
    defect of Icy Moon and keeps its traceback.
    """


def describe_error(error: Exception, where: object) -> str:
    """Describe, in a sentence, an error that stops one of many tasks while the others continue."""
    if isinstance(error, IcyMoonError):
        return str(error)
    if isinstance(error, MemoryError):
        return f"{where}: there is not enough memory; close other programs, or work on smaller images."
    return f"{where}: it cannot be used ({type(error).__name__}: {error}); please report this."


class DiskError(IcyMoonError):
    """Nothing can be written to this disk or folder."""


def find_first_line(error: Exception) -> str:
    """Find the reason why an operator of Blender failed, in one line."""
    lines = [line.removeprefix("Error: ").strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__
