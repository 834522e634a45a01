"""What ``reproduce``, ``study`` and ``validate`` refuse before anything is rendered."""

from __future__ import annotations

import pytest
from icymoon.commands.cli import main
from icymoon.stereo.paper import OUTPUT_FILES


@pytest.mark.parametrize("scale", ["nan", "inf", "0", "0.01", "-1", "2"])
def test_a_scale_that_cannot_be_is_refused(tmp_path, capsys, scale):
    assert main(["reproduce", "guiss", "--dry-run", "--out", str(tmp_path), f"--scale={scale}"]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "give 0.05 to 1" in told


def test_a_folder_of_files_has_to_be_there(tmp_path, capsys):
    words = ["reproduce", "guiss", "--pairs", "1", "--dry-run", "--out", str(tmp_path / "out")]
    assert main([*words, "--files", str(tmp_path / "none")]) == 1
    assert "is not a folder" in capsys.readouterr().err


@pytest.mark.long
def test_a_folder_of_files_has_to_replace_something(tmp_path, capsys):
    words = ["reproduce", "guiss", "--pairs", "1", "--dry-run", "--out", str(tmp_path / "out")]
    (tmp_path / "files").mkdir()
    assert main([*words, "--files", str(tmp_path / "files")]) == 1
    assert "no file in" in capsys.readouterr().err


@pytest.mark.parametrize("name", OUTPUT_FILES)
def test_tables_of_others_are_not_overwritten(tmp_path, capsys, name):
    (tmp_path / name).write_text("mine")
    assert main(["reproduce", "guiss", "--dry-run", "--out", str(tmp_path)]) == 1
    assert f"{name} already exists" in capsys.readouterr().err
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize(
    "words",
    [["reproduce", "guiss"], ["study", "recipes"], ["validate", "--only", "colours"]],
    ids=["reproduce", "study", "validate"],
)
@pytest.mark.parametrize("below", ["", "more/and/more"])
def test_a_file_in_the_place_of_the_folder_is_refused_before_any_work(tmp_path, capsys, words, below):
    """Without the check at the start, each verb fails only when it writes its plan or its tables."""
    (tmp_path / "mine").write_text("mine")
    assert main([*words, "--out", str(tmp_path / "mine" / below)]) == 1
    told = capsys.readouterr()
    assert f"--out: {tmp_path / 'mine'} is a file, not a folder" in told.err
    assert told.err.count("\n") == 1
    assert told.out == ""
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_study_asks_for_its_matchers_before_it_renders(tmp_path, capsys):
    assert main(["study", "size", "--methods", "bm,nonesuch", "--out", str(tmp_path / "out")]) == 1
    assert "nonesuch" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
