"""Matchers on photographs and their twins: by images whose disparity is known."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from icymoon.support.errors import IcyMoonError
from icymoon.validation import polar_stereo
from icymoon.validation.comparison import FAILS, NOT_JUDGED, PASSES
from icymoon.validation.polar.data_set import EYES, HEIGHT_PX, WIDTH_PX, View, read_terrains
from icymoon.validation.polar.scene import Masks, Twin, find_frame
from icymoon.validation.polar_stereo import METHODS, judge_stereo, rectify_photograph
from polar_folders import read_known


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The terrain, its true camera, and our rig at position A."""
    folder = tmp_path_factory.mktemp("polar")
    terrain, camera, sand, _ = read_known(folder)
    return folder, terrain, camera, find_frame(terrain, camera, sand, "A", 480)


def test_a_photograph_is_seen_as_our_rig_sees_it(known):
    _, _, camera, frame = known
    bent = replace(camera, eyes={view: replace(eye, k1=-0.09, k2=0.01) for view, eye in camera.eyes.items()})
    rows, columns = frame.shape
    pixels = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1).reshape(-1, 2)
    there = frame.unrectify(bent, "R", pixels)
    assert frame.rectify(bent, "R", there) == pytest.approx(pixels, abs=1e-6)
    # An image whose values are its own columns, at the middles of pixels.
    image = np.broadcast_to(np.arange(WIDTH_PX) + 0.5, (HEIGHT_PX, WIDTH_PX))
    inside = (there > 20).all(axis=1) & (there < [WIDTH_PX - 20, HEIGHT_PX - 20]).all(axis=1)
    assert inside.mean() > 0.8
    assert rectify_photograph(frame, bent, "R", image).ravel()[inside] == pytest.approx(there[inside, 0], abs=0.05)


def _judge(known, monkeypatch, pairs, spoiled, methods=("bm", "sgbm")):
    """Rows of so many pairs with a texture at a constant disparity; photographs ``spoiled`` get noise instead."""
    monkeypatch.setattr(polar_stereo, "METHODS", methods)
    folder, terrain, camera, frame = known
    rows, columns = frame.shape
    random, shift = np.random.default_rng(3), 24
    texture = cv2.GaussianBlur(random.random((rows, columns + shift)), (0, 0), 1.2)
    views = {"L": texture[:, :columns], "R": texture[:, shift:]}
    depth = np.full(frame.shape, frame.focal_px * frame.baseline_m / shift)
    everywhere, nowhere = np.ones(frame.shape, bool), np.zeros(frame.shape, bool)
    masks, images, shown = {}, {}, {}
    for azimuth in range(pairs):
        for eye in EYES:
            at = View("A", eye), azimuth
            twin = Twin(everywhere, nowhere, nowhere, views[eye], depth)
            masks[at] = Masks(everywhere, nowhere, everywhere, nowhere, everywhere, twin)
            images[at] = folder / f"{azimuth}{eye}.png"
            shown[images[at]] = random.random(frame.shape) if azimuth < spoiled else views[eye]
    monkeypatch.setattr(polar_stereo, "_read_photograph", lambda terrain, at: shown[terrain.images[at]])
    monkeypatch.setattr(polar_stereo, "rectify_photograph", lambda frame, camera, eye, image: image)
    return judge_stereo(replace(terrain, images=images), camera, {"A": frame}, masks)


def test_twins_that_are_like_the_photographs_predict_their_errors(known, monkeypatch):
    found = _judge(known, monkeypatch, 8, 0)
    assert len(found) == 2 * 2
    assert [row.verdict for row in found] == [PASSES] * len(found)
    means = found[::2]
    assert all(row.ours == row.theirs for row in means)
    assert all(0.0 <= row.ours < 0.3 for row in means)  # the texture is found where its other eye shows it


def test_photographs_that_no_matcher_understands_are_not_predicted(known, monkeypatch):
    found = _judge(known, monkeypatch, 8, 8)
    assert all(row.theirs > 0.5 for row in found[::2])
    assert [row.verdict for row in found] == [FAILS] * len(found)


def test_few_pairs_have_no_interval(known, monkeypatch):
    found = _judge(known, monkeypatch, 2, 0)
    assert [row.verdict for row in found] == [PASSES, NOT_JUDGED] * 2
    assert "an interval takes 8 pairs, here are 2" in found[1].note


def test_the_learned_matcher_and_the_filled_one_are_judged_too(known, monkeypatch):
    pytest.importorskip("torch")
    found = _judge(known, monkeypatch, 1, 0, METHODS)
    assert [row.quantity.partition(" on 1 pair")[0] for row in found[::2]] == [
        "StereoBM",
        "SGBM",
        "SGBM with WLS",
        "icynet",
    ]
    assert all(0.0 <= row.ours == row.theirs < 0.3 for row in found[::2])


def test_a_matcher_without_its_library_is_left_out(known, monkeypatch):
    def refuse(method, options):
        if method == "icynet":
            raise IcyMoonError("no PyTorch")
        return dict(options)

    monkeypatch.setattr(polar_stereo, "check_options", refuse)
    found = _judge(known, monkeypatch, 1, 0, ("icynet", "bm"))
    assert [row.quantity.partition(" on 1 pair")[0] for row in found[::2]] == ["StereoBM"]


def test_photographs_are_found_beside_the_labels_and_must_be_whole(known):
    folder, terrain, camera, frame = known
    (row,) = judge_stereo(terrain, camera, {"A": frame}, {})
    assert row.verdict == NOT_JUDGED
    assert "photographs/TT_P_off_AZ_E.png" in row.note
    (folder / "photographs").mkdir(exist_ok=True)
    path = folder / "photographs" / "07_A_off_30_L.png"
    cv2.imwrite(str(path), np.zeros((10, 20), np.uint8))
    (again,) = read_terrains(folder)
    assert again.images == {(View("A", "L"), 30): path}
    with pytest.raises(IcyMoonError, match="has 20 x 10 pixels; a photograph has 1936 x 1216"):
        polar_stereo._read_photograph(again, (View("A", "L"), 30))
    path.unlink()
