"""What a lens does to an image before it is detected: point spread and veiling glare, on linear radiance."""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import SensorSettings
from ...support.arrays import Array

_REACH = 4.0  # standard deviations; beyond lies 6e-5 of a Gaussian


def apply_point_spread(radiance: Array, sensor: SensorSettings) -> Array:
    """Radiance (H, W) as the lens passes it on, float64.

    ``sensor.psf_sigma_px``: Gaussian point spread, its standard deviation. ``sensor.veiling_glare``:
    share of the light of the whole image that is spread evenly over it (the veiling glare index of
    ISO 9358). Both keep the total of an even image; the image goes on beyond its border as its
    border is. Infinite radiance is held at the largest number that can still be added up.
    """
    image = np.minimum(np.asarray(radiance, np.float64), 1e30)
    sigma, glare = float(sensor.psf_sigma_px), float(sensor.veiling_glare)
    if sigma > 0 and image.size:
        image = _blur_axis(_blur_axis(image, sigma, 0), sigma, 1)
    if glare > 0 and image.size:
        image = (1 - glare) * image + glare * image.mean()
    return image


def gaussian_kernel(sigma_px: float) -> Array:
    """Weights of a Gaussian integrated over each pixel, odd in number, their sum 1."""
    reach = math.ceil(_REACH * sigma_px)
    edges = (np.arange(-reach, reach + 2) - 0.5) / (math.sqrt(2) * sigma_px)
    weights = np.diff([math.erf(x) for x in edges])
    return weights / weights.sum()


def _blur_axis(image: Array, sigma: float, axis: int) -> Array:
    kernel = gaussian_kernel(sigma)
    reach = len(kernel) // 2
    padded = np.pad(image, [(reach, reach) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
    length = image.shape[axis]

    def shifted(k: int) -> Array:
        return padded[k : k + length] if axis == 0 else padded[:, k : k + length]

    result = kernel[reach] * shifted(reach)
    part = np.empty_like(result)
    for k in range(reach):  # the kernel is even
        np.add(shifted(k), shifted(2 * reach - k), out=part)
        part *= kernel[k]
        result += part
    return result
