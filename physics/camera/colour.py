"""A camera with a colour sensor: the filters' signals from a pair's bands, the Bayer mosaic, and demosaicing.

Each pixel of a Bayer mosaic (Bayer 1976, US patent 3971065) is behind a red, green or blue filter. The model of
``sensor`` applies to the mosaic, one number per pixel. Demosaicing then finds the two missing colours of each pixel
from its neighbours. In this module ``sensor`` and ``light`` are the settings topics of these names.
"""

from __future__ import annotations

import numpy as np

from ...settings.topics.camera import SensorSettings
from ...settings.topics.light import LightSettings
from ...support.arrays import Array
from ..light.bands import band_shares
from ..light.photons import optics_m2_sr, photons_by_wavelength
from ..light.sunlight import sun_colour

#: Weights of R, G and B in the grey image that matchers get; the luminance of ITU-R BT.709 is for linear colours.
GREY_WEIGHTS = {"LUMINANCE": (0.2126, 0.7152, 0.0722), "MEAN": (1 / 3, 1 / 3, 1 / 3)}
#: Least signal of white ground in a channel, relative to the strongest channel, for a white balance.
_MIN_RELATIVE_SIGNAL = 1e-6
#: Weights (5, 5) around a pixel that interpolate a missing colour. The key is where the samples of this colour lie: on
#: all four sides of the pixel, on its left and right, above and below, or on its diagonals.
_Kernels = dict[str, Array]


def _make_kernels(cross: list[list[float]], row: list[list[float]], diagonal: list[list[float]]) -> _Kernels:
    return {"cross": np.array(cross), "row": np.array(row), "column": np.array(row).T, "diagonal": np.array(diagonal)}


#: BILINEAR takes the mean of the nearest samples; MALVAR adds the Laplacian of the pixel's own colour (Malvar, He and
#: Cutler 2004, ICASSP, III-485). Both are exact for colours that change linearly.
LINEAR = {
    "BILINEAR": _make_kernels(
        [[0, 0, 0, 0, 0], [0, 0, 0.25, 0, 0], [0, 0.25, 0, 0.25, 0], [0, 0, 0.25, 0, 0], [0, 0, 0, 0, 0]],
        [[0, 0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0.5, 0, 0.5, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 0]],
        [[0, 0, 0, 0, 0], [0, 0.25, 0, 0.25, 0], [0, 0, 0, 0, 0], [0, 0.25, 0, 0.25, 0], [0, 0, 0, 0, 0]],
    ),
    "MALVAR": _make_kernels(
        [
            [0, 0, -0.125, 0, 0],
            [0, 0, 0.25, 0, 0],
            [-0.125, 0.25, 0.5, 0.25, -0.125],
            [0, 0, 0.25, 0, 0],
            [0, 0, -0.125, 0, 0],
        ],
        [
            [0, 0, 0.0625, 0, 0],
            [0, -0.125, 0, -0.125, 0],
            [-0.125, 0.5, 0.625, 0.5, -0.125],
            [0, -0.125, 0, -0.125, 0],
            [0, 0, 0.0625, 0, 0],
        ],
        [
            [0, 0, -0.1875, 0, 0],
            [0, 0.25, 0, 0.25, 0],
            [-0.1875, 0, 0.75, 0, -0.1875],
            [0, 0.25, 0, 0.25, 0],
            [0, 0, -0.1875, 0, 0],
        ],
    ),
}


def filter_efficiency(sensor: SensorSettings, wavelength_m: Array) -> Array:
    """Compute the electrons per photon (channels, n) at wavelengths (n,) in metres, within the camera's band. Channels
    are one grey channel, or R, G, B.
    """
    if sensor.colour == "MONO":
        return np.full((1, len(wavelength_m)), float(sensor.quantum_efficiency))
    nm = np.asarray(wavelength_m) * 1e9
    return np.stack(
        [
            np.minimum(
                float(sensor[f"{name}_efficiency"])
                * 2.0 ** -(((nm - float(sensor[f"{name}_centre_nm"])) / float(sensor[f"{name}_half_width_nm"])) ** 2)
                + float(sensor.filter_leak),
                1.0,
            )
            for name in ("red", "green", "blue")
        ]
    )


