"""The verdict on noise of the render and of baked light, on pairs whose noise is known."""

import json

import numpy as np
import pairs
import pytest
from icymoon.settings.description import defaults, merged
from icymoon.stereo.images.disparity_and_occlusion import find_visible_in_right
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.stereo.measure.render_noise import (
    BAKE,
    CLEAN,
    DECIDES,
    NOISY,
    RENDER,
    UNKNOWN,
    judge_render_noise,
    measure_hidden_share,
)

RIG = pairs.camera(320, 240)
SMOOTH = pairs.Scene(contrast=0.3)


def judged(noise_dn=0.0, scene=SMOOTH, shade=None, seed=0):
    """The verdict on a pair with normal noise of ``noise_dn`` grey levels per eye, darkened by ``shade`` (H, W)."""
    (depth, left, _), (other, right, _) = (pairs.view(scene, RIG, eye) for eye in ("left", "right"))
    random = np.random.default_rng(seed)
    eyes = []
    for eye, light in enumerate((left, right)):
        level = 100 * light / scene.radiance
        if shade is not None:
            level = level * shade[eye]
        eyes.append(level + noise_dn * random.standard_normal(level.shape))
    return judge_render_noise(eyes[0], eyes[1], RIG.disparity(depth), find_visible_in_right(depth, other, RIG))


@pytest.mark.parametrize("noise_dn", [4.0, 8.0, 16.0])
def test_the_noise_of_an_eye_is_found(noise_dn):
    found = judged(noise_dn)
    rest = judged().lit.noise_dn  # of the interpolation
    assert found.lit.noise_dn == pytest.approx(np.hypot(noise_dn, rest), rel=0.05)
    assert found.lit.share > 0.9


def test_the_verdict_goes_from_clean_to_decided_by_noise():
    verdicts = [judged(noise_dn).verdict for noise_dn in (0.0, 1.0, 2.0, 8.0, 32.0)]
    assert verdicts[0] == CLEAN
    assert verdicts[-1] == DECIDES
    assert verdicts == sorted(verdicts, key=(CLEAN, NOISY, DECIDES).index)


def test_doubt_grows_with_noise_to_what_a_matcher_loses():
    doubts = [judged(noise_dn).doubt for noise_dn in (0.0, 8.0, 32.0, 128.0)]
    assert doubts == sorted(doubts)
    assert doubts[0] < 0.01
    assert 0.3 < doubts[-1] < 0.45


def test_shadow_is_judged_by_itself():
    """The same noise that the light hides decides in a shadow of a tenth of the light."""
    dark = np.where(np.arange(RIG.height_px) < RIG.height_px / 2, 0.1, 1.0)[:, None]
    found = judged(1.0, shade=(dark, dark))
    assert found.lit.hidden < 0.02
    assert found.shadow.hidden > 0.2
    assert found.shadow.share == pytest.approx(0.5, abs=0.05)
    assert found.verdict == DECIDES
    few = np.where(np.arange(RIG.height_px) < 10, 0.1, 1.0)[:, None]
    assert judged(1.0, shade=(few, few)).verdict != DECIDES  # below 5 % of the image


def test_nothing_to_compare_gives_no_verdict():
    empty = judge_render_noise(np.ones((9, 9)), np.ones((9, 9)), np.full((9, 9), np.nan), np.zeros((9, 9), bool))
    assert (empty.verdict, empty.doubt, empty.lit.noise_dn) == (None, None, None)
    tiny = judge_render_noise(np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1), bool))
    assert tiny.verdict is None


def test_images_without_noise_or_texture_are_clean():
    flat = np.full((40, 60), 100.0)
    found = judge_render_noise(flat, flat, np.full((40, 60), 5.0), np.broadcast_to(np.arange(60) >= 5, (40, 60)))
    assert (found.verdict, found.lit.noise_dn, found.doubt) == (CLEAN, 0.0, 0.0)


SHIFT_PX = 7


def on_ground(fixed_dn, render_dn=0.0, known=True, seed=0):
    """The verdict on a plane across the view with texture of 4 grey levels, on which baked light has noise of
    ``fixed_dn``, alike in both eyes, with another such error as known, and each eye has its own noise."""
    random = np.random.default_rng(seed)
    shape = RIG.height_px, RIG.width_px + SHIFT_PX
    ground = 100 + 4 * random.standard_normal(shape) + fixed_dn * random.standard_normal(shape)
    left, right = (
        ground[:, at : at + RIG.width_px] + render_dn * random.standard_normal((RIG.height_px, RIG.width_px))
        for at in (0, SHIFT_PX)
    )
    seen = np.broadcast_to(np.arange(RIG.width_px) >= SHIFT_PX, left.shape)
    error = fixed_dn * random.standard_normal(left.shape)
    return judge_render_noise(left, right, np.full(left.shape, float(SHIFT_PX)), seen, error if known else None)


def test_noise_that_both_eyes_share_is_judged_by_the_error_of_the_bake():
    """Texture is hidden where its 25 pixels have a variance below that of the noise, so 4 levels are hidden by 16 and
    not by 0.4. Between the eyes nothing differs."""
    found = [on_ground(fixed_dn) for fixed_dn in (0.0, 0.4, 3.0, 16.0)]
    assert [each.lit.noise_dn for each in found] == [0.0] * 4
    assert [each.verdict for each in found[:2]] == [CLEAN, CLEAN]
    assert found[-1].verdict == DECIDES
    assert [each.lit.hidden for each in found] == sorted(each.lit.hidden for each in found)
    assert [each.lit.baked_dn for each in found] == pytest.approx([0.0, 0.4, 3.0, 16.0], rel=0.02)
    assert (found[-1].larger, found[-1].lit.by_bake) == (BAKE, 1.0)
    assert found[0].larger is None


