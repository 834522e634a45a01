"""Extra layers of fractal noise on the ground, each of a stated RMS height.

A layer is a fractal sum (``FRACTALS``) over octaves of a noise (``BASES``), optionally with its domain warped. The mean
and range of a sum depend on its fractal and its noise, so a layer is brought to zero mean and unit RMS on sample points
that depend neither on the patch nor on the mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...settings.topics.ground import TerrainLayer
from ...support.arrays import Array, Numbers
from .noise.bases_and_fractals import BASES, FRACTALS
from .noise.lattice_noise import gradient_noise
from .roughness.roughness import resolved_share
from .roughness.structure_function import NOISE_DEVIATION

#: Number of points over which a layer's mean and RMS are taken.
_STATISTICS_POINTS = 8192
#: Side of the square that contains them, in wavelengths.
_SPAN_WAVELENGTHS = 64.0
MAX_OCTAVES = 16
_OCTAVE_TURN_RAD = math.radians(37.0)


@dataclass(frozen=True)
class NoiseLayer:
    """One layer; build it with :func:`make_layer`. An octave that is left out is held at ``signal_mean``; ``centre``
    and ``factor`` bring the sum to metres.
    """

    basis: str
    fractal: str
    scale_m: float
    octaves: int
    lacunarity: float
    roughness: float
    warp_m: float
    keys: tuple[int, ...]
    offsets: Array
    signal_mean: float = 0.0
    centre: float = 0.0
    factor: float = 1.0

    def heights(self, x_m: Array, y_m: Array, shortest_m: Numbers = 0.0) -> Array:
        """Compute heights in metres; ``x_m`` and ``y_m`` broadcast, ``shortest_m`` is a number or one per point.

        Octaves fade out between 1.5 and 1 times ``shortest_m``.
        """
        shape = np.broadcast_shapes(np.shape(x_m), np.shape(y_m), np.shape(shortest_m))
        if self.warp_m:
            x_m, y_m = self._warp_points(x_m, y_m)

        def signal(k: int) -> Numbers:
            share = resolved_share(self.scale_m / self.lacunarity**k, shortest_m)
            if not np.any(share):
                return self.signal_mean
            return self.signal_mean + share * (self.signal(k, x_m, y_m) - self.signal_mean)

        total = FRACTALS[self.fractal].of(signal, self.octaves, self.roughness)
        return np.broadcast_to((total - self.centre) * self.factor, shape)

    def signal(self, k: int, x_m: Array, y_m: Array) -> Array:
        """Compute the fractal's signal of octave k."""
        wavelength = self.scale_m / self.lacunarity**k
        cos, sin = math.cos(k * _OCTAVE_TURN_RAD) / wavelength, math.sin(k * _OCTAVE_TURN_RAD) / wavelength
        noise = BASES[self.basis](
            (cos * x_m + self.offsets[k, 0]) - sin * y_m, (sin * x_m + self.offsets[k, 1]) + cos * y_m, self.keys[k]
        )
        return FRACTALS[self.fractal].signal(noise)

    def _warp_points(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """Shift points sideways by noise with the layer's scale and the RMS ``warp_m``."""
        x_m, y_m = np.broadcast_arrays(x_m, y_m)
        east, north = (
            gradient_noise(
                x_m / self.scale_m + self.offsets[k, 0], y_m / self.scale_m + self.offsets[k, 1], self.keys[k]
            )
            for k in (-1, -2)
        )
        return x_m + self.warp_m / NOISE_DEVIATION * east, y_m + self.warp_m / NOISE_DEVIATION * north


def make_layer(settings: TerrainLayer, random: np.random.Generator) -> NoiseLayer | None:
    """Make the layer that one entry of ``terrain.layers`` describes; None if it has no height."""
    keys = tuple(int(k) for k in random.integers(0, 2**32, MAX_OCTAVES + 2))
    offsets = random.uniform(0.0, 1024.0, (MAX_OCTAVES + 2, 2))
    if settings.amplitude_m == 0.0:
        return None
    parts = {k: settings[k] for k in ("basis", "fractal", "scale_m", "octaves", "lacunarity", "roughness", "warp_m")}
    raw = NoiseLayer(**parts, keys=keys, offsets=offsets)
    x, y = random.uniform(-0.5, 0.5, (2, _STATISTICS_POINTS)) * (_SPAN_WAVELENGTHS * raw.scale_m)
    mean = float(f"{raw.signal(0, x, y).mean():.9e}")
    sample = raw.heights(x, y)
    deviation = float(sample.std())
    factor = settings.amplitude_m / deviation if deviation > 1e-12 else 0.0
    # Ten digits, as sums differ between machines in the last ones.
    return NoiseLayer(
        **parts,
        keys=keys,
        offsets=offsets,
        signal_mean=mean,
        centre=float(f"{sample.mean():.9e}"),
        factor=float(f"{factor:.9e}"),
    )
