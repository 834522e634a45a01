"""A pytest plugin that measures tests, for ``make measure-tests``: which take more than a second of a processor.

Time of a processor hangs less on what else the machine does than time on a clock. It counts threads and the processes
that a test has waited for; what a fixture of a module takes counts for its first test.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path

import pytest

LIST = Path(__file__).resolve().parents[1] / "over_a_second.txt"
LIMIT_S = 1.0


def _spent_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.hookimpl(hookwrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, None, None]:
    before = _spent_s()
    yield
    if _spent_s() - before > LIMIT_S:
        with LIST.open("a", encoding="utf-8") as file:  # a line at a time, so that several processes can write
            file.write(f"{item.nodeid}\n")
