"""The reflectance of surfaces towards their light, at phase 0 and any incidence, as a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.labels import LANDER, ROCK, TERRAIN
from ..surfaces.photometry import Law, lunar_lambert
from ..surfaces.surface_law import make_law

#: Number of steps of the cosine in a table. Linear interpolation between them is off by less than 1e-6 for our laws to
#: an incidence of 85 degrees; a test measures it.
_STEPS = 2**14
#: Assumed albedos of a lander, and of objects of the user.
_LANDER_ALBEDO, _OBJECT_ALBEDO = 0.3, 0.5
#: Label of triangles whose material has none.
_UNLABELLED = 0


@dataclass(frozen=True)
class Backscatter:
    """``reflectance`` (_STEPS + 1,), bidirectional reflectance r in 1/sr where light and sensor are in one direction,
    at equal steps of the cosine of incidence from 0 to 1. r is the BRDF times that cosine; the opposition surge is
    included."""

    reflectance: Array

    def find(self, cosine: Array) -> Array:
        """r at cosines of incidence, any shape, from 0 to 1."""
        place = cosine * _STEPS
        below = np.minimum(place.astype(np.int64), _STEPS - 1)
        return np.asarray(
            self.reflectance[below] + (place - below) * (self.reflectance[below + 1] - self.reflectance[below])
        )


def tabulate_backscatter(law: Law) -> Backscatter:
    """The table of a law of reflectance, see ``photometry``."""
    angle = np.arccos(np.linspace(0, 1, _STEPS + 1))
    return Backscatter(np.asarray(law(angle, angle, np.zeros(len(angle)))))


def tabulate_scene(settings: Settings) -> dict[int, Backscatter]:
    """The tables of a scene by semantic label. Principled snow has no closed form and counts as a Lambert surface of
    its albedo; so do the lander and other objects, with an assumed albedo. Differences of albedo from place to place
    are left out."""
    rock = settings.rock_surface if settings.rocks.own_surface else settings.surface
    laws = {
        TERRAIN: make_law(settings.surface, settings.hapke) or lunar_lambert(settings.surface.albedo, 0.0),
        ROCK: make_law(rock, settings.hapke) or lunar_lambert(rock.albedo, 0.0),
        LANDER: lunar_lambert(_LANDER_ALBEDO, 0.0),
        _UNLABELLED: lunar_lambert(_OBJECT_ALBEDO, 0.0),
    }
    return {label: tabulate_backscatter(law) for label, law in laws.items()}
