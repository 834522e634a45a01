"""Classes of pixels and the sums over them."""

import numpy as np
import pytest
from icymoon.stereo.measure import by_pixel_class
from icymoon.stereo.measure.by_pixel_class import (
    DEPOSITS,
    FACTORS,
    MATERIAL,
    OCCLUSION,
    RANGE,
    SHADOW,
    SLOPE,
    SUMS,
    TEXTURE,
    ClassCells,
    add_sums,
    classify_pixels,
    find_shadow,
    measure_texture,
)
from icymoon.stereo.measure.metrics import is_usable
from icymoon.support.labels import LANDER, ROCK, TERRAIN

pytestmark = pytest.mark.filterwarnings("error")

RANDOM = np.random.default_rng(0)
TRUTH = np.where(RANDOM.random((60, 80)) < 0.1, np.nan, RANDOM.uniform(0.4, 120, (60, 80)))
DEPTH = np.where(RANDOM.random((60, 80)) < 0.2, np.nan, TRUTH * RANDOM.normal(1, 0.05, (60, 80)))
CLASSES = classify_pixels(
    TRUTH,
    RANDOM.random((60, 80)) < 0.9,
    RANDOM.exponential(3, (60, 80)),
    np.ones((60, 80)),
    np.tile([0.0, 0.0, 1.0], (60, 80, 1)),
    RANDOM.integers(0, 5, (60, 80)),
    [0.0, 0.0, 1.0],
)


def sums_by_class(classes, depth, truth, disparity, true, doffs_px=0.0):
    known = is_usable(truth)
    return by_pixel_class.sum_by_class(
        ClassCells(classes, known), depth[known], truth[known], disparity[known], true[known], doffs_px
    )


def test_classes_lie_between_their_bounds():
    assert RANGE.of(np.array([0.1, 0.5, 5.0, 1e10, np.nan])).tolist() == [0, 1, 7, 16, -1]
    assert RANGE.classes[7] == "4–6"
    for factor in FACTORS:
        assert CLASSES[factor.key].max() < len(factor.classes)


def test_classes_are_those_of_every_evaluation_so_far():
    """Or sums that are kept with old and new pairs would not add up."""
    assert RANGE.bounds[:2] == (0.5, 0.75)
    assert RANGE.bounds[2:] == tuple(2 * bound for bound in RANGE.bounds[:-2])  # two to a doubling
    assert RANGE.bounds[-1] == 96.0
    assert TEXTURE.bounds == tuple(2.0**k for k in range(-1, 6))
    assert SLOPE.classes == ("< 5", "5–10", "10–15", "15–20", "20–30", "30–45", "45–60", "> 60")


def test_pixels_are_of_the_class_that_truth_and_image_say():
    """One row of pixels; ground tilted by 0, 25 and 95 degrees, the last turned from a Sun overhead."""
    tilt = np.radians([[0.0, 25.0, 95.0]])
    normal = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], -1)
    found = classify_pixels(
        np.array([[0.4, 5.0, 100.0]]),
        np.array([[True, False, True]]),
        np.array([[0.1, 3.0, 40.0]]),
        np.maximum(normal[..., 2], 0.0),
        normal,
        np.array([[TERRAIN, ROCK, LANDER]]),
        [0.0, 0.0, 1.0],
    )
    for factor, wanted in (
        (RANGE, ("< 0.5", "4–6", "> 96")),
        (TEXTURE, ("< 0.5", "2–4", "> 32")),
        (SLOPE, ("< 5", "20–30", "> 60")),
        (OCCLUSION, ("both eyes", "left only", "both eyes")),
        (MATERIAL, ("terrain", "rock", "lander")),
        (SHADOW, ("sunlit", "sunlit", "shadow")),
    ):
        assert tuple(factor.classes[k] for k in found[factor.key][0]) == wanted
    nothing = classify_pixels(
        np.ones((1, 1)),
        np.ones((1, 1), bool),
        np.ones((1, 1)),
        np.ones((1, 1)),
        None,
        np.array([[99]]),
        [0.0, 0.0, 1.0],
    )
    assert nothing["material"].tolist() == nothing["shadow"].tolist() == [[-1]]  # a label of no class; no normals


