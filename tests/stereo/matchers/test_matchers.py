"""The matchers: accuracy on exact images, invalid pixels, options, unusable images."""

import cv2
import numpy as np
import pairs
import pytest
from icymoon.stereo.matchers import check_options, get_matcher_title, match
from icymoon.support.errors import IcyMoonError

RIG = pairs.camera()
ANYWHERE = ("bm", "sgbm", "sgbm_wls", "jplv")  # what runs without a checkpoint or another program
#: For images as small as these, where four per cent of the image is a large patch.
SMALL = {"jplv": {"blob_size": 50}}
#: The options of the GUISS paper, written a second time, so that a changed preset fails.
GUISS = {
    "disparities": 96,
    "min_disparity": 4,
    "window": 49,
    "prefilter": "xsobel",
    "prefilter_size": 17,
    "prefilter_cap": 20,
    "texture_threshold": 18,
    "uniqueness": 0,
    "speckle_window": 0,
    "speckle_range": 9,
    "left_right": 25,
    "left_border": "skip",
    "rounding": "up",
    "grey": "luminance",
}


def images(scene, rig=RIG):
    """8-bit images and the true disparity."""
    (depth, left, _), (_, right, _) = pairs.view(scene, rig, "left"), pairs.view(scene, rig, "right")
    left, right = (
        np.rint(np.clip(light / (2 * scene.radiance), 0, 1) * 255).astype(np.uint8) for light in (left, right)
    )
    return left, right, rig.disparity(depth)


@pytest.mark.parametrize(
    ("method", "options", "bound"),
    [
        ("sgbm", {}, 0.05),
        ("bm", {"preset": "guiss"}, 0.15),
        ("bm", {"window": 21}, 0.06),
        ("bm", {}, 0.06),
        ("sgbm_wls", {}, 0.06),
        ("jplv", {}, 0.1),
        ("jplv", {"subpixel": "affine"}, 0.03),
    ],
)
def test_subpixel_accuracy_on_an_exactly_sampled_plane(method, options, bound):
    left, right, truth = images(pairs.Scene(rock=False, contrast=0.2))
    disparity, valid, info = match(method, left, right, options)
    assert disparity.dtype == np.float32
    assert valid.mean() > 0.25
    np.testing.assert_array_equal(valid, np.isfinite(disparity))
    assert np.median(np.abs(disparity - truth)[valid]) < bound
    assert info["method"] == method
    assert info["seconds"] >= 0


@pytest.mark.parametrize("method", ["sgbm", "sgbm_wls", "bm"])
def test_opencvs_rounding_leaves_no_offset(method):
    """By itself it shifts sgbm by +0.025 px and bm by +0.03 px."""
    left, right, truth = images(pairs.Scene(rock=False, contrast=0.2))
    disparity, valid, _ = match(method, left, right, {})
    # Pixel locking pulls both ways alike; what is left is far below the 1/16 px that disparities come in.
    assert abs(np.median((disparity - truth)[valid])) < 0.012


@pytest.mark.parametrize("method", ["sgbm", "sgbm_wls", "bm"])
def test_the_left_border_is_measured_where_both_eyes_see_it(method):
    left, right, truth = images(pairs.Scene())
    disparity, valid, _ = match(method, left, right)
    margin = 8 if method == "bm" else 0  # half a window
    both = (np.arange(RIG.width_px) >= truth + margin) & (np.arange(RIG.width_px) < RIG.width_px - margin)
    both[:margin] = both[RIG.height_px - margin :] = False
    assert (valid & both).sum() > 0.95 * both.sum()
    assert (disparity[valid] <= np.nonzero(valid)[1] + 1e-6).all()  # never a match outside the right image
    if method != "sgbm_wls":  # which fills in what is hidden too
        assert np.mean(np.abs(disparity - truth)[:, :96][valid[:, :96]] > 1) < 0.02
        skipped = match(method, left, right, {"left_border": "skip"})[1]
        assert not skipped[:, :95].any()


@pytest.mark.parametrize("mode", ["sgbm", "hh", "3way", "hh4"])
def test_every_mode_of_sgbm_measures(mode):
    left, right, truth = images(pairs.Scene())
    disparity, valid, _ = match("sgbm", left, right, {"mode": mode})
    assert valid.mean() > 0.8
    assert np.mean(np.abs(disparity - truth)[valid] > 1) < 0.02


@pytest.mark.parametrize("method", ["sgbm", "sgbm_wls"])
def test_strips_of_a_large_image_give_what_the_whole_image_gives(method, monkeypatch):
    left, right, _ = images(pairs.Scene(contrast=0.2), pairs.camera(256, 400))
    whole, valid, _ = match(method, left, right, {"disparities": 64})
    monkeypatch.setattr("icymoon.stereo.matchers.sgbm._MAX_COST_BYTES", 4 * 200 * 320 * 64)  # 72 of 200 rows are kept
    strips, also, _ = match(method, left, right, {"disparities": 64})
    assert np.mean(valid != also) < 0.005
    both = valid & also
    assert np.mean(np.abs(whole - strips)[both] > 1 / 16) < 0.005
    monkeypatch.setattr("icymoon.stereo.matchers.sgbm._STRIP_MARGIN_ROWS", 1)  # the margin is what makes them so
    assert np.mean(match(method, left, right, {"disparities": 64})[0] != whole) > np.mean(strips != whole)


