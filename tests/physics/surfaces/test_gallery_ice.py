"""The gallery's ice and snow show what their settings are for: no gems, and glints."""

from __future__ import annotations

import numpy as np
from icymoon.physics.surfaces.fractures import sight_depth_m
from icymoon.settings import description, preset_files

#: Slopes that grains have, in degrees: no steeper facet is seen.
STEEPEST_DEG = 50.0


def _described(name):
    return description.merged(description.defaults(), preset_files.load_preset(name))


def _unit(azimuth_deg, elevation_deg):
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])


def test_level_snow_in_the_middle_has_facets_that_mirror_the_sun_and_no_denoiser_removes_them():
    scene = _described("gallery/fresh_snow")
    light, rig = scene.light, scene.rig
    eye = -_unit(rig.heading_deg, -rig.pitch_deg)
    halfway = eye + _unit(light.sun_azimuth_deg, light.sun_elevation_deg)
    slope = np.degrees(np.arccos(halfway[2] / np.linalg.norm(halfway)))
    assert scene.surface.glint_share > 0.0
    assert slope < STEEPEST_DEG - 10.0
    assert scene.quality.denoiser == "NONE"


def test_nobody_sees_through_rocks_of_bubbly_ice():
    scene = _described("gallery/subsurface_ice")
    assert 0.0 < sight_depth_m(scene.rock_surface) < scene.rocks.smallest_m
