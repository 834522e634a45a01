"""Where there is no terminal, a line shows now and then that the work goes on."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from icymoon.support import terminal


def until(found: Callable[[], bool]) -> None:
    for _ in range(500):
        if found():
            return
        time.sleep(0.01)
    raise AssertionError


@pytest.mark.parametrize(
    ("show", "message", "line"),
    [
        (
            terminal.show_progress,
            {"type": "progress", "fraction": 0.4, "message": "Pair [b]1[/b] of 2"},
            "Pair [b]1[/b] of 2: 40 %",
        ),
        (
            terminal.show_counted_progress,
            {"type": "progress", "done": 3, "total": 8, "message": "sgbm"},
            "Matching: 3 of 8",
        ),
    ],
)
def test_a_line_comes_without_a_message(monkeypatch, capsys, show, message, line):
    monkeypatch.setattr(terminal, "_PROGRESS_LINE_S", 0.01)
    printed = ""

    def there() -> bool:
        nonlocal printed
        found = capsys.readouterr()
        printed += found.out + found.err
        return printed.count(line) >= 2

    with show("Matching") as tell:
        tell(message)
        until(there)
    capsys.readouterr()
    time.sleep(0.05)
    assert capsys.readouterr().out == ""  # nothing after the end


def test_short_work_prints_no_such_line(capsys):
    with terminal.show_counted_progress("Matching") as tell:
        tell({"type": "progress", "done": 3, "total": 8, "message": "sgbm"})
    assert capsys.readouterr().err == ""