@pytest.mark.parametrize(
    ("mode", "low", "high"), [("hh", -0.02, 0.02), ("hh4", -0.02, 0.02), ("sgbm", -0.14, -0.07), ("3way", -0.10, -0.02)]
)
def test_modes_without_paths_from_below_shift_sloping_ground(mode, low, high):
    """The manual says so: their disparity is too small where it grows downward in the image."""
    left, right, truth = images(pairs.Scene(rock=False, contrast=0.2))
    disparity, valid, _ = match("sgbm", left, right, {"mode": mode})
    assert low < np.median((disparity - truth)[valid]) < high


def test_filled_in_pixels_are_marked_and_can_be_dropped():
    left, right, truth = images(pairs.Scene())
    disparity, filled, info = match("sgbm_wls", left, right)
    confidence = info["arrays"]["confidence"]
    assert (confidence.dtype, confidence.shape) == (np.uint8, left.shape)
    sure, valid, _ = match("sgbm_wls", left, right, {"min_confidence": 1})
    np.testing.assert_array_equal(valid, filled & (confidence > 0))
    np.testing.assert_array_equal(sure[valid], disparity[valid])
    assert 0.7 < valid.mean() < filled.mean()
    bad = np.abs(disparity - truth) > 1
    assert bad[valid].mean() < bad[filled & ~valid].mean() / 5  # what it is unsure of is where it errs


def test_invalid_is_never_a_depth():
    left, right, _ = images(pairs.Scene(), pairs.camera(400, 144))
    disparity, valid, _ = match("bm", left, right, {"preset": "guiss"})
    # The first columns cannot be searched; OpenCV writes 3.0 there, which is less than the search range.
    assert not valid[:, : 4 + 96 - 1 + 24].any()
    assert disparity[valid].min() >= 4
    assert np.isnan(disparity[~valid]).all()


def test_bm_by_preset_is_the_papers():
    assert check_options("bm", {"preset": "guiss"}) == GUISS
    matcher = cv2.StereoBM.create(96, 49)
    matcher.setPreFilterType(1)
    matcher.setPreFilterSize(17)
    matcher.setPreFilterCap(20)
    matcher.setTextureThreshold(18)
    matcher.setUniquenessRatio(0)
    matcher.setSpeckleRange(9)
    matcher.setSpeckleWindowSize(0)
    matcher.setDisp12MaxDiff(25)
    matcher.setMinDisparity(4)
    left, right, _ = images(pairs.Scene())
    disparity, valid, _ = match("bm", left, right, {"preset": "guiss"})
    assert valid.sum() > 5000
    np.testing.assert_array_equal(disparity[valid], (matcher.compute(left, right) / 16.0)[valid])


@pytest.mark.parametrize("bands", [3, 4])
def test_bm_by_preset_sees_luminance_as_the_papers_code_does(bands):
    left, right, _ = images(pairs.Scene(), pairs.camera(320, 160))
    # Coloured noise, so that luminance and the mean of the bands differ.
    noise = np.random.default_rng(0).integers(-40, 40, (160, 320, bands))
    left, right = (np.clip(eye[..., None] + noise, 0, 255).astype(np.uint8) for eye in (left, right))
    grey, other = (cv2.cvtColor(np.ascontiguousarray(eye[..., :3]), cv2.COLOR_BGR2GRAY) for eye in (left, right))
    found, _, info = match("bm", left, right, {"preset": "guiss"})
    np.testing.assert_array_equal(found, match("bm", grey, other, {"preset": "guiss"})[0])
    assert info["options"]["grey"] == "luminance"
    mean = match("bm", left, right, {"preset": "guiss", "grey": "mean"})[0]
    assert np.mean(found[np.isfinite(found)] != mean[np.isfinite(found)]) > 0.05
    left, right = (eye.astype(np.uint16) * 257 for eye in (left, right))
    np.testing.assert_array_equal(match("bm", left, right, {"preset": "guiss"})[0], found)


@pytest.mark.parametrize("method", ANYWHERE)
def test_the_number_of_threads_changes_nothing(method):
    left, right, _ = images(pairs.Scene(), pairs.camera(400, 200))
    threads = cv2.getNumThreads()
    try:
        results = []
        for count in (1, 4):
            cv2.setNumThreads(count)
            results.append(match(method, left, right)[0])
            assert cv2.getNumThreads() == 1  # which the seconds are for
    finally:
        cv2.setNumThreads(threads)
    np.testing.assert_array_equal(results[0], results[1])


@pytest.mark.parametrize("method", ANYWHERE)
@pytest.mark.parametrize("level", [0, 1, 128, 255])
def test_an_image_without_texture_gives_no_depth(method, level):
    flat = np.full((144, 256), level, np.uint8)
    assert not match(method, flat, flat)[1].any()


