"""A rendered pair as a photograph beside its twin: equal with the same settings, different with another surface."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pairs
import pytest
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.images.develop import develop
from icymoon.stereo.images.image_files import write_png
from icymoon.stereo.images.views import read_eye
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.matchers.search_range import SearchRange
from icymoon.stereo.twin import compare_twin
from icymoon.stereo.twin.compare_twin import (
    GRADIENT_BOUNDS,
    LEVEL_BOUNDS,
    choose_search_range,
    find_consistent,
    measure_image,
    measure_matcher,
    read_or_measure,
)
from icymoon.stereo.twin.limits import list_limits
from icymoon.stereo.twin.page import write_page
from icymoon.stereo.twin.photographs import Photographs, make_rectification
from icymoon.stereo.twin.plan import Described, Twin
from icymoon.stereo.twin.summary import summarise
from icymoon.support.errors import IcyMoonError

CAMERA = pairs.camera(160, 112)
METHODS = parse_methods("bm,sgbm")
ROUGH, PALE = {}, {"contrast": 0.15}


def rectification():
    cx, cy = CAMERA.cx_px - 0.5, CAMERA.cy_px - 0.5
    left = CalibratedCamera(CAMERA.width_px, CAMERA.height_px, CAMERA.focal_px, CAMERA.focal_px, cx, cy)
    right = left.placed(np.eye(3), np.array([-CAMERA.baseline_m, 0.0, 0.0]))
    return make_rectification(CalibratedRig((left, right)), CAMERA, "test")


def rendered(folder, number, surface):
    """A pair at its own distance, with noise of its own."""
    scene = pairs.Scene(distance_m=1.8 + 0.03 * number, sky_rows=0, **surface)
    return pairs.write_pair(folder / f"{number:03d}", scene, CAMERA, noise=0.01)


def photographed(folder, number, surface, depth=True):
    """The images of a rendered pair as files, and its true depth."""
    pair = read_pair(rendered(folder, number, surface))
    (left, view), (right, _) = (read_eye(pair, eye) for eye in ("left", "right"))
    taken = develop(pair, left, right, pair.settings)
    for eye, image in zip(("left", "right"), taken.for_matchers(), strict=True):
        write_png(folder / f"{number}-{eye}.png", image)
    np.save(folder / f"{number}.npy", view.depth)
    left_file, right_file = (folder / f"{number}-{eye}.png" for eye in ("left", "right"))
    return Photographs(f"p{number}", left_file, right_file, folder / f"{number}.npy" if depth else None)


def settings_of(folder):
    return read_pair(folder).settings


def records(tmp_path, count, surface, methods=METHODS):
    """Photographs of the rough surface beside twins of another, or the same, one."""
    found = []
    for number in range(count):
        photographs = photographed(tmp_path / "real", number, ROUGH)
        twin = rendered(tmp_path / "twins", number, surface)
        found.append(
            read_or_measure(photographs, rectification(), twin, settings_of(twin), methods, tmp_path / "measured")
        )
    return found


@pytest.mark.long
def test_a_twin_with_the_same_settings_is_equal_within_its_noise(tmp_path):
    """Eleven pairs whose noise alone differs: what is measured differs by what noise does, and no interval of a
    difference leaves out 0."""
    methods = parse_methods("sgbm")
    rows, needed = summarise(records(tmp_path, 11, ROUGH, methods), methods)
    assert needed <= 11
    for row in rows:
        low, high = row.difference_interval
        assert low <= 0 <= high, row
    by_key = {(row.quantity.key, row.method): row for row in rows}
    # The noise is 1 % of the light in each pixel; over thousands of pixels little of it is left.
    for key in ("contrast", "gradient", "texture"):
        row = by_key[key, ""]
        assert row.means["photograph"] == pytest.approx(row.means["twin"], rel=0.02)
    assert by_key["coverage", "sgbm"].difference == pytest.approx(0, abs=0.01)
    assert by_key["wrong", "sgbm"].means["photograph"] < 0.3, "the depth of the photograph is its truth"


@pytest.mark.long
def test_a_twin_of_another_surface_differs_and_the_page_shows_it(tmp_path):
    methods = parse_methods("sgbm")
    rows, _ = summarise(records(tmp_path, 11, PALE, methods), methods)
    by_key = {row.quantity.key: row for row in rows if not row.method}
    for key in ("contrast", "gradient", "texture"):
        row = by_key[key]
        assert row.means["photograph"] > 2 * row.means["twin"]
        assert row.difference_interval[0] > 0
        assert row.difference_text.startswith("+")
    assert by_key["smooth"].difference < 0


def write(tmp_path, count=1, depth=True):
    found, twins = [], []
    for number in range(count):
        photographs = photographed(tmp_path / "real", number, ROUGH, depth)
        folder = rendered(tmp_path / "twins", number, PALE)
        settings = settings_of(folder)
        found.append(read_or_measure(photographs, rectification(), folder, settings, METHODS, tmp_path / "measured"))
        twins.append(Twin(photographs, PlannedPair(folder.name, settings, 0.0), None))
    described = Described(defaults(), merged(), merged(), [])
    rows, needed = summarise(found, METHODS)
    limits = list_limits(twins, found, described, rectification(), needed, "")
    page = write_page(tmp_path, tmp_path / "measured", twins, found, rows, METHODS, limits, ["A <note>."])
    return page.read_text(encoding="utf-8"), found, limits


def test_the_page_contains_both_sides_and_no_address(tmp_path):
    html, found, limits = write(tmp_path)
    assert html.count("<img ") == 8, "two eyes and two methods of each side"
    assert html.count("data:image/jpeg;base64,") == 8
    assert "http" not in html.replace("http-equiv", "").replace("http://www.w3.org/", "")
    assert "A &lt;note&gt;." in html
    for sentence in limits:
        assert sentence.split(",")[0].replace("'", "&#39;") in html
    assert html.count('class="chart"') == 3
    lines = (tmp_path / "twin.csv").read_text(encoding="utf-8").splitlines()
    heads, photograph, twin = (line.split(",") for line in lines)
    assert (photograph[1], twin[1]) == ("photograph", "twin")
    assert float(photograph[heads.index("contrast")]) == found[0]["photograph"]["statistics"]["contrast"]
    assert float(twin[heads.index("sgbm coverage")]) == found[0]["twin"]["matched"]["sgbm"]["coverage"]


def test_without_truth_only_the_twin_has_errors_and_the_page_says_so(tmp_path):
    html, found, limits = write(tmp_path, depth=False)
    assert found[0]["photograph"]["matched"]["bm"]["wrong"] is None
    assert found[0]["twin"]["matched"]["bm"]["wrong"] is not None
    assert any("no true depth of the photographs" in sentence for sentence in limits)
    assert any("Intervals of the differences take 11 pairs, and there is 1" in sentence for sentence in limits)
    assert "–" in html


def test_numbers_are_measured_once_and_again_when_something_changes(tmp_path, monkeypatch):
    photographs = photographed(tmp_path / "real", 0, ROUGH)
    twin = rendered(tmp_path / "twins", 0, PALE)
    given = photographs, rectification(), twin, settings_of(twin)
    first = read_or_measure(*given, METHODS, tmp_path / "out")
    calls = []
    original = compare_twin.measure_matcher
    monkeypatch.setattr(compare_twin, "measure_matcher", lambda *a: calls.append(1) or original(*a))
    assert read_or_measure(*given, METHODS, tmp_path / "out") == json.loads(json.dumps(first))
    assert not calls
    read_or_measure(*given, parse_methods("bm:window=9"), tmp_path / "out")
    assert len(calls) == 2, "other methods"
    brighter = merged(given[3], {"sensor": {"auto_target": 0.4}})
    read_or_measure(*given[:3], brighter, parse_methods("bm:window=9"), tmp_path / "out")
    assert len(calls) == 4, "another camera response"
    write_png(photographs.left, np.full((112, 160), 9, np.uint8) + np.arange(160, dtype=np.uint8))
    read_or_measure(*given[:3], brighter, parse_methods("bm:window=9"), tmp_path / "out")
    assert len(calls) == 6, "another photograph"
    read_or_measure(
        replace(photographs, depth=None), *given[1:3], brighter, parse_methods("bm:window=9"), tmp_path / "out"
    )
    assert len(calls) == 8, "no truth any more"


def test_what_was_cut_off_is_measured_again(tmp_path, monkeypatch):
    photographs = photographed(tmp_path / "real", 0, ROUGH)
    twin = rendered(tmp_path / "twins", 0, PALE)
    given = photographs, rectification(), twin, settings_of(twin), METHODS, tmp_path / "out"

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(compare_twin, "draw_depth", stop)
    with pytest.raises(KeyboardInterrupt):
        read_or_measure(*given)
    assert not (tmp_path / "out" / "p0.json").exists(), "numbers are written when the pictures are there"
    monkeypatch.undo()
    assert read_or_measure(*given)["rendered"] == twin.name
    (tmp_path / "out" / "p0.json").write_text("{}", encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"p0\.json.*remove it"):
        read_or_measure(*given)


def test_a_ramp_has_its_gradient_and_exposure_does_not_count():
    ramp = np.tile(np.arange(128.0), (128, 1)) + 20
    seen = np.ones(ramp.shape, bool)
    numbers, curves = measure_image(ramp, 255.0, seen)
    assert numbers["gradient"] == pytest.approx(1.0)
    assert numbers["texture"] == pytest.approx(1.0)
    assert numbers["smooth"] == 1
    assert numbers["contrast"] == pytest.approx(ramp.std() / ramp.mean())
    assert numbers["dark"] == numbers["saturated"] == 0
    assert sum(curves["levels"]) == pytest.approx(1)
    assert (len(curves["levels"]), len(curves["gradients"])) == (len(LEVEL_BOUNDS) - 1, len(GRADIENT_BOUNDS) - 1)
    darker, _ = measure_image(0.5 * ramp, 0.5 * 255.0, seen)
    assert darker == pytest.approx(numbers, nan_ok=True)
    clipped, _ = measure_image(np.minimum(3 * ramp, 255), 200.0, seen)
    assert clipped["saturated"] == pytest.approx(63 / 128)  # the columns from level 85 on


def test_only_what_is_seen_counts():
    image = np.random.default_rng(5).uniform(0, 255, (96, 96))
    seen = np.zeros(image.shape, bool)
    seen[8:80, 8:80] = True
    hidden = np.where(seen, image, 0.0)
    other = np.where(seen, image, 255.0)
    inside, _ = measure_image(hidden, 255.0, seen)
    assert measure_image(other, 255.0, seen)[0] == pytest.approx(inside)


def test_consistent_is_what_both_eyes_say():
    left = np.full((2, 12), 3.0)
    right = np.full((2, 12), 3.0)
    right[0, 4] = 5.0  # the left pixel in column 7 points at it
    right[1, 5] = np.nan
    left[1, 10] = np.nan
    found = find_consistent(left, right)
    wrong = {(0, 7), (1, 8), (1, 10)} | {(row, column) for row in (0, 1) for column in (0, 1, 2)}
    assert {tuple(at) for at in np.argwhere(~found)} == wrong
    assert not find_consistent(left + 1.01, right)[1].any()


def test_a_matcher_is_consistent_with_itself_on_a_shifted_image():
    """The right image is the left one moved by 6 px, so both directions find 6 px."""
    wide = np.random.default_rng(7).integers(0, 256, (96, 166)).astype(np.uint8)
    left, right = wide[:, :160].copy(), wide[:, 6:].copy()
    truth = np.full(left.shape, 6.0)
    (method,) = parse_methods("sgbm")
    search = SearchRange(0, 31, "rig")
    seen = np.ones(left.shape, bool)
    disparity, numbers = measure_matcher(left, right, seen, method, pairs.camera(160, 96), search, truth)
    assert np.nanmedian(disparity) == pytest.approx(6, abs=0.1)
    assert numbers["coverage"] > 0.75
    assert numbers["consistent"] > 0.97
    assert numbers["epe_px"] < 0.1
    assert numbers["wrong"] == pytest.approx(1 - numbers["coverage"], abs=0.06)
    half = seen.copy()
    half[:, 80:] = False
    covered, _ = measure_matcher(left, right, half, method, pairs.camera(160, 96), search, None)
    assert np.isnan(covered[:, 80:]).all()
    other, unknown = measure_matcher(left, right, seen, method, pairs.camera(160, 96), search, None)
    assert math.isnan(unknown["wrong"])
    assert np.array_equal(other, disparity, equal_nan=True)


def test_both_sides_search_what_either_has():
    settings = merged(defaults(), {"rig": {"height_m": 1.6, "pitch_deg": 45.0}})
    alone = choose_search_range(settings, [None])
    near = choose_search_range(settings, [None, np.full((4, 640), alone.most_px + 50.0)])
    assert near.least_px == alone.least_px
    assert near.most_px >= alone.most_px + 50
    up = merged(settings, {"rig": {"pitch_deg": -60.0}})
    assert choose_search_range(up, [None]).source == "fixed"
