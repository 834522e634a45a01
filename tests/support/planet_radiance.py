"""The radiance of places of the planet, which the nodes of its material compute at each pixel."""

from __future__ import annotations

import numpy as np
from icymoon.physics.light.planet_face import FACES, face_scale, radiance_over_zenith
from icymoon.physics.light.planetshine import Planet, VisibleCap
from icymoon.support.arrays import Array


def sphere_of(seen: VisibleCap, position: Array) -> Array:
    """Unit vectors of the stretched space at places relative to the observer, or near to the globe there."""
    found = (position - seen.planet.direction) @ seen.shape.stretch
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def face_radiance(planet: Planet, position: Array) -> Array:
    """Radiance (..., 3) in W/(m² sr) of places of the planet (..., 3) relative to the observer, in R, G, B of sunlight.

    Edges of bands waver in an image, which is left out here.
    """
    seen = VisibleCap(planet)
    sphere = sphere_of(seen, position)
    even = seen.radiance(sphere)
    if planet.face not in FACES:
        return np.repeat(even[..., None], 3, axis=-1)
    normal = seen.normal(sphere)
    toward = -position / np.linalg.norm(position, axis=-1, keepdims=True)
    passed = seen.passed(sphere)[..., None]
    face = radiance_over_zenith(FACES[planet.face], planet, normal, toward)
    return np.asarray(seen.shape.full_radiance * face * passed * face_scale(planet))
