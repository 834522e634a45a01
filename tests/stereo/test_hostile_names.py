"""Names and errors with control characters: shown in the terminal, the report, the log and the tables, never obeyed."""

from __future__ import annotations

import csv
import json
import os
import shlex
import subprocess
import sys

import foreign
import pairs
import pytest
from icymoon.stereo import cli
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.support.errors import IcyMoonError

HOSTILE = "q\x1b[2J\x1b]0;x\x07[b]\u202e"
SHOWN = r"q\x1b[2J\x1b]0;x\x07[b]\u202e"
#: Such a name as all systems allow.
TURNED = "broken\u202e\x9b[b]"
CONTROLS = "\x1b", "\x07", "\u202e", "\x9b"


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    """An evaluation of pairs in a folder of a hostile name, one of them damaged, with a failing external matcher."""
    folder = tmp_path_factory.mktemp("names") / HOSTILE
    rendered = pairs.write_pair(folder / "set" / "pairs" / "whole", rig=pairs.camera(96, 48))
    data = json.loads((rendered / "pair.json").read_text(encoding="utf-8"))
    data["settings"]["light"]["body"] = HOSTILE
    data |= {"versions": {"blender": HOSTILE}, "device": HOSTILE}
    (rendered / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    broken = pairs.write_pair(folder / "set" / "pairs" / TURNED, rig=pairs.camera(96, 48))
    (broken / "left.exr").write_bytes(b"none")
    program = folder / "evil.py"
    program.write_text("import sys; sys.exit('\\x1b[2J\\u202e')", encoding="utf-8")
    command = f"{shlex.quote(sys.executable)} {shlex.quote(str(program))} {{left}} {{right}} {{out}}"
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "icymoon.stereo",
            "evaluate",
            str(folder / "set"),
            "--methods",
            "bm",
            "--method",
            f"evil=external:command={command}",
            "--out",
            str(folder / "out"),
            "--jobs",
            "1",
        ],
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    return folder / "out", done


def test_the_terminal_shows_them(evaluated):
    _, done = evaluated
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert SHOWN in done.stdout + done.stderr
    assert not [control for control in CONTROLS if control in done.stdout + done.stderr]


@pytest.mark.parametrize("name", ["report.html", "results.csv", "results.jsonl", "report.json", "summary.json"])
def test_what_is_written_shows_them(evaluated, name):
    out, _ = evaluated
    text = (out / name).read_text(encoding="utf-8")
    assert r"\x1b[2J" in text or "\\u001b[2J" in text
    assert not [control for control in CONTROLS if control in text]
    if name == "results.csv":
        with (out / name).open(encoding="utf-8", newline="") as stream:
            assert {row["pair"] for row in csv.DictReader(stream)} == {"whole", r"broken\u202e\x9b[b]"}


def test_the_names_in_the_page_s_data_are_those_of_the_folders(evaluated):
    """A click loads a picture by its name, so it must be the real one; the page shows it as below."""
    out, _ = evaluated
    page = (out / "report.html").read_text(encoding="utf-8")
    data = json.loads(page.split('id="data">')[1].split("</script>")[0])
    assert {row[0] for row in data["pairs"]} == {"whole", TURNED}


@pytest.mark.parametrize("name", [HOSTILE, "a\nb", "a\\b", "a:b", "nul", "a ", "\udcff"], ids=ascii)
def test_a_name_that_results_cannot_have_is_refused_at_once(tmp_path, name):
    pair = pairs.write_pair(tmp_path / "set" / "pairs" / "x", rig=pairs.camera(96, 48))
    pair.rename(pair.with_name(name))
    with pytest.raises(IcyMoonError, match="rename its folder"):
        find_sources([tmp_path / "set"])


@pytest.mark.long
def test_without_standard_error_good_pairs_are_read(tmp_path):
    """OpenEXR is silenced by exchanging that stream: of one that is closed there is nothing to exchange."""
    pairs.write_pair(tmp_path / "set" / "pairs" / "a", rig=pairs.camera(96, 48))
    words = [sys.executable, "-m", "icymoon.stereo", "evaluate", "set", "--methods", "bm", "--out", "out"]
    for lacks in ("2>&-", "<&- >&- 2>&-"):
        done = subprocess.run(
            ["/bin/sh", "-c", f"{shlex.join(words)} {lacks}"],
            cwd=tmp_path,
            capture_output=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done
        row = json.loads((tmp_path / "out" / "results.jsonl").read_text().splitlines()[0])
        assert (row["status"], row["pair"]) == ("ok", "a")


def test_silence_needs_no_standard_error(tmp_path):
    """As the API may be used by a program without one."""
    program = (
        "import os, sys\nos.close(2); sys.stderr = None\n"
        "from icymoon.stereo.images.exr import silence_openexr\n"
        "with silence_openexr():\n    os.write(2, b'lost')\n"
        "try:\n    os.fstat(2)\nexcept OSError:\n    print('still closed')\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout == "still closed\n"


@pytest.mark.long
def test_foreign_names_are_shown(tmp_path, capsys):
    folder = foreign.kitti_2015(tmp_path / HOSTILE)
    assert cli.main(["evaluate", str(folder), "--methods", "bm", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for text in (said.out, said.err, page):
        assert not [control for control in CONTROLS if control in text]
    assert os.listdir(tmp_path / "out")
