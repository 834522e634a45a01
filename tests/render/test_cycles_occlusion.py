"""What is hidden from the other eye, against a second ray caster, in truth, masks and what is left of old pairs."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from icymoon.nodes.build_scene import build_scene
from icymoon.physics.camera.occlusion import find_matching_column, is_in_frame
from icymoon.render.pairs.pair_folder import EYES, Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.images.exr import read_truth, read_view
from icymoon.stereo.measure.prepare_pair import load_pair
from other_rays import cast_from_other_eye, tree_of_scene
from rendering import complete, empty_scene

ROCKS = {
    "rocks": {"coverage": 0.12, "smallest_m": 0.1, "largest_m": 0.6},
    "terrain": {"rms_slope_deg": 12.0},
    "rig": {"width_px": 320, "height_px": 240},
    "quality": {"samples": 1},
}


def shoot(folder: Path, *parts: dict) -> Pair:
    settings = complete(*parts)
    built = build_scene(empty_scene(), settings)
    return read_pair(
        render_pairs(built, expand_headings(settings), folder, 1, time.perf_counter(), lambda *a, **k: None)[0]
    )


@pytest.mark.long
def test_hidden_pixels_are_those_of_another_ray_caster(tmp_path):
    """The bounds are those of the issue: 99 % of what is behind something more than 1 px nearer, 0.1 % false."""
    pair = shoot(tmp_path, ROCKS, {"rocks": {"coverage": 0.25}})
    tree = tree_of_scene(pair)
    far = found = false = pixels = 0
    for eye in EYES:
        view = read_view(pair.truth(eye), eye)
        disparity = pair.camera.disparity(view.depth)
        met, inside = cast_from_other_eye(tree, pair, eye, disparity), is_in_frame(find_matching_column(disparity, eye))
        with np.errstate(invalid="ignore"):
            hidden, behind = inside & (met > disparity + 0.01), inside & (met > disparity + 1.0)
        far, found = far + behind.sum(), found + (view.hidden & behind).sum()
        false, pixels = false + (view.hidden & ~hidden).sum(), pixels + inside.sum()
        assert hidden.mean() > 0.002
    assert found >= 0.99 * far
    assert false <= 0.001 * pixels


def test_masks_are_what_the_rays_found(tmp_path):
    pair = shoot(tmp_path, ROCKS, {"rig": {"width_px": 96, "height_px": 72}})
    loaded = load_pair(pair.folder, {})
    for eye in EYES:
        view = read_view(pair.truth(eye), eye)
        column = find_matching_column(pair.camera.disparity(view.depth), eye)
        assert view.hidden.any()
        assert not view.hidden[~is_in_frame(column)].any()
        np.testing.assert_array_equal(loaded.visible[eye], is_in_frame(column) & ~view.hidden)


def test_a_blurred_image_with_margins_has_them_in_the_truth_of_the_sharp_rig(tmp_path):
    parts = (ROCKS, {"rig": {"width_px": 96, "height_px": 72, "toe_in_deg": 2.0, "overscan": 0.1}})
    pair = shoot(tmp_path, *parts)
    for eye in EYES:
        sharp = read_truth(pair.truth(eye), eye).hidden
        turned = read_truth(pair.truth_of_image(eye), eye).hidden
        assert abs(turned.mean() - sharp.mean()) < 0.01  # of eyes that are turned in, about the same points
        assert sharp.shape == pair.camera.rendered_px[::-1]
        assert sharp.any()
    assert load_pair(pair.folder, {}).visible["left"].shape == (72, 96)


def test_depth_alone_has_no_rays(tmp_path):
    pair = shoot(tmp_path, ROCKS, {"rig": {"width_px": 48, "height_px": 36}, "quality": {"truth": "DEPTH"}})
    assert read_view(pair.truth("left"), "left").hidden is None
    assert load_pair(pair.folder, {}).visible["left"].any()