def compute_channel_rates(light: LightSettings, sensor: SensorSettings, pitch_m: float) -> Array:
    """Compute the photo-electrons per second (channels, 3) in a pixel of side ``pitch_m`` per W/(m² sr) in a pair's R,
    G, B.

    White ground in sunlight has the bands ``sun_colour`` for any temperature of the Sun. On it, each channel receives
    exactly the black-body light of the Sun through its filter.
    """
    wavelength, photons = photons_by_wavelength(light, sensor)
    white = sun_colour(light.sun_temperature_k)
    seen = filter_efficiency(sensor, wavelength) * photons
    return np.asarray(optics_m2_sr(sensor, pitch_m) * (seen @ band_shares(wavelength).T) / white)


def compute_white_rates(light: LightSettings, rates: Array) -> Array:
    """Compute the electrons per second (channels,) per W/(m² sr) of white ground in sunlight, from ``rates`` (channels,
    3) of the bands.
    """
    return np.asarray(rates @ sun_colour(light.sun_temperature_k))


def can_balance(white: Array) -> bool:
    """Return whether each channel receives enough light for a white balance. ``white`` (channels,) are the channels'
    signals of white ground.
    """
    return bool(white.min() > _MIN_RELATIVE_SIGNAL * white.max())


def compute_white_gains(white: Array, sensor: SensorSettings) -> Array:
    """Compute the factors (3,) on R, G, B after demosaicing. With SUN they make white ground grey, and each is at least
    1. All are 1 if a channel receives less than a millionth of the light of another.
    """
    if sensor.white_balance == "NONE" or not can_balance(white):
        return np.ones(3)
    return np.asarray(white.max() / white)


def find_channel(pattern: str, row: int, column: int) -> int:
    """Find the channel (0, 1, 2 for R, G, B) of the pixel at ``row`` and ``column`` of the mosaic."""
    return "RGB".index(pattern[2 * (row % 2) + column % 2])


def apply_mosaic(planes: Array, pattern: str) -> Array:
    """Select the values (H, W) that pixels receive through their filters, from planes (3, H, W) of R, G, B."""
    result = np.empty_like(planes[0])
    for row, column in np.ndindex(2, 2):
        result[row::2, column::2] = planes[find_channel(pattern, row, column), row::2, column::2]
    return result


def demosaic(numbers: Array, pattern: str, method: str) -> Array:
    """Demosaic an image (H, W) of at least 3 x 3 pixels to R, G and B, float64 (H, W, 3); ``method`` is a key of
    LINEAR.

    The image is mirrored at the outermost pixels, which keeps the pattern. Beside an edge, results may lie outside the
    range of the mosaic.
    """
    image = np.asarray(numbers, np.float64)
    height, width = image.shape
    padded = np.pad(image, 2, mode="reflect")
    result = np.empty((height, width, 3))
    for row, column in np.ndindex(2, 2):
        own = find_channel(pattern, row, column)
        for channel in range(3):
            if channel == own:
                result[row::2, column::2, channel] = image[row::2, column::2]
                continue
            kernel = LINEAR[method][_find_sample_pattern(pattern, row, column, channel)]
            total = sum(
                weight * padded[row + dy : height + dy : 2, column + dx : width + dx : 2]
                for (dy, dx), weight in np.ndenumerate(kernel)
                if weight
            )
            result[row::2, column::2, channel] = total
    return result


def _find_sample_pattern(pattern: str, row: int, column: int, channel: int) -> str:
    """Find where the samples of another channel lie around a pixel: a key of the kernels."""
    beside = find_channel(pattern, row, column + 1) == channel
    above = find_channel(pattern, row + 1, column) == channel
    return "cross" if beside and above else "row" if beside else "column" if above else "diagonal"


def mix_to_grey(colours: Array, sensor: SensorSettings) -> Array:
    """Mix colours (H, W, 3) to the grey image (H, W) that matchers get."""
    return np.asarray(colours @ np.array(GREY_WEIGHTS[sensor.grey]))
