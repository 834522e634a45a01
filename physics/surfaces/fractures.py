"""Fractures inside ice: the light that an open crack reflects, and the depth to which cracks are visible.

An open crack is a gap of air. It totally reflects light inside the ice that meets it at more than 50 degrees from its
normal. So a crack is a bright veil from one side and nearly invisible from another.
"""

from __future__ import annotations

import numpy as np

from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array, Numbers


def gap_reflectance(cosine: Numbers, refractive_index: float) -> Array:
    """Compute the share of unpolarised light inside ice that a gap of air reflects, at cosines from the gap's normal.

    Both faces of the gap reflect F by Fresnel's formula, again and again: 2 F / (1 + F) for each polarisation.
    Interference is left out, because gaps are wider than the light's coherence.
    """
    mu = np.asarray(cosine, np.float64)
    inside = 1.0 - refractive_index**2 * (1.0 - mu**2)
    air = np.sqrt(np.maximum(inside, 0.0))
    across = ((refractive_index * mu - air) / np.maximum(refractive_index * mu + air, 1e-12)) ** 2
    along = ((mu - refractive_index * air) / np.maximum(mu + refractive_index * air, 1e-12)) ** 2
    return np.asarray(np.where(inside <= 0.0, 1.0, across / (1.0 + across) + along / (1.0 + along)))


def sight_depth_m(surface: SurfaceSettings) -> float:
    """Compute the depth of sight in metres into ice with ``surface`` settings: the distance at which 1/e of the light
    is still unscattered; 0 for opaque ice.

    Bubbles of radius a and volume share f have a cross section of 3 f / (4 a) per volume, so light is scattered after 4
    a / (3 f) on average. In ice without bubbles, the nearest fractures hide the rest.
    """
    if surface.bubble_share > 0.0:
        return float(4.0 * surface.bubble_radius_m / (3.0 * surface.bubble_share))
    if surface.transmission > 0.0:
        return float(surface.fracture_spacing_m)
    return float(surface.subsurface_radius_m) if surface.subsurface_weight > 0.0 else 0.0


def has_fractures(surface: SurfaceSettings) -> bool:
    """Return whether fractures inside the ice are visible."""
    return surface.model == "PRINCIPLED" and surface.fracture_share > 0.0 and sight_depth_m(surface) > 0.0
