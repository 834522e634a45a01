"""Dust or frost on the window before a lens: the share of each pixel's light that it stops.

Grains lie on a flat window ahead of the entrance pupil, whose diameter is A = focal length / f-number. A pixel's beam
crosses the window in a disc of that diameter. The centre of the disc is off the axis by the window's distance times the
tangent of the pixel's angle. The blocked share of light is the share of the disc that grains cover, so a grain much
smaller than the pupil gives a faint, wide spot without a sharp image.

The model is geometric: grains are opaque discs that bend no light, and sunlight on the window itself is left out.
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

#: Maximum number of grains; drawing them takes some seconds.
MAX_GRAINS = 50_000
#: Maximum number of pixels of the window that the beams cross; they take 2 GB.
MAX_WINDOW_PIXELS = 32_000_000
#: Number of pixels of grains that are drawn together, to bound memory.
_PIXELS_AT_ONCE = 2_000_000
#: Index of the deposits among the sensor's random streams; streams 0 and 1 are the patterns of the eyes.
_DEPOSIT_STREAM = 2


def compute_blocked_share(
    sensor: SensorSettings, rig: RigSettings, shape: tuple[int, int], seed: int, eye: str
) -> Array | None:
    """Compute the share (H, W), 0 to 1, of each pixel's light that deposits block; None without deposits. ``seed``
    belongs to the data set, so that all images of an eye have the same deposits. Raises IcyMoonError if the beams cross
    too many pixels of the window, or for too many grains.
    """
    share = float(sensor.deposit_share)
    if share <= 0.0:
        return None
    per_mm = focal_px(rig) / float(sensor.deposit_window_mm)  # pixels for each millimetre of the window
    grain, pupil = float(sensor.deposit_mm) * per_mm, rig.focal_length_mm / float(sensor.f_number) * per_mm
    reach = math.ceil(pupil / 2) + 1
    rows, columns = shape[0] + 2 * reach, shape[1] + 2 * reach
    if rows * columns > MAX_WINDOW_PIXELS:
        raise IcyMoonError(
            f"The beams cross {columns} x {rows} pixels of the window with deposits, more than "
            f"{MAX_WINDOW_PIXELS // 1_000_000} million; raise sensor.deposit_window_mm or sensor.f_number."
        )
    # The number of discs at random places whose union covers this share.
    wide = grain / 2 + 1
    density = -math.log1p(-share) / (math.pi * (grain / 2) ** 2)
    expected = density * (rows + 2 * wide) * (columns + 2 * wide)
    if expected > MAX_GRAINS:
        raise IcyMoonError(
            f"sensor.deposit_share and sensor.deposit_mm make {expected:.3g} grains, more than "
            f"{MAX_GRAINS}; make the grains larger or fewer."
        )
    alike = bool(sensor.deposits_alike)
    random = make_generator(
        seed, "sensor", _DEPOSIT_STREAM + int(sensor.deposit_seed), 0 if alike else find_stream(eye)
    )
    count = int(random.poisson(expected))
    places = random.uniform((-wide, -wide), (rows + wide, columns + wide), (count, 2))
    covered = 1.0 - np.exp(-_sum_of_discs(places, grain / 2, (rows, columns)))
    return np.clip(_mean_in_discs(covered, pupil / 2)[reach : reach + shape[0], reach : reach + shape[1]], 0.0, 1.0)


def apply_deposits(light: Array, blocked: Array | None, sensor: SensorSettings) -> Array:
    """Return the light (H, W) behind the window: the transmitted light, and a veil of scattered light. The share
    ``sensor.deposit_scatter`` of the blocked light is spread evenly over the whole image.
    """
    if blocked is None:
        return light
    light = np.minimum(np.asarray(light, np.float64), 1e30)
    return (1.0 - blocked) * light + float(sensor.deposit_scatter) * blocked * light.mean()


def _sum_of_discs(places: Array, radius: float, shape: tuple[int, int]) -> Array:
    """Sum the optical depth (H, W) of the discs: its negative exponential is the share of a pixel that no disc covers.
    ``places`` (n, 2) and ``radius`` are in pixels.
    """
    total = np.zeros(shape[0] * shape[1])
    reach = math.ceil(radius + 0.5)
    around = np.arange(-reach, reach + 1)
    for part in np.array_split(places, 1 + len(places) * len(around) ** 2 // _PIXELS_AT_ONCE):
        row, column = np.floor(part).astype(int).T[..., None] + around  # (grains, across) each
        down, right = row + 0.5 - part[:, :1], column + 0.5 - part[:, 1:]
        stamp = np.clip(radius + 0.5 - np.hypot(down[:, :, None], right[:, None, :]), 0.0, min(1.0, 2 * radius))
        stamp *= math.pi * radius**2 / stamp.sum(axis=(1, 2), keepdims=True)  # keeps the area of the smallest disc
        inside = ((row >= 0) & (row < shape[0]))[:, :, None] & ((column >= 0) & (column < shape[1]))[:, None, :]
        # An opaque pixel has no finite logarithm, so it passes a little light, less than a converter's step.
        left = -np.log1p(-np.minimum(stamp[inside], 1.0 - 1e-9))
        where = (row[:, :, None] * shape[1] + column[:, None, :])[inside]
        total += np.bincount(where, left, len(total))
    return total.reshape(shape)


def _mean_in_discs(image: Array, radius: float) -> Array:
    """Average ``image`` in a disc around each pixel; only correct at least one radius, in pixels, from the border."""
    rows, columns = image.shape
    y, x = np.fft.fftfreq(rows, 1.0 / rows)[:, None], np.fft.fftfreq(columns, 1.0 / columns)[None, :]
    disc = np.clip(radius + 0.5 - np.hypot(y, x), 0.0, 1.0)
    if disc.sum() == 0.0:
        return image
    spectrum = np.fft.rfft2(image) * np.fft.rfft2(disc / disc.sum())
    return np.fft.irfft2(spectrum, image.shape)
