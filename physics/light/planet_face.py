"""The face of the globe of Saturn or Jupiter: bands, limb darkening, the Great Red Spot, colour.

A face is a pattern of reflectance over the globe. Its light is scaled so that the planet gives the site the irradiance
that ``planetshine`` computes for an even globe. A face therefore changes the image of the planet and the colour of its
light, but not the amount.

The reflectance of a place is B(φ) times a law of limb darkening, with the planetographic latitude φ. B is a rounded
reading for the bands R, G, B, good to about 0.05. Clouds drift, and their patterns change over months: a face is
typical and shows no particular date.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np

from ...support.arrays import Array
from .planetshine import Planet, VisibleCap, make_cap_nodes

#: Least cosine of the angle of emission, which keeps the limb finite.
MIN_COSINE = 0.02


@dataclass(frozen=True)
class Spot:
    """An oval cloud, such as the Great Red Spot. Its semi-axes are angles in radians at the planet's centre;
    reflectances are in R, G, B.
    """

    latitude_deg: float
    half_length: float
    half_height: float
    reflectance: tuple[float, float, float]
    collar: tuple[float, float, float]


#: Radii of the outer edges of a spot and of its collar, over the radius of the spot.
SPOT_EDGES = (1.0, 1.25)
#: Width of each of these edges, over the radius of the spot.
SPOT_SOFTNESS = 0.1


@dataclass(frozen=True)
class Limb:
    """A law of limb darkening, by the cosines μ₀ and μ of the angles of incidence and emission.

    Minnaert's law is (μ₀ μ)^k / μ (1941, Astrophysical Journal 93, 403), Barkstrom's [μ₀ μ / (μ₀ + μ)]^k / μ. In full
    light, where μ₀ = μ, both have the same shape if Barkstrom's exponent is twice Minnaert's.
    """

    law: Literal["MINNAERT", "BARKSTROM"]
    phase_deg: tuple[float, ...]  # angles at the planet between the Sun and the observer, rising
    exponents: tuple[tuple[float, float, float], ...]  # of each angle in R, G, B

    def exponents_at(self, phase_deg: float) -> tuple[float, float, float]:
        """Interpolate the exponents in R, G, B; beyond the ends they stay the same."""
        r, g, b = (float(np.interp(phase_deg, self.phase_deg, band)) for band in np.transpose(self.exponents))
        return r, g, b


@dataclass(frozen=True)
class Face:
    """The pattern of a globe: reflectances, interpolated linearly over the sine of the latitude."""

    sine: tuple[float, ...]  # of planetographic latitudes, from south to north
    reflectance: tuple[tuple[float, float, float], ...]  # in R, G, B
    limb: Limb
    tint: tuple[float, float, float]  # ratio of all its light to sunlight in each band; the mean is 1
    spot: Spot | None = None
    ripple_deg: float = 0.0  # by how much the edges of its bands waver in latitude


def _divide_by_mean(bands: tuple[float, float, float]) -> tuple[float, float, float]:
    mean = sum(bands) / 3
    return (bands[0] / mean, bands[1] / mean, bands[2] / mean)


#: Saturn's limb: fits to Pioneer 11's images at 0.64 and 0.44 µm (Dones et al. 1993, Icarus 105, 184, table V, as in
#: Dyudina et al. 2005, Astrophysical Journal 618, 973, table 2). G, at 0.54 µm, is the mean of both.
_SATURN_LIMB = Limb(
    "BARKSTROM",
    (0.0, 30.0, 60.0, 90.0, 120.0, 150.0),
    tuple(
        (red, (red + blue) / 2, blue)
        for red, blue in ((1.48, 1.11), (1.48, 1.11), (1.46, 1.15), (1.42, 1.18), (1.36, 1.20), (1.34, 1.41))
    ),
)


def _make_saturn() -> Face:
    """Make Saturn's bands in V, alike in north and south; their contrast is 0.6 times as high in R, 1.3 times in B."""
    latitude = np.array([0.0, 10, 18, 25, 33, 40, 48, 60, 65, 78, 90])
    visual = np.array([1.16, 1.12, 0.98, 0.90, 0.88, 0.96, 0.86, 0.88, 0.80, 0.78, 0.70])
    both = np.concatenate([-latitude[:0:-1], latitude])
    bands = 1 + (np.concatenate([visual[:0:-1], visual])[:, None] - 1) * (0.6, 1.0, 1.3)
    return Face(
        tuple(np.sin(np.radians(both)).tolist()),
        tuple((r, g, b) for r, g, b in bands.tolist()),
        _SATURN_LIMB,
        _divide_by_mean((1.15, 1.0, 0.69)),
    )


#: Reflectances of a bright zone,
_ZONE_RGB = (0.82, 0.76, 0.62)
#: of the polar regions,
_POLE_RGB = (0.58, 0.50, 0.42)
#: and of a thin belt.
_THIN_BELT_RGB = (0.70, 0.60, 0.45)
#: Jupiter's zones and belts from south to north: the latitude at which each begins, and its reflectances.
_JUPITER_BANDS = (
    (-90.0, _POLE_RGB),
    (-48.0, _ZONE_RGB),
    (-33.0, _THIN_BELT_RGB),
    (-27.0, _ZONE_RGB),
    (-20.0, (0.68, 0.55, 0.38)),
    (-7.0, _ZONE_RGB),
    (7.0, (0.66, 0.52, 0.34)),
    (18.0, _ZONE_RGB),
    (24.0, _THIN_BELT_RGB),
    (31.0, _ZONE_RGB),
    (36.0, _THIN_BELT_RGB),
    (40.0, _ZONE_RGB),
    (48.0, _POLE_RGB),
)
#: Half the width, in degrees, of an edge between two bands.
_EDGE_DEG = 0.6
#: Half the width, in degrees, of the edge of a polar region.
_POLE_EDGE_DEG = 7.0


