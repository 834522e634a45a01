"""The JPL correlator: bit-exact with the original's output, and by a plain transcription where that has none."""

import zlib

import jpl_images
import numpy as np
import pairs
import pytest
from icymoon.stereo.matchers import jpl_correlator as jpl
from icymoon.stereo.matchers import match
from icymoon.support.errors import IcyMoonError

NO_DATA = 0x7FFF


@pytest.mark.parametrize("name", jpl_images.CASES)
def test_every_bit_is_the_originals(name):
    arguments, options, (left_crc, right_crc, expected), counts = jpl_images.CASES[name]
    left, right, _ = jpl_images.pair(*arguments)
    assert (zlib.crc32(left.tobytes()), zlib.crc32(right.tobytes())) == (left_crc, right_crc)
    disparity, valid, info = match("jplv", left, right, options)
    fixed, flags = info["arrays"]["jpl_disparity"], info["arrays"]["flags"]
    assert (fixed.dtype, flags.dtype) == (np.int32, np.uint8)
    assert zlib.crc32(fixed.astype("<i4").tobytes()) == expected
    assert info["counts"] == counts
    assert [int((flags == flag).sum()) for flag in range(len(jpl.FLAGS))] == [counts[name] for name in jpl.FLAGS]
    np.testing.assert_array_equal(flags == 0, fixed != NO_DATA)
    if "pyramid_level" not in options:
        np.testing.assert_array_equal(disparity[valid], fixed[valid] / 256)
        np.testing.assert_array_equal(valid, flags == 0)


def plain_search(left, right, least, most, window, rim, uncertainty):
    """Disparity and flags pixel by pixel, in Python's own integers."""
    height, width = left.shape
    half = window // 2
    first, last_row, last_column = rim + half, height - rim - half - 1, width - rim - half - 1
    left, right = left.astype(int), right.astype(int)

    def score(row, column, disparity):
        rows = slice(row - half, row + half + 1)
        return int(
            np.abs(
                left[rows, column - half : column + half + 1]
                - right[rows, column - disparity - half : column - disparity + half + 1]
            ).sum()
        )

    disparities = np.full(left.shape, NO_DATA)
    flags = np.full(left.shape, jpl.BOUND)
    for row in range(first, last_row + 1):
        scores = {
            (column, disparity): score(row, column, disparity)
            for column in range(first, last_column + 1)
            for disparity in range(least, min(most, column - first) + 1)
        }
        for column in range(first, last_column + 1):
            own = [d for d in range(least, most + 1) if (column, d) in scores]
            best = min(own, key=lambda d: (scores[column, d], d), default=None)
            if best is None or best in (own[0], own[-1]):
                flags[row, column] = jpl.BORDER
                continue
            there = column - best
            back = min(
                (d for d in range(least, most + 1) if (there + d, d) in scores), key=lambda d: (scores[there + d, d], d)
            )
            low, least_score, high = (scores[column, best + step] for step in (-1, 0, 1))
            curvature = low + high - 2 * least_score
            if abs(back - best) > 1:
                flags[row, column] = jpl.LRLOS
            elif curvature == 0 or least_score in (low, high):
                flags[row, column] = jpl.FLAT
            else:
                offset = int(128 * (low - high) / curvature)
                error = window**2 * ((467 * offset**2 >> 16) + 362)
                bad = uncertainty and error >= uncertainty * curvature
                flags[row, column] = jpl.THRESH if bad else jpl.ACCEPT
                disparities[row, column] = NO_DATA if bad else 256 * best + offset
    return disparities, flags


@pytest.mark.parametrize(
    ("window", "least", "most", "uncertainty", "size"),
    [
        (3, 0, 9, 0, (40, 30)),
        (3, 3, 60, 300, (40, 30)),
        (15, 0, 12, 0, (48, 34)),
        (17, 1, 12, 200, (48, 34)),
        (5, 38, 39, 0, (40, 24)),
        (5, 60, 70, 0, (40, 24)),
    ],
)
def test_search_and_tests_are_those_of_a_plain_transcription(window, least, most, uncertainty, size):
    left, right, _ = jpl_images.pair(size[0], size[1], 5, 128, 20, slope=4)
    left[8:14] //= 64  # flat stretches and ties
    right[8:14] //= 64
    disparity, flags = plain_search(left, right, least, most, window, 4, uncertainty)
    found = jpl.search_disparities(left, right, least, most, window, 4)
    margin = 4 + window // 2
    got = jpl.judge_matches(found, least, most, window, uncertainty)
    np.testing.assert_array_equal(got[1], flags[margin:-margin, margin:-margin])
    np.testing.assert_array_equal(got[0], disparity[margin:-margin, margin:-margin])