def test_an_error_of_exactly_a_pixel_or_ten_centimetres_is_within_it():
    truth, depth = np.array([[2.0, 4.0, 8.0, 0.5]]), np.array([[2.125, 4.25, 8.0, 0.5 + 0.1]])
    true, disparity = np.array([[20.0, 10.0, 5.0, 80.0]]), np.array([[19.0, 8.5, 5.5, 80.0]])
    classes = {factor.key: np.zeros((1, 4), int) for factor in FACTORS}
    found = {key: sums[0] for key, sums in sums_by_class(classes, depth, truth, disparity, true)["range"].items()}
    assert (found["n"], found["bad_1"], found["fine"]) == (4, 1, 3)
    assert found["fine_epe_px"] == pytest.approx(1.0 + 0.5)
    assert found["l1_rate_10"] == 2
    assert found["m_per_px"] == pytest.approx(2 / 20 + 4 / 10 + 8 / 5 + 0.5 / 80)


def test_sums_are_those_of_the_pixels_of_each_class():
    sums = sums_by_class(CLASSES, DEPTH, TRUTH, 85 / DEPTH, 85 / TRUTH)
    for factor in FACTORS:
        for k in range(len(factor.classes)):
            here = (CLASSES[factor.key] == k) & np.isfinite(TRUTH)
            both = here & np.isfinite(DEPTH)
            error, pixels = np.abs(DEPTH - TRUTH)[both], np.abs(85 / DEPTH - 85 / TRUTH)[both]
            got = {key: sums[factor.key][key][k] for key in SUMS}
            assert (got["true"], got["n"], got["bad_1"]) == (here.sum(), both.sum(), (pixels > 1).sum())
            assert got["l1_m"] == pytest.approx(error.sum(), rel=1e-6)
            assert got["epe_px"] == pytest.approx(pixels.sum(), rel=1e-6)
            assert got["fine"] == (pixels <= 1).sum()
            assert got["m_per_px"] == pytest.approx((TRUTH[both] ** 2 / 85).sum(), rel=1e-6)
    for key in ("range", "texture", "occlusion"):  # everyone is in one of these classes
        assert sum(sums[key]["true"]) == np.isfinite(TRUTH).sum()


def test_a_disparity_of_shifted_principal_points_counts_from_where_depth_is_infinite():
    """Where d + doffs = f B / Z, a pixel of disparity is Z / (d + doffs) of depth."""
    shifted = sums_by_class(CLASSES, DEPTH, TRUTH, 85 / DEPTH - 3, 85 / TRUTH - 3, doffs_px=3.0)
    plain = sums_by_class(CLASSES, DEPTH, TRUTH, 85 / DEPTH, 85 / TRUTH)
    for key in ("m_per_px", "epe_px"):
        assert shifted["range"][key] == pytest.approx(plain["range"][key], rel=1e-9)


def test_sums_add_up():
    one = sums_by_class(CLASSES, DEPTH, TRUTH, 85 / DEPTH, 85 / TRUTH)
    two = add_sums(add_sums(None, one), one)
    assert two["range"]["n"] == [2 * n for n in one["range"]["n"]]
    assert two["range"]["l1_m"] == [2 * total for total in one["range"]["l1_m"]]


def test_texture_is_the_gradient_along_the_row():
    ramp = np.tile(np.arange(0, 200, 4, dtype=np.uint8), (20, 1))
    np.testing.assert_allclose(measure_texture(ramp), 4)
    np.testing.assert_allclose(measure_texture(ramp.T), 0)
    assert (measure_texture(np.full((5, 5), 255, np.uint8)) == 0).all()
    assert measure_texture(np.zeros((1, 1), np.uint8)).tolist() == [[0]]
    assert measure_texture(np.array([[0, 8]], np.uint8)).tolist() == [[8, 8]]
    assert TEXTURE.of(measure_texture(ramp)).max() == 4


def test_texture_is_a_mean_over_nine_pixels_each_way():
    step = np.zeros((31, 31), np.uint8)
    step[15:, 15:] = 8  # whose gradient is 4 in two columns of its lower half
    found = measure_texture(step)
    assert found[25, 15] == pytest.approx(np.sqrt(2 * 16 / 9))
    assert (found[25, [9, 20]] == 0).all()
    assert (found[25, [10, 19]] > 0).all()
    assert found[15, 15] == pytest.approx(np.sqrt(2 * 16 / 9 * 5 / 9))


