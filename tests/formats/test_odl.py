"""Labels of PDS3: what a tokenizer must get right, and that nothing of a stranger's makes it slow or deep."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from icymoon.formats.odl import parse_label

pytestmark = pytest.mark.timeout(20)
LABEL = """PDS_VERSION_ID = PDS3  /* a comment with = and "quotes */
^IMAGE = ("A.IMG", 12 <BYTES>)
GROUP = GEOMETRY
  NAME = "two
     lines, one = text"
  SYMBOL = 'N/A'
  VECTOR = (1.5 <m>, -2e3,
            3)
  SET = {A, "B",
     {C}}
  ROWS = ((1, 2), (3, 4))
  OBJECT = INNER
    msl:key = 16#FF#
    EMPTY = ()
  END_OBJECT = INNER
  START_TIME = 2004-01-05T12:00:00.000Z
END_GROUP
AFTER = 1
AFTER = 1
AGAIN = 1
AGAIN = 2
END
\0\xff ( { " GROUP = no part of it
"""


def test_a_label_is_its_statements():
    label = parse_label(LABEL)
    assert label.values == {"PDS_VERSION_ID": "PDS3", "^IMAGE": ["A.IMG", "12"], "AFTER": "1", "AGAIN": "1"}
    assert label.unclear == {"AGAIN"}
    geometry, inner = label.list_all_groups()[1:]
    assert (geometry.name, inner.name) == ("GEOMETRY", "INNER")
    assert geometry.values == {
        "NAME": "two\n     lines, one = text",
        "SYMBOL": "N/A",
        "VECTOR": ["1.5", "-2e3", "3"],
        "SET": ["A", "B", ["C"]],
        "ROWS": [["1", "2"], ["3", "4"]],
        "START_TIME": "2004-01-05T12:00:00.000Z",
    }
    assert inner.values == {"MSL:KEY": "16#FF#", "EMPTY": []}


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_text_without_quotes_spoils_only_itself(end):
    label = parse_label(end.join(("A = 1", "NOTE = taken by hand", "B = 2", "", "END")))
    assert (label.values["A"], label.values["NOTE"], label.values["B"]) == ("1", "taken", "2")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('A = 1\nB = "no end', "line 2: a quotation"),
        ("A = 'no end", "line 1: a quotation"),
        ("/* no end", "comment"),
        ("A = <m", "unit"),
        ("A = (1, 2", r"'\(' without its '\)'"),
        ("A = {1)", "out of place"),
        ("A =", "without a value"),
        ("A = = 3", "out of place"),
        ("END_GROUP = A", "has not begun"),
        ("A = 1\nEND_OBJECT\n", "line 2: the end of a"),
        ("GROUP = (A)", "is a sequence"),
        ("GROUP = A\n" * 33, "nested too deeply"),
        ("A = " + "(" * 10**5, "out of place"),
        ("A = ," * 9, "out of place"),
        ('A = "\n' * 10**5 + "B = '", "a quotation"),
    ],
)
def test_what_is_no_label_is_told_with_its_line(text, words):
    with pytest.raises(ValueError, match=words):
        parse_label(text)


@pytest.mark.ci_takes(8)
@pytest.mark.parametrize(
    "text",
    [
        "\n" * 10**6,
        " " * 10**6,
        "A" * 10**6,
        "/*" * 10**5 + "*/",
        "<>" * 10**5,
        "=" * 10**6,
        "," * 10**6,
        "/ " * 10**5,
        "A = B\n" * 10**5,
        "A = (" + "1," * 10**5 + ")",
        "GROUP = A END_GROUP\n" * 10**5,
        '""' * 10**5,
        "(" * 10**5,
        "END",
        "\0" * 10**5,
        "\x1b[31m = 1",
        "A = \ud7ff\U0010ffff",
        "OBJECT = A\n" * 30 + "B = C\n" * 10**4,
        "A/" * 10**5,
        "",
    ],
)
def test_a_text_takes_time_in_proportion_to_its_length(text):
    with suppress(ValueError):
        parse_label(text)


@pytest.mark.parametrize("seed", range(10))
def test_a_damaged_label_is_read_or_refused(seed):
    random = np.random.default_rng(seed)
    for _ in range(150):
        data = bytearray(LABEL.encode("latin-1"))
        for at in random.integers(0, len(data), 3):
            data[at] = random.integers(0, 256)
        with suppress(ValueError):
            parse_label(data.decode("utf-8", "replace"))
