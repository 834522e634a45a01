"""A pytest plugin that measures tests and compares them with ``tests/left_to_ci.txt``, left out by `make test`.

Processor time depends less on the load of the machine than clock time. It contains threads and the processes that a
test has waited for. The cost of a module's fixture counts for the first test that uses it. A test that imports many
modules is not judged, because the next test of the process finds them loaded.

The end of a session tells the tests whose place in the list is wrong, and the processor time of the tests that `make
test` takes. The session fails if a test outside the list takes ``FAIL_S``, or if those that should join it take
``TOGETHER_FAIL_SHARE`` of that time: so the list stays nearly true without being watched. A test between ``LEAVE_S``
and ``JOIN_S`` stays where it is, so two machines agree on the list. ``--measure-tests`` writes the list anew.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Generator, Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest

LIST = Path(__file__).resolve().parents[1] / "left_to_ci.txt"
#: Processor seconds below which a test leaves the list, above which it joins it, and above which it must be in it.
LEAVE_S, JOIN_S, FAIL_S = 0.15, 0.3, 20.0
#: Share of the processor time of `make test` that all tests that should join the list may take. Fixtures of modules,
#: and a machine that is twice as slow, were seen to bring a tenth.
TOGETHER_FAIL_SHARE = 0.25
#: New modules from which on a test's time is that of imports.
_MANY_MODULES = 20
#: Marks of tests that `make test` leaves out without the list.
APART = {"slow", "heavy", "long"}
_start = pytest.StashKey[tuple[float, int]]()


def spent_s() -> float:
    """Processor seconds of this process and of those that it has waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def read_list() -> list[str]:
    """The tests of the list."""
    return LIST.read_text(encoding="utf-8").splitlines()


def wrong_places(seconds: Mapping[str, float], listed: Collection[str]) -> tuple[set[str], set[str]]:
    """The tests that should join the list, and those that should leave it, by their measured processor seconds."""
    join = {test for test, taken in seconds.items() if taken > JOIN_S and test not in listed}
    return join, {test for test in listed if seconds.get(test, JOIN_S) < LEAVE_S}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--measure-tests", action="store_true", help=f"write {LIST.name} anew from this session's times")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):  # a worker of xdist sends its reports, and judges none
        config.pluginmanager.register(Judge(config.getoption("--measure-tests"), read_list()))


@pytest.hookimpl(hookwrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, None, None]:
    item.stash[_start] = spent_s(), len(sys.modules)
    yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    if call.when == "teardown":  # the last report of a test
        seconds, modules = item.stash[_start]
        if len(sys.modules) - modules < _MANY_MODULES:
            apart = any(item.get_closest_marker(mark) for mark in APART)
            item.user_properties.append(("processor_s", [spent_s() - seconds, apart]))


class Judge:
    """Takes in the times of a session and compares them with the list."""

    def __init__(self, writes: bool, listed: Iterable[str]) -> None:
        self._writes, self._listed = writes, set(listed)
        self._seconds: dict[str, float] = {}
        self._ran: set[str] = set()
        self._marked: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._ran.add(report.nodeid)
        properties: dict[str, Any] = dict(report.user_properties) if report.when == "teardown" else {}
        seconds, apart = properties.get("processor_s", (None, False))
        if apart:
            self._marked.add(report.nodeid)
        elif seconds is not None:
            self._seconds[report.nodeid] = seconds

    def too_slow(self) -> list[str]:
        """The tests outside the list that take ``FAIL_S`` or more."""
        return sorted(test for test, taken in self._seconds.items() if taken >= FAIL_S and test not in self._listed)

    def together_too_slow(self) -> float | None:
        """Processor seconds of the tests that should join the list, where these are too many."""
        together = sum(self._seconds[test] for test in wrong_places(self._seconds, self._listed)[0])
        quick = sum(taken for test, taken in self._seconds.items() if test not in self._listed)
        return together if together > TOGETHER_FAIL_SHARE * quick else None

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._writes:
            join, leave = wrong_places(self._seconds, self._listed)
            # Of files that ran, a test that did not run is no more.
            files = {test.partition("::")[0] for test in self._ran}
            gone = {test for test in self._listed - self._ran if test.partition("::")[0] in files}
            self._listed = (self._listed | join) - leave - gone - self._marked
            LIST.write_text("".join(f"{test}\n" for test in sorted(self._listed)), encoding="utf-8")
        elif (self.too_slow() or self.together_too_slow()) and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        quick = [taken for test, taken in self._seconds.items() if test not in self._listed]
        terminalreporter.write_sep("=", "processor time")
        terminalreporter.write_line(f"make test has {len(quick)} of these tests, which took {sum(quick):.0f} CPU s.")
        join, leave = wrong_places(self._seconds, self._listed)
        for test in self.too_slow():
            terminalreporter.write_line(f"ERROR {self._seconds[test]:.1f} CPU s: {test} must be in {LIST.name}.")
        if together := self.together_too_slow():
            terminalreporter.write_line(f"ERROR {together:.1f} CPU s: {len(join)} tests that must be in {LIST.name}.")
        for tests, what in ((join - set(self.too_slow()), "could join"), (leave, "could leave")):
            for test in sorted(tests)[:20]:
                terminalreporter.write_line(f"{self._seconds[test]:.1f} CPU s: {test} {what} {LIST.name}.")
        if join or leave:
            terminalreporter.write_line(f"`make measure-tests` writes {LIST.name} anew.")
