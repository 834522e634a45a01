"""Comparisons: their verdicts, how they run, and those of a user."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.commands.run_validation import choose_comparisons
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT
from icymoon.validation.all_comparisons import MODULES, load_comparisons
from icymoon.validation.comparison import (
    FAILS,
    NOT_JUDGED,
    PASSES,
    Bench,
    Comparison,
    Row,
    load_own_comparison,
    run_comparison,
)
from icymoon.validation.tables import make_markdown_section, make_row_cells, replace_sections, summarise_result

#: The page that sums up, and the one with all numbers.
PAGE, DETAILS = (
    (ROOT / "docs" / "theory" / name).read_text(encoding="utf-8") for name in ("validation.md", "validation-details.md")
)

OWN = """
from icymoon.validation.comparison import Comparison, Row
COMPARISON = Comparison("mine", "Mine", "Why.", lambda bench: [Row("size", {ours}, 1.0, 0.1, "a ruler")])
"""


@pytest.mark.parametrize(
    ("ours", "more", "verdict", "note"),
    [
        (1.1, {}, PASSES, ""),
        (1.11, {}, FAILS, ""),
        (0.89, {"why": "Cause: known"}, FAILS, "Cause: known"),
        (1.0, {"why": "Likely cause: a guess"}, PASSES, ""),
        (1.1, {"fitted": True}, NOT_JUDGED, "Not judged: ours was fitted to it"),
        (1.11, {"fitted": True}, FAILS, ""),
        (1.11, {"unjudged": "it is no snow"}, NOT_JUDGED, "Not judged: it is no snow"),
        (1.0, {"unjudged": "it is no snow"}, NOT_JUDGED, "Not judged: it is no snow"),
        (math.nan, {}, FAILS, ""),
        (math.nan, {"fitted": True}, FAILS, ""),
        (math.inf, {"why": "Cause: known"}, FAILS, "Cause: known"),
    ],
)
def test_verdicts(ours, more, verdict, note):
    row = Row("x", ours, 1.0, 0.1 + 1e-12, "source", **more)
    assert (row.verdict, row.note) == (verdict, note)
    json.dumps(row.to_json(), allow_nan=False)


def _made(tmp_path, *rows):
    return run_comparison(Comparison("a", "A", "", lambda bench: list(rows)), Bench(tmp_path))


def test_one_row_that_fails_fails_the_comparison_whatever_its_cause(tmp_path):
    good, fitted = Row("a", 1.0, 1.0, 0.1, "s"), Row("b", 1.0, 1.0, 0.1, "s", fitted=True)
    assert _made(tmp_path, good, fitted).passes
    assert "passes; of 2 numbers 1 pass, 1 are not judged." in summarise_result(_made(tmp_path, good, fitted))
    found = _made(tmp_path, good, Row("c", 2.0, 1.0, 0.1, "s", why="Likely cause: noise"), fitted)
    assert not found.passes
    assert "FAILS; of 3 numbers 1 pass, 1 fail, 1 are not judged." in summarise_result(found)
    assert "| fails | 1, 2 |" in make_markdown_section(found)
    assert make_markdown_section(found).endswith(
        "\n\n1. s.\n2. Likely cause: noise.\n3. Not judged: ours was fitted to it.\n"
    )
    assert not _made(tmp_path, good, Row("d", 1.2, 1.0, 0.1, "s", fitted=True)).passes


def test_a_comparison_that_judged_nothing_does_not_pass(tmp_path):
    assert not _made(tmp_path, Row("a", 1.0, 1.0, 0.1, "s", unjudged="it is no snow")).passes


def test_a_comparison_that_cannot_be_made_fails_with_its_sentence(tmp_path):
    def refuse(bench):
        raise IcyMoonError("No lamp is there; buy one.")

    found = run_comparison(Comparison("lamp", "Lamp", "", refuse), Bench(tmp_path))
    assert not found.passes
    assert "buy one" in summarise_result(found)
    assert "Not made: No lamp" in make_markdown_section(found)
    assert not run_comparison(Comparison("none", "None", "", lambda bench: []), Bench(tmp_path)).passes


def test_a_users_own_file(tmp_path, capsys):
    file = tmp_path / "mine.py"
    for ours, status in ((1.05, 0), (2.0, 1)):
        file.write_text(OWN.format(ours=ours), encoding="utf-8")
        assert (
            main(["validate", "--own", str(file), "--only", "mine", "--out", str(tmp_path / "out"), "--json"]) == status
        )
        report = json.loads(capsys.readouterr().out)
        assert report["passes"] == (status == 0)
        assert report == json.loads((tmp_path / "out" / "validation.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (None, "There is no comparison"),
        ("x = 1", "has no comparison"),
        ("import nowhere_at_all", "cannot be run"),
        ("COMPARISON = 3", "has no comparison"),
        ("def f(:", "cannot be run"),
    ],
)
def test_a_bad_file_is_one_sentence(tmp_path, text, word):
    file = tmp_path / "mine.py"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError, match=word):
        load_own_comparison(file)


@pytest.mark.parametrize(
    ("compare", "word"),
    [
        ("1 / 0", r"mine.py, line 3: the comparison fails \(ZeroDivisionError: division by zero\)"),
        ("3", "returns int and not a list of Row"),
        ("[('size', 1.0)]", "returns list and not a list of Row"),
        ("[Row('size', '1', 1.0, 0.1, 's')]", "row 'size' are not all numbers"),
    ],
)
def test_what_fails_in_a_users_comparison_is_one_sentence(tmp_path, compare, word):
    file = tmp_path / "mine.py"
    file.write_text(
        "from icymoon.validation.comparison import Comparison, Row\ndef compare(bench):\n"
        f"    return {compare}\nCOMPARISON = Comparison('mine', 'Mine', 'Why.', compare)\n",
        encoding="utf-8",
    )
    found = run_comparison(load_own_comparison(file), Bench(tmp_path))
    assert not found.passes
    assert re.search(word, found.error)


def test_a_users_comparison_may_return_numpys_numbers_and_sentences_of_ours(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("import numpy as np\n" + OWN.format(ours="np.float32(1)"), encoding="utf-8")
    assert run_comparison(load_own_comparison(file), Bench(tmp_path)).passes
    file.write_text(OWN.format(ours=1).replace("[Row", "bench.render(3) or [Row"), encoding="utf-8")
    assert "line 3" in run_comparison(load_own_comparison(file), Bench(tmp_path)).error


def test_a_users_comparison_cannot_need_an_option_that_is_not_there(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(OWN.format(ours=1).rstrip()[:-1] + ", needs='mars')", encoding="utf-8")
    with pytest.raises(IcyMoonError, match="no option gives the folder of needs='mars'"):
        load_own_comparison(file)


def test_a_picture_is_a_png_file_in_the_folder(tmp_path):
    Bench(tmp_path).draw("one", np.full((3, 4, 3), 7, np.uint8))
    assert (cv2.imread(str(tmp_path / "pictures" / "one.png")) == np.full((3, 4, 3), 7)).all()


def test_names_on_the_command_line_are_those_of_the_comparisons():
    assert [each.name for each in load_comparisons()] == list(MODULES)


def test_other_verbs_import_no_comparison():
    program = (
        "import sys\nfrom icymoon.commands.cli import main\nmain(['presets'])\n"
        "print(*(name for name in sys.modules if name.startswith('icymoon.validation.')), file=sys.stderr)"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=240, check=False)
    assert ended.stderr.split() == []


def test_choosing(tmp_path):
    assert [each.name for each in choose_comparisons(["codes"], [], False)] == ["codes"]
    assert all(each.quick for each in choose_comparisons([], [], True))
    with pytest.raises(IcyMoonError, match="did you mean 'albedos'"):
        choose_comparisons(["albdos"], [], False)
    file = tmp_path / "mine.py"
    file.write_text(OWN.replace('"mine"', '"codes"').format(ours=1), encoding="utf-8")
    with pytest.raises(IcyMoonError, match="rename yours"):
        choose_comparisons([], [file], False)


def test_sections_of_a_page_are_renewed_and_the_rest_stays(tmp_path):
    comparison = Comparison("a", "A", "Text.", lambda bench: [Row("q | r", 1.0, 1.0, 0.0, "s", unit="m")])
    result = run_comparison(comparison, Bench(tmp_path))
    page = "# Page\n\nIntro.\n\n## A\n\nold\n\n## Last\n\nEnd.\n"
    new = replace_sections(page, [result])
    assert "old" not in new
    assert "| q \\| r | 1 m | 1 m |" in new
    assert new.startswith("# Page\n\nIntro.\n\n## A\n")
    assert new.endswith("## Last\n\nEnd.\n")
    assert replace_sections(new, [result]) == new
    assert replace_sections("# Page\n\n## Last\n\nEnd.\n", [result]) == new.replace("Intro.\n\n", "")


def test_lines_of_a_text_are_paragraphs_and_items(tmp_path):
    text = f"One.\n\n* {'a ' * 70}\n* b\n\nLast."
    section = make_markdown_section(
        run_comparison(Comparison("a", "A", text, lambda bench: [Row("q", 1, 1, 0, "s")]), Bench(tmp_path))
    )
    lines = section.splitlines()
    assert lines[2:4] == ["One.", ""]
    assert lines[4].startswith("* a a")
    assert lines[5].startswith("    a a")
    assert lines[6:9] == ["* b", "", "Last."]
    assert max(map(len, lines)) <= 120


def test_a_figure_is_below_the_command(tmp_path):
    comparison = Comparison("a", "A", "Text.", lambda bench: [Row("q", 1.0, 1.0, 0.0, "s")], figure="![Twins](a.png)")
    section = make_markdown_section(run_comparison(comparison, Bench(tmp_path)))
    assert f"`{comparison.command}`\n\n![Twins](a.png)\n\n| quantity" in section


@pytest.mark.parametrize("name", ["albedos", "colours", "codes"])
def test_comparisons_that_need_no_blender_are_those_of_the_page(tmp_path, name):
    (comparison,) = choose_comparisons([name], [], True)
    found = run_comparison(comparison, Bench(tmp_path, quick=True))
    section = section_of(DETAILS, comparison.title)
    assert " ".join(comparison.text.split()) in " ".join(section.split())
    # What is ours and by how much it is off may differ in the last digit between machines.
    assert [(quantity, *line[1:3], line[4]) for quantity, *line in table_of(section)] == [
        (quantity, *rest[1:3], rest[4]) for quantity, *rest in map(make_row_cells, found.rows)
    ]


def section_of(page, title):
    """The text under a heading of a page."""
    return page.split(f"\n## {title}\n")[1].split("\n## ")[0]


def table_of(section):
    """The cells of the rows of a section's table."""
    return [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")][2:]


@pytest.mark.parametrize("page", [PAGE, DETAILS], ids=["page", "details"])
def test_the_manual_has_a_section_of_every_comparison(page):
    for each in load_comparisons():
        assert f"`{each.command}`" in section_of(page, each.title)


def test_the_page_counts_the_verdicts_of_the_details():
    counted = {row[0].split("]")[0][1:]: [int(cell) for cell in row[2:]] for row in table_of(PAGE.split("\n## ")[0])}
    for each in load_comparisons():
        verdicts = [row[5] for row in table_of(section_of(DETAILS, each.title))]
        kinds = [verdicts.count(kind) for kind in (PASSES, FAILS, NOT_JUDGED)]
        assert counted.pop(each.title) == [len(verdicts), *kinds]
        assert sum(kinds) == len(verdicts)
    assert not counted


@pytest.mark.parametrize("each", load_comparisons(), ids=lambda each: each.name)
def test_every_note_of_the_details_is_used_and_every_row_has_its_source(each):
    section = section_of(DETAILS, each.title)
    notes = dict(re.findall(r"(?m)^(\d+)\. (.*)$", section))
    rows = [(row[5], row[6].split(", ")) for row in table_of(section)]
    assert set(notes) == {number for _, numbers in rows for number in numbers}
    for verdict, (source, *why) in rows:
        assert not re.match("Cause|Likely|Not judged", notes[source])
        assert len(why) <= 1
        assert (verdict == PASSES) <= (not why)
        assert (verdict == NOT_JUDGED) == (bool(why) and notes[why[0]].startswith("Not judged: "))


@pytest.mark.parametrize("name", ["albedos", "colours", "codes"])
def test_what_takes_seconds_is_in_the_manual(name, tmp_path):
    (comparison,) = (each for each in load_comparisons() if each.name == name)
    found = run_comparison(comparison, Bench(tmp_path, quick=True))
    assert not found.error
    assert make_markdown_section(found) in DETAILS
