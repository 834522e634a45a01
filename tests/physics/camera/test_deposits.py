"""Deposits on the window: their share, the size of a spot by geometry, and that light adds up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.camera.deposits import apply_deposits, compute_blocked_share
from icymoon.physics.rig.focal_length import focal_px
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

SHAPE = (240, 320)


def described(**sensor: float | bool) -> Settings:
    return merged(defaults(), {"rig": {"width_px": SHAPE[1], "height_px": SHAPE[0]}, "sensor": sensor})


def blocked(settings: Settings, seed: int = 1, eye: str = "left") -> Array:
    found = compute_blocked_share(settings.sensor, settings.rig, SHAPE, seed, eye)
    assert found is not None
    return found


def test_without_deposits_nothing_changes():
    settings = described()
    assert compute_blocked_share(settings.sensor, settings.rig, SHAPE, 1, "left") is None
    light = np.random.default_rng(1).uniform(0, 9, SHAPE)
    assert apply_deposits(light, None, settings.sensor) is light


@pytest.mark.parametrize(("share", "grain_mm"), [(0.05, 0.5), (0.8, 1.0)])
def test_the_window_is_covered_by_the_share(share, grain_mm):
    settings = described(deposit_share=share, deposit_mm=grain_mm, f_number=16.0)
    means = [blocked(settings, seed).mean() for seed in range(6)]
    assert np.mean(means) == pytest.approx(share, abs=4 * np.std(means) / math.sqrt(len(means)) + 0.002)


def test_one_grain_is_a_spot_as_wide_and_as_dark_as_geometry_has_it():
    settings = described(deposit_share=0.0001, deposit_mm=0.6, deposit_window_mm=30.0, f_number=22.0)
    rig, sensor = settings.rig, settings.sensor
    pupil = rig.focal_length_mm / sensor.f_number
    per_mm = focal_px(rig) / sensor.deposit_window_mm
    found = next(
        image
        for image in (blocked(settings, seed) for seed in range(200))
        if image[5:-5, 5:-5].max() > 0
        and max(image[:5].max(), image[-5:].max(), image[:, :5].max(), image[:, -5:].max()) < 1e-9
    )
    # The beam blocked in full counts (d / A)² of its disc; over the whole spot a grain blocks its own area once.
    assert found.max() == pytest.approx((sensor.deposit_mm / pupil) ** 2, rel=0.1)
    grains = found.sum() / (math.pi / 4 * (sensor.deposit_mm * per_mm) ** 2)
    assert grains == pytest.approx(round(grains), abs=0.02)
    assert round(grains) == 1
    wide = np.ptp(np.flatnonzero((found > 1e-6).any(axis=0))) + 1
    assert wide == pytest.approx((pupil + sensor.deposit_mm) * per_mm, abs=2.5)  # to the pixel on either side


def test_eyes_have_their_own_deposits_unless_alike_and_seeds_move_them():
    own, alike = described(deposit_share=0.1), described(deposit_share=0.1, deposits_alike=True)
    assert np.array_equal(blocked(own), blocked(own))
    assert not np.allclose(blocked(own), blocked(own, eye="right"))
    assert np.array_equal(blocked(alike), blocked(alike, eye="right"))
    assert not np.allclose(blocked(own), blocked(described(deposit_share=0.1, deposit_seed=1)))
    assert not np.allclose(blocked(own), blocked(own, seed=2))


def test_light_is_taken_and_its_veil_is_even():
    settings = described(deposit_share=0.2, deposit_scatter=0.5)
    share = blocked(settings)
    assert share.min() >= 0.0
    assert share.max() <= 1.0
    even = apply_deposits(np.full(SHAPE, 4.0), share, settings.sensor)
    np.testing.assert_allclose(even, 4.0 * (1 - 0.5 * share), rtol=1e-12)
    ends = apply_deposits(np.full(SHAPE, np.inf), share, settings.sensor)
    assert np.isfinite(ends).all()


def test_too_many_grains_are_a_sentence():
    with pytest.raises(IcyMoonError, match=r"make the grains larger"):
        blocked(described(deposit_share=0.9, deposit_mm=0.01))
    with pytest.raises(IcyMoonError, match=r"raise sensor\.deposit_window_mm"):
        blocked(described(deposit_share=0.1, deposit_window_mm=0.1))
