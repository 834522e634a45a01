"""The share of the Sun that a planet hides: the exact overlap of a disc and an ellipsoid on the celestial sphere."""

from __future__ import annotations

import math

import numpy as np

from ...support.arrays import Array
from .planetshine import Planet, make_ellipsoid

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def compute_hidden_share(planet: Planet, sun_diameter_deg: float) -> float:
    """Compute the share of the evenly bright disc of the Sun that a planet hides, with an error below 2e-4.

    The error is below 5e-3 for a planet that looks smaller than the Sun. Two effects are left out. Limb darkening of
    the Sun, 40 % of the mean in green light, matters only while the planet's limb crosses the Sun (a minute of
    Enceladus' day, four of Europa's). The planet's atmosphere bends a little light around it.
    """
    apart = 180 - planet.phase_deg
    if planet.angular_diameter_deg <= 0 or apart > (planet.angular_diameter_deg + sun_diameter_deg) / 2:
        return 0.0
    radius = math.radians(max(sun_diameter_deg, 1e-6) / 2)
    shape = make_ellipsoid(planet)
    # A ray from the site along w meets the ellipsoid where w Q w > 0, ahead if w · o < 0.
    toward = shape.stretch @ shape.observer / shape.radius
    quadric = (
        np.outer(toward, toward)
        - (shape.observer @ shape.observer - 1) * (shape.stretch @ shape.stretch) / shape.radius**2
    )
    sun = planet.sun
    up: Array = planet.direction - (planet.direction @ sun) * sun  # chords run toward the planet, across its limb
    if np.linalg.norm(up) < 1e-12:
        up = np.cross(sun, np.eye(3)[np.abs(sun).argmin()])
    up /= np.linalg.norm(up)
    side = np.cross(sun, up)
    angle = math.pi / 2 * _NODES  # of the chord's foot; this variable makes both ends of the integral smooth
    off = radius * np.sin(angle)
    half = 2 * np.arcsin(np.sqrt(np.sin((radius + off) / 2) * np.sin((radius - off) / 2) / np.cos(off)))
    foot = np.cos(off)[:, None] * sun + np.sin(off)[:, None] * side
    hidden = np.array([_integrate_hidden(f, up, h, quadric, toward) for f, h in zip(foot, half, strict=True)])
    weight = _WEIGHTS * np.cos(angle)
    return float(np.clip((weight * hidden).sum() / (weight * 2 * np.sin(half)).sum(), 0.0, 1.0))


def _integrate_hidden(foot: Array, up: Array, half: float, quadric: Array, toward: Array) -> float:
    """Integrate the cosine of the distance from ``foot`` over the hidden part of a great circle from -half to half.

    On the circle w = cos φ foot + sin φ up, the quadric is mean + swing cos(2 φ - turn).
    """
    a, b, c = foot @ quadric @ foot, foot @ quadric @ up, up @ quadric @ up
    mean, swing, turn = (a + c) / 2, math.hypot((a - c) / 2, b), math.atan2(b, (a - c) / 2)
    if mean + swing <= 0:
        return 0.0  # the circle passes beside the planet
    wide = math.acos(float(np.clip(-mean / swing, -1.0, 1.0))) / 2 if swing > 0 else math.pi / 2
    middle = turn / 2
    if toward @ (math.cos(middle) * foot + math.sin(middle) * up) > 0:
        middle += math.pi  # the other intersection is behind the site
    middle = (middle + math.pi) % (2 * math.pi) - math.pi
    low, high = max(middle - wide, -half), min(middle + wide, half)
    return math.sin(high) - math.sin(low) if high > low else 0.0
