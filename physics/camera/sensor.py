"""A camera's sensor: from the light on a pixel to the number that is read out of it.

The chain follows EMVA 1288: photo-electrons in proportion to light and exposure time, dark current, the Poisson noise
of both, a well that overflows, fixed patterns, the noise of reading, and an analogue-digital converter with a black
level. All of it happens after rendering, so a change of exposure or gain never needs a new render.

``sensor`` is the ``sensor`` topic of the settings throughout; ``rate`` is the result of ``photons.electron_rate``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from ...settings.topics.camera import SensorSettings
from ...support.arrays import Array, Numbers
from ..random_numbers.seeds import make_generator

_EYE_STREAMS = {"left": 0, "right": 1}

#: Shortest exposure time in seconds that auto exposure chooses.
SHORTEST_S = 1.0e-6
#: Longest exposure time in seconds that auto exposure chooses.
LONGEST_S = 1.0e3

#: Share of saturated pixels above which a warning is given.
MAX_SATURATED_SHARE = 0.02

#: Mean electrons from which on Poisson noise cannot keep any well (at most 1e7) from being full.
_SURELY_FULL_E = 1.0e9


def gain_dn_per_e(sensor: SensorSettings) -> float:
    """Compute the system gain K in digital numbers per electron. With ``gain`` 1 a full well gives the converter's
    largest number.
    """
    return float(sensor.gain) * (top_dn(sensor) - black_dn(sensor)) / float(sensor.full_well_e)


def top_dn(sensor: SensorSettings) -> int:
    """Return the largest digital number of the converter."""
    return int(2 ** int(sensor.bits) - 1)


def black_dn(sensor: SensorSettings) -> float:
    """Compute the digital number of a dark pixel, from ``black_level``, a share of the converter's range."""
    return float(sensor.black_level) * top_dn(sensor)


def capacity_e(sensor: SensorSettings) -> float:
    """Compute the electrons at which a pixel saturates: a full well, or the end of the converter's range."""
    return float(sensor.full_well_e) / max(1.0, float(sensor.gain))


def choose_exposure_s(left_light: Array, rate: float, sensor: SensorSettings) -> float:
    """Choose the exposure time in seconds of both eyes, from the left eye's grey radiance ``left_light`` (any shape).

    Auto exposure puts the ``auto_percentile`` quantile of the radiance at ``auto_target`` of the capacity. If that
    quantile is black, the brightest pixel replaces it. A wholly black image gives nothing to measure, so it gets the
    exposure time of the settings. The time of auto exposure stays between SHORTEST_S and LONGEST_S.
    """
    return expose_level_s(meter_level(left_light, sensor) if sensor.auto_exposure else 0.0, rate, sensor)


def meter_level(left_light: Array, sensor: SensorSettings) -> float:
    """Find the radiance that auto exposure maps to ``auto_target`` of the capacity, see ``choose_exposure_s``; 0 for a
    black image.
    """
    light = _clip_invalid_radiance(left_light)
    light = light[np.isfinite(light)]
    if light.size == 0:
        return 0.0
    return float(np.quantile(light, float(sensor.auto_percentile))) or float(light.max())


def expose_level_s(level: float, rate: float, sensor: SensorSettings) -> float:
    """Choose the exposure time, s, for a radiance ``level`` that auto exposure has metered; see
    ``choose_exposure_s``."""
    fixed = float(sensor.exposure_s)
    if not sensor.auto_exposure or level * rate <= 0:
        return fixed
    return float(np.clip(float(sensor.auto_target) * capacity_e(sensor) / (level * rate), SHORTEST_S, LONGEST_S))


def warn_on_exposure(seconds: float, saturated: float, sensor: SensorSettings) -> list[str]:
    """List sentences about an exposure: auto exposure reached a limit, or too many pixels are saturated. ``saturated``
    is the share of the left pixels at the converter's top.
    """
    said = []
    if sensor.auto_exposure and seconds in (SHORTEST_S, LONGEST_S):
        end = "shortest" if seconds == SHORTEST_S else "longest"
        said.append(
            f"Auto exposure ended at its {end} time, {seconds:g} s; change sensor.f_number, sensor.gain or "
            "sensor.pixel_pitch_um."
        )
    if saturated > MAX_SATURATED_SHARE:
        cause = "sensor.auto_target or sensor.auto_percentile" if sensor.auto_exposure else "sensor.exposure_s"
        said.append(
            f"More than {MAX_SATURATED_SHARE:.0%} of the left image's pixels are saturated; lower {cause}, or merge "
            "exposures with sensor.brackets."
        )
    return said


def dark_current_e_s(sensor: SensorSettings) -> float:
    """Compute the dark current of a pixel at ``temperature_k``, in electrons per second. It doubles every
    ``dark_doubling_k`` (EMVA 1288).
    """
    steps = (float(sensor.temperature_k) - float(sensor.dark_reference_k)) / float(sensor.dark_doubling_k)
    return float(sensor.dark_current_e_s) * 2.0 ** min(steps, 100.0)


