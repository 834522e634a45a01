"""Radiance along rays on a ground: Sun and lamp by the surface's law, their shadows, bounces, and a faint sky."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...physics.surfaces.photometry import Law
from ...rays.shapes import Hits, dot_products, normalize
from ...support.arrays import Array
from .grounds import GROUND, Ground

#: Share of the distance by which shadow rays start above the surface. It exceeds the error of single precision.
_LIFT = 2e-4
#: Bounds of the albedo after a pattern has changed it.
_MIN_ALBEDO, _MAX_ALBEDO = 0.02, 0.995
#: Least cosine between the normal with relief and the ray back to the eye.
_MIN_COSINE = 0.02
_FARTHEST_M = 1e4
#: Number of bounces of indirect light that are traced.
_BOUNCES = 3


@dataclass(frozen=True)
class PointLamp:
    """A lamp at a point ``position_m`` (3,) of the world, which shines equally in all directions and hides nothing.

    Its radiant intensity counts light as the Sun's irradiance does, see ``physics.light.lamps``.
    """

    position_m: Array
    intensity_w_sr: float


@dataclass(frozen=True)
class Lighting:
    """Light on a ground.

    ``sun`` (3,) is the unit vector to the Sun; its irradiance and angular radius follow. ``sky`` is the ratio of the
    irradiance of level ground by an even sky to the Sun's irradiance, so that an irradiance of 0 is a dark night.
    ``other_albedo`` (k,) are the albedos of rocks and shapes by their number. ``lamp`` is an additional light.
    """

    sun: Array
    irradiance_wm2: float
    sun_radius_rad: float
    sky: float
    other_albedo: Array
    lamp: PointLamp | None = None


def compute_radiance(
    ground: Ground,
    light: Lighting,
    origin: Array,
    direction: Array,
    pixel_rad: float,
    indirect: Array,
    random: np.random.Generator,
) -> Array:
    """Compute the radiance (n,), W/(m² sr), along rays (n, 3) from ``origin`` (3,), 0 for the sky.

    ``pixel_rad`` is the width of a pixel. ``indirect`` (n,) is the irradiance by other ground and the sky, see
    ``measure_indirect``. ``random`` draws the point on the Sun for each ray.
    """
    hits = ground.tracer.intersect(origin, direction, 1e-3, _FARTHEST_M)
    met = np.flatnonzero(hits.met)
    radiance = np.zeros(len(direction))
    if not len(met):
        return radiance
    seen = _find_points(ground, hits, met, origin, direction[met])
    albedo, normal = _add_pattern(ground, light, seen, pixel_rad)
    law = ground.recipe.law(albedo)
    toward = _draw_on_sun(light, len(met), random)
    radiance[met] = _scatter(law, normal, toward, seen.back, light.irradiance_wm2 * _find_lit(ground, seen, toward))
    if light.lamp is not None:
        toward, irradiance = _light_by_lamp(ground, light.lamp, seen)
        radiance[met] += _scatter(law, normal, toward, seen.back, irradiance)
    radiance[met] += np.minimum(albedo, 1.0) * indirect[met] / np.pi
    return radiance


def measure_indirect(
    ground: Ground, light: Lighting, origin: Array, direction: Array, rays_each: int, random: np.random.Generator
) -> Array:
    """Measure the irradiance (n,), W/m², by other ground and the sky at the hits of rays (n, 3); 0 where a ray meets
    nothing.

    ``rays_each`` rays are followed over ``_BOUNCES`` bounces off Lambert ground. The ground where they end is assumed
    to have the mean of this light over all rays.
    """
    hits = ground.tracer.intersect(origin, direction, 1e-3, _FARTHEST_M)
    met = np.flatnonzero(hits.met)
    found = np.zeros(len(direction))
    if not len(met):
        return found
    seen = _find_points(ground, hits, met, origin, direction[met])
    start, normal = (np.repeat(each, rays_each, axis=0) for each in (seen.lifted, seen.normal))
    gathered, going, weight = np.zeros(len(start)), np.arange(len(start)), 1.0
    for _ in range(_BOUNCES):
        onward = _draw_cosine(normal, random)
        hits = ground.tracer.intersect(start, onward, 0.0, _FARTHEST_M)
        gathered[going[~hits.met]] += weight * light.sky * light.irradiance_wm2
        weight *= ground.recipe.albedo
        reached = np.flatnonzero(hits.met)
        going = going[reached]
        if not len(reached):
            break
        seen = _find_points(ground, hits, reached, start[reached], onward[reached])
        lit = _find_lit(ground, seen, np.broadcast_to(light.sun, seen.points.shape))
        start, normal = seen.lifted, seen.normal
        gathered[going] += weight * light.irradiance_wm2 * lit * np.maximum(normal @ light.sun, 0.0)
        if light.lamp is not None:
            toward, irradiance = _light_by_lamp(ground, light.lamp, seen)
            gathered[going] += weight * irradiance * np.maximum(dot_products(normal, toward), 0.0)
    rest = np.zeros(len(gathered))
    rest[going] = weight
    once, left = (each.reshape(-1, rays_each).mean(axis=1) for each in (gathered, rest))
    found[met] = once + left * once.mean() / (1.0 - min(float(left.mean()), 0.99))
    return found


@dataclass(frozen=True)
class _Points:
    """Places where n rays met the ground.

    ``points`` (n, 3) have unit vectors ``back`` (n, 3) to the rays' origins, unit normals (n, 3) on that side,
    distances ``away_m`` (n,), ``label`` (n,) and ``number`` (n,), see ``grounds``.
    """

    points: Array
    back: Array
    normal: Array
    away_m: Array
    label: Array
    number: Array

    @property
    def lifted(self) -> Array:
        """Points (n, 3), lifted above their surfaces for rays that start there."""
        return np.asarray(self.points + (_LIFT * self.away_m)[:, None] * self.normal)


def _find_points(ground: Ground, hits: Hits, met: Array, origin: Array, ahead: Array) -> _Points:
    """Find the hits of the rays ``met`` (n,), which go ``ahead`` (n, 3) from ``origin``, (3,) or (n, 3)."""
    along, tables = hits.along[met], ground.shading
    long = np.sqrt(dot_products(ahead, ahead))
    back = ahead * (-1.0 / long)[:, None]
    normal = tables.find_normals(hits, met)
    normal *= np.where(dot_products(normal, back) < 0, np.float32(-1), np.float32(1))[:, None]
    place = hits.place[met]
    return _Points(
        origin + ahead * along[:, None], back, normal, along * long, tables.label[place], tables.number[place]
    )


def _add_pattern(ground: Ground, light: Lighting, seen: _Points, pixel_rad: float) -> tuple[Array, Array]:
    """Return the albedos (n,) and unit normals (n, 3) with the ground's pattern of albedo and relief."""
    slant = np.maximum(dot_products(seen.normal, seen.back), 0.15)
    deviation, slope = ground.recipe.pattern.sample(seen.points, pixel_rad * seen.away_m / np.sqrt(slant))
    normal = normalize(seen.normal - slope + dot_products(slope, seen.normal)[:, None] * seen.normal)
    # Relief may turn a normal away from the eye. Such a normal is turned back until it just faces the eye.
    short = np.maximum(_MIN_COSINE - dot_products(normal, seen.back), 0.0)
    normal = normalize(normal + short[:, None] * seen.back)
    others = light.other_albedo[seen.number % len(light.other_albedo)]
    albedo = np.where(seen.label == GROUND, ground.recipe.albedo, others) * (1.0 + deviation)
    return np.clip(albedo, _MIN_ALBEDO, _MAX_ALBEDO), normal


