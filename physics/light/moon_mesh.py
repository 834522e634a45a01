"""Moons in the sky as one mesh about the observer. It emits their light, however small they are.

A moon at least two pixels wide is a disc with a limb that is soft over a pixel. A smaller moon is a cone of light, as a
star is, two pixels and its own width across. Both emit the moon's irradiance and hide the solid angle of its disc.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .moons import SkyMoon
from .planetshine import VisibleCap, make_disc_mesh

#: Width in pixels below which a moon is a cone of light.
_MIN_DISC_PX = 2.0
#: Difference in pixels between the radius of a cone and of its moon; with it, Cycles' pixel filter loses at most 5 % of
#: the light.
_SPREAD_PX = 1.0


@dataclass(frozen=True)
class MoonMesh:
    """Moons about the observer; the planet's centre is at distance 1."""

    vertices: Array  # (n, 3)
    faces: Array  # (m, 4); a triangle has its first vertex twice
    radiance: Array  # (n, 3) W/(m² sr) in R, G, B of sunlight
    transmission: Array  # (n,) share of the light from behind that passes


def is_above_horizon(moon: SkyMoon, pixel_rad: float, dip_deg: float) -> bool:
    """Return whether any part of a moon's image is above a horizon ``dip_deg`` under the horizontal."""
    height = math.degrees(math.asin(float(np.clip(moon.globe.direction[2], -1, 1))))
    return height + moon.globe.angular_diameter_deg / 2 + math.degrees(_SPREAD_PX * pixel_rad) > -dip_deg


def make_moon_mesh(moons: Sequence[SkyMoon], pixel_rad: float) -> MoonMesh:
    """Make the mesh of the moons for cameras whose pixels are ``pixel_rad`` radians wide. It is not cut at the
    horizon.
    """
    parts, first = [], 0
    for moon in moons:
        wide = math.radians(moon.globe.angular_diameter_deg) >= _MIN_DISC_PX * pixel_rad
        part = _make_disc(moon, pixel_rad) if wide else _make_cone(moon, pixel_rad)
        parts.append(MoonMesh(moon.distance * part.vertices, part.faces + first, part.radiance, part.transmission))
        first += len(part.vertices)
    vertices, faces, radiance, transmission = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("vertices", "faces", "radiance", "transmission")
    )
    return MoonMesh(vertices, faces, radiance, transmission)


def _make_disc(moon: SkyMoon, pixel_rad: float) -> MoonMesh:
    shape, seen = make_disc_mesh(moon.globe, pixel_rad, widest_rim=1.0), VisibleCap(moon.globe)
    ray = shape.vertices / np.linalg.norm(shape.vertices, axis=1, keepdims=True)
    normal = shape.vertices - moon.globe.direction
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # On the rim beyond the limb the light is the limb's.
    sunlit = np.maximum(normal @ moon.globe.sun, 0.0)
    emission = np.maximum(-(normal * ray).sum(axis=1), 0.0)
    pattern = sunlit if moon.is_hazy else sunlit / np.maximum(sunlit + emission, 1e-9)
    shown = pattern * (1 - shape.transmission)
    total = _integrate(ray, shape.faces, shown)
    light = moon.irradiance_wm2 / total if total > 0 else np.zeros(3)
    hidden = math.pi * seen.shape.radius**2 / _integrate(ray, shape.faces, 1 - shape.transmission)
    passed = 1 - np.minimum(hidden * (1 - shape.transmission), 1.0)
    return MoonMesh(shape.vertices, shape.faces, shown[:, None] * light, passed)


def _integrate(ray: Array, faces: Array, values: Array) -> float:
    """Integrate ``values`` (n,) at unit vectors ``ray`` (n, 3), linear over triangles, over the solid angle."""
    total = 0.0
    for corners in (faces[:, :3], faces[:, [0, 2, 3]]):
        a, b, c = (ray[corners[:, k]] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        total += float((area * values[corners].mean(axis=1)).sum())
    return total


def _make_cone(moon: SkyMoon, pixel_rad: float) -> MoonMesh:
    """Make a hexagon whose light and opacity fall linearly from its centre to 0 at its rim, where their mean is a
    third.
    """
    own = math.sin(math.radians(moon.globe.angular_diameter_deg / 2))
    radius, toward = own + _SPREAD_PX * pixel_rad, moon.globe.direction
    x = np.cross(np.eye(3)[np.abs(toward).argmin()], toward)
    x /= np.linalg.norm(x)
    angle = np.arange(6) * np.pi / 3
    rim = toward + radius * (np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * np.cross(toward, x))
    third = 1.5 * math.sqrt(3.0) * radius**2 / 3
    radiance = np.zeros((7, 3))
    radiance[0] = moon.irradiance_wm2 / third
    corner = np.arange(6)
    faces = np.stack([0 * corner, 1 + corner, 1 + (corner + 1) % 6, 0 * corner], axis=1)
    return MoonMesh(np.vstack([toward, rim]), faces, radiance, np.append(1 - math.pi * own**2 / third, np.ones(6)))
