"""The verdict on render noise, on pairs whose noise is known."""

import numpy as np
import pairs
import pytest
from icymoon.stereo.images.disparity_and_occlusion import visible_in_right
from icymoon.stereo.measure.render_noise import CLEAN, DECIDES, NOISY, render_noise

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
    return render_noise(eyes[0], eyes[1], RIG.disparity(depth), visible_in_right(depth, other, RIG))


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
    empty = render_noise(np.ones((9, 9)), np.ones((9, 9)), np.full((9, 9), np.nan), np.zeros((9, 9), bool))
    assert (empty.verdict, empty.doubt, empty.lit.noise_dn) == (None, None, None)
    tiny = render_noise(np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1), bool))
    assert tiny.verdict is None


def test_images_without_noise_or_texture_are_clean():
    flat = np.full((40, 60), 100.0)
    found = render_noise(flat, flat, np.full((40, 60), 5.0), np.broadcast_to(np.arange(60) >= 5, (40, 60)))
    assert (found.verdict, found.lit.noise_dn, found.doubt) == (CLEAN, 0.0, 0.0)
