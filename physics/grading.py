"""A mesh that is as fine as the cameras need and no finer, out to the horizon.

Vertices stand on rings about the site, at spacings that grow with the distance from the camera so
that the error of the mesh stays under a bound in pixels, whatever the heading, for both eyes.

Replacing fractal ground by straight lines between points D apart leaves, half-way, an RMS height
error of nu(D) sqrt(2^-2H - 1/4) (from the definition of the RMS deviation nu(D) = nu0 D^H); seen from
a distance d by a camera of focal length f (px) that is f/d times as many pixels. So the bound
gives the spacing at every distance. On smooth ground a second bound holds: a triangle's edge is
never longer than ``LONGEST_PX``, so that shadows and silhouettes stay round; and on the roughest a
third: it is never shorter than ``SHORTEST_PX``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

LONGEST_PX = 12.0
SHORTEST_PX = 1.5  # roughness finer than that is under a pixel, and costs without showing
#: Part of the eye's distance by which spacings are chosen as if the ground were nearer: the other eye
#: stands beside the site, and ground may rise toward the cameras.
_MARGIN = 0.8


@dataclass(frozen=True)
class Grading:
    """What decides the spacing: camera, roughness and the tolerated error.

    ``error_px`` is the RMS error of the mesh in pixels, ``slope`` the RMS slope (tangent) at
    ``baseline_m``, ``height_m`` the height of the camera above the ground at the site.
    """

    error_px: float
    focal_px: float
    height_m: float
    slope: float
    baseline_m: float
    hurst: float

    def spacing_m(self, distance_m: np.ndarray) -> np.ndarray:
        """Vertex spacing in metres that the bound allows at distances from the camera in metres."""
        distance = np.asarray(distance_m, np.float64) * _MARGIN
        longest = LONGEST_PX * distance / self.focal_px
        if self.slope <= 0.0:
            return longest
        midway = math.sqrt(max(2.0 ** (-2 * self.hurst) - 0.25, 1e-4))
        tolerated_m = self.error_px * distance / self.focal_px
        ratio = tolerated_m / (midway * self.slope * self.baseline_m)
        wanted = self.baseline_m * ratio ** (1.0 / self.hurst)
        return np.clip(wanted, longest * (SHORTEST_PX / LONGEST_PX), longest)


def horizon_m(eye_height_m: float, body_radius_m: float) -> float:
    """Distance along the ground to the horizon of a sphere, in metres.

    Exact: R arccos(R / (R + h)); written with a half angle, since the cosine is close to 1.
    """
    half_sine = math.sqrt(eye_height_m / (2.0 * (body_radius_m + eye_height_m)))
    return 2.0 * body_radius_m * math.asin(min(half_sine, 1.0))


def drop_m(distance_m: np.ndarray, body_radius_m: float) -> np.ndarray:
    """How far a sphere's ground lies under its tangent plane at distances along the plane, in metres."""
    r = np.asarray(distance_m, np.float64)
    return r**2 / (body_radius_m + np.sqrt(body_radius_m**2 - np.minimum(r, body_radius_m) ** 2))


def rings(grading: Grading, farthest_m: float) -> tuple[np.ndarray, int]:
    """Radii of the rings in metres (n,), the last at ``farthest_m``, and the vertices on each.

    All rings have the same number of vertices, that of the ring that needs most, so that the mesh
    is a grid in (ring, azimuth) and can have no crack.
    """
    radii = [0.0]
    azimuths = 8.0
    while radii[-1] < farthest_m:
        distance = math.hypot(radii[-1], grading.height_m)
        step = float(grading.spacing_m(np.array(distance)))
        radii.append(min(radii[-1] + step, farthest_m))
        azimuths = max(azimuths, 2 * math.pi * radii[-1] / step)
    return np.array(radii[1:]), math.ceil(azimuths)


class Ground(Protocol):
    """A height function, as ``physics.terrain`` makes it."""

    def heights(self, x_m: np.ndarray, y_m: np.ndarray, shortest_m: float = 0.0) -> np.ndarray:
        """Heights in metres without the wavelengths below ``shortest_m``."""
        ...


def ring_heights(ground: Ground, x_m: np.ndarray, y_m: np.ndarray, spacing_m: np.ndarray) -> np.ndarray:
    """Heights of rings (n, azimuths) that carry no wavelength below twice their spacing (n,).

    Between powers of two the two nearest cut-offs are blended, so that a wavelength fades out over
    several rings and leaves no step.
    """
    level = np.log2(2.0 * spacing_m)
    band = np.floor(level).astype(int)
    heights = np.empty(x_m.shape)
    for j in np.unique(band):
        rows = band == j
        part = (level[rows] - j)[:, None]
        fine = ground.heights(x_m[rows], y_m[rows], 2.0**j)
        coarse = ground.heights(x_m[rows], y_m[rows], 2.0 ** (j + 1))
        heights[rows] = fine + part * (coarse - fine)
    return heights


def ring_faces(ring_count: int, azimuths: int) -> np.ndarray:
    """Triangles (m, 3) int32 of ``ring_count`` closed rings about a centre vertex, which is vertex 0."""
    around = np.arange(azimuths)
    following = (around + 1) % azimuths
    fan = np.stack([np.zeros(azimuths, int), 1 + around, 1 + following], axis=1)
    inner = (1 + np.arange(ring_count - 1)[:, None] * azimuths)
    a, b = (inner + around).ravel(), (inner + following).ravel()
    outer_a, outer_b = a + azimuths, b + azimuths
    strips = np.concatenate([np.stack([a, outer_a, outer_b], 1), np.stack([a, outer_b, b], 1)])
    return np.concatenate([fan, strips]).astype(np.int32)