def test_texture_of_an_even_image_is_a_number_though_its_sums_are_rounded(monkeypatch):
    monkeypatch.setattr(by_pixel_class.cv2, "boxFilter", lambda image, *_, **__: np.full_like(image, -1e-17))
    assert (measure_texture(np.full((5, 5), 255, np.uint8)) == 0).all()


def test_cast_and_own_shadows():
    """Half of a Lambertian ground is in a cast shadow that a tenth of the light reaches, a strip faces away."""
    sun = np.array([0.6, 0.0, 0.8])
    normal = np.tile([0.0, 0.0, 1.0], (40, 60, 1))
    normal[:, :10] = [-0.9, 0.0, 0.436]  # turned away
    normal[:, 10:20] = [0.3, 0.0, 0.954]
    albedo = np.where(np.arange(40)[:, None] < 20, 0.9, 0.3) * RANDOM.uniform(0.9, 1.0, (40, 60))
    semantic = np.where(np.arange(40)[:, None] < 20, 1, 2) * np.ones((1, 60), int)  # dark rock, bright ice
    light = np.maximum(normal @ sun, 0.05)
    light[:, 40:] *= 0.1
    shadow = find_shadow(albedo * light, normal, sun.tolist(), semantic)
    expected = np.zeros((40, 60), bool)
    expected[:, :10] = expected[:, 40:] = True
    np.testing.assert_array_equal(shadow, expected)


@pytest.mark.parametrize("reaches", [0.2, 0.3, 0.4, 0.5])
@pytest.mark.parametrize("tilted", [0.0, 0.9, 1.3])
def test_ground_is_in_shadow_below_about_a_third_of_the_light_whichever_way_it_faces(reaches, tilted):
    """An even Lambertian ground under a Sun overhead, facets from level to 75° steep, half of it in a penumbra.

    What makes a shadow is the part of its own light that a facet gets, however dark its slant makes it.
    """
    normal = np.zeros((20, 40, 3))
    normal[..., 2] = 1.0
    normal[10:] = [np.sin(tilted), 0.0, np.cos(tilted)]
    light = 0.7 * normal[..., 2]
    light[:, 30:] *= reaches
    shadow = find_shadow(light, normal, [0.0, 0.0, 1.0], np.ones((20, 40), int))
    assert not shadow[:, :30].any()
    assert (shadow[:, 30:] == (reaches < 0.35)).all()


def test_pixels_behind_deposits_are_those_that_lose_a_twentieth_of_their_light():
    one = np.ones((1, 4))
    found = classify_pixels(one, one > 0, one, one, None, None, None, np.array([[0, 12, 13, 255]], np.uint8))
    assert [DEPOSITS.classes[k] for k in found["deposits"][0]] == ["clean", "clean", "deposits", "deposits"]


def test_sums_with_an_earlier_evaluation_are_of_the_factors_of_both():
    sums = sums_by_class(CLASSES, DEPTH, TRUTH, 85 / DEPTH, 85 / TRUTH)
    earlier = {key: value for key, value in sums.items() if key != "deposits"}
    assert set(by_pixel_class.add_sums(sums, earlier)) == set(by_pixel_class.add_sums(earlier, sums)) == set(earlier)


def test_unknown_properties_classify_nothing():
    found = classify_pixels(TRUTH, TRUTH > 0, np.ones_like(TRUTH), np.ones_like(TRUTH), None, None, None)
    assert all((found[key] == -1).all() for key in ("slope", "shadow", "material", "deposits"))
    sums = sums_by_class(found, DEPTH, TRUTH, 85 / DEPTH, 85 / TRUTH)
    assert sum(sums["slope"]["true"]) == 0


def test_an_image_of_one_pixel_or_none_known():
    for truth in (np.array([[2.0]]), np.array([[np.nan]])):
        found = classify_pixels(
            truth, truth > 0, measure_texture(np.zeros((1, 1), np.uint8)), truth * 0, None, None, None
        )
        sums = sums_by_class(found, truth, truth, 85 / truth, 85 / truth)
        assert sum(sums["range"]["n"]) == np.isfinite(truth).sum()
