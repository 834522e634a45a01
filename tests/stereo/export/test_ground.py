"""What Blender wrote about an exported ground is read back, or is one sentence; and which pairs share its files."""

from __future__ import annotations

import pytest
from hostile_arrays import NO_FILES, put
from icymoon.settings.description import check, defaults, merged
from icymoon.stereo.export.ground import FORMATS, _make_files_key, read_geometry
from icymoon.support.errors import IcyMoonError

DAMAGED = {
    "empty": b"",
    "list": b"[]",
    "without": b"{}",
    "number": b'{"left_out": 5}',
    "numbers": b'{"left_out": [5]}',
    "cut": b'{"left_out": ["rocks"',
    "deep": b'{"left_out": ' + b"[" * 50_000,
    "nan": b'{"left_out": [], "a": NaN}',
    "5000 digits": b'{"left_out": [], "a": ' + b"1" * 5000 + b"}",
    "surrogate": b'{"left_out": ["\\ud800"]}',
    "no UTF-8": b'{"left_out": ["\xff"]}',
    "infinite": b'{"left_out": [], "a": 1e999}',
}


def test_what_was_written_is_read(tmp_path):
    put(tmp_path / "geometry.json", b'{"left_out": ["its rocks"], "cell_m": 0.5}')
    assert read_geometry(tmp_path) == {"left_out": ["its rocks"], "cell_m": 0.5}


@pytest.mark.parametrize("what", [*NO_FILES, *DAMAGED])
def test_anything_else_is_one_sentence(tmp_path, what):
    put(tmp_path / "geometry.json", DAMAGED.get(what, what))
    with pytest.raises(IcyMoonError, match=r"geometry\.json.*export the ground again\.$"):
        read_geometry(tmp_path)


DISPLACED = {"surface": {"relief": "DISPLACEMENT", "grain_amplitude_m": 0.01}}
BRIGHT, ROUGH = {"surface": {"albedo": 0.4}}, {"surface": {"grain_amplitude_m": 0.02}}
LANDER = {"lander": {"kind": "PARAMETRIC"}}


@pytest.mark.parametrize(
    ("base", "change", "apart"),
    [
        ({}, {"light": {"sun_elevation_deg": 9.0}}, ()),
        ({"surface": {"relief": "BUMP"}}, BRIGHT, ("dem",)),
        ({"surface": {"relief": "BUMP"}}, ROUGH, ("dem",)),
        (DISPLACED, ROUGH, FORMATS),
        ({"surface": {"relief": "BUMP"}}, LANDER, FORMATS[1:]),
    ],
    ids=str,
)
def test_pairs_share_a_file_only_if_it_is_the_same(base, change, apart):
    one, other = (merged(defaults(), *(check(part, "test") for part in parts)) for parts in ((base,), (base, change)))
    assert tuple(kind for kind in FORMATS if _make_files_key(one, kind) != _make_files_key(other, kind)) == apart
