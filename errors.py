"""The one exception a person is meant to read."""

from __future__ import annotations


class IcyMoonError(Exception):
    """One sentence that says what is wrong, where, and how to mend it.

    Operators turn it into a report, the command line into a line on stderr and exit code 1;
    anything else that is raised is a defect of ours and keeps its traceback.
    """


class DiskError(IcyMoonError):
    """The disk or the folder refuses, whatever is written there."""
