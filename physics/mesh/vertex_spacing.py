"""How fine a mesh of the ground has to be, at every distance, for the cameras that look at it.

The error of a mesh is how far the described ground is off its triangles, square to them, as seen from the
nearer eye: in pixels, length over distance times focal length. It is not predicted from a law of
roughness, which would hold for one kind of ground only, but measured on the ground itself: triangles
of a given size are put at random places round the site and compared with the ground under them.
That gives the largest size whose error stays under the bound, for every distance.

What does not depend on it: the heading (the finest of all sectors decides) and the eye (the other eye
may stand one baseline from the site, on any side). The body's curvature is added to the heights.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..rig.seen_points import is_in_view
from ..terrain.terrain import Terrain
from .finer_in_view import FineRelief, find_relief_in_mesh
from .horizon import horizon_m
from .vertex_rings import RINGS_APART, VertexRings

#: Triangles measured per distance, and the sectors they are sorted into.
_SAMPLES, _SECTORS = 1800, 6
#: Maximum number of sizes that are tried, each half the one before, from the longest edge to more than memory holds.
_HALVINGS = 24
#: Share of the measured triangles that keep to the error. Of an image it is 0.95: one image shows few hills, and
#: their crests, which face the eye and hide the ground behind them, err more than the ground does on the whole.
_SHARE = 0.97
#: Steps by which the error is raised until the vertices are few enough.
_COARSER = 1.05
#: Shortest wavelength on the mesh, in spacings. Leaving out all that two spacings cannot carry, as a uniform grid
#: does, would double the error: straight lines between points of the ground are nearer to it than between
#: points of a smoothed ground. Much shorter waves only make the points noisy.
CARRIED = 0.7
#: Greatest ratio of the relief to the relief of a sample of the ground.
_HIGHER = 1.25
#: Ground is not looked at from closer than this share of the camera's height, however it rises to it.
_CLOSEST = 0.25
#: Beyond the ground with fine relief, the limit on the spacing grows with this power of the distance.
_FADE = 4.0
#: A strip between two rings has edges up to this much longer than its spacing.
EDGE_OVER_SPACING = 1.4


@dataclass(frozen=True)
class GradingView:
    """The view that decides the grading: the site and the left eye's height above it in metres, the distance
    to the other eye, and the pixels per radian."""

    x_m: float
    y_m: float
    height_m: float
    baseline_m: float
    pixels_per_radian: float

    def nearest_m(self, radius_m: Numbers) -> Array:
        """Distance of level ground, ``radius_m`` from the site, to the nearest place an eye can be at."""
        return np.hypot(np.maximum(np.asarray(radius_m, np.float64) - self.baseline_m, 0.0), self.height_m)


#: The ``rig`` settings that a grading depends on.
OF_THE_RIG = ("x_m", "y_m", "height_m", "baseline_m", "focal_length_mm", "sensor_width_mm", "width_px", "height_px")


def make_grading_view(rig: RigSettings) -> GradingView:
    """The view of ``rig`` settings.

    A pixel at the tangents (a, b) from the optical axis spans 1 / (1 + a² + b²) of the angle that one on the
    axis does, in the direction away from it; the mean over the image is what counts.
    """
    half_width = rig.sensor_width_mm / 2 / rig.focal_length_mm
    half_height = half_width * rig.height_px / rig.width_px
    stretch = 1.0 + (half_width**2 + half_height**2) / 3.0
    return GradingView(rig.x_m, rig.y_m, rig.height_m, rig.baseline_m, rig.width_px / (2.0 * half_width) * stretch)


@dataclass(frozen=True)
class VertexSpacing:
    """The spacing that was found. ``nearest_m`` (n,) are distances to the eye, rising, and ``spacing_m`` (n,) the
    vertex spacings there; between them the spacing is a power of the distance. ``error_px`` is the bound on
    the error that it keeps, ``wanted_vertices`` the number of vertices for the bound that the settings ask for.
    ``relief`` is the cut for fine relief; the spacing is before the cut."""

    view: GradingView
    nearest_m: Array
    spacing_m: Array
    farthest_m: float
    error_px: float
    wanted_vertices: float
    relief: FineRelief | None = None

    def spacing_at(self, radius_m: Numbers) -> Array:
        """Vertex spacing in metres at distances from the site in metres."""
        distance = self.view.nearest_m(radius_m)
        spacing = np.exp(np.interp(np.log(distance), np.log(self.nearest_m), np.log(self.spacing_m)))
        if self.relief is None:
            return spacing
        if self.relief.to_m <= self.view.height_m:  # fine relief is nowhere high enough to ask for it
            return spacing
        beyond = np.maximum(distance / self.relief.to_m, 1.0)
        widest = self.relief.uncut_px / self.view.pixels_per_radian * distance * beyond**_FADE
        return np.minimum(spacing, widest)

    @property
    def finest_m(self) -> float:
        """Spacing at the site in metres."""
        return float(self.spacing_at(0.0))

    @functools.cached_property
    def rings(self) -> VertexRings:
        """The rings that the vertices stand on."""
        radii, last = [self.finest_m], self.finest_m
        while last < self.farthest_m:
            last += RINGS_APART * float(self.spacing_at(last))
            radii.append(last)
        # The last ring stands at the end, or the one before is moved there: no sliver.
        if len(radii) > 1 and radii[-1] - self.farthest_m > 0.5 * (radii[-1] - radii[-2]):
            radii.pop()
        radii[-1] = self.farthest_m
        return VertexRings.of(np.array(radii), self.spacing_at(np.array(radii)))


def find_fine_relief(settings: Settings) -> FineRelief | None:
    """Where the graded mesh of complete ``settings`` is to have fine relief; None if nowhere, or for other ground."""
    return find_relief_in_mesh(settings, make_grading_view(settings.rig).pixels_per_radian)


def _count_cut(grading: VertexSpacing, rig: RigSettings, most: int) -> int:
    """How many vertices are added for fine relief, on level ground; 0 if there are more than ``most`` without them.

    Narrow images ask for more vertices than any memory holds, so they are counted before they are made.
    """
    relief, at = grading.relief, grading.view
    if relief is None or grading.rings.vertices > most:
        return 0
    rings = grading.rings
    x, y = rings.map_positions()
    near = relief.is_cut(at.nearest_m(np.hypot(x, y)))
    return (relief.parts**2 - 1) * int(
        np.sum(is_in_view(rig, x[near], y[near], np.full(int(near.sum()), -at.height_m)))
    )


def _spread_points_evenly(count: int, dimensions: int) -> Array:
    """Points (dimensions, count) that fill the unit cube evenly: multiples of powers of one number, modulo 1.

    Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018: the number is the root of x^(d+1) = x + 1.
    """
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    return (0.5 + steps[:, None] * np.arange(count)) % 1.0


def _farthest_ground_m(ground: Terrain, at: GradingView, ground_m: float, body_radius_m: float) -> float:
    """Distance in metres beyond which no ground can be seen: highest relief sinks under the horizon there."""
    outward, turn = _spread_points_evenly(4 * _SAMPLES, 2)
    radius = at.height_m * (2.0 * horizon_m(at.height_m, body_radius_m) / at.height_m) ** outward
    z = ground.heights(at.x_m + radius * np.cos(2 * np.pi * turn), at.y_m + radius * np.sin(2 * np.pi * turn))
    lowest, highest = float(min(z.min(), ground_m)), float(max(z.max(), ground_m))
    relief = _HIGHER * (highest - lowest)
    eye = ground_m + at.height_m - lowest + relief - (highest - lowest)
    return min(horizon_m(eye, body_radius_m) + horizon_m(relief, body_radius_m), 0.9 * body_radius_m)


class _ErrorProbe:
    """Triangles round the site at one distance, and how far they are from the ground under them."""

    def __init__(self, ground: Terrain, at: GradingView, ground_m: float, low_m: float, high_m: float) -> None:
        outward, turn, self._phase, first, second = _spread_points_evenly(_SAMPLES, 5)
        # Logarithmic, or over the whole disc round the site.
        radius = high_m * np.sqrt(outward) if low_m == 0.0 else low_m * (high_m / low_m) ** outward
        east, north = np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)
        self._ground, self._view = ground, at
        self._x, self._y = at.x_m + radius * east, at.y_m + radius * north
        sector = (turn * _SECTORS).astype(int)
        self._sectors = [np.flatnonzero(sector == k) for k in range(_SECTORS)]
        root = np.sqrt(first)
        self._share = np.stack([1.0 - root, root * (1.0 - second), root * second])  # even over a triangle
        self._z = ground.heights(self._x, self._y)
        toward = np.minimum(radius, at.baseline_m)  # the other eye, on the side of the ground looked at
        self._to_eye = np.stack([(toward - radius) * east, (toward - radius) * north, ground_m + at.height_m - self._z])
        self._far = np.maximum(np.linalg.norm(self._to_eye, axis=0), _CLOSEST * at.height_m)
        self._spacing = at.nearest_m(radius) / at.pixels_per_radian

    def error_px(self, spacing_px: float) -> float:
        """The error in pixels of triangles with sides of ``spacing_px`` pixels, in the worst sector.

        Each triangle counts as much as it fills of the image: by how it faces the eye.
        """
        side = spacing_px * self._spacing
        angle = 2 * np.pi * (self._phase + np.arange(3)[:, None] / 3.0)
        x, y = (side / math.sqrt(3.0) * f(angle) for f in (np.cos, np.sin))
        x, y = x - (self._share * x).sum(axis=0), y - (self._share * y).sum(axis=0)
        z = self._ground.heights(self._x + x, self._y + y, np.broadcast_to(CARRIED * side, x.shape))
        edges = np.stack([x[1:] - x[0], y[1:] - y[0], z[1:] - z[0]])
        normal = np.cross(edges[:, 0], edges[:, 1], axis=0)
        normal /= np.linalg.norm(normal, axis=0)
        error = np.abs(((self._share * z).sum(axis=0) - self._z) * normal[2]) / self._far
        seen = np.maximum((normal * self._to_eye).sum(axis=0) / (normal[2] * self._far), 1e-3)
        worst = max(_bound_error(error[here], seen[here]) for here in self._sectors)
        return worst * self._view.pixels_per_radian


def _bound_error(errors: Array, weights: Array) -> float:
    """A bound on weighted errors: nearly all are below it, and so is their RMS, which a few large ones raise."""
    order = np.argsort(errors)
    below = np.cumsum(weights[order]) / weights.sum()
    return max(float(np.interp(_SHARE, below, errors[order])), math.sqrt(float(np.average(errors**2, weights=weights))))


def _measure_curve(probe: _ErrorProbe, longest_px: float, error_px: float) -> tuple[Array, Array]:
    """Spacings in pixels, falling, and the errors they leave, down to the first that keeps to ``error_px``."""
    spacings, errors = [longest_px], [probe.error_px(longest_px)]
    while errors[-1] > error_px and len(spacings) < _HALVINGS:
        spacings.append(spacings[-1] / 2)
        errors.append(min(probe.error_px(spacings[-1]), errors[-1]))
    return np.array(spacings), np.array(errors)


def _interpolate_log(x: float, xs: Array, ys: Array) -> float:
    """``ys`` at ``x``, a power law between points; ``xs`` rises."""
    tiny = 1e-30
    return math.exp(
        float(np.interp(math.log(max(x, tiny)), np.log(np.maximum(xs, tiny)), np.log(np.maximum(ys, tiny))))
    )


def _count_vertices(grading: VertexSpacing) -> float:
    """How many vertices a grading takes, to about a per cent."""
    r = np.concatenate([[0.0], np.geomspace(grading.finest_m, grading.farthest_m, 400)])
    density = 2 * np.pi * r / (RINGS_APART * grading.spacing_at(r) ** 2)
    return 1.0 + float(np.sum((density[1:] + density[:-1]) / 2 * np.diff(r)))


def _probes_of(ground: Terrain, at: GradingView, ground_m: float, nearest_m: Array) -> list[_ErrorProbe]:
    """A probe for each of the distances, half way on to the next ones; the first is under the eyes too."""
    probes = []
    for k, distance in enumerate(nearest_m):
        low, high = (
            at.baseline_m + math.sqrt(max(d * d - at.height_m**2, 0.0))
            for d in (distance / math.sqrt(2.0), min(distance * math.sqrt(2.0), float(nearest_m[-1])))
        )
        probes.append(_ErrorProbe(ground, at, ground_m, 0.0 if k == 0 else low, high))
    return probes


def choose_vertex_spacing(ground: Terrain, settings: Settings) -> VertexSpacing:
    """The grading that complete ``settings`` ask for on a ground (not yet curved).

    Where it would take more than ``mesh.most`` vertices, first vertices of fine relief are set wider apart, then all
    vertices; ``error_px`` is the error that remains.
    """
    mesh, at, body = settings.mesh, make_grading_view(settings.rig), float(settings.terrain.body_radius_m)
    ground_m = float(ground.heights(at.x_m, at.y_m))
    farthest = max(min(_farthest_ground_m(ground, at, ground_m, body), float(mesh.farthest_m)), 2.0 * at.height_m)
    last = float(at.nearest_m(farthest))
    nearest = np.geomspace(at.height_m, last, 1 + max(2, math.ceil(math.log2(last / at.height_m))))
    probes = _probes_of(ground, at, ground_m, nearest)
    curves = [_measure_curve(probe, mesh.edge_px / EDGE_OVER_SPACING, mesh.error_px) for probe in probes]

    def made(error_px: float, wider: float = 1.0) -> VertexSpacing:
        # Six digits, as powers differ between machines in the last ones.
        pixels = wider * np.array(
            [float(f"{_interpolate_log(error_px, errors[::-1], spacings[::-1]):.5e}") for spacings, errors in curves]
        )
        return VertexSpacing(at, nearest, pixels * nearest / at.pixels_per_radian, farthest, error_px, wanted, relief)

    relief = find_relief_in_mesh(settings, at.pixels_per_radian)
    error, wider, wanted = float(mesh.error_px), 1.0, 0.0
    grading = made(error)
    wanted = _count_vertices(grading) + _count_cut(grading, settings.rig, mesh.most)
    if wanted <= mesh.most and grading.rings.vertices <= mesh.most:
        return made(error)  # with the final ``wanted``
    while relief is not None and grading.rings.vertices + _count_cut(grading, settings.rig, mesh.most) > mesh.most:
        coarser = relief.spacing_px * relief.parts / (relief.parts - 1) if relief.parts > 1 else math.inf
        relief = replace(relief, parts=relief.parts - 1, spacing_px=coarser) if relief.parts > 2 else None
        grading = made(error)
    # Then the error rises; where the longest edges alone are too many, they grow as well.
    worst = max(errors[0] for _, errors in curves)
    while _count_vertices(grading) > mesh.most and error < worst:
        error *= _COARSER
        grading = made(error)
    wider = max(1.0, math.sqrt(_count_vertices(grading) / mesh.most))
    while (grading := made(error, wider)).rings.vertices > mesh.most:
        wider *= _COARSER
    if wider == 1.0 and error == mesh.error_px:
        return grading
    left = [
        probe.error_px(spacing / distance * at.pixels_per_radian)
        for probe, spacing, distance in zip(probes, grading.spacing_m, nearest, strict=True)
    ]
    return replace(grading, error_px=max(left))
