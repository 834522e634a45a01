"""Heights of icy ground with stated statistics, as a function of position.

Roughness is stated as planetary science states it (Shepard et al. 2001, JGR 106 E12): the RMS
deviation nu(dx) = <(z(p + dx) - z(p))²>^½ of points dx apart grows as dx^H, and the RMS slope at a
baseline is nu(dx)/dx. The surface is a multifractal sum of noise octaves (after Musgrave, in Ebert
et al., "Texturing and Modeling", ch. 16), scaled so that the patch has the stated slope.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .noise import gradient_noise
from .seeds import generator, stream

_CALIBRATION_PAIRS = 16384
#: Rotation between octaves, so that their lattices do not line up and show as a grid.
_OCTAVE_TURN = math.radians(37.0)


@dataclass(frozen=True)
class Terrain:
    """A patch of ground. All lengths in metres; build it with :func:`terrain`."""

    size_m: float
    hurst: float
    multifractality: float
    outer_scale_m: float
    lacunarity: float
    octaves: int
    keys: tuple[int, ...] = field(repr=False)
    offsets: tuple[tuple[float, float], ...] = field(repr=False)
    scale: float = 1.0
    mean: float = 0.0

    def wavelength_m(self, octave: int) -> float:
        """Wavelength of an octave; 0 is the longest."""
        return self.outer_scale_m / self.lacunarity**octave

    def heights(self, x_m: Any, y_m: Any, shortest_m: float = 0.0) -> np.ndarray:
        """Heights in metres at east and north coordinates (arrays that broadcast).

        Octaves of wavelength below ``shortest_m`` are left out: a mesh with vertices d apart
        cannot carry wavelengths below 2 d, and would show them as noise of another statistics.
        """
        shape = np.broadcast_shapes(np.shape(x_m), np.shape(y_m))
        x, y = (np.broadcast_to(np.asarray(a, np.float64), shape).reshape(-1) for a in (x_m, y_m))
        total = np.zeros(x.shape)
        if self.scale == 0.0:
            return total.reshape(shape)
        weight = np.ones(x.shape)
        variance = 0.0
        for octave in range(self.octaves):
            wavelength = self.wavelength_m(octave)
            if wavelength < shortest_m and octave > 0:
                break
            turn = octave * _OCTAVE_TURN
            cos, sin = math.cos(turn) / wavelength, math.sin(turn) / wavelength
            ox, oy = self.offsets[octave]
            amplitude = (wavelength / self.outer_scale_m) ** self.hurst
            signal = gradient_noise(cos * x - sin * y + ox, sin * x + cos * y + oy, self.keys[octave])
            total += amplitude * weight * signal
            if self.multifractality:
                # Finer octaves grow where the ground so far is high: hollows stay smooth.
                variance += amplitude**2
                height = np.clip(0.5 + total / (1.2 * math.sqrt(variance)), 0.0, 1.0)
                weight = 1.0 - self.multifractality * (1.0 - height)
        return ((total - self.mean) * self.scale).reshape(shape)


def terrain(settings: Mapping[str, Any], seed: int) -> Terrain:
    """The ground that ``terrain`` settings and the data set's seed describe.

    It is scaled so that pairs of points one slope baseline apart, drawn all over the patch, have
    the stated RMS slope. The standard error of that scale is about 1 %.
    """
    octaves = int(settings["octaves"])
    size, baseline = float(settings["size_m"]), float(settings["slope_baseline_m"])
    random = np.random.default_rng(stream(seed, "terrain", 0))
    keys = tuple(int(k) for k in random.integers(0, 2**32, 16, dtype=np.uint64)[:octaves])
    offsets = tuple((float(a), float(b)) for a, b in random.uniform(0, 1024, (16, 2))[:octaves])
    rough = Terrain(size, settings["hurst"], settings["multifractality"], settings["outer_scale_m"],
                    settings["lacunarity"], octaves, keys, offsets)
    slope = math.tan(math.radians(settings["rms_slope_deg"]))
    draw = generator(seed, "terrain", 1)
    x, y = draw.uniform(-size / 2, size / 2, (2, _CALIBRATION_PAIRS))
    angle = draw.uniform(0, 2 * np.pi, _CALIBRATION_PAIRS)
    here = rough.heights(x, y)
    there = rough.heights(x + baseline * np.cos(angle), y + baseline * np.sin(angle))
    deviation = float(np.sqrt(np.mean((there - here) ** 2)))
    scale = slope * baseline / deviation if deviation > 0.0 else 0.0
    return Terrain(size, rough.hurst, rough.multifractality, rough.outer_scale_m, rough.lacunarity, octaves,
                   keys, offsets, scale, float(np.mean(here)))


def rms_deviation(heights_m: np.ndarray, lag: int) -> float:
    """RMS deviation nu in metres of a square height grid at a lag of whole vertex spacings.

    Both axes count; NaN where the grid is smaller than the lag.
    """
    if not 0 < lag < min(heights_m.shape):
        return math.nan
    along_x = heights_m[:, lag:] - heights_m[:, :-lag]
    along_y = heights_m[lag:, :] - heights_m[:-lag, :]
    return math.sqrt((np.mean(along_x**2) + np.mean(along_y**2)) / 2)