@dataclass(frozen=True)
class FixedPattern:
    """Fixed differences between the pixels of one sensor: arrays (H, W), or one neutral number."""

    response: Numbers = 1.0  # factor on photo-electrons (PRNU)
    offset_e: Numbers = 0.0  # electrons added to the dark signal (DSNU)


def find_stream(eye: str) -> int:
    """Find the index of the random stream of an eye, or of another camera by its name."""
    if eye in _EYE_STREAMS:
        return _EYE_STREAMS[eye]
    return int.from_bytes(hashlib.sha256(eye.encode()).digest()[:8], "big")


def draw_pattern(seed: int, eye: str, shape: tuple[int, int], sensor: SensorSettings) -> FixedPattern:
    """Draw the fixed pattern of one eye's sensor: Gaussian, the same in all images of the data set."""
    random = make_generator(seed, "sensor", find_stream(eye))
    prnu, dsnu = float(sensor.prnu), float(sensor.dsnu_e)
    response = np.maximum(1 + prnu * random.standard_normal(shape), 0.0) if prnu > 0 else 1.0
    return FixedPattern(response, dsnu * random.standard_normal(shape) if dsnu > 0 else 0.0)


def collect_electrons(
    light: Array,
    seconds: float,
    rate: float,
    sensor: SensorSettings,
    random: np.random.Generator,
    pattern: FixedPattern | None = None,
    hits_e: Numbers = 0.0,
) -> Array:
    """Collect the electrons, float64 in the shape of ``light``, that are read from each pixel.

    ``light`` is radiance in W/(m² sr) behind the lens, ``hits_e`` electrons that particles freed. NaN and negative
    radiance (defects of a render) count as dark. Shot noise arises before the well is full and read noise after it, so
    a saturated pixel shows read noise only. Row noise is temporal, as in EMVA 1288, release 4: one number for each row
    of each image. Results can be slightly negative; the converter clips them.
    """
    pattern = pattern or FixedPattern()
    full_well = float(sensor.full_well_e)
    with np.errstate(over="ignore", invalid="ignore"):  # a firefly may overflow; infinity is full as well
        charge = _clip_invalid_radiance(light) * (rate * seconds) * pattern.response
        charge = np.minimum(
            np.nan_to_num(charge, nan=0.0, posinf=_SURELY_FULL_E) + dark_current_e_s(sensor) * seconds, _SURELY_FULL_E
        )
    if sensor.shot_noise:
        charge = random.poisson(charge).astype(np.float64)
    charge = charge + hits_e
    if float(sensor.blooming) > 0:
        charge = spread_overflow(charge, full_well, float(sensor.blooming))
    charge = np.minimum(charge, full_well) + pattern.offset_e
    read_noise, row_noise = float(sensor.read_noise_e), float(sensor.row_noise_e)
    if read_noise > 0:
        charge = charge + random.normal(0.0, read_noise, charge.shape)
    if row_noise > 0:  # drawn last, so that images without it stay the same
        charge = charge + random.normal(0.0, row_noise, (*charge.shape[:-1], 1))
    return charge


def spread_overflow(charge: Array, full_well_e: float, share: float) -> Array:
    """Return the electrons (H, W) after overflow along the columns. ``share`` of a pixel's electrons above
    ``full_well_e`` runs over, half of it up and half down. It fills pixels on its way until it is used up or leaves the
    image; the rest is drained.
    """
    excess = np.maximum(charge - full_well_e, 0.0) * (share / 2)
    result = np.minimum(charge, full_well_e)
    if not excess.any():
        return result
    for rows in (range(len(result)), range(len(result) - 1, -1, -1)):
        carried = np.zeros_like(result[0])
        for row in rows:
            taken = np.minimum(carried, full_well_e - result[row])
            result[row] += taken
            carried += excess[row] - taken
    return result


def convert_to_digital(charge: Array, sensor: SensorSettings) -> Array:
    """Convert electrons to the converter's output, uint16 in the shape of ``charge``: linear above the black level with
    ``gain_dn_per_e``, rounded, and limited to the converter's range.
    """
    numbers = np.rint(charge * gain_dn_per_e(sensor) + black_dn(sensor))
    return np.clip(numbers, 0, top_dn(sensor)).astype(np.uint16)


def make_noise_generator(seed: int, pair_id: str, eye: str, *index: int) -> np.random.Generator:
    """Make the random generator of one eye of one pair (and of one exposure, ``index``). It depends only on the data
    set's seed, pair, eye and index, and is independent of other streams.
    """
    digest = int.from_bytes(hashlib.sha256(pair_id.encode()).digest()[:8], "big")
    return make_generator(seed, "sensor", digest, find_stream(eye), *index)


def _clip_invalid_radiance(radiance: Array) -> Array:
    """Replace NaN and negative radiance, which are defects of a render, by 0."""
    return np.maximum(np.nan_to_num(np.asarray(radiance, np.float64), nan=0.0, posinf=np.inf), 0.0)
