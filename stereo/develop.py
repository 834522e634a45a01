"""Developing a pair: linear radiance to the grey images that stereo matchers are given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.sensor import digital_numbers, electrons, noise_generator, saturation_radiance
from ..render.pair import EYES, Pair
from .exr import View


@dataclass(frozen=True)
class Images:
    """A developed pair, uint16 (H, W) digital numbers of ``bits`` bits."""

    left: np.ndarray
    right: np.ndarray
    bits: int
    saturation_radiance: float  # W/(m² sr) that fills the well
    saturated: float  # share of the left pixels at the converter's top

    def for_matchers(self) -> tuple[np.ndarray, np.ndarray]:
        """Left and right as uint8: OpenCV's matchers take nothing finer, so more bits are scaled down."""
        return to_8_bit(self.left, self.bits), to_8_bit(self.right, self.bits)


def grey(radiance: np.ndarray) -> np.ndarray:
    """Mean of the bands, float64 (H, W), of radiance (H, W, 3).

    A panchromatic camera weighs the bands alike; luminance weights are a property of eyes. Icy
    surfaces here are grey, so the choice matters only for coloured additions.
    """
    return radiance.mean(axis=-1, dtype=np.float64)


def develop(pair: Pair, left: View, right: View, sensor: Mapping[str, Any]) -> Images:
    """Both eyes through one camera response with one exposure and independent noise.

    ``sensor`` is the ``sensor`` topic to use, which need not be the one the pair was rendered with.
    The noise is the same for the same pair and data set seed, however often it is developed.
    """
    seed = int(pair.settings["dataset"]["seed"])
    light = {"left": grey(left.radiance), "right": grey(right.radiance)}
    saturation = saturation_radiance(light["left"], sensor)
    image = {eye: digital_numbers(electrons(light[eye], saturation, sensor, noise_generator(seed, pair.id, eye)),
                                  sensor) for eye in EYES}
    bits = int(sensor["bits"])
    return Images(image["left"], image["right"], bits, saturation,
                  float(np.mean(image["left"] == 2 ** bits - 1)))


def to_8_bit(numbers: np.ndarray, bits: int) -> np.ndarray:
    """uint8 of digital numbers of ``bits`` bits, the top of the range kept at the top."""
    if bits == 8:
        return numbers.astype(np.uint8)
    return np.rint(numbers * (255.0 / (2 ** bits - 1))).astype(np.uint8)
