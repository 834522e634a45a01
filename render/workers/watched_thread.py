"""Runs a function in a thread, with the interface of a process. Imports no Blender."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from ...support.errors import describe_error
from .process import Message


class Calculation(threading.Thread):
    """A running function. Its last message is a ``result`` with its ``value``, or an ``error``.

    A function that ``reports`` gets another function as an argument and calls it with its finished share (0 to 1) and
    its present work. Each call becomes a message of ``progress``.

    A thread cannot be stopped, so after ``cancel`` the function runs on and its value is dropped. Python waits for the
    thread at exit.
    """

    left, returncode, cause = False, 0, ""

    def __init__(self, calculate: Callable[..., Any], subject: object, reports: bool = False) -> None:
        """Start ``calculate``; ``subject`` is the file or thing that an error names."""
        super().__init__(name=f"Icy Moon {subject}")
        self.cancelled = False
        self._arguments = (self._report,) if reports else ()
        self._calculate, self._subject = calculate, subject
        self._messages: list[Message] = []
        self.start()

    def run(self) -> None:
        """Run the function; called in the thread."""
        try:
            message: Message = {"type": "result", "value": self._calculate(*self._arguments)}
        except Exception as error:
            message = {"type": "error", "message": describe_error(error, self._subject)}
        self._messages.append(message)

    def _report(self, fraction: float, text: str) -> None:
        self._messages.append({"type": "progress", "fraction": fraction, "message": text})

    @property
    def running(self) -> bool:
        """Whether more messages may follow."""
        return self.is_alive()

    def poll(self) -> list[Message]:
        """Return the new messages, each once, in their order."""
        return [self._messages.pop(0) for _ in self._messages[:]]

    def cancel(self) -> None:
        """Mark the calculation as cancelled. It runs to its end, and its result is dropped."""
        self.cancelled = True

    def stop(self) -> None:
        """Cancel the calculation if it is still running."""
        self.cancelled = self.cancelled or self.is_alive()