def _make_jupiter() -> Face:
    sine, reflectance = [-1.0], [_JUPITER_BANDS[0][1]]
    for (_, before), (edge, after) in pairwise(_JUPITER_BANDS):
        half = _POLE_EDGE_DEG if _POLE_RGB in (before, after) else _EDGE_DEG
        sine += [math.sin(math.radians(edge - half)), math.sin(math.radians(edge + half))]
        reflectance += [before, after]
    return Face(
        (*sine, 1.0),
        (*reflectance, _JUPITER_BANDS[-1][1]),
        Limb("MINNAERT", (0.0,), ((1.0, 0.95, 0.87),)),
        _divide_by_mean((1.0, 1.0, 0.835)),
        Spot(
            -22.5, 7000 / (71492 * math.cos(math.radians(22.5))), 5750 / 71492, (0.70, 0.48, 0.28), (0.86, 0.80, 0.68)
        ),
        0.35,
    )


#: Faces by the value of ``light.planet_face``. Saturn's brightness over latitude: rounded from HST images at 435 to
#: 716 nm (Icarus 100, Dec 1992) and Franz and Price; Jupiter's zones, belts, limb and the size of its Red Spot, 14 000
#: by 11 500 km: the usual nomenclature and rounded values near full light. Both tints: the albedo spectra of whole
#: discs of Karkoschka 1998, Icarus 133, 134, seen in the primaries of sRGB.
FACES = {"SATURN": _make_saturn(), "JUPITER": _make_jupiter()}


def spot_axes(planet: Planet, spot: Spot) -> Array:
    """Compute the rows (3, 3): the globe's normal in the middle of a spot, and the directions to east and north
    there.
    """
    front: Array = -planet.direction + (planet.direction @ planet.pole) * planet.pole
    if np.linalg.norm(front) < 1e-9:  # seen from above a pole
        front = np.cross(planet.pole, np.eye(3)[np.abs(planet.pole).argmin()])
    front /= np.linalg.norm(front)
    longitude, latitude = math.radians(planet.spot_longitude_deg), math.radians(spot.latitude_deg)
    out = math.cos(longitude) * front + math.sin(longitude) * np.cross(planet.pole, front)
    return np.stack(
        [
            math.cos(latitude) * out + math.sin(latitude) * planet.pole,
            np.cross(planet.pole, out),
            math.cos(latitude) * planet.pole - math.sin(latitude) * out,
        ]
    )


def _band_reflectance(face: Face, planet: Planet, normal: Array) -> Array:
    """Compute the reflectances B (..., 3) at unit normals (..., 3)."""
    sine = normal @ planet.pole
    found = np.stack([np.interp(sine, face.sine, band) for band in np.transpose(face.reflectance)], axis=-1)
    if face.spot is not None:
        middle, east, north = spot_axes(planet, face.spot)
        away = np.hypot(normal @ east / face.spot.half_length, normal @ north / face.spot.half_height)
        away = np.where(normal @ middle > 0, away, np.inf)
        for edge, colour in zip(SPOT_EDGES[::-1], (face.spot.collar, face.spot.reflectance), strict=True):
            inside = np.clip((edge - away) / SPOT_SOFTNESS + 0.5, 0, 1)[..., None]
            found = found + inside * (np.array(colour) - found)
    return found


def radiance_over_zenith(face: Face, planet: Planet, normal: Array, toward: Array) -> Array:
    """Compute the unscaled radiance (..., 3), without ripples, relative to an even globe with the Sun in the zenith.
    ``normal`` and ``toward`` (..., 3) are unit vectors, ``toward`` to the observer.
    """
    incidence = np.maximum(normal @ planet.sun, 0.0)[..., None]
    emission = np.maximum((normal * toward).sum(axis=-1), MIN_COSINE)[..., None]
    both = incidence * emission / (incidence + emission if face.limb.law == "BARKSTROM" else 1.0)
    exponents = np.array(face.limb.exponents_at(planet.phase_deg))
    return np.asarray(_band_reflectance(face, planet, normal) * both**exponents / emission)


def face_tint(planet: Planet) -> Array:
    """Return the ratio (3,) of the planet's light to sunlight in each band; the mean of the bands is 1."""
    return np.array(FACES[planet.face].tint if planet.face in FACES else (1.0, 1.0, 1.0))


@lru_cache(maxsize=4)
def face_scale(planet: Planet) -> tuple[float, float, float]:
    """Compute the factors on the bands of a face that give the planet the irradiance of an even globe times the
    tint.
    """
    face, seen = FACES[planet.face], VisibleCap(planet)
    nodes = make_cap_nodes(seen)
    facing = nodes.solid_angle * np.maximum(nodes.ray @ planet.direction, 0.0)
    normal, shaded = seen.normal(nodes.sphere), facing * seen.passed(nodes.sphere)
    total = (radiance_over_zenith(face, planet, normal, -nodes.ray) * shaded[..., None]).sum(axis=(0, 1))
    even = float((np.maximum(normal @ planet.sun, 0.0) * shaded).sum())
    r, g, b = (tint * even / band if band > 0 else tint for tint, band in zip(face.tint, total.tolist(), strict=True))
    return r, g, b
