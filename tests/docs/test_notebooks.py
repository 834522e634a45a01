"""The notebooks run, and give what their pages show."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import manual
import pytest
from icymoon.support.version import ROOT

sys.path.insert(0, str(ROOT / "docs" / "make"))
import notebooks

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def assert_alike(found: str, kept: str) -> None:
    """The words are the same; numbers are those of another machine or Blender, whose noise differs a little."""
    assert _NUMBER.sub("#", " ".join(found.split())) == _NUMBER.sub("#", " ".join(kept.split()))
    for one, other in zip(_NUMBER.findall(found), _NUMBER.findall(kept), strict=True):
        assert float(one) == pytest.approx(float(other), rel=0.3, abs=0.1), f"{one} is not {other}"


def test_outputs_that_differ_are_found():
    assert_alike("a 1.00\n b 57%", "a 1.1 b 60%")
    for other in ("a 1.0 b 90%", "a 1.0 c 57%"):
        with pytest.raises(AssertionError):
            assert_alike("a 1.0 b 57%", other)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", notebooks.names())
def test_it_gives_what_its_page_shows(name, tmp_path):
    """In a process of its own: a notebook changes the folder, and its worker ends with it."""
    pytest.importorskip("bpy", reason="notebooks render")
    pytest.importorskip("matplotlib")
    program = (
        "import json, pathlib, sys; sys.path.insert(0, sys.argv[1]); import notebooks\n"
        "found = notebooks.read(sys.argv[2]); notebooks.run(found)\n"
        "pathlib.Path(sys.argv[3]).write_text(json.dumps(notebooks.texts(found)), encoding='utf-8')"
    )
    out = tmp_path / "texts.json"
    ended = subprocess.run(
        [sys.executable, "-c", program, str(ROOT / "docs" / "make"), name, str(out)],
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    found, kept = json.loads(out.read_text(encoding="utf-8")), notebooks.texts(notebooks.read(name))
    assert len(found) == len(kept)
    for one, other in zip(found, kept, strict=True):
        assert_alike(one, other)


@pytest.mark.parametrize("name", notebooks.names())
def test_it_is_a_notebook_with_the_outputs_of_one_run(name):
    found = notebooks.read(name)
    assert (found["nbformat"], found["nbformat_minor"]) == (4, 5)
    code = [cell for cell in found["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert sum(bool(cell["outputs"]) for cell in code) >= 3
    assert not re.findall(r"/(?:work|home|tmp)/", json.dumps(found)), "a path of the machine that ran it"
    assert f"docs/notebooks/{name}.md" in manual.pages()
