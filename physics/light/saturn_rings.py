"""Saturn's main rings as a moon sees them, sunlit or from their unlit side, in the planet's shadow.

The moon sees the rings at a slant: at Enceladus the site is at most 250 km off their plane, so that they are a line at
most 0.1° thick. Each ring is an even layer of particles that scatter once (Chandrasekhar 1960, Radiative Transfer, ch.
9). This is right at a slant, where the light comes from the layer's top. For a ring seen and lit from high above, where
light is scattered more than once, ring B is a third too dark. The thickness of 10 m is far below a pixel.

Left out are the planet's light on the rings, their light on the ground, and gaps narrower than the Cassini Division.
``planetshine`` has their shadow on the planet. As there, the unit of length is the planet's distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .planetshine import Planet, Ring

SATURN_EQUATOR_KM = 60268.0


def _make_ring(inner_km: float, outer_km: float, optical_depth: float, albedo: float) -> Ring:
    return Ring(inner_km / SATURN_EQUATOR_KM, outer_km / SATURN_EQUATOR_KM, optical_depth, albedo)


#: NASA's Saturnian Rings Fact Sheet (NSSDCA): radii, and the middle of the ranges of optical depth and albedo.
RINGS = {
    "C": _make_ring(74658.0, 91975.0, 0.15, 0.2),
    "B": _make_ring(91975.0, 117507.0, 1.5, 0.5),
    "Cassini Division": _make_ring(117507.0, 122340.0, 0.1, 0.3),
    "A": _make_ring(122340.0, 136780.0, 0.6, 0.5),
}
#: Exponent n of the phase function of the particles, (1 - α/π)^n divided by its mean; the value is Callisto's: Dones et
#: al. 1993, Icarus 105, 184.
_PHASE_POWER = 3.092
#: Number of circles of a ring's mesh.
_MESH_CIRCLES = 6
#: Number of sectors of a ring's mesh.
_SECTORS = 512


def _phase_scale() -> float:
    x, weight = np.polynomial.legendre.leggauss(64)
    angle = math.pi * (x + 1) / 2
    return float(2 / (math.pi / 2 * weight * (1 - angle / math.pi) ** _PHASE_POWER * np.sin(angle)).sum())


_PHASE_SCALE = _phase_scale()


def phase_function(phase: Array) -> Array:
    """Compute the light that a particle scatters at phase angles (radians), relative to the mean over all
    directions.
    """
    return np.asarray(_PHASE_SCALE * (1 - phase / math.pi) ** _PHASE_POWER)


def ring_brightness(ring: Ring, sun: float, seen: Array, phase: Array, lit: bool) -> Array:
    """Compute I/F of a ring: its radiance relative to a white matt surface that faces the Sun.

    ``sun`` and ``seen`` are sines of the elevations of the Sun and the observer above the ring's plane; ``lit`` is true
    if both are on one side.
    """
    if sun <= 0:
        return np.zeros_like(phase)
    depth, seen = ring.optical_depth, np.maximum(seen, 1e-9)
    scattered = ring.albedo / 4 * phase_function(phase) * sun
    if lit:
        return np.asarray(scattered / (sun + seen) * -np.expm1(-depth * (1 / sun + 1 / seen)))
    apart = np.where(np.abs(sun - seen) < 1e-6 * sun, 1e-6 * sun, sun - seen)  # the limit is smooth
    return np.asarray(scattered / apart * (np.exp(-depth / sun) - np.exp(-depth / (sun - apart))))


@dataclass(frozen=True)
class RingMesh:
    """Rings about the observer as quadrilaterals; the planet's centre is at distance 1."""

    vertices: Array  # (n, 3)
    faces: Array  # (m, 4)
    radiance: Array  # (n,) W/(m² sr)
    transmission: Array  # (n,) share of the light from behind that passes


def shadow_half_angle(radius: Array, sun_elevation: float, flattening: float) -> Array:
    """Compute half the angle in radians, at the planet's centre, that its shadow covers on circles with ``radius`` in
    equatorial radii.

    The planet is the unit sphere in a stretched space. There, a point r (cos φ, sin φ, 0) on the far side is in the
    shadow of a Sun at elevation β if r² - r² cos² φ cos² β < 1.
    """
    stretched = math.atan2(math.sin(sun_elevation) / (1 - flattening), math.cos(sun_elevation))
    return np.arccos(np.clip(np.sqrt(np.maximum(radius**2 - 1, 0.0)) / (radius * math.cos(stretched)), 0.0, 1.0))


def make_ring_mesh(planet: Planet) -> RingMesh | None:
    """Make the rings of a planet; None without rings, or if they are seen from within their plane. Sunlit and shadowed
    arcs are separate strips, which keeps the edge of the shadow sharp.
    """
    height, up = float(-planet.direction @ planet.pole), float(planet.sun @ planet.pole)
    if not planet.rings or abs(height) < 1e-7 or planet.angular_diameter_deg <= 0:
        return None
    scale = math.sin(math.radians(planet.angular_diameter_deg / 2))
    toward = planet.sun - up * planet.pole  # in the plane; anything in it if the Sun is over the pole
    if np.linalg.norm(toward) < 1e-9:
        toward = np.cross(planet.pole, np.eye(3)[np.abs(planet.pole).argmin()])
    toward /= np.linalg.norm(toward)
    across = np.cross(planet.pole, toward)
    parts = []
    for ring in planet.rings:
        radius = np.linspace(ring.inner, ring.outer, _MESH_CIRCLES + 1)
        half = shadow_half_angle(radius, math.asin(np.clip(up, -1, 1)), planet.flattening)
        for lit, middle, reach, sectors in ((1.0, 0.0, math.pi - half, _SECTORS), (0.0, math.pi, half, _SECTORS // 8)):
            if not reach.any():
                continue
            around = middle + reach[:, None] * np.linspace(-1, 1, sectors + 1)
            flat = np.cos(around)[..., None] * toward + np.sin(around)[..., None] * across
            position = planet.direction + scale * radius[:, None, None] * flat
            ray = position / np.linalg.norm(position, axis=-1, keepdims=True)
            seen = np.abs(ray @ planet.pole)
            phase = np.arccos(np.clip(-ray @ planet.sun, -1, 1))
            bright = ring_brightness(ring, abs(up), seen, phase, up * height > 0)
            parts.append(
                (
                    position,
                    lit * planet.sun_irradiance_wm2 / math.pi * bright,
                    np.exp(-ring.optical_depth / np.maximum(seen, 1e-9)),
                )
            )
    faces, first = [], 0
    for position, _, _ in parts:
        n, m = position.shape[:2]
        corner = first + (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).ravel()
        faces.append(np.stack([corner, corner + m, corner + m + 1, corner + 1], axis=1))
        first += n * m
    vertices, radiance, transmission = (
        np.concatenate([part[k].reshape(-1, 3) if k == 0 else part[k].ravel() for part in parts]) for k in range(3)
    )
    return RingMesh(vertices, np.concatenate(faces), radiance, transmission)