def plain_mean_times(image, side, row, column):
    half = side // 2
    return int(image[row - half : row + half + 1, column - half : column + half + 1].sum()) * (4096 // side**2)


@pytest.mark.parametrize("shape", [(60, 71), (61, 70)])
def test_two_halvings_are_those_of_a_plain_transcription(shape):
    """Level 2, as the rovers ran it, for odd and even sizes."""
    image = np.random.default_rng(3).integers(0, 256, shape).astype(np.uint8)
    wide = image.astype(int)
    half = np.array(
        [
            [
                plain_mean_times(wide, 3, r, c) >> 12 if 1 <= r < shape[0] - 1 and 1 <= c < shape[1] - 1 else 0
                for c in range(0, shape[1], 2)
            ]
            for r in range(0, shape[0], 2)
        ]
    )
    expected = np.array(
        [
            [
                min(max(126 * 4096 + plain_mean_times(half, 3, r, c) - plain_mean_times(half, 11, r, c), 0), 255 * 4096)
                >> 12
                if 5 <= r < half.shape[0] - 5 and 5 <= c < half.shape[1] - 5
                else 0
                for c in range(0, half.shape[1], 2)
            ]
            for r in range(0, half.shape[0], 2)
        ]
    )
    got, rim = jpl.band_pass(image, 2)
    np.testing.assert_array_equal(got, expected)
    assert rim == 3  # (1 px + 5 px of the half image + 1) // 2


def test_blobs_are_patches_whose_neighbours_differ_by_less_than_a_quarter_pixel():
    step = np.full((6, 10), 60 * 256)
    step[:, 4:] += 63
    assert not jpl.find_blobs(step, 60).any()
    step[:, 4:] += 1
    assert jpl.find_blobs(step, 25)[:, :4].all()
    assert not jpl.find_blobs(step, 25)[:, 4:].any()
    assert not jpl.find_blobs(step, 24).any()
    diagonal = np.full((4, 4), NO_DATA)
    diagonal[0, 0] = diagonal[1, 1] = 5 * 256
    assert jpl.find_blobs(diagonal, 2).sum() == 2
    assert not jpl.find_blobs(diagonal, 1).any()
    # 255 disparities, as many as one search takes, are more than 16 bits of 1/256 px hold.
    far_apart = np.full((4, 8), 1000 * 256)
    far_apart[:, 4:] = 1254 * 256
    assert not jpl.find_blobs(far_apart, 16).any()
    assert jpl.find_blobs(far_apart, 17).all()


def test_blob_size_below_zero_is_a_share_of_the_image():
    left, right, _ = jpl_images.pair(160, 120, 1, 128, 4)
    assert (
        match("jplv", left, right, {"blob_size": -4})[2]["counts"]
        == match("jplv", left, right, {"blob_size": 160 * 120 * 4 // 100})[2]["counts"]
    )


@pytest.mark.parametrize("level", [1, 2])
def test_halved_images_give_disparities_of_the_full_ones_in_their_place(level):
    """On a plane, bilinear interpolation between halved pixels adds no error of its own."""
    scene, rig = pairs.Scene(rock=False, contrast=0.4), pairs.camera(640, 320)
    (depth, left, _), (_, right, _) = pairs.view(scene, rig, "left"), pairs.view(scene, rig, "right")
    left, right = (np.rint(light / (2 * scene.radiance) * 255).astype(np.uint8) for light in (left, right))
    disparity, valid, info = match("jplv", left, right, {"pyramid_level": level})
    truth = rig.disparity(depth)
    assert disparity.shape == left.shape
    assert info["arrays"]["jpl_disparity"].shape == (320 >> level, 640 >> level)
    assert valid.mean() > 0.5
    # The original quotes 0.25 px of the halved images; half of that is the parabola's part on such a plane.
    assert np.median(np.abs(disparity - truth)[valid]) < 0.125 * 2**level
    assert abs(np.median((disparity - truth)[valid])) < 0.02 * 2**level  # a shifted grid would show here


def test_enlarging_never_joins_two_surfaces():
    from icymoon.stereo.matchers.jplv import _enlarge_disparity

    small = np.array([[10.0, 10.5, 20.0], [10.0, np.nan, 20.0]])
    big = _enlarge_disparity(small, 1, (4, 6))
    np.testing.assert_array_equal(big[0], [20, 20.5, 21, 21, 40, 40])
    np.testing.assert_array_equal(big[2], [20, 20, np.nan, np.nan, 40, 40])
    assert big[1, 0] == 20


def errors_by_fraction(disparity, truth):
    """Mean error, px, in each of 16 bins of the true disparity's fraction."""
    error = disparity - truth
    good = np.abs(error) < 1  # False for NaN
    bins = np.floor(truth[good] % 1 * 16).astype(int)
    return np.bincount(bins, error[good], 16) / np.bincount(bins, minlength=16)


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("noise", [0, 2])
def test_affine_windows_remove_pixel_locking(noise):
    scene, rig = pairs.Scene(contrast=0.4), pairs.camera(480, 270)
    (depth, left, _), (_, right, _) = pairs.view(scene, rig, "left"), pairs.view(scene, rig, "right")
    random = np.random.default_rng(0)
    left, right = (
        np.rint(light / (2 * scene.radiance) * 255 + noise * random.standard_normal(light.shape))
        .clip(0, 255)
        .astype(np.uint8)
        for light in (left, right)
    )
    truth = rig.disparity(depth)
    plain, valid, plain_info = match("jplv", left, right)
    affine, affine_valid, info = match("jplv", left, right, {"subpixel": "affine"})
    np.testing.assert_array_equal(valid, affine_valid)
    np.testing.assert_array_equal(info["arrays"]["jpl_disparity"], plain_info["arrays"]["jpl_disparity"])
    locked, free = errors_by_fraction(plain, truth), errors_by_fraction(affine, truth)
    assert np.std(locked) > 0.03  # the parabola's, so that the next line means something
    assert np.std(free) < np.std(locked) / 8
    assert np.nanmean(np.abs(affine - truth)) < 0.6 * np.nanmean(np.abs(plain - truth))


@pytest.mark.parametrize("window", [5, 31])
def test_the_affine_fit_leaves_alone_what_it_cannot_fit(window):
    left = np.zeros((60, 90), np.uint8)
    disparity = np.full((60, 90), np.nan)
    disparity[20:40, 30:60] = 7.25
    from icymoon.stereo.matchers.slanted_windows import refine_subpixel

    np.testing.assert_array_equal(refine_subpixel(left, left, disparity, window, 4), disparity)
    stripes = np.broadcast_to((np.arange(60) * 4).astype(np.uint8)[:, None], (60, 90))  # nothing to match along rows
    np.testing.assert_array_equal(refine_subpixel(stripes, stripes, disparity, window, 4), disparity)
    noise, other = np.random.default_rng(0).integers(0, 255, (2, 60, 90)).astype(np.uint8)
    assert np.nanmax(np.abs(refine_subpixel(noise, other, disparity, window, 4) - 7.25)) <= 1
    tiny = np.full((2, 2), 1.0)
    np.testing.assert_array_equal(refine_subpixel(tiny, tiny, tiny, window, 4), tiny)


def test_ranges_that_cannot_be_searched_are_named():
    image = np.zeros((40, 60), np.uint8)
    for options in ({"min_disparity": 40, "max_disparity": 20}, {"max_disparity": 255, "pyramid_level": 0}):
        with pytest.raises(IcyMoonError, match=r"jplv would search disparities .*max_disparity"):
            match("jplv", image, image, options)
    match("jplv", image, image, {"max_disparity": 254})
    match("jplv", image, image, {"max_disparity": 500, "pyramid_level": 1})
    with pytest.raises(IcyMoonError, match=r"too small for JPLV.*lower jplv.window or jplv.pyramid_level"):
        match("jplv", image, image, {"pyramid_level": 3})