def test_the_same_noise_hides_as_much_whether_the_eyes_share_it_or_not():
    """What a matcher compares is noise in either case. Texture of 4 levels, noise of 4: each estimate of a variance has
    a spread of a quarter, so about half of the pixels are hidden."""
    shared, own = on_ground(4.0), on_ground(0.0, render_dn=4.0)
    assert shared.lit.hidden == pytest.approx(own.lit.hidden, abs=0.06)
    assert shared.doubt == pytest.approx(own.doubt, abs=0.02)
    assert (shared.larger, own.larger) == (BAKE, RENDER)


def test_the_larger_part_of_the_noise_is_named():
    assert on_ground(6.0, render_dn=12.0).larger == RENDER
    assert on_ground(12.0, render_dn=6.0).larger == BAKE


def test_an_error_that_does_not_vary_from_place_to_place_hides_nothing():
    flat = np.full((40, 60), 100.0)
    flat[::2] += 4.0
    seen = np.broadcast_to(np.arange(60) >= 5, flat.shape)
    found = judge_render_noise(flat, flat, np.full(flat.shape, 5.0), seen, np.full(flat.shape, 8.0))
    assert (found.verdict, found.lit.hidden) == (CLEAN, 0.0)


def test_without_the_error_of_a_bake_no_pair_is_clean():
    assert on_ground(16.0, known=False).verdict == UNKNOWN
    assert on_ground(0.0, known=False).verdict == UNKNOWN
    found = on_ground(0.0, render_dn=16.0, known=False)
    assert (found.verdict, found.larger) == (DECIDES, RENDER)  # whatever the bake adds
    assert found.lit.baked_dn is None


def noise_of(folder, response=None):
    return prepare_pair(folder, response or {}).facts["noise"]


@pytest.mark.parametrize("layout", ["4.x view", "5.x"])
def test_a_pair_is_judged_by_the_error_that_it_contains(tmp_path, layout):
    """Radiance of 2 W/(m² sr) with texture of a few per cent: an error of 2e-5 of it hides nothing, and one of 0.5
    all."""
    random = np.random.default_rng(1).standard_normal((pairs.camera().height_px, pairs.camera().width_px))
    clean, noisy = (
        noise_of(pairs.write_pair(tmp_path / name, layout=layout, baked_error=share * 2.0 * random))
        for name, share in (("clean", 1e-5), ("noisy", 0.5))
    )
    assert clean["verdict"] == CLEAN
    assert clean["lit"]["baked_dn"] < 0.01
    assert (noisy["verdict"], noisy["larger"]) == (DECIDES, BAKE)
    assert noisy["lit"]["noise_dn"] == clean["lit"]["noise_dn"]


@pytest.mark.parametrize("error", [None, np.nan])
def test_a_pair_of_an_older_version_with_baked_light_is_unknown(tmp_path, error):
    shape = pairs.camera().height_px, pairs.camera().width_px
    folder = pairs.write_pair(
        tmp_path / "pair",
        settings=merged(defaults(), {"quality": {"indirect": "BAKED"}}),
        baked_error=None if error is None else np.full(shape, error),
    )
    path = folder / "pair.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"indirect": pairs.BAKED}))
    assert noise_of(folder)["verdict"] == UNKNOWN
    path.write_text(json.dumps(json.loads(path.read_text()) | {"indirect": {"method": "TRACED", "why": "rocks"}}))
    assert noise_of(folder)["verdict"] == CLEAN


def test_the_error_of_a_bake_grows_with_the_light_that_it_is_of(tmp_path):
    random = np.random.default_rng(1).standard_normal((pairs.camera().height_px, pairs.camera().width_px))
    folder = pairs.write_pair(tmp_path / "pair", planet_share=0.5, baked_error=0.02 * random)
    exposed = {"auto_exposure": False, "exposure_s": prepare_pair(folder, {}).facts["exposure_s"]}
    dark, plain = (
        noise_of(folder, {"light": {"sun_scale": scale}, "sensor": exposed})["lit"]["baked_dn"] for scale in (0.5, 1.0)
    )
    assert plain > 0
    assert dark == pytest.approx(plain / 2, rel=0.01)


def test_what_is_truly_hidden_follows_from_the_difference():
    random = np.random.default_rng(5)
    texture = 100 + 10 * random.standard_normal((60, 80))
    everywhere = np.ones(texture.shape, bool)
    weak, strong = 2 * random.standard_normal(texture.shape), 50 * random.standard_normal(texture.shape)
    assert measure_hidden_share(weak, texture, everywhere) == 0
    assert measure_hidden_share(strong, texture, everywhere) == 1
    # What is the same all around changes no pattern.
    assert measure_hidden_share(np.full(texture.shape, 40.0), texture, everywhere) == 0
    # A quarter of the pixels; at its edge, squares of five pixels have some of both.
    part = np.where(np.arange(80) < 20, strong, weak)
    assert abs(measure_hidden_share(part, texture, everywhere) - 0.25) < 3 / 80
    assert measure_hidden_share(strong, texture, np.zeros(texture.shape, bool)) is None


def test_light_and_shadow_are_judged_apart_by_the_difference_too():
    random = np.random.default_rng(6)
    texture = 100 + 10 * random.standard_normal((60, 80))
    noise = random.standard_normal(texture.shape)
    for columns, hidden in ((20, 1.0), (2, 0.0)):  # a shadow of 2 of 80 columns is no twentieth of the image
        dark = np.arange(80) < columns
        image = np.where(dark, texture / 50, texture)
        found = measure_hidden_share(noise, image, np.ones(texture.shape, bool))
        assert abs(found - hidden) < 0.15
