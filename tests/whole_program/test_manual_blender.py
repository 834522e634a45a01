"""What the manual says of operators and of the pair folder is what Blender and a rendered pair have."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from icymoon.render.passes import UNWANTED_PASSES
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth
from icymoon.stereo.images.exr import read_view
from icymoon.support.version import ROOT
from rendering import render

sys.path.insert(0, str(ROOT / "docs" / "make"))
import manual
import reference

PAGE = (ROOT / "docs" / "reference" / "pair.md").read_text(encoding="utf-8")


#: What a camera may do to the files of a pair, beside the plain one.
CAMERAS = (
    {"overscan": 0.25},
    {"focus_distance_m": 1.0},
    {"toe_in_deg": 4.0},
    {"overscan": 0.25, "focus_distance_m": 1.0, "toe_in_deg": 4.0, "speed_right_m_s": 1.0, "motion_exposure_s": 0.01},
)
#: The Python that reads the truth of any pair; the thickness of loose material is not in every pair.
PIECES = [
    block
    for block in manual.blocks()
    if block.language == "python" and "DATASET" in block.code and "loose_thickness_m" not in block.code
]


def test_the_python_of_the_manual_gives_the_truth_whatever_the_camera(registered, tmp_path, monkeypatch):
    """The truth is that of the plain rig: the manual's lines give it, of its size, for every camera."""
    monkeypatch.chdir(tmp_path)
    scene = {"quality": {"samples": 1}, "rig": {"width_px": 48, "height_px": 36, "distortion_k1": 0.0}}
    plain = render(tmp_path / "plain", scene)[0]
    depth_m = find_scene_depth(read_view(plain.image("left"), "left"))
    assert len(PIECES) == 2
    for k, rig in enumerate(CAMERAS):
        render(tmp_path / "data" / str(k), scene, {"rig": rig})
        for piece in PIECES:
            (tmp_path / "piece.py").write_text(piece.code.replace("DATASET", f"data/{k}"))
            found = runpy.run_path("piece.py")
            truth = found["depth_m"] if "depth_m" in found else find_scene_depth(found["left"])
            # Rendered again with margins, a ray's direction has other roundings, which grazing ground stretches.
            np.testing.assert_allclose(truth, depth_m, rtol=1e-4, err_msg=f"{piece} {rig}")
            if "disparity_px" in found:
                np.testing.assert_allclose(found["disparity_px"], plain.camera.focal_baseline_px_m / truth, rtol=1e-6)
                assert found["image_left"].shape == found["image_right"].shape == depth_m.shape
                assert found["image_left"].std() > 1


def test_the_page_of_operators_has_what_is_registered(registered):
    listed = {operator.name: operator for operator in reference.operators()}
    assert set(listed) == {f"icymoon.{name}" for name in dir(bpy.ops.icymoon)}
    for name, operator in listed.items():
        rna = getattr(bpy.ops.icymoon, name.removeprefix("icymoon.")).get_rna_type()
        assert (operator.label, operator.description) == (rna.name, rna.description)
        shown = {
            prop.identifier: (prop.name, prop.description)
            for prop in rna.properties
            if prop.identifier != "rna_type" and not prop.is_hidden
        }
        assert operator.properties == shown


def test_the_page_of_the_pair_folder_has_what_a_pair_holds(registered, tmp_path: Path):
    pair, _ = render(
        tmp_path,
        {
            "quality": {
                "samples": 1,
                "truth_by": "CYCLES",
                "files": "FULL",
                "indirect": "BAKED",
                "bake_samples": 4,
                "bake_noise": 0.0,
            },
            "surface": {"model": "LAMBERT"},
            "rig": {"width_px": 32, "height_px": 24},
            "light": {"planet": True, "planet_elevation_deg": 40.0},
        },
    )
    written = set(re.findall(r"`(\w+)`", PAGE.split("## pair.json")[1].split("## Reading a pair in Python")[0]))
    assert set(pair.data) - written == set()
    passes = set(re.findall(r"`((?:Beauty|Truth)\.[\w ]+)`", PAGE))
    with OpenEXR.File(str(pair.image("left"))) as file:
        channels = [name for part in file.parts for name in part.channels]
    for channel in channels:
        assert ".".join(channel.split(".")[:2]) in passes - UNWANTED_PASSES, channel
    of_other_pairs = {"Truth.Distance", "Truth.LooseThickness"}  # of cameras beside the pair, and where asked for
    for name in (
        passes - of_other_pairs - {"Truth.IndexMA", "Truth.IndexOB", "Truth.Material Index", "Truth.Object Index"}
    ):
        assert any(channel.startswith(name) for channel in channels), name
    for label, meaning in re.findall(r"(?m)^\| (\d) \| (\w+)", PAGE):
        assert pair.data["channels"]["semantic"][label] == meaning
