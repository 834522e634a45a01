"""In a Blender program the package OpenEXR crashes, so nothing may load it there."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pairs
import pytest
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.stereo.environment.packages import is_in_blender, require_modules
from icymoon.stereo.images.views import read_eye
from icymoon.support.errors import IcyMoonError


@pytest.mark.parametrize(
    ("app", "inside"),
    [
        (SimpleNamespace(binary_path="/usr/bin/blender", module=False), True),
        (SimpleNamespace(binary_path="/usr/bin/blender"), True),
        (SimpleNamespace(binary_path=""), False),
        (SimpleNamespace(binary_path="/python", module=True), False),
    ],
    ids=["4.3 on", "4.2", "module 4.2", "module"],
)
def test_a_program_is_told_from_the_module(app, inside, monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(app=app))
    assert is_in_blender() == inside
    monkeypatch.delitem(sys.modules, "bpy")
    assert not is_in_blender()


def test_pairs_are_read_without_the_package_and_what_needs_it_is_refused(tmp_path, monkeypatch):
    pair = read_pair(pairs.write_pair(tmp_path / "pairs" / "0123456789ab"))
    with_package = read_eye(pair, "left")[1].radiance
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(app=SimpleNamespace(binary_path="/blender", module=False)))
    monkeypatch.setitem(sys.modules, "OpenEXR", None)  # whoever imports it gets an ImportError
    assert np.array_equal(read_eye(pair, "left")[1].radiance, with_package)
    with pytest.raises(IcyMoonError, match="crash inside Blender"):
        require_modules("numpy", "OpenEXR")
