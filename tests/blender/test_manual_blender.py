"""What the manual says of operators and of the pair folder is what Blender and a rendered pair have."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import bpy
import OpenEXR
from icymoon.render.passes import UNWANTED
from icymoon.version import ROOT
from rendering import render

sys.path.insert(0, str(ROOT / "docs" / "make"))
import reference

PAGE = (ROOT / "docs" / "reference" / "pair.md").read_text(encoding="utf-8")


def test_the_page_of_operators_has_what_is_registered(registered):
    listed = {operator.name: operator for operator in reference.operators()}
    assert set(listed) == {f"icymoon.{name}" for name in dir(bpy.ops.icymoon)}
    for name, operator in listed.items():
        rna = getattr(bpy.ops.icymoon, name.removeprefix("icymoon.")).get_rna_type()
        assert (operator.label, operator.description) == (rna.name, rna.description)
        shown = {prop.identifier: (prop.name, prop.description) for prop in rna.properties
                 if prop.identifier != "rna_type" and not prop.is_hidden}
        assert operator.properties == shown


def test_the_page_of_the_pair_folder_has_what_a_pair_holds(registered, tmp_path: Path):
    pair, _ = render(tmp_path, {"quality": {"samples": 1}, "light": {"planet": True, "planet_elevation_deg": 40.0},
                                "rig": {"width_px": 32, "height_px": 24}})
    written = set(re.findall(r"`(\w+)`", PAGE.split("## pair.json")[1].split("## Reading it")[0]))
    assert set(pair.data) - written == set()
    passes = set(re.findall(r"`((?:Beauty|Truth)\.[\w ]+)`", PAGE))
    with OpenEXR.File(str(pair.image("left"))) as file:
        channels = [name for part in file.parts for name in part.channels]
    #: Blender adds these by itself: the truth's own colour, and each image before the denoiser.
    spare = ("Truth.Combined", "Beauty.Noisy Image")
    if bpy.app.version < (5, 0, 0):  # one part for a whole render, of which nothing can be left out
        spare += tuple(UNWANTED)
    for channel in channels:
        assert channel.startswith((*passes, *spare)), channel
    for name in passes - {"Truth.IndexMA", "Truth.IndexOB", "Truth.Material Index", "Truth.Object Index"}:
        assert any(channel.startswith(name) for channel in channels), name
    for label, meaning in re.findall(r"(?m)^\| (\d) \| (\w+)", PAGE):
        assert pair.data["channels"]["semantic"][label] == meaning
