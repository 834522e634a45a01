"""The list of tests that `make test` leaves to CI, and the plugin that measures and judges tests."""

import ast
import os
import subprocess
import sys

import pytest
from icymoon.support.version import ROOT
from processor_time import JOIN_S, LEAVE_S, LIST, read_list, wrong_places

LISTED = read_list()
#: A test that takes a third of a second of a processor, and the list and limits of a session of its own.
BUSY = """
import time

def busy(seconds=0.3):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
"""
PLUGIN = """
import processor_time
from pathlib import Path

processor_time.LIST = Path("list.txt").absolute()
processor_time.LEAVE_S, processor_time.JOIN_S, processor_time.FAIL_S = 0.05, 0.2, {most}
processor_time.TOGETHER_FAIL_SHARE = {together}
from processor_time import *
"""
TESTS = """
import pytest
from busy import busy

def test_quick():
    pass

def test_between():
    busy(0.12)

def test_slow():
    busy()

def test_as_slow():
    busy()

@pytest.mark.heavy
def test_marked():
    busy()

def test_that_imports_much():
    import sys, types
    busy()
    sys.modules |= {f"made_up_{k}": types.ModuleType("made_up") for k in range(30)}
"""
SLOW = "test_it.py::test_as_slow\ntest_it.py::test_slow\n"


def test_the_list_is_sorted_and_names_tests_that_there_are():
    assert sorted(set(LISTED)) == LISTED
    found: dict[str, set[str]] = {}
    for line in LISTED:
        file, _, name = line.partition("::")
        if file not in found:
            tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
            found[file] = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        assert name.partition("[")[0].rpartition("::")[2] in found[file], line


def test_a_time_between_the_limits_changes_no_place():
    for seconds in (LEAVE_S, (LEAVE_S + JOIN_S) / 2, JOIN_S):
        assert wrong_places({"a": seconds}, []) == (set(), set())
        assert wrong_places({"a": seconds}, ["a"]) == (set(), set())
    assert wrong_places({"a": 1.01 * JOIN_S, "b": 0.99 * LEAVE_S}, ["b", "c"]) == ({"a"}, {"b"})


def session(folder, listed, *options, most=9.0, together=9.0):
    """Exit status and output of a session over ``TESTS``, and its list."""
    texts = {
        "list.txt": listed,
        "busy.py": BUSY,
        "limits.py": PLUGIN.format(most=most, together=together),
        "test_it.py": TESTS,
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers =\n  heavy\npythonpath = .\n")
    path = os.pathsep.join([str(folder), str(LIST.parent / "support"), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "limits", "-p", "no:cacheprovider", *options],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, (folder / "list.txt").read_text().split()


@pytest.mark.parametrize("workers", [pytest.param([], marks=pytest.mark.long), ["-n", "1"]], ids=["alone", "xdist"])
def test_a_slow_test_outside_the_list_is_told_and_then_fails_the_session(tmp_path, workers):
    status, said, listed = session(tmp_path, "", *workers)
    assert (status, listed) == (0, [])
    assert "test_it.py::test_slow could join list.txt" in said
    assert "test_marked" not in said
    assert "test_that_imports_much" not in said
    status, said, _ = session(tmp_path, "", *workers, most=0.25)
    assert status == 1
    assert "test_it.py::test_slow must be in list.txt" in said
    assert session(tmp_path, SLOW, *workers, most=0.25)[0] == 0


@pytest.mark.long
def test_many_slow_tests_outside_the_list_fail_the_session(tmp_path):
    """Two of 0.3 s take 0.83 of the time beside one of 0.12 s, and one takes 0.71; a listed one does not count."""
    status, said, _ = session(tmp_path, "", together=0.77)
    assert status == 1
    assert "2 tests that must be in list.txt" in said
    assert session(tmp_path, "test_it.py::test_slow\n", together=0.77)[0] == 0


def test_the_list_is_written_anew(tmp_path):
    listed = ["other.py::test_elsewhere", "test_it.py::test_gone", "test_it.py::test_marked", "test_it.py::test_quick"]
    status, _, written = session(tmp_path, "\n".join(listed), "--measure-tests")
    assert (status, written) == (0, ["other.py::test_elsewhere", *SLOW.split()])
