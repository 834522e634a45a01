"""The share of the ground in a camera's view that the Sun reaches, for any direction of the Sun."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from .shapes import World
from .stereo_truth import Eye
from .surface import Tracer, find_surface

#: Distance from the ground, as a share of the distance to the eye, from which rays go to the Sun: above the error of
#: single precision.
_LIFT = 1e-4


def measure_sunlit_shares(world: World, tracer: Tracer, eye: Eye, suns: Array, near_m: float) -> Array:
    """Measure, for each of ``suns`` (k, 3), unit vectors toward the Sun, the share (k,) of the pixels with ground that
    are lit. Lit ground faces the Sun, with nothing in between. NaN if no pixel shows ground."""
    direction = eye.directions(np.arange(eye.rows * eye.columns))
    seen = find_surface(world, tracer.intersect(eye.position, direction, near_m, np.inf), eye.position, direction)
    met = np.isfinite(seen.along)
    if not met.any():
        return np.full(len(suns), np.nan)
    away = direction[met] * seen.along[met, None]
    lift = _LIFT * np.linalg.norm(away, axis=1, keepdims=True)
    place, normal = eye.position + away + lift * seen.normal[met], seen.normal[met]
    faces = suns @ normal.T > 0
    far = np.full(len(place), np.inf)
    free = [~tracer.is_blocked(place, np.broadcast_to(sun, place.shape), 0.0, far) for sun in suns]
    return np.asarray((faces & np.array(free)).mean(axis=1))
