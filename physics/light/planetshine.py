"""The planet in a moon's sky: a sunlit ellipsoid, so near that its size matters.

The usual formula, geometric albedo times phase function times (R/d)², holds for a distant point. A moon sees less of
the planet's disc, and the middle of the disc is nearer: from Enceladus, Saturn is 18 % brighter at full phase than by
this formula and half as bright at 120°. So the visible part of the planet is integrated at its true distance, which is
the unit of length here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ...support.arrays import Array

#: Largest phase angle of the published phase curve of Jupiter, in degrees; beyond it, the ratio to a Lambert sphere is
#: constant.
_JUPITER_CURVE_END_DEG = 130.0
#: Largest phase angle of the published phase curve of Saturn, in degrees.
_SATURN_CURVE_END_DEG = 150.0


@dataclass(frozen=True)
class Ring:
    """A ring: radii over the planet's equatorial radius, mean normal optical depth, and albedo of single scattering."""

    inner: float
    outer: float
    optical_depth: float
    albedo: float


@dataclass(frozen=True, eq=False)
class Planet:
    """A planet as seen from the site; directions are unit vectors (3,) in the local frame. Planets of equal values are
    equal.
    """

    direction: Array  # of its centre
    angular_diameter_deg: float  # of its equator
    flattening: float  # 1 - polar radius / equatorial radius
    pole: Array  # its axis
    sun: Array  # direction of the Sun
    sun_irradiance_wm2: float
    geometric_albedo: float
    phase_law: str  # "LAMBERT", "JUPITER" or "SATURN"
    rings: tuple[Ring, ...] = ()  # in the plane of its equator; they shade it, and ``saturn_rings`` makes their mesh
    face: str = "PLAIN"  # or a key of ``planet_face.FACES``; this module ignores it
    spot_longitude_deg: float = 0.0  # of its Red Spot, east of the meridian that faces the site

    def _values(self) -> tuple[Any, ...]:
        return tuple(tuple(value.tolist()) if isinstance(value, np.ndarray) else value for value in vars(self).values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Planet) and self._values() == other._values()

    def __hash__(self) -> int:
        return self._values().__hash__()  # for caches only; no result depends on it

    @property
    def phase_deg(self) -> float:
        """Angle at the planet between the Sun, far away, and the site: 0 full, 180 new."""
        return math.degrees(math.acos(float(np.clip(-self.direction @ self.sun, -1, 1))))


def lambert_phase(phase_deg: float) -> float:
    """Compute the brightness of a distant Lambert sphere relative to full phase: [sin α + (π - α) cos α] / π."""
    a = math.radians(phase_deg)
    return max(0.0, (math.sin(a) + (math.pi - a) * math.cos(a)) / math.pi)


def phase_function(law: str, phase_deg: float) -> float:
    """Compute the brightness of a distant planet relative to full phase.

    JUPITER and SATURN (its globe without rings): Mallama and Hilton 2018, Astronomy and Computing 25, 10-24, eqs. 8, 9,
    11 and 12, in V; up to 130° and 150°.
    """
    if law == "LAMBERT":
        return lambert_phase(phase_deg)
    end = _JUPITER_CURVE_END_DEG if law == "JUPITER" else _SATURN_CURVE_END_DEG
    if phase_deg > end:
        return phase_function(law, end) * lambert_phase(phase_deg) / lambert_phase(end)
    a = phase_deg
    if a <= (12.0 if law == "JUPITER" else 6.5):
        magnitude = -3.7e-4 * a + 6.16e-4 * a**2
    elif law == "JUPITER":
        x = a / 180
        magnitude = -0.033 - 2.5 * math.log10(1 - 1.507 * x - 0.363 * x**2 - 0.062 * x**3 + 2.809 * x**4 - 1.876 * x**5)
    else:
        magnitude = 0.01 + 2.446e-4 * a + 2.672e-4 * a**2 - 1.505e-6 * a**3 + 4.767e-9 * a**4
    return float(10 ** (-0.4 * magnitude))


def lambert_albedo(law: str, geometric_albedo: float, phase_deg: float) -> float:
    """Compute the albedo of the Lambert sphere that is as bright as the planet at a phase.

    A Lambert sphere of albedo A has the geometric albedo 2A/3; a published phase curve scales it.
    """
    lambert = lambert_phase(min(phase_deg, 179.0))
    return 1.5 * geometric_albedo * phase_function(law, min(phase_deg, 179.0)) / lambert


