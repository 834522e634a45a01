"""Show Camera Image: the rendered pair through another camera response, from Blender."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest


def test_the_rendered_pair_is_exposed_with_the_present_response(small, tmp_path):
    with pytest.raises(RuntimeError, match="press Render Stereo Pair"):
        bpy.ops.icymoon.expose()
    assert bpy.ops.icymoon.build_scene() == {"FINISHED"}
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    shown = {}
    for bits in (8, 12):
        small.icymoon.sensor.bits = bits
        assert bpy.ops.icymoon.expose() == {"FINISHED"}
        (folder,) = (tmp_path / "dataset" / "exposed").iterdir()
        shown[bits] = json.loads((folder / "images.json").read_text())["image_bits"]
        assert (Path(folder) / "left.png").is_file()
    assert shown == {8: 8, 12: 12}
    assert len(list((tmp_path / "dataset" / "pairs").iterdir())) == 1  # nothing was rendered for it
