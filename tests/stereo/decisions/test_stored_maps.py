"""The maps of decisions read back: as they were written, or a sentence; and outlines against areas."""

from __future__ import annotations

import json

import numpy as np
import pytest
import workspaces
from icymoon.stereo.decide import decide_pairs
from icymoon.stereo.decisions import stored_maps
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.decisions.stored_maps import (
    HEIGHT_ERROR,
    SLOPE,
    SUITABILITY,
    TRUE_DEPTH,
    list_methods,
    read_map,
    trace_outlines,
)
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError


@pytest.fixture(scope="module")
def decided(tmp_path_factory):
    """The decisions of StereoBM on a pair."""
    folder = tmp_path_factory.mktemp("decided")
    decide_pairs([workspaces.write(folder / "pairs" / "a")], parse_methods("bm"), folder / "decisions", read_rules())
    return folder / "decisions"


def test_what_was_written_is_read(decided):
    report = json.loads((decided / "decisions.json").read_text())
    truth = np.load(decided / "pairs" / "a" / "truth_dem.npy")
    assert list_methods(decided) == ["bm", TRUE_DEPTH]
    assert stored_maps.list_pairs(decided, "bm") == ["a"]
    for label, name in (("bm", "bm"), (TRUE_DEPTH, "true_depth")):
        files = {
            kind: np.load(decided / "pairs" / "a" / f"{name}_{kind}.npy") for kind in ("dem", "suitability", "slope")
        }
        maps = {kind: read_map(decided, "a", label, kind) for kind in (SUITABILITY, SLOPE, HEIGHT_ERROR)}
        np.testing.assert_array_equal(maps[SUITABILITY].values, files["suitability"])
        np.testing.assert_array_equal(maps[SLOPE].values, files["slope"])
        np.testing.assert_allclose(maps[HEIGHT_ERROR].values, files["dem"] - truth, atol=1e-6)
        (chosen,) = (row["numbers"]["sites"]["chosen"] for row in report["rows"] if row["method"] == label)
        assert maps[SLOPE].chosen == (None if chosen is None else tuple(chosen))
        assert maps[SLOPE].reach is None  # no arm
    exact = read_map(decided, "a", TRUE_DEPTH, HEIGHT_ERROR)
    assert exact.grid.west_m == pytest.approx(-0.6)
    # Half of the cells at least are level ground that is seen, whose depth is exact to a millimetre.
    assert np.mean(np.abs(exact.values) < 1e-3) > 0.5


def test_the_verdict_of_a_calibration_is_read(decided, tmp_path):
    copy = copied(decided, tmp_path)
    report = json.loads((copy / "decisions.json").read_text())
    for row in report["rows"]:
        row["guarantee"] = {"verdict": "abstains"} if row["method"] == "bm" else None
    (copy / "decisions.json").write_text(json.dumps(report))
    assert read_map(copy, "a", "bm", SLOPE).guarantee == "abstains"
    assert read_map(copy, "a", TRUE_DEPTH, SLOPE).guarantee == read_map(decided, "a", "bm", SLOPE).guarantee == ""


def test_an_arms_reach_is_read(decided, tmp_path):
    copy = copied(decided, tmp_path)
    change(copy, arm=True)
    assert (read_map(copy, "a", "bm", SLOPE).reach == np.load(copy / "pairs" / "a" / "reach.npy")).all()


def copied(decided, folder):
    for path in decided.rglob("*.*"):
        target = folder / path.relative_to(decided)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(path.read_bytes())
    return folder


def change(folder, **entries):
    path = folder / "pairs" / "a" / "decisions.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | entries))


def test_no_damaged_or_foreign_file_is_read(decided, tmp_path):
    copy = copied(decided, tmp_path / "copy")
    path = copy / "pairs" / "a" / "bm_slope.npy"
    good = path.read_bytes()
    header = {"descr": "<f4", "fortran_order": False, "shape": (10**6, 10**6)}
    with path.open("wb") as stream:
        np.lib.format.write_array_header_1_0(stream, header)
    huge = path.read_bytes()
    np.save(path, np.array([["x", {}]], object), allow_pickle=True)
    pickled = path.read_bytes()
    np.save(path, np.zeros((30, 30), np.complex64))
    other_type = path.read_bytes()
    np.save(path, np.zeros((3, 30), np.float32))
    for content in (b"", good[:200], huge, pickled, other_type, path.read_bytes(), b"PK\x03\x04"):
        path.write_bytes(content)
        with pytest.raises(IcyMoonError, match="press Decide Where to Dig again"):
            read_map(copy, "a", "bm", SLOPE)
    path.write_bytes(good)
    np.save(tmp_path / "outside.npy", np.zeros((30, 30), np.float32))
    for entries in (
        {"rows": 0},
        {"rows": 5000},
        {"origin_m": [1.0]},
        {"cell_m": 0},
        {"images": {"truth_dem": "../outside.npy"}},
        {"images": {"truth_dem": "a\0.npy"}},
    ):
        saved = (copy / "pairs" / "a" / "decisions.json").read_text()
        change(copy, **entries)
        with pytest.raises(IcyMoonError, match="press Decide Where to Dig again"):
            read_map(copy, "a", "bm", SLOPE)
        (copy / "pairs" / "a" / "decisions.json").write_text(saved)
    with pytest.raises(IcyMoonError, match="no decisions on pair b"):
        read_map(copy, "b", "bm", SLOPE)
    assert list_methods(tmp_path / "nowhere") == []


def test_a_report_of_any_size_is_not_read(decided, tmp_path, monkeypatch):
    monkeypatch.setattr(stored_maps, "_MAX_BYTES", 100)
    with pytest.raises(IcyMoonError, match="larger than"):
        read_map(decided, "a", "bm", SLOPE)


def test_outlines_enclose_the_cells():
    """Their areas by Gauss's formula, holes less, are the number of cells, and their edges those between cells."""
    random = np.random.default_rng(3)
    for shape in ((1, 1), (7, 9), (20, 20)):
        cells = random.random(shape) < 0.6
        ways = trace_outlines(cells)
        area = sum(float((way[:, 1] * (np.roll(way[:, 0], -1) - np.roll(way[:, 0], 1))).sum()) / 2 for way in ways)
        padded = np.pad(cells, 1).astype(int)
        assert area == cells.sum()
        assert sum(map(len, ways)) == sum(int(np.abs(np.diff(padded, axis=axis)).sum()) for axis in (0, 1))
    assert trace_outlines(np.zeros((4, 4), bool)) == []