@dataclass(frozen=True)
class Ellipsoid:
    """A planet as the unit sphere of a space that is stretched along its pole, with its centre at the origin."""

    radius: float  # of its equator, in units of its distance
    stretch: Array  # (3, 3), to that space but for the radius
    observer: Array  # (3,), in that space
    full_radiance: float  # W/(m² sr) where the Sun stands in the zenith


def make_ellipsoid(planet: Planet) -> Ellipsoid:
    """Make the shape of a planet; its radiance is Lambert's with the albedo of its phase."""
    radius = math.sin(math.radians(planet.angular_diameter_deg / 2))
    stretch = np.eye(3) + (1 / (1 - planet.flattening) - 1) * np.outer(planet.pole, planet.pole)
    albedo = lambert_albedo(planet.phase_law, planet.geometric_albedo, planet.phase_deg)
    return Ellipsoid(
        radius, stretch, stretch @ -planet.direction / radius, albedo * planet.sun_irradiance_wm2 / math.pi
    )


class VisibleCap:
    """Points (..., 3) of the visible part of the planet, by polar angles about the sub-observer point. In the stretched
    space this part is a cap of the sphere.
    """

    def __init__(self, planet: Planet) -> None:
        self.planet, self.shape = planet, make_ellipsoid(planet)
        self.shrink = np.eye(3) - planet.flattening * np.outer(planet.pole, planet.pole)
        distance = float(np.linalg.norm(self.shape.observer))
        self.half_angle = math.acos(min(1.0, 1 / distance))
        self.axis = self.shape.observer / distance
        side = np.eye(3)[np.abs(self.axis).argmin()]
        self.x = np.cross(side, self.axis) / np.linalg.norm(np.cross(side, self.axis))
        self.y = np.cross(self.axis, self.x)

    def sphere(self, angle: Array, around: Array) -> Array:
        """Compute unit vectors (..., 3) of the stretched space, at an ``angle`` from the axis and ``around`` it, in
        radians.
        """
        return np.cos(angle)[..., None] * self.axis + np.sin(angle)[..., None] * (
            np.cos(around)[..., None] * self.x + np.sin(around)[..., None] * self.y
        )

    def position(self, sphere: Array) -> Array:
        """Compute the positions (..., 3) on the ellipsoid of unit vectors (..., 3), relative to the observer."""
        return self.planet.direction + self.shape.radius * sphere @ self.shrink

    def normal(self, sphere: Array) -> Array:
        """Compute the unit normals (..., 3) of the planet at unit vectors (..., 3)."""
        found = sphere @ self.shape.stretch
        return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))

    def radiance(self, sphere: Array) -> Array:
        """Compute the radiance (...) in W/(m² sr) at unit vectors (..., 3); 0 in the night."""
        lit = np.maximum(self.normal(sphere) @ self.planet.sun, 0.0)
        return np.asarray(self.shape.full_radiance * lit * self.passed(sphere))

    def passed(self, sphere: Array) -> Array:
        """Compute the share (...) of the sunlight that the rings let through to points of the planet."""
        point, passed = sphere @ self.shrink, np.ones(sphere.shape[:-1])
        up = float(self.planet.sun @ self.planet.pole)
        if abs(up) < 1e-6:
            return passed  # the Sun is in their plane
        way = -(point @ self.planet.pole) / up  # along the ray to the Sun, to the plane
        radius = np.linalg.norm(point + way[..., None] * self.planet.sun, axis=-1)
        for ring in self.planet.rings:
            crossed = (way > 0) & (radius > ring.inner) & (radius < ring.outer)
            passed[crossed] = math.exp(-ring.optical_depth / abs(up))
        return passed


@dataclass(frozen=True)
class CapNodes:
    """Nodes (n, 2n) of a quadrature over the part of the planet above the horizon."""

    sphere: Array  # (n, 2n, 3) unit vectors of the stretched space
    ray: Array  # (n, 2n, 3) unit vectors toward the nodes
    solid_angle: Array  # (n, 2n) sr; 0 below the horizon


