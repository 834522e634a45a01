"""A log of rows that someone else has written or changed: rows are read, anything else is left out."""

from __future__ import annotations

import json

import pytest
from hostile_arrays import flipped, put
from icymoon.stereo.report import row_log
from icymoon.stereo.report.row_log import RowLog
from icymoon.support.errors import IcyMoonError

ROW = {"pair": "a", "method": "bm", "key": "k"}
LINE = json.dumps(ROW).encode() + b"\n"
LINES = {
    "empty": b"\n",
    "text": b"x\n",
    "list": b"[]\n",
    "null": b"null\n",
    "nan": b'{"pair": "a", "method": "bm", "key": NaN}\n',
    "deep": b"[" * 50_000 + b"\n",
    "5000 digits": b"1" * 5000 + b"\n",
    "NUL": b"\0" * 40 + b"\n",
    "no UTF-8": b"\xff\xfe\n",
    "no key": b'{"pair": "a", "method": "bm"}\n',
    "number": b'{"pair": 1, "method": "bm", "key": "k"}\n',
    "outside": b'{"pair": "../a", "method": "bm", "key": "k"}\n',
    "surrogate": b'{"pair": "\\ud800", "method": "b", "key": "k"}\n',
    "return": b"\r\n",
    "huge number": b'{"pair": "a", "method": "bm", "key": 1e999}\n',
    "half": LINE[:10] + b"\n",
    "two in one": LINE[:-1] + LINE,
}


@pytest.mark.parametrize("kind", LINES)
def test_other_lines_are_left_out(tmp_path, kind):
    path = tmp_path / "results.jsonl"
    path.write_bytes(LINES[kind] + LINE + LINES[kind])
    log = RowLog(path)
    assert log.find("a", "bm", "k") == ROW
    log.append(ROW | {"pair": "b"})
    assert RowLog(path).find("b", "bm", "k") == ROW | {"pair": "b"}


@pytest.mark.parametrize("ends", [True, False])
def test_a_line_without_end_takes_no_memory(tmp_path, monkeypatch, ends):
    monkeypatch.setattr(row_log, "_LONGEST_ROW", 100)
    path = tmp_path / "results.jsonl"
    for length in (99, 100, 101, 199, 200, 201, 5000):
        path.write_bytes(LINE + b"x" * length + (b"\n" + LINE.replace(b'"a"', b'"b"') if ends else b""))
        log = RowLog(path)
        assert log.find("a", "bm", "k") == ROW
        assert (log.find("b", "bm", "k") is not None) == ends
        assert (path.read_bytes() == LINE) != ends  # what was cut off goes


def test_a_row_of_the_longest_length_is_read(tmp_path, monkeypatch):
    path = tmp_path / "results.jsonl"
    for spare in (0, 1, -1):
        monkeypatch.setattr(row_log, "_LONGEST_ROW", len(LINE) + spare)
        path.write_bytes(LINE + LINE.replace(b'"a"', b'"b"'))
        assert (RowLog(path).find("b", "bm", "k") is not None) == (spare >= 0)


@pytest.mark.parametrize("place", ["pipe", "folder", "device"])
def test_what_is_no_regular_file_is_a_sentence(tmp_path, place):
    path = tmp_path / "results.jsonl"
    put(path, place)
    with pytest.raises(IcyMoonError, match=r"results\.jsonl"):
        RowLog(path)


def test_a_file_that_changes_meanwhile_is_a_sentence(tmp_path):
    path = tmp_path / "results.jsonl"
    path.write_bytes(LINE)
    log = RowLog(path)
    for data in (b"", b"x" * 500, LINE.replace(b'"a"', b'"b"'), b"[" * 50_000):
        path.write_bytes(data)
        with pytest.raises(IcyMoonError, match="evaluate again"):
            log.read("a", "bm")


@pytest.mark.heavy
def test_random_damage_loses_only_the_rows_it_hits(tmp_path):
    path = tmp_path / "results.jsonl"
    rows = b"".join(LINE.replace(b'"a"', b'"p%d"' % k) for k in range(20))
    for data in flipped(rows, 1000):
        path.write_bytes(data)
        log = RowLog(path)
        assert sum(log.find(f"p{k}", "bm", "k") is not None for k in range(20)) >= 20 - 2 * 3
