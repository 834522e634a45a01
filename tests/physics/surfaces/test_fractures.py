"""Fractures in ice: a gap of air against Fresnel's formula, and how far one sees."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.surfaces.fractures import gap_reflectance, has_fractures, sight_depth_m
from icymoon.settings.description import defaults

ICE = 1.31


def test_a_gap_seen_straight_on_reflects_twice_what_one_face_does_less_what_both_do():
    one = ((ICE - 1) / (ICE + 1)) ** 2
    assert gap_reflectance(1.0, ICE) == pytest.approx(2 * one / (1 + one), rel=1e-12)


def test_beyond_the_critical_angle_all_is_reflected_and_before_it_more_the_flatter():
    critical = math.asin(1 / ICE)
    flat, steep = np.linspace(critical, math.pi / 2, 9)[1:], np.linspace(math.radians(38), critical, 20)[:-1]
    assert (gap_reflectance(np.cos(flat), ICE) == 1.0).all()
    assert (np.diff(gap_reflectance(np.cos(steep), ICE)) > 0).all()
    # One polarisation passes wholly at Brewster's angle, so that less than half is reflected there.
    assert gap_reflectance(math.cos(math.atan(1 / ICE)), ICE) < 0.5


def test_a_plate_of_ice_in_air_and_a_gap_of_air_in_ice_reflect_alike():
    outside = np.linspace(0.0, math.radians(80), 9)
    inside = np.arcsin(np.sin(outside) / ICE)
    assert gap_reflectance(np.cos(inside), ICE) == pytest.approx(gap_reflectance(np.cos(outside), 1 / ICE), rel=1e-9)


def test_one_sees_further_into_ice_with_fewer_or_larger_bubbles_and_not_into_opaque_ice():
    surface = defaults().surface | {"fracture_share": 0.3}
    bubbly = surface | {"bubble_share": 0.01, "bubble_radius_m": 5e-4}
    # One bubble of radius a hides a disc: with N per volume the mean free path is 1 / (N pi a^2).
    number = 0.01 / (4 / 3 * math.pi * 5e-4**3)
    assert sight_depth_m(bubbly) == pytest.approx(1 / (number * math.pi * 5e-4**2))
    assert has_fractures(bubbly)
    assert has_fractures(surface | {"transmission": 0.5})
    assert not has_fractures(surface)
    assert not has_fractures(bubbly | {"model": "LAMBERT"})
    assert not has_fractures(bubbly | {"fracture_share": 0.0})