@lru_cache(maxsize=4)  # finding 96 nodes takes 4 ms, and a slider of the Sun needs them three times a step
def _find_gauss_nodes(n: int) -> tuple[Array, Array]:
    """Return the nodes and weights (n,) of Gauss-Legendre quadrature from -1 to 1."""
    return np.polynomial.legendre.leggauss(n)


@dataclass(frozen=True)
class _CapInPlace:
    """A visible cap, equal to others of the same shape and place, whatever their light."""

    key: tuple[float, ...]
    seen: VisibleCap = field(compare=False)


def make_cap_nodes(seen: VisibleCap, nodes: int = 96) -> CapNodes:
    """Make Gauss-Legendre nodes (``nodes``, 2 ``nodes``) over the visible part of the planet. All callers share the
    arrays, which are read-only.
    """
    planet = seen.planet
    key = planet.angular_diameter_deg, planet.flattening, *planet.pole.tolist(), *planet.direction.tolist()
    return _make_nodes_in_place(_CapInPlace(key, seen), nodes)


@lru_cache(maxsize=4)  # a slider of the Sun asks for the same planet's nodes
def _make_nodes_in_place(cap: _CapInPlace, nodes: int) -> CapNodes:
    seen, planet = cap.seen, cap.seen.planet
    x, weight = _find_gauss_nodes(nodes)
    angle = seen.half_angle * (x + 1) / 2
    around = 2 * np.pi * (np.arange(2 * nodes) + 0.5) / (2 * nodes)
    sphere = seen.sphere(*np.meshgrid(angle, around, indexing="ij"))
    position = seen.position(sphere)
    distance = np.linalg.norm(position, axis=-1)
    ray = position / distance[..., None]
    # Areas of the stretched space go over with their normals: det(A) A⁻ᵀ n dA.
    area = (
        seen.shape.radius**2
        * (1 - planet.flattening)
        * (weight * np.sin(angle))[:, None]
        * seen.half_angle
        / 2
        * (np.pi / nodes)
    )
    solid_angle = -((sphere @ seen.shape.stretch) * ray).sum(axis=-1) * area / distance**2
    found = CapNodes(sphere, ray, np.where(ray[..., 2] > 0, solid_angle, 0.0))
    for array in (found.sphere, found.ray, found.solid_angle):
        array.flags.writeable = False
    return found


@lru_cache(maxsize=4)  # one change of the light asks for the same planet's rays a dozen times
def make_light_rays(planet: Planet, nodes: int = 96) -> tuple[Array, Array]:
    """Divide the planet's light into rays: unit vectors (n, 3) toward its surface, and the irradiance (n,) in W/m² of
    each ray on a surface that faces it.

    Parts of the planet below the horizon (z < 0) give no light. The error of the quadrature is about 2e-4 if horizon or
    terminator cross the disc, 1e-3 if rings shade it, else far less.
    """
    if planet.angular_diameter_deg <= 0:
        return np.array([planet.direction]), np.zeros(1)
    seen = VisibleCap(planet)
    found = make_cap_nodes(seen, nodes)
    rays, brought = found.ray.reshape(-1, 3), (seen.radiance(found.sphere) * found.solid_angle).ravel()
    rays.flags.writeable = brought.flags.writeable = False  # all callers share them
    return rays, brought


def irradiance_wm2(planet: Planet, normal: Array | None = None, nodes: int = 96) -> float:
    """Compute the irradiance from the planet on a surface with the unit normal ``normal`` (3,); without it, on a
    surface that faces the planet.
    """
    ray, brought = make_light_rays(planet, nodes)
    return float(brought @ np.maximum(ray @ (planet.direction if normal is None else normal), 0.0))


def find_mean_direction(planet: Planet) -> Array:
    """Find the unit vector (3,) of the mean direction of the planet's light; of the planet's centre if it is dark."""
    ray, brought = make_light_rays(planet)
    total = brought @ ray
    length = float(np.linalg.norm(total))
    return np.asarray(total / length if length > 0 else planet.direction)


