"""What Blender wrote about an exported ground is read back, or is one sentence."""

from __future__ import annotations

import pytest
from hostile_arrays import NO_FILES, put
from icymoon.errors import IcyMoonError
from icymoon.stereo.export.ground import read_geometry

DAMAGED = {"empty": b"", "list": b"[]", "without": b"{}", "number": b'{"left_out": 5}',
           "numbers": b'{"left_out": [5]}', "cut": b'{"left_out": ["rocks"', "deep": b'{"left_out": ' + b"[" * 50_000,
           "nan": b'{"left_out": [], "a": NaN}',
           "5000 digits": b'{"left_out": [], "a": ' + b"1" * 5000 + b"}", "surrogate": b'{"left_out": ["\\ud800"]}',
           "no UTF-8": b'{"left_out": ["\xff"]}', "infinite": b'{"left_out": [], "a": 1e999}'}


def test_what_was_written_is_read(tmp_path):
    put(tmp_path / "geometry.json", b'{"left_out": ["its rocks"], "cell_m": 0.5}')
    assert read_geometry(tmp_path) == {"left_out": ["its rocks"], "cell_m": 0.5}


@pytest.mark.parametrize("what", [*NO_FILES, *DAMAGED])
def test_anything_else_is_one_sentence(tmp_path, what):
    put(tmp_path / "geometry.json", DAMAGED.get(what, what))
    with pytest.raises(IcyMoonError, match=r"geometry\.json.*export the ground again\.$"):
        read_geometry(tmp_path)