@pytest.mark.parametrize("method", ANYWHERE)
def test_zero_and_negative_disparities_are_invalid(method):
    left, right, _ = images(pairs.Scene(rock=False))
    same = match(method, left, left, {"min_disparity": 0})[1]
    assert same.mean() < 0.02
    swapped, valid, _ = match(method, right, left, {"min_disparity": 0} | SMALL.get(method, {}))
    assert valid.any()
    assert (swapped[valid] > 0).all()


@pytest.mark.parametrize("method", ANYWHERE)
def test_colour_and_16_bit_images_are_the_same_as_grey_ones(method):
    left, right, _ = images(pairs.Scene())
    expected = match(method, left, right)[0]

    def colour(image):
        return np.repeat(image[..., None], 3, axis=-1)

    np.testing.assert_array_equal(match(method, colour(left), colour(right))[0], expected)
    np.testing.assert_array_equal(
        match(method, left.astype(np.uint16) * 257, right.astype(np.uint16) * 257)[0], expected
    )


@pytest.mark.parametrize("method", ANYWHERE)
def test_unusable_images_are_refused(method):
    good = np.zeros((144, 256), np.uint8)
    for left, right, reason in [
        (good, good[:, :-1], "the same size"),
        (good.astype(float), good, "float64"),
        (good[None], good, "shape"),
        (good[:0], good[:0], "shape"),
    ]:
        with pytest.raises(IcyMoonError, match=reason):
            match(method, left, right)


@pytest.mark.parametrize("shape", [(1, 1), (3, 400), (40, 60), (48, 400), (60, 140)])
def test_images_too_small_for_the_window_are_refused(shape):
    small = np.zeros(shape, np.uint8)
    with pytest.raises(IcyMoonError, match=r"too small for StereoBM.*lower bm.disparities or bm.window"):
        match("bm", small, small, {"preset": "guiss"})
    with pytest.raises(IcyMoonError, match="too small for SGBM"):
        match("sgbm", small[:, :98], small[:, :98], {"left_border": "skip"})
    for method in ANYWHERE:
        with pytest.raises(IcyMoonError, match=f"too small for {get_matcher_title(method)}:"):
            match(method, small[:, :2], small[:, :2])


@pytest.mark.parametrize("shape", [(1, 3), (4, 4), (3, 400)])
@pytest.mark.parametrize("method", ["sgbm", "sgbm_wls"])
def test_sgbm_takes_any_size_wider_than_half_its_window(shape, method):
    small = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    assert match(method, small, small)[0].shape == shape


@pytest.mark.parametrize("method", ["bm", "jplv"])  # the others spread what they find
def test_one_bright_pixel_is_no_surface(method):
    left, right = np.zeros((2, 144, 256), np.uint8)
    left[70, 120], right[70, 100] = 255, 255
    # At most what the windows and the filters around that pixel see.
    assert match(method, left, right)[1].sum() <= 27**2


@pytest.mark.parametrize(
    ("method", "options", "reason"),
    [
        ("bn", {}, "Unknown matcher 'bn', did you mean 'bm'"),
        ("orb-slam", {}, "known are bm, sgbm, "),
        ("bm", {"windw": 9}, r"Unknown option bm.windw, did you mean 'window'"),
        ("bm", {"window": 10}, "bm.window is 10, outside 5 to 255 in steps of 2"),
        ("bm", {"window": "large"}, "bm.window must be a whole number, not 'large'"),
        ("bm", {"disparities": 100}, "steps of 16"),
        ("bm", {"prefilter": "sobel"}, "did you mean 'xsobel'"),
        ("bm", {"preset": "guis"}, "did you mean 'guiss'"),
        ("sgbm", {"preset": "guiss"}, "Unknown option sgbm.preset"),
        ("sgbm", {"p1": 900, "p2": 800}, "sgbm.p2, 800, must be above sgbm.p1"),
        ("sgbm_wls", {"p1": 900, "p2": 800}, "sgbm_wls.p2, 800, must be above sgbm_wls.p1"),
        ("sgbm_wls", {"edge": "sharp"}, "sgbm_wls.edge must be a number, not 'sharp'"),
        ("sgbm_wls", {"edge": "nan"}, "sgbm_wls.edge is nan, outside 0.1 to 100.0"),
        ("jplv", {"window": 8}, "in steps of 2"),
    ],
)
def test_wrong_methods_and_options_are_named(method, options, reason):
    blank = np.zeros((144, 256), np.uint8)
    with pytest.raises(IcyMoonError, match=reason):
        match(method, blank, blank, options)


def test_options_override_a_preset_and_answer_to_opencvs_names():
    assert check_options("bm", {"window": "21", "preset": "guiss"}) == GUISS | {"window": 21}
    assert check_options("bm", {"preset": "guiss", "blockSize": 21, "numDisparities": 128}) == GUISS | {
        "window": 21,
        "disparities": 128,
    }
