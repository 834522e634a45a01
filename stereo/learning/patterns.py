"""Fine structure of a surface that its triangles lack: noise of albedo and of relief, by position in the world.

A pattern is a sum of octaves. Each octave looks up one periodic tile of noise, turned, shifted and scaled. An octave
fades out where its wavelength approaches the width of a pixel on the ground, as in an image with many samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from ...physics.random_numbers.seeds import make_generator
from ...support.arrays import Array

#: Side of the tile in texels, and waves of its middle wavelength along a side.
_TILE_TEXELS, _WAVES = 128, 12
#: Number of octaves, and their longest wavelengths in metres.
_OCTAVES, _LONGEST_M = 6, (0.08, 0.8)
#: Shift in the tile, east and north, per metre of height, so that walls have structure too.
_SKEW = (0.37, 0.61)
#: Length of a wave, px, at which an octave has faded out. At twice the length it has its full strength.
_FADE_PX = 1.5
#: Texels in a row of the map that OpenCV looks up. OpenCV takes no array longer than 32767.
_ROW = 1024


@dataclass(frozen=True)
class Pattern:
    """Octaves (k,) of noise.

    Each has a ``wavelength_m``, a ``turn`` in radians and a ``shift`` (k, 2) in texels. ``albedo`` and ``slope`` are
    the standard deviations of its relative albedo and of its relief's slope.
    """

    wavelength_m: Array
    turn: Array
    shift: Array
    albedo: Array
    slope: Array

    def sample(self, points: Array, pixel_m: Array) -> tuple[Array, Array]:
        """Sample the pattern at ``points`` (n, 3) in metres, where a pixel is ``pixel_m`` (n,) wide on the ground.

        Return the relative deviations (n,) of albedo and the gradients (n, 3) of the relief, float32.
        """
        east, north = ((points[:, axis] + _SKEW[axis] * points[:, 2]).astype(np.float32) for axis in (0, 1))
        per_pixel = (1.0 / (_FADE_PX * pixel_m)).astype(np.float32)
        albedo, along, aside = np.zeros((3, len(points)), np.float32)
        for wavelength, turn, shift, own_albedo, own_slope in zip(
            *(each.astype(np.float32) for each in (self.wavelength_m, self.turn, self.shift, self.albedo, self.slope)),
            strict=True,
        ):
            share = np.clip(wavelength * per_pixel - np.float32(1), 0, 1)
            if not share.any():
                continue
            scale, c, s = _TILE_TEXELS / _WAVES / wavelength, np.cos(turn), np.sin(turn)
            found = _sample_tile(scale * (c * east - s * north) + shift[0], scale * (s * east + c * north) + shift[1])
            albedo += own_albedo * share * found[:, 0]
            share *= own_slope
            along += share * (c * found[:, 1] + s * found[:, 2])
            aside += share * (c * found[:, 2] - s * found[:, 1])
        return albedo, np.stack([along, aside, _SKEW[0] * along + _SKEW[1] * aside], axis=1)


def draw_pattern(random: np.random.Generator) -> Pattern:
    """Draw a random pattern: its longest wavelength, its roughness, and the strength of albedo and relief."""
    longest = np.exp(random.uniform(*np.log(_LONGEST_M)))
    wavelength = longest / 2.0 ** np.arange(_OCTAVES)
    fall = random.uniform(0.5, 1.0, 2)[:, None] ** np.arange(_OCTAVES)
    fall /= np.sqrt((fall**2).sum(axis=1, keepdims=True))
    strength = np.exp(random.uniform(np.log(0.005), np.log(0.25))), np.exp(random.uniform(np.log(0.02), np.log(0.5)))
    return Pattern(
        wavelength,
        random.uniform(0, 2 * np.pi, _OCTAVES),
        random.uniform(0, _TILE_TEXELS, (_OCTAVES, 2)),
        strength[0] * fall[0],
        strength[1] * fall[1],
    )


def _sample_tile(u: Array, v: Array) -> Array:
    """Sample the tile's three channels (n, 3) at texel coordinates (n,) of any size, linearly between texels."""
    count, rows = len(u), -(-len(u) // _ROW)
    place = np.zeros((2, rows * _ROW), np.float32)
    for own, each in zip(place, (u, v), strict=True):
        own[:count] = each - _TILE_TEXELS * np.floor(each * np.float32(1 / _TILE_TEXELS))
    across, down = place.reshape(2, rows, _ROW)
    found = cv2.remap(_make_tile(), across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found.reshape(-1, 3)[:count])


@lru_cache(maxsize=1)
def _make_tile() -> Array:
    """Make periodic noise (texels, texels, 3) float32 around one wavelength.

    The channels are a field, and the two slopes of another field. Each has the standard deviation 1.
    """
    random = make_generator(0, "surface", 46)
    frequency = np.fft.fftfreq(_TILE_TEXELS) * _TILE_TEXELS
    down, across = frequency[:, None], frequency[None, :]
    radius = np.maximum(np.hypot(down, across), 1e-9)
    band = np.exp(-0.5 * (np.log(radius / _WAVES) / 0.35) ** 2)
    fields = [np.fft.fft2(random.standard_normal((_TILE_TEXELS, _TILE_TEXELS))) * band for _ in range(2)]
    tile = np.stack(
        [np.fft.ifft2(each).real for each in (fields[0], 1j * across * fields[1], 1j * down * fields[1])], axis=-1
    )
    return np.asarray(tile / tile.std(axis=(0, 1)), np.float32)
