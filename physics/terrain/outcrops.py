"""Outcrops on distant hills: pieces of broken ice that stand out of smoother slopes, in places of all widths.

Where fines cover slopes, only ice that is higher than the cover is bare. The pieces have the heights that the law of
the hills states for relief as wide as they are. Their cover is a level that varies over places of all widths, and only
parts above it show. That ice breaks like this on either moon is a guess.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ...settings.topics.ground import HillsSettings, TerrainLayer
from ...support.arrays import Array, Numbers
from .noise_layers import MAX_OCTAVES, NoiseLayer, make_layer

#: Deviation of the level of the cover over that of the heights of pieces.
_COVER = 1.5
#: Height over which pieces rise out of the cover, over the deviation of their heights.
_FEATHER = 0.3
#: Width of the narrowest places, in widths of the widest pieces.
_NARROWEST = 4.0
#: Deviation of the heights of pieces over that of the law; the rest lies under the cover.
_RELIEF = 0.5
_LACUNARITY = 2.0


@dataclass(frozen=True)
class Outcrops:
    """Pieces and their cover, both of unit deviation. Heights in metres are ``scale_m`` times the part above
    ``level``.
    """

    pieces: NoiseLayer
    places: NoiseLayer
    level: float
    scale_m: float

    def heights(self, x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        """Compute heights in metres above the slopes at coordinates that broadcast, without waves under
        ``shortest_m``.
        """
        above = self.pieces.heights(x_m, y_m, shortest_m) - self.level
        above += _COVER * self.places.heights(x_m, y_m, shortest_m)
        risen = np.clip(above + _FEATHER, 0.0, 2.0 * _FEATHER)
        return np.asarray(self.scale_m * np.maximum(above, risen * risen / (4.0 * _FEATHER)))


def make_outcrops(settings: HillsSettings, random: np.random.Generator) -> Outcrops | None:
    """Make the outcrops of hills; None if the settings ask for none, or if the widest hills are too narrow for places
    of outcrops.
    """
    widest, baseline, hurst = float(settings.outcrop_m), float(settings.slope_baseline_m), float(settings.hurst)
    narrowest = _NARROWEST * widest
    if settings.outcrops == 0.0 or not _have_places(settings):
        return None
    octaves = 1 + round(math.log(max(widest / settings.smallest_m, 1.0), _LACUNARITY))
    pieces = _make_layer("BROKEN", widest, octaves, float(f"{_LACUNARITY**-hurst:.9e}"), random)
    count = 1 + math.floor(math.log(settings.largest_m / narrowest, _LACUNARITY))
    places = _make_layer("GRADIENT", float(settings.largest_m), count, 1.0, random)
    share = min(max(float(settings.outcrops), 1e-6), 1.0 - 1e-6)
    level = NormalDist(0.0, math.hypot(1.0, _COVER)).inv_cdf(1.0 - share)
    rise_m = baseline * math.tan(math.radians(settings.rms_slope_deg)) * (widest / 2 / baseline) ** hurst
    # Half their width apart, heights of relief without longer waves differ by the root of two times its deviation.
    return Outcrops(pieces, places, float(f"{level:.9e}"), float(f"{_RELIEF * math.sqrt(0.5) * rise_m:.9e}"))


def _have_places(settings: HillsSettings) -> bool:
    """Return whether the widest hills are as wide as the narrowest places of outcrops."""
    return bool(settings.largest_m >= _NARROWEST * settings.outcrop_m)


def advise_on_outcrops(settings: HillsSettings) -> list[str]:
    """Return a sentence, in a list, if hills have no place for the outcrops that are asked for; else an empty list."""
    if settings.outcrops == 0.0 or settings.rms_slope_deg == 0.0 or _have_places(settings):
        return []
    return [
        f"Hills have no outcrops, because the widest (hills.largest_m, {settings.largest_m:g} m) are less than "
        f"{_NARROWEST:g} times as wide as the pieces of ice (hills.outcrop_m, {settings.outcrop_m:g} m); lower "
        "hills.outcrop_m or raise hills.largest_m."
    ]


def _make_layer(basis: str, widest_m: float, octaves: int, roughness: float, random: np.random.Generator) -> NoiseLayer:
    entry = TerrainLayer(
        fractal="FBM",
        amplitude_m=1.0,
        scale_m=widest_m,
        octaves=min(octaves, MAX_OCTAVES),
        lacunarity=_LACUNARITY,
        roughness=roughness,
        warp_m=0.0,
    ) | {"basis": basis}
    made = make_layer(entry, random)
    assert made is not None
    return made