def _find_lit(ground: Ground, seen: _Points, toward: Array, reach: float = _FARTHEST_M) -> Array:
    """Find the points, bool (n,), that face a light in the directions ``toward`` (n, 3) and are not in shadow.

    Only surfaces within ``reach`` times the length of the directions cast shadows.
    """
    lit = dot_products(seen.normal, toward) > 0
    asked = np.flatnonzero(lit)
    lit[asked] = ~ground.tracer.is_blocked(seen.lifted[asked], toward[asked], 0.0, np.full(len(asked), reach))
    return lit


def _light_by_lamp(ground: Ground, lamp: PointLamp, seen: _Points) -> tuple[Array, Array]:
    """Return unit vectors (n, 3) from points to a lamp, and the irradiance (n,), W/m², of surfaces that face it.

    The irradiance is 0 in shadow.
    """
    way = lamp.position_m - seen.lifted
    lit = _find_lit(ground, seen, way, 1.0)  # up to the lamp, not beyond it
    square = dot_products(way, way)
    return way / np.sqrt(square)[:, None], lamp.intensity_w_sr / square * lit


def _scatter(law: Law, normal: Array, toward: Array, back: Array, irradiance: Array) -> Array:
    """Compute the radiance (n,), W/(m² sr), by light from ``toward`` (n, 3).

    ``irradiance`` (n,), W/m², is for surfaces that face the light.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # where the relief faces away from the light
        return irradiance * np.where(irradiance > 0, law(*_measure_angles(normal, toward, back)), 0.0)


def _draw_on_sun(light: Lighting, count: int, random: np.random.Generator) -> Array:
    """Draw unit vectors (count, 3) to random points of the Sun's disc."""
    aside = normalize(np.cross(light.sun, [0.0, 0.0, 1.0] if abs(light.sun[2]) < 0.9 else [1.0, 0.0, 0.0])[None])[0]
    up = np.cross(aside, light.sun)
    share, turn = random.random((2, count), np.float32)
    radius, angle = light.sun_radius_rad * np.sqrt(share), np.float32(2 * np.pi) * turn
    across, along = (radius * np.cos(angle))[:, None], (radius * np.sin(angle))[:, None]
    return np.asarray(light.sun + across * aside + along * up)  # the disc is so small that these are unit vectors


def _draw_cosine(normal: Array, random: np.random.Generator) -> Array:
    """Draw directions (n, 3) above surfaces with these unit normals (n, 3).

    The density is proportional to the cosine.
    """
    height, angle = 2 * random.random(len(normal)) - 1, 2 * math.pi * random.random(len(normal))
    flat = np.sqrt(1 - height**2)
    ball = np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)
    return normalize(normal * (1 + 1e-6) + ball)


def _measure_angles(normal: Array, toward: Array, back: Array) -> tuple[Array, Array, Array]:
    """Measure incidence, emission, and the azimuth between them, radians (n,).

    The azimuth is 0 where the light is behind the observer.
    """
    cos_i, cos_e = dot_products(normal, toward), dot_products(normal, back)
    # The components along the surface.
    along: Array = toward - cos_i[:, None] * normal
    away: Array = back - cos_e[:, None] * normal
    sin_i, sin_e = np.sqrt(dot_products(along, along)), np.sqrt(dot_products(away, away))
    cos_azimuth = dot_products(along, away) / np.maximum(sin_i * sin_e, 1e-12)
    return np.arctan2(sin_i, cos_i), np.arctan2(sin_e, cos_e), np.arccos(np.clip(cos_azimuth, -1.0, 1.0))
