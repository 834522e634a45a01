"""Charged particles that hit the sensor: straight tracks of electrons, as in images from Jupiter's radiation belts."""

from __future__ import annotations

import numpy as np

from ...settings.topics.camera import SensorSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError

#: Maximum number of particles in an exposure.
MAX_HITS = 1_000_000


def expected_hit_count(sensor: SensorSettings, shape: tuple[int, int], pitch_m: float, seconds: float) -> float:
    """Compute the expected number of particles through an image (H, W) with pixels of side ``pitch_m`` in one exposure.

    ``sensor.radiation_flux_cm2_s`` counts particles from all directions behind the shield, per second and cm² of the
    sensor's plane.
    """
    area_cm2 = shape[0] * shape[1] * (pitch_m * 100) ** 2
    return float(sensor.radiation_flux_cm2_s) * area_cm2 * seconds


def draw_hits(
    sensor: SensorSettings, shape: tuple[int, int], pitch_m: float, seconds: float, random: np.random.Generator
) -> Array:
    """Draw the electrons (H, W) that particles leave in one exposure.

    The number of particles is Poisson distributed. In an isotropic flux through a plane, cos² θ is uniform between 0
    and 1. A particle crosses the sensitive depth d (``radiation_depth_um``) on a straight line of length d / cos θ,
    whose part along the plane is d tan θ. It frees ``radiation_e_per_um`` electrons per micrometre. Raises IcyMoonError
    above a million hits, when every pixel would be hit.
    """
    mean = expected_hit_count(sensor, shape, pitch_m, seconds)
    if mean > MAX_HITS:
        raise IcyMoonError(
            f"sensor.radiation_flux_cm2_s gives {mean:.3g} hits in {seconds:.3g} s, more than "
            f"{MAX_HITS}; lower it or sensor.exposure_s."
        )
    count = int(random.poisson(mean))
    cos2 = 1.0 - random.random(count)  # above 0
    depth_um = float(sensor.radiation_depth_um)
    electrons = float(sensor.radiation_e_per_um) * depth_um / np.sqrt(cos2)
    length_px = depth_um * 1e-6 * np.sqrt(1 / cos2 - 1) / pitch_m
    direction = random.random(count) * 2 * np.pi
    start = random.random((2, count)) * np.array(shape)[:, None]
    # The part of a very flat track outside the image is skipped.
    kept = np.minimum(1.0, (shape[0] + shape[1]) / np.maximum(length_px, 1e-300))
    return _draw_tracks(start, direction, length_px * kept, electrons * kept, shape)


def _draw_tracks(start: Array, direction: Array, length_px: Array, electrons: Array, shape: tuple[int, int]) -> Array:
    """Draw the electrons (H, W) of straight tracks, in steps of at most half a pixel. Each step's electrons go to the
    pixel of its middle.
    """
    steps = np.ceil(2 * length_px).astype(np.intp) + 1
    track = np.repeat(np.arange(len(steps)), steps)
    along = (np.arange(len(track)) - np.repeat(np.cumsum(steps) - steps, steps) + 0.5) / steps[track]
    row = np.floor(start[0, track] + along * length_px[track] * np.sin(direction[track])).astype(np.intp)
    column = np.floor(start[1, track] + along * length_px[track] * np.cos(direction[track])).astype(np.intp)
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    place = row[inside] * shape[1] + column[inside]
    charge = (electrons / steps)[track[inside]]
    return np.bincount(place, charge, shape[0] * shape[1]).reshape(shape)
