"""The one exception a person is meant to read."""

from __future__ import annotations


class IcyMoonError(Exception):
    """One sentence that says what is wrong, where, and how to mend it.

    Operators turn it into a report, the command line into a line on stderr and exit code 1;
    anything else that is raised is a defect of ours and keeps its traceback.
    """


def describe_error(error: Exception, where: object) -> str:
    """What to tell of an error that keeps one of many things from being done, whatever it is."""
    if isinstance(error, IcyMoonError):
        return str(error)
    if isinstance(error, MemoryError):
        return f"{where}: there is not enough memory; close other programs, or work on smaller images."
    return f"{where}: it cannot be used ({type(error).__name__}: {error}); please report this."


class DiskError(IcyMoonError):
    """The disk or the folder refuses, whatever is written there."""
