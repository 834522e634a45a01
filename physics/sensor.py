"""A camera's sensor: from the light of a pixel to the number that is read out of it.

The chain is the linear part of EMVA 1288: photo-electrons proportional to the light, their Poisson
noise, a well that overflows, the noise of reading, an analogue-digital converter. All of it happens
after rendering, so a change of exposure or gain never needs a new render.

``sensor`` is the ``sensor`` topic of a scene description throughout (see ``properties.SENSOR``).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from .seeds import generator

EYE_STREAMS = {"left": 0, "right": 1}

#: Electrons beyond which Poisson noise cannot bring any well (at most 1e7) back below full.
_DROWNED_E = 1.0e9


def saturation_radiance(left_grey: np.ndarray, sensor: Mapping[str, Any]) -> float:
    """The radiance, W/(m² sr), that just fills the well. Both eyes share it.

    ``left_grey`` is the left eye's grey radiance, any shape. With auto exposure its
    ``auto_percentile`` quantile is put at ``auto_target`` of the well; where that quantile is
    black the brightest pixel stands in, and a wholly black image is exposed as if auto exposure
    were off, since nothing in it says how.
    """
    fixed = float(sensor["saturation_radiance"])
    if not sensor["auto_exposure"]:
        return fixed
    light = _sane(left_grey)
    light = light[np.isfinite(light)]
    if light.size == 0:
        return fixed
    level = float(np.quantile(light, float(sensor["auto_percentile"]))) or float(light.max())
    return level / float(sensor["auto_target"]) or fixed


def electrons(grey: np.ndarray, saturation: float, sensor: Mapping[str, Any],
              random: np.random.Generator) -> np.ndarray:
    """Electrons, float64 and of the shape of ``grey``, that are read from each pixel.

    ``grey`` is radiance in W/(m² sr); ``saturation`` the radiance that fills the well. NaN and
    negative radiance (defects of a render) count as dark. Shot noise comes before the well is full,
    read noise after, so that a saturated pixel shows read noise only. The result can be slightly
    negative: the converter, not the well, has a floor.
    """
    full_well = float(sensor["full_well_e"])
    with np.errstate(over="ignore"):  # a firefly may overflow; infinity is full as well
        charge = np.minimum(_sane(grey) / saturation * full_well, _DROWNED_E)
    if sensor["shot_noise"]:
        charge = random.poisson(charge).astype(np.float64)
    charge = np.minimum(charge, full_well)
    read_noise = float(sensor["read_noise_e"])
    if read_noise > 0:
        charge = charge + random.normal(0.0, read_noise, charge.shape)
    return charge


def digital_numbers(charge: np.ndarray, sensor: Mapping[str, Any]) -> np.ndarray:
    """The converter's output, uint16 and of the shape of ``charge`` (electrons).

    Linear: 0 electrons are 0, a full well is 2^bits - 1, rounded to the nearest number and held at
    both ends.
    """
    top = 2 ** int(sensor["bits"]) - 1
    return np.clip(np.rint(charge / float(sensor["full_well_e"]) * top), 0, top).astype(np.uint16)


def noise_generator(seed: int, pair_id: str, eye: str) -> np.random.Generator:
    """The random stream of one eye of one pair: the same for the same data set seed, pair and eye,
    independent between eyes and between pairs."""
    digest = int.from_bytes(hashlib.sha256(pair_id.encode()).digest()[:8], "big")
    return generator(seed, "sensor", digest, EYE_STREAMS[eye])


def _sane(radiance: np.ndarray) -> np.ndarray:
    return np.maximum(np.nan_to_num(np.asarray(radiance, np.float64), nan=0.0, posinf=np.inf), 0.0)