def find_lit_chords(planet: Planet) -> tuple[Array, float]:
    """Find the lit part of the planet's disc: the unit vector (3,) across the disc toward the Sun, and the share of
    each chord along it, from the Sun's side, that contains all lit points.

    The disc is a circle as wide as the equator about the planet's centre, in coordinates that keep areas.
    """
    across: Array = planet.sun - (planet.sun @ planet.direction) * planet.direction
    if np.linalg.norm(across) < 1e-6:
        across = np.cross(planet.direction, np.eye(3)[np.abs(planet.direction).argmin()])
    across /= np.linalg.norm(across)
    ray, brought = make_light_rays(planet)
    ray = ray[brought > 0]
    if not len(ray):
        return across, 1.0
    deep = 2 * math.sin(math.radians(planet.angular_diameter_deg / 4)) ** 2
    down = ((ray - planet.direction) ** 2).sum(axis=-1) / 2
    scale = 1 / np.sqrt(deep * (2 - down))
    s, t = ray @ across * scale, ray @ np.cross(planet.direction, across) * scale
    end = np.sqrt(np.maximum(1 - t**2, 1e-4))
    return across, min(1.0, float(((end - s) / (2 * end)).max()) + 0.03)  # the quadrature's rays are not that far apart


def unshaded_share(planet: Planet) -> float:
    """Compute the share of the planet's light on level ground that remains in the shadow of the rings."""
    level = np.array([0.0, 0.0, 1.0])
    bare = irradiance_wm2(replace(planet, rings=()), level) if planet.rings else 0.0
    return irradiance_wm2(planet, level) / bare if bare > 0 else 1.0


@dataclass(frozen=True)
class DiscMesh:
    """The visible part of a planet as a mesh around the observer; its centre is at distance 1."""

    vertices: Array  # (n, 3)
    faces: Array  # (m, 4), the first ring has its first vertex twice; towards the observer
    transmission: Array  # (n,) share of the light from behind that passes


#: Number of sectors of a disc's mesh: a chord is within 4e-5 of its outline.
_DISC_SECTORS = 384
#: Widest soft rim, over the radius of the planet. A wider rim would change the light of a small planet.
_WIDEST_RIM = 0.1


def make_disc_mesh(planet: Planet, pixel_rad: float, rings: int = 48, widest_rim: float = _WIDEST_RIM) -> DiscMesh:
    """Make the planet as a mesh whose outline is within 4e-5 of the ellipsoid's. Its radiance is computed at each
    pixel.

    ``pixel_rad`` is the angle of a pixel in radians. Over this angle, half of it on each side of the limb, the
    transmission rises linearly from 0 to 1, and is 1/2 on the limb. So the transmission at a pixel is the share of it
    that the planet leaves free, and few light paths suffice to find the pixel's mean. The rim is at most ``widest_rim``
    radii wide.
    """
    seen = VisibleCap(planet)
    width = min(pixel_rad, widest_rim * seen.shape.radius)
    around = np.arange(_DISC_SECTORS) * 2 * np.pi / _DISC_SECTORS
    angle = np.arange(1, rings + 1) * seen.half_angle / rings
    sphere = seen.sphere(*np.meshgrid(angle, around, indexing="ij"))
    position, limb = seen.position(sphere), seen.position(sphere[-1])
    # Rays touch the planet at its limb, so the normal there points out of the disc.
    outward = seen.normal(sphere[-1])
    ray = limb / np.linalg.norm(limb, axis=-1, keepdims=True)
    beside = (position * outward).sum(axis=-1) / (position * ray).sum(axis=-1)
    beyond = limb + width / 2 * np.linalg.norm(limb, axis=-1, keepdims=True) * outward
    passed = np.append(np.clip(0.5 + beside / width, 0.0, 0.5), np.ones((1, _DISC_SECTORS)), axis=0)
    vertices = np.concatenate([seen.position(seen.axis)[None], position.reshape(-1, 3), beyond])
    return DiscMesh(vertices, _list_disc_faces(rings + 1), np.append(0.0, passed))


def _list_disc_faces(circles: int) -> Array:
    """List the quadrilaterals (m, 4) between a centre, which is vertex 0, and circles of ``_DISC_SECTORS`` vertices."""
    here = np.arange(_DISC_SECTORS)
    after = (here + 1) % _DISC_SECTORS
    first = np.stack([0 * here, 1 + here, 1 + after, 0 * here], axis=1)
    starts = 1 + np.arange(circles)[:, None] * _DISC_SECTORS
    corners = [starts[:-1] + here, starts[1:] + here, starts[1:] + after, starts[:-1] + after]
    return np.concatenate([first, np.stack(corners, axis=-1).reshape(-1, 4)])
