"""Effects of a lens on linear radiance before detection: point spread and veiling glare."""

from __future__ import annotations

import math

import numpy as np

from ...settings.topics.camera import SensorSettings
from ...support.arrays import Array

_REACH_SIGMAS = 4.0  # standard deviations; beyond them lies 6e-5 of a Gaussian


def apply_point_spread(radiance: Array, sensor: SensorSettings) -> Array:
    """Return the radiance (H, W), float64, behind the lens.

    ``sensor.psf_sigma_px`` is the standard deviation of the Gaussian point spread. ``sensor.veiling_glare`` is the
    share of the whole image's light that is spread evenly over it (the veiling glare index of ISO 9358). Both keep the
    total of an even image. Border pixels are repeated beyond the border. Infinite radiance is limited to the largest
    number that can be summed.
    """
    image = np.minimum(np.asarray(radiance, np.float64), 1e30)
    sigma, glare = float(sensor.psf_sigma_px), float(sensor.veiling_glare)
    if sigma > 0 and image.size:
        image = _blur_axis(_blur_axis(image, sigma, 0), sigma, 1)
    if glare > 0 and image.size:
        image = (1 - glare) * image + glare * image.mean()
    return image


def gaussian_kernel(sigma_px: float) -> Array:
    """Compute the weights (2 n + 1,) of a Gaussian that is integrated over each pixel, with the sum 1."""
    reach = math.ceil(_REACH_SIGMAS * sigma_px)
    edges = (np.arange(-reach, reach + 2) - 0.5) / (math.sqrt(2) * sigma_px)
    weights = np.diff([math.erf(x) for x in edges])
    return weights / weights.sum()


def _blur_axis(image: Array, sigma: float, axis: int) -> Array:
    """Blur the image along one axis."""
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
