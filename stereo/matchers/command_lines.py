"""Command lines of the user's programs."""

from __future__ import annotations

import shutil

from ...support.errors import IcyMoonError
from ...support.system import split_command


def split_arguments(option: str, command: str, example: str) -> list[str]:
    """The arguments of a command. Raises IcyMoonError, naming the ``option``, if it has none."""
    try:
        arguments = split_command(command)
    except ValueError as error:
        raise IcyMoonError(f"{option} cannot be split into arguments ({error}); close its quotes.") from None
    if not arguments:
        raise IcyMoonError(f"{option} is empty; write it as {example}.")
    return arguments


def require_program(option: str, name: str) -> None:
    """Raise IcyMoonError unless there is a program of this name or path on this machine."""
    if shutil.which(name) is None:
        raise IcyMoonError(f"{option} starts with {name}, which is not a program on this machine; give its whole path.")
