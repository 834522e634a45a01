"""Projectors without rays: geometry, patterns, decoding, triangulation, and contrast on ice."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.projector.decode import decode_columns, triangulate_columns
from icymoon.physics.projector.device import Projector, sample_pattern
from icymoon.physics.projector.ice_contrast import find_modulation, find_phase_bias
from icymoon.physics.projector.patterns import Pattern, make_dots, make_gray_and_phase
from icymoon.support.errors import IcyMoonError


def test_the_field_has_its_power_and_its_corners():
    projector = Projector(64, 48, 60.0, 3.0)
    pose = projector.place(np.eye(4))
    half = np.array([32, 24]) / projector.focal_px
    corners = np.array([[x * half[0], y * half[1], 1.0] for x in (-1, 1) for y in (-1, 1)]) * 0.999 + pose[:3, 3]
    np.testing.assert_allclose(projector.locate(corners, pose)[0], [0, 0], atol=0.05)
    assert np.isnan(projector.locate(-corners, pose)).all()
    x, y = (np.linspace(-h, h, 201) for h in half)
    whole = np.trapezoid if hasattr(np, "trapezoid") else np.trapz
    by_sum = whole(whole((1 + x[:, None] ** 2 + y**2) ** -1.5, y, axis=1), x)
    assert projector.solid_angle_sr == pytest.approx(by_sum, rel=1e-4)
    cone_sr = 2 * math.pi * (1 - math.cos(math.radians(projector.cone_deg) / 2))
    assert projector.cone_power_w / cone_sr == pytest.approx(projector.power_w / projector.solid_angle_sr)


def test_a_projector_is_placed_and_aimed_as_lamps_are():
    pose = Projector(right_m=0.3, ahead_m=0.5, up_m=0.2, azimuth_deg=90.0).place(np.eye(4))
    np.testing.assert_allclose(pose[:3, 3], [0.3, -0.2, 0.5])
    np.testing.assert_allclose(pose[:3, 2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(Projector(elevation_deg=90.0).place(np.eye(4))[:3, 2], [0, -1, 0], atol=1e-12)


def test_dots_are_as_many_and_as_large_as_asked_and_repeat_by_their_seed():
    projector = Projector(200, 150)
    dots = make_dots(projector, 100, 4.0, 7)
    assert dots.sum() == pytest.approx(100 * math.pi * 4, rel=0.1)  # some overlap or leave the field
    np.testing.assert_array_equal(dots, make_dots(projector, 100, 4.0, 7))
    assert (dots != make_dots(projector, 100, 4.0, 8)).any()
    assert make_dots(projector, 1, 3.0, 0).max() > 0.5


@pytest.mark.parametrize(("columns", "period", "shifts"), [(640, 32.0, 4), (100, 13.0, 3), (37, 8.0, 5), (4, 64.0, 3)])
def test_codes_decode_to_their_columns_also_at_the_edges_of_bits(columns, period, shifts):
    projector = Projector(columns, 4, 40.0)
    patterns = make_gray_and_phase(projector, period, shifts)
    decoded = decode_columns(100 + 900 * patterns, projector, period, 50.0)
    np.testing.assert_allclose(decoded, np.tile(np.arange(columns) + 0.5, (4, 1)), atol=1e-3)
    wrong = 100 + 900 * patterns
    bits = len(patterns) - 2 - shifts
    wrong[1 + bits, :, 1:] = wrong[1 + bits, :, :-1]  # the finest bit is a column late
    late = decode_columns(wrong, projector, period, 50.0)
    np.testing.assert_allclose(late[0, 1:], np.arange(1, columns) + 0.5, atol=1e-3)
    assert np.isnan(decode_columns(100 + 9 * patterns, projector, period, 50.0)).all()


def test_sampling_is_linear_between_the_middles_of_pixels():
    pattern = np.array([[0.0, 1.0], [0.0, 1.0]])
    place = np.array([[0.5, 1.0], [1.0, 1.0], [1.5, 0.2], [np.nan, np.nan]])
    np.testing.assert_allclose(sample_pattern(pattern, place), [0.0, 0.5, 1.0, 0.0])
    assert sample_pattern(np.ones((1, 1)), np.array([[0.3, 0.9]])) == 1.0


def test_columns_of_a_wall_give_its_depth():
    projector = Projector(640, 480, right_m=0.4, azimuth_deg=-5.0)
    eye, rays = np.eye(4), np.stack([*np.meshgrid(np.linspace(-0.2, 0.2, 9), [0.0, 0.1]), np.ones((2, 9))], axis=-1)
    pose = projector.place(eye)
    column = projector.locate((rays * 3.0).reshape(-1, 3), pose)[:, 0].reshape(2, 9)
    np.testing.assert_allclose(triangulate_columns(column, projector, pose, eye, rays), 3.0, rtol=1e-9)


def test_contrast_and_bias_on_ice_are_those_of_photon_walks():
    """Walks with g 0.75 and an absorption of 0.01 per transport length."""
    found = find_modulation(np.array([5.0, 20.0, 100.0]), 0.01)
    np.testing.assert_allclose(found, [0.27, 0.76, 0.98], atol=0.05)
    assert found[1:] == pytest.approx([0.76, 0.98], abs=0.02)
    assert find_modulation(1e9, 0.01) == pytest.approx(1.0)
    np.testing.assert_allclose(find_phase_bias(np.array([20.0, 45.0, 60.0])), [0.32, 0.63, 0.75], atol=0.03)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Projector(power_w=-1.0), "power is -1 W"),
        (lambda: Projector(power_w=math.nan), "power is nan W"),
        (lambda: Projector(columns=0), "0 x 480 pixels"),
        (lambda: Projector(width_deg=170.0), "170° wide"),
        (lambda: Projector(10, 1000, 140.0), "from corner to corner"),
        (lambda: Pattern(dots=0).make(Projector()), "has 0 dots; give 1 to"),
        (lambda: Pattern(dot_px=0.0).make(Projector()), "0 pixels wide"),
        (lambda: Pattern("NONE").make(Projector()), "There is no pattern 'NONE'"),
        (lambda: Pattern("STRIPES", period_px=1.0).make(Projector()), "period of 1 pixels"),
        (lambda: Pattern("GRAY_PHASE", shifts=2).make(Projector()), "has 2 shifts"),
    ],
)
def test_projectors_and_patterns_that_cannot_be_are_one_sentence(make, told):
    with pytest.raises(IcyMoonError) as error:
        make()
    assert told in str(error.value)
