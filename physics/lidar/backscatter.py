"""Tables of the reflectance of surfaces back toward the light, at phase angle 0 and any incidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.labels import LANDER, ROCK, TERRAIN
from ..surfaces.photometry import Law, lunar_lambert
from ..surfaces.surface_law import find_albedos, make_law

#: Number of steps of the cosine in a table. For our laws, linear interpolation between them has an error below 1e-6 up
#: to an incidence of 85 degrees; a test measures it.
_STEPS = 2**14
#: Assumed albedos of a lander, and of objects of the user.
_LANDER_ALBEDO, _OBJECT_ALBEDO = 0.3, 0.5
#: Label of triangles whose material has no label.
_UNLABELLED = 0


@dataclass(frozen=True)
class Backscatter:
    """``reflectance`` (_STEPS + 1,) is the bidirectional reflectance r in 1/sr where light and sensor are in one
    direction, at equal steps of the cosine of incidence from 0 to 1. r is the BRDF times that cosine; the opposition
    surge is included.
    """

    reflectance: Array

    def find(self, cosine: Array) -> Array:
        """Interpolate r at cosines of incidence, any shape, from 0 to 1."""
        place = cosine * _STEPS
        below = np.minimum(place.astype(np.int64), _STEPS - 1)
        return np.asarray(
            self.reflectance[below] + (place - below) * (self.reflectance[below + 1] - self.reflectance[below])
        )


@dataclass(frozen=True)
class AlbedoMap:
    """Albedo (rows, columns) on square cells of ``cell_m`` as seen from above, north first; NaN where it is unknown.
    ``west_m`` and ``north_m`` are its western and northern edges. ``clean`` is, by label, the albedo for which the
    label's law is tabulated.
    """

    albedo: Array
    cell_m: float
    west_m: float
    north_m: float
    clean: Mapping[int, float]

    def find_factors(self, point_m: Array, label: Array) -> Array:
        """Find the factors (n,) on the laws' reflectance at points (n, 3) of labels (n,): the albedo of the cell over
        the clean albedo; 1 outside the map and for other labels.
        """
        rows, columns = self.albedo.shape
        column = np.floor((point_m[:, 0] - self.west_m) / self.cell_m)
        row = np.floor((self.north_m - point_m[:, 1]) / self.cell_m)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        found = np.full(len(label), np.nan)
        found[inside] = self.albedo[row[inside].astype(np.int64), column[inside].astype(np.int64)]
        clean = np.full(256, np.nan)
        for one, value in self.clean.items():
            clean[one] = value if value > 0.0 else np.nan
        factor = found / clean[label]
        return np.where(np.isnan(factor), 1.0, factor)


def tabulate_backscatter(law: Law) -> Backscatter:
    """Tabulate the backscatter of a reflectance law, see ``photometry``."""
    angle = np.arccos(np.linspace(0, 1, _STEPS + 1))
    return Backscatter(np.asarray(law(angle, angle, np.zeros(len(angle)))))


def find_clean_albedos(settings: Settings) -> dict[int, float]:
    """Find the albedo of ground and rocks, by label, in even light, for which ``tabulate_scene`` makes their laws."""
    rock = settings.rock_surface if settings.rocks.own_surface else settings.surface
    found = {}
    for label, surface in ((TERRAIN, settings.surface), (ROCK, rock)):
        albedos = find_albedos(surface, settings.hapke) if surface.model == "HAPKE" else None
        found[label] = float(surface.albedo) if albedos is None else albedos.bond
    return found


def has_patches(settings: Settings) -> bool:
    """Return whether the albedo of ground or rocks varies over the surface, or differs from their setting."""
    rock = settings.rock_surface if settings.rocks.own_surface else settings.surface
    return settings.textures.set != "NONE" or any(
        surface.ice_colour != "GREY"
        or (surface.model == "PRINCIPLED" and max(surface.bubble_share, surface.frost_share) > 0.0)
        or any((surface.albedo_variation, surface.face_variation, surface.salt_share))
        or any((surface.trough_dirt, surface.slope_dirt))
        for surface in (settings.surface, rock)
    )


def tabulate_scene(settings: Settings) -> dict[int, Backscatter]:
    """Tabulate a scene's backscatter by semantic label.

    Principled snow has no closed form and counts as a Lambert surface of its albedo. So do the lander and other
    objects, with an assumed albedo. An ``AlbedoMap`` contains variations of albedo over the ground.
    """
    rock = settings.rock_surface if settings.rocks.own_surface else settings.surface
    laws = {
        TERRAIN: make_law(settings.surface, settings.hapke) or lunar_lambert(settings.surface.albedo, 0.0),
        ROCK: make_law(rock, settings.hapke) or lunar_lambert(rock.albedo, 0.0),
        LANDER: lunar_lambert(_LANDER_ALBEDO, 0.0),
        _UNLABELLED: lunar_lambert(_OBJECT_ALBEDO, 0.0),
    }
    return {label: tabulate_backscatter(law) for label, law in laws.items()}
