"""Dust or frost on the window before a lens: which share of each pixel's light it takes away.

Grains lie on a flat window ahead of the entrance pupil, of diameter A = focal length / f-number. A pixel's beam crosses
the window in a disc of that diameter, whose centre is off the axis by the window's distance times the tangent of the
pixel's angle. The blocked share of light is the share of the disc that grains cover, so a grain much smaller than the
pupil is a faint, wide spot, and no image of it is sharp. This is geometry alone: grains are opaque discs, no light
is bent, and sunlight on the window itself is left out.
"""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import RigSettings, SensorSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..random_numbers.seeds import make_generator
from ..rig.focal_length import focal_px
from .sensor import find_stream

#: Most grains that are drawn, and most pixels of the window that the beams cross: some seconds and 2 GB.
MOST_GRAINS, MOST_PIXELS = 50_000, 32_000_000
#: Pixels of grains that are drawn at once, for memory.
_AT_ONCE = 2_000_000
#: Index of these among the streams of the sensor: the first two are the patterns of the eyes.
_STREAM = 2


def compute_blocked_share(
    sensor: SensorSettings, rig: RigSettings, shape: tuple[int, int], seed: int, eye: str
) -> Array | None:
    """Share (H, W) from 0 to 1 of each pixel's light that deposits block, on the sensor; None without deposits.

    ``seed`` is the data set's: the same deposits are in all of its images. Raises IcyMoonError for too many
    grains.
    """
    share = float(sensor.deposit_share)
    if share <= 0.0:
        return None
    per_mm = focal_px(rig) / float(sensor.deposit_window_mm)  # pixels for each millimetre of the window
    grain, pupil = float(sensor.deposit_mm) * per_mm, rig.focal_length_mm / float(sensor.f_number) * per_mm
    reach = math.ceil(pupil / 2) + 1
    rows, columns = shape[0] + 2 * reach, shape[1] + 2 * reach
    if rows * columns > MOST_PIXELS:
        raise IcyMoonError(
            f"The beams cross {columns} x {rows} pixels of the window with deposits, more than "
            f"{MOST_PIXELS // 1_000_000} million; raise sensor.deposit_window_mm or sensor.f_number."
        )
    # Discs at random places that cover this share together, where they overlap counted once.
    wide = grain / 2 + 1
    density = -math.log1p(-share) / (math.pi * (grain / 2) ** 2)
    expected = density * (rows + 2 * wide) * (columns + 2 * wide)
    if expected > MOST_GRAINS:
        raise IcyMoonError(
            f"sensor.deposit_share and sensor.deposit_mm make {expected:.3g} grains, more than "
            f"{MOST_GRAINS}; make the grains larger or fewer."
        )
    alike = bool(sensor.deposits_alike)
    random = make_generator(seed, "sensor", _STREAM + int(sensor.deposit_seed), 0 if alike else find_stream(eye))
    count = int(random.poisson(expected))
    places = random.uniform((-wide, -wide), (rows + wide, columns + wide), (count, 2))
    covered = 1.0 - np.exp(-_sum_of_discs(places, grain / 2, (rows, columns)))
    return np.clip(_mean_in_discs(covered, pupil / 2)[reach : reach + shape[0], reach : reach + shape[1]], 0.0, 1.0)


def apply_deposits(light: Array, blocked: Array | None, sensor: SensorSettings) -> Array:
    """Light (H, W) behind the window: the light that passes, and a veil of the light that the grains scatter.

    Of blocked light ``sensor.deposit_scatter`` goes on, evenly from the whole image.
    """
    if blocked is None:
        return light
    light = np.minimum(np.asarray(light, np.float64), 1e30)
    return (1.0 - blocked) * light + float(sensor.deposit_scatter) * blocked * light.mean()


def _sum_of_discs(places: Array, radius: float, shape: tuple[int, int]) -> Array:
    """For each pixel (row, column), a number whose negative exponential is the share that no disc covers."""
    total = np.zeros(shape[0] * shape[1])
    reach = math.ceil(radius + 0.5)
    around = np.arange(-reach, reach + 1)
    for part in np.array_split(places, 1 + len(places) * len(around) ** 2 // _AT_ONCE):
        row, column = np.floor(part).astype(int).T[..., None] + around  # (grains, across) each
        down, right = row + 0.5 - part[:, :1], column + 0.5 - part[:, 1:]
        stamp = np.clip(radius + 0.5 - np.hypot(down[:, :, None], right[:, None, :]), 0.0, min(1.0, 2 * radius))
        stamp *= math.pi * radius**2 / stamp.sum(axis=(1, 2), keepdims=True)  # of its area, however small
        inside = ((row >= 0) & (row < shape[0]))[:, :, None] & ((column >= 0) & (column < shape[1]))[:, None, :]
        # An opaque pixel has no finite logarithm, so it passes a little light, less than a converter's step.
        left = -np.log1p(-np.minimum(stamp[inside], 1.0 - 1e-9))
        where = (row[:, :, None] * shape[1] + column[:, None, :])[inside]
        total += np.bincount(where, left, len(total))
    return total.reshape(shape)


def _mean_in_discs(image: Array, radius: float) -> Array:
    """The mean in a disc around each pixel; only right at least a radius from the border."""
    rows, columns = image.shape
    y, x = np.fft.fftfreq(rows, 1.0 / rows)[:, None], np.fft.fftfreq(columns, 1.0 / columns)[None, :]
    disc = np.clip(radius + 0.5 - np.hypot(y, x), 0.0, 1.0)
    if disc.sum() == 0.0:
        return image
    spectrum = np.fft.rfft2(image) * np.fft.rfft2(disc / disc.sum())
    return np.fft.irfft2(spectrum, image.shape)
