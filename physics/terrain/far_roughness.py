"""Places of unlike roughness among distant hills, for the relief that is narrower than the hills.

Relief that is equally rough everywhere looks like ripples of sand from far away: at a grazing view its longest waves
stand in rows up to the horizon. Measured topography is intermittent instead, rough in places and smooth in others, with
places of all widths (Gagnon et al. 2006, Nonlinear Processes in Geophysics 13, 541: a codimension C1 of 0.12 on Earth
down to 40 m). The factor here is the factor of a log-normal cascade with places from the widest hills to twice the
longest wave of the ground. Its logarithm has the standard deviation sqrt(2 C1 ln(ratio of the widths)). That ice of
metres on the moons follows the law is a guess.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...settings.topics.ground import HillsSettings, TerrainLayer
from ...support.arrays import Array
from .landforms.landform import smooth_step
from .noise_layers import MAX_OCTAVES, NoiseLayer, make_layer

#: Distance, in half diagonals of the patch, from which on places differ as stated.
_WHOLE_AT = 4.0
#: Width of the narrowest places, in longest waves of the ground.
_NARROWEST = 2.0


@dataclass(frozen=True)
class FarRoughness:
    """A factor on the heights of the random surface and its layers; build it with :func:`make_far_roughness`.
    ``places`` is the noise, of unit standard deviation, and ``deviation`` the standard deviation of the factor's
    logarithm. The factor is exactly 1 within ``start_m`` of the origin.
    """

    start_m: float
    deviation: float
    places: NoiseLayer

    def factor(self, x_m: Array, y_m: Array) -> Array:
        """Compute the factor at coordinates that broadcast. Its mean square is 1, because exp(s g - s²) has a mean
        square of 1 for normal g.
        """
        x_m, y_m = np.broadcast_arrays(x_m, y_m)
        distance = np.hypot(x_m, y_m)
        beyond, made = distance > self.start_m, np.ones(distance.shape)
        if beyond.any():
            share = smooth_step(np.log(distance[beyond] / self.start_m) / math.log(_WHOLE_AT))
            s = self.deviation * share
            made[beyond] = np.exp(s * self.places.heights(x_m[beyond], y_m[beyond]) - s * s)
        return made


def make_far_roughness(
    hills: HillsSettings, longest_m: float, random: np.random.Generator, size_m: float
) -> FarRoughness | None:
    """Make the places around a patch of side ``size_m`` on ground with waves up to ``longest_m``; None if nothing
    varies.
    """
    narrowest = _NARROWEST * longest_m
    if hills.rms_slope_deg == 0.0 or hills.patchiness == 0.0 or hills.largest_m < narrowest:
        return None
    entry = TerrainLayer(
        basis="GRADIENT",
        fractal="FBM",
        amplitude_m=1.0,
        scale_m=float(hills.largest_m),
        octaves=min(1 + math.floor(math.log2(hills.largest_m / narrowest)), MAX_OCTAVES),
        lacunarity=2.0,
        roughness=1.0,
        warp_m=0.0,
    )
    places = make_layer(entry, random)
    assert places is not None
    return FarRoughness(size_m * math.sqrt(0.5), float(hills.patchiness), places)
