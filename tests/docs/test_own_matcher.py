"""From "I have a network" to its row in the report, word by word from the manual."""

from __future__ import annotations

import json
import shlex
import sys

import manual
import pairs
import pytest
from icymoon.stereo import cli

PAGE = "docs/howto/own-matcher.md"
CODE = [block.code for block in manual.blocks() if block.page == PAGE and block.language in ("python", "sh")]
MAX_LINES = 15


def after(words: str) -> int:
    """The place of the first piece of code with these words."""
    return next(k for k, code in enumerate(CODE) if words in code)


def put_python_on_path(folder, monkeypatch):
    """Make ``python`` the one that runs the tests: not every system has that name for it."""
    folder.mkdir()
    (folder / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n', encoding="utf-8")
    (folder / "python").chmod(0o755)
    monkeypatch.setenv("PATH", str(folder), prepend=":")


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("file", "program", "command", "name"),
    [
        ("mynet.py", "from icymoon_serve import serve", "mynet=resident", "mynet"),
        ("mine.py", "import sys", "command='python mine.py", "mine"),
    ],
)
def test_a_program_of_the_manual_gets_its_row(file, program, command, name, tmp_path, monkeypatch):
    pairs.write_pair(tmp_path / "DATASET" / "pairs" / "one", rig=pairs.camera(320, 180))
    text, words = CODE[after(program)], shlex.split(CODE[after(command)])
    lines = [line for line in text.splitlines() if line.strip()]
    assert len(lines) + 1 <= MAX_LINES  # with the command
    (tmp_path / file).write_text(text + "\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    put_python_on_path(tmp_path / "bin", monkeypatch)
    assert words[:3] == ["python", "-m", "icymoon.stereo"]
    assert cli.main(words[3:]) == 0
    rows = json.loads((tmp_path / "REPORT" / "report.json").read_text(encoding="utf-8"))["rows"]
    (row,) = (row for row in rows if row["method"] == name)
    assert row["status"] == "ok"
    assert row["coverage"] > 0.5
    assert row["l1_m"] < 0.1
