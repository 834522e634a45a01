"""The vertex spacing that a mesh of the ground needs, at every distance, for the cameras that look at it.

The error of a mesh is the distance of the described ground from its triangles, along their normals, as seen from the
nearer eye: in pixels, length over distance times focal length. A law of roughness would predict it for one kind of
ground only, so it is measured on the ground itself: triangles of a given size are put at random places around the site
and compared with the ground under them. The result is the largest size whose error stays under the bound, for every
distance.

The result depends neither on the heading (the finest of all sectors decides) nor on the eye (the other eye may stand
one baseline from the site, on any side). The body's curvature is added to the heights.
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

#: Number of triangles measured per distance.
_TRIANGLES_MEASURED = 1800
#: Number of sectors into which they are sorted.
_SECTORS = 6
#: Maximum number of sizes that are tried, each half the previous one, from the longest edge to more than memory holds.
_MAX_HALVINGS = 24
#: Share of the measured triangles whose error is within the bound. In an image this share is 0.95: an image shows few
#: hills, and their crests, which face the eye and hide the ground behind them, have larger errors.
_SHARE_WITHIN_ERROR = 0.97
#: Factor by which the error is raised until the vertices are few enough.
_ERROR_STEP = 1.05
#: Shortest wavelength on the mesh, in spacings. Leaving out all waves below two spacings, as a uniform grid does, would
#: double the error: straight lines between points of the ground are nearer to it than lines between points of a
#: smoothed ground. Much shorter waves only make the points noisy.
CARRIED_WAVELENGTH = 0.7
#: Largest relief of the ground, over the relief of its sampled points.
_RELIEF_MARGIN = 1.25
#: Least distance at which ground is seen, over the camera's height, even if the ground rises toward it.
_MIN_DISTANCE = 0.25
#: Power of the distance with which the limit on the spacing grows beyond the ground with fine relief.
_SPACING_EXPONENT = 4.0
#: Largest ratio of the edges of a strip between two rings to its spacing.
EDGE_OVER_SPACING = 1.4


@dataclass(frozen=True)
class GradingView:
    """The view that decides the grading: the site, the left eye's height above it in metres, the distance to the other
    eye in metres, and the pixels per radian.
    """

    x_m: float
    y_m: float
    height_m: float
    baseline_m: float
    pixels_per_radian: float

    def nearest_m(self, radius_m: Numbers) -> Array:
        """Compute the distance in metres of level ground, ``radius_m`` from the site, from the nearest possible place
        of an eye.
        """
        return np.hypot(np.maximum(np.asarray(radius_m, np.float64) - self.baseline_m, 0.0), self.height_m)


#: The ``rig`` settings that a grading depends on.
GRADING_RIG_SETTINGS = (
    "x_m",
    "y_m",
    "height_m",
    "baseline_m",
    "focal_length_mm",
    "sensor_width_mm",
    "width_px",
    "height_px",
)


def make_grading_view(rig: RigSettings) -> GradingView:
    """Make the view of ``rig`` settings.

    In the direction away from the optical axis, a pixel at the tangents (a, b) spans 1 / (1 + a² + b²) of the angle of
    a pixel on the axis; the mean over the image is used.
    """
    half_width = rig.sensor_width_mm / 2 / rig.focal_length_mm
    half_height = half_width * rig.height_px / rig.width_px
    stretch = 1.0 + (half_width**2 + half_height**2) / 3.0
    return GradingView(rig.x_m, rig.y_m, rig.height_m, rig.baseline_m, rig.width_px / (2.0 * half_width) * stretch)


@dataclass(frozen=True)
class VertexSpacing:
    """Vertex spacing by distance. ``nearest_m`` (n,) are increasing distances to the eye, and ``spacing_m`` (n,) the
    vertex spacings there; between them the spacing is a power of the distance. ``error_px`` is the bound on the error,
    and ``wanted_vertices`` the number of vertices for the bound of the settings. ``relief`` is the cut for fine relief;
    spacings are before the cut.
    """

    view: GradingView
    nearest_m: Array
    spacing_m: Array
    farthest_m: float
    error_px: float
    wanted_vertices: float
    relief: FineRelief | None = None

    def spacing_at(self, radius_m: Numbers) -> Array:
        """Compute the vertex spacing in metres at distances from the site in metres."""
        distance = self.view.nearest_m(radius_m)
        spacing = np.exp(np.interp(np.log(distance), *self._logarithms))
        if self.relief is None:
            return spacing
        if self.relief.to_m <= self.view.height_m:  # fine relief is nowhere high enough for finer triangles
            return spacing
        beyond = np.maximum(distance / self.relief.to_m, 1.0)
        widest = self.relief.uncut_px / self.view.pixels_per_radian * distance * beyond**_SPACING_EXPONENT
        return np.minimum(spacing, widest)

    @functools.cached_property
    def _logarithms(self) -> tuple[Array, Array]:
        """Logarithms of the distances and of the spacings, cached because rings ask for spacings one by one."""
        return np.log(self.nearest_m), np.log(self.spacing_m)

    @property
    def finest_m(self) -> float:
        """Vertex spacing at the site, in metres."""
        return float(self.spacing_at(0.0))

    @functools.cached_property
    def rings(self) -> VertexRings:
        """The rings of vertices of the mesh."""
        radii, last = [self.finest_m], self.finest_m
        while last < self.farthest_m:
            last += RINGS_APART * float(self.spacing_at(last))
            radii.append(last)
        # The last ring stands at the end; if it would make slivers, the previous ring is moved there.
        if len(radii) > 1 and radii[-1] - self.farthest_m > 0.5 * (radii[-1] - radii[-2]):
            radii.pop()
        radii[-1] = self.farthest_m
        return VertexRings.of(np.array(radii), self.spacing_at(np.array(radii)))


def find_fine_relief(settings: Settings) -> FineRelief | None:
    """Find the fine relief in the graded mesh of complete ``settings``; None without any, and for other ground."""
    return find_relief_in_mesh(settings, make_grading_view(settings.rig).pixels_per_radian)


def count_added(grading: VertexSpacing, rig: RigSettings, most: float = math.inf) -> int:
    """Count the vertices that fine relief adds on level ground; 0 if the mesh without them has more than ``most``. They
    are counted before they are made, because narrow images can ask for more vertices than any memory holds.
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
    """Spread points (dimensions, count) that fill the unit cube evenly: multiples of powers of one number, modulo 1.

    Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018: the number is the root of x^(d+1) = x + 1.
    """
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    return (0.5 + steps[:, None] * np.arange(count)) % 1.0


def find_farthest_ground_m(
    ground: Terrain, at: GradingView, ground_m: float, body_radius_m: float, points: int = 4 * _TRIANGLES_MEASURED
) -> float:
    """Find the distance in metres beyond which no ground is visible, because even the highest relief is under the
    horizon.

    The relief is measured at a number of ``points``.
    """
    outward, turn = _spread_points_evenly(points, 2)
    radius = at.height_m * (2.0 * horizon_m(at.height_m, body_radius_m) / at.height_m) ** outward
    z = ground.heights(at.x_m + radius * np.cos(2 * np.pi * turn), at.y_m + radius * np.sin(2 * np.pi * turn))
    lowest, highest = float(min(z.min(), ground_m)), float(max(z.max(), ground_m))
    relief = _RELIEF_MARGIN * (highest - lowest)
    eye = ground_m + at.height_m - lowest + relief - (highest - lowest)
    return min(horizon_m(eye, body_radius_m) + horizon_m(relief, body_radius_m), 0.9 * body_radius_m)


class _ErrorProbe:
    """Triangles around the site at one distance, and their distances from the ground under them."""

    def __init__(self, ground: Terrain, at: GradingView, ground_m: float, low_m: float, high_m: float) -> None:
        outward, turn, self._phase, first, second = _spread_points_evenly(_TRIANGLES_MEASURED, 5)
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
        toward = np.minimum(radius, at.baseline_m)  # the other eye, on the side of the ground that is tested
        self._to_eye = np.stack([(toward - radius) * east, (toward - radius) * north, ground_m + at.height_m - self._z])
        self._far = np.maximum(np.linalg.norm(self._to_eye, axis=0), _MIN_DISTANCE * at.height_m)
        self._spacing = at.nearest_m(radius) / at.pixels_per_radian

    def error_px(self, spacing_px: float) -> float:
        """Measure the error in pixels of triangles with sides of ``spacing_px`` pixels, in the worst sector. Each
        triangle is weighted by the area that it fills in the image.
        """
        side = spacing_px * self._spacing
        angle = 2 * np.pi * (self._phase + np.arange(3)[:, None] / 3.0)
        x, y = (side / math.sqrt(3.0) * f(angle) for f in (np.cos, np.sin))
        x, y = x - (self._share * x).sum(axis=0), y - (self._share * y).sum(axis=0)
        z = self._ground.heights(self._x + x, self._y + y, np.broadcast_to(CARRIED_WAVELENGTH * side, x.shape))
        edges = np.stack([x[1:] - x[0], y[1:] - y[0], z[1:] - z[0]])
        normal = np.cross(edges[:, 0], edges[:, 1], axis=0)
        normal /= np.linalg.norm(normal, axis=0)
        error = np.abs(((self._share * z).sum(axis=0) - self._z) * normal[2]) / self._far
        seen = np.maximum((normal * self._to_eye).sum(axis=0) / (normal[2] * self._far), 1e-3)
        worst = max(_bound_error(error[here], seen[here]) for here in self._sectors)
        return worst * self._view.pixels_per_radian


def _bound_error(errors: Array, weights: Array) -> float:
    """Find a bound on weighted errors: nearly all errors are below it, and so is their RMS, which a few large errors
    raise.
    """
    order = np.argsort(errors)
    below = np.cumsum(weights[order]) / weights.sum()
    return max(
        float(np.interp(_SHARE_WITHIN_ERROR, below, errors[order])),
        math.sqrt(float(np.average(errors**2, weights=weights))),
    )


def _measure_curve(probe: _ErrorProbe, longest_px: float, error_px: float) -> tuple[Array, Array]:
    """Measure decreasing spacings in pixels, and their errors, down to the first error within ``error_px``."""
    spacings, errors = [longest_px], [probe.error_px(longest_px)]
    while errors[-1] > error_px and len(spacings) < _MAX_HALVINGS:
        spacings.append(spacings[-1] / 2)
        errors.append(min(probe.error_px(spacings[-1]), errors[-1]))
    return np.array(spacings), np.array(errors)


def _interpolate_log(x: float, xs: Array, ys: Array) -> float:
    """Interpolate ``ys`` at ``x``, with a power law between points; ``xs`` increases."""
    tiny = 1e-30
    return math.exp(
        float(np.interp(math.log(max(x, tiny)), np.log(np.maximum(xs, tiny)), np.log(np.maximum(ys, tiny))))
    )


def _count_vertices(grading: VertexSpacing) -> float:
    """Estimate the number of vertices of a grading, to about a per cent."""
    r = np.concatenate([[0.0], np.geomspace(grading.finest_m, grading.farthest_m, 400)])
    density = 2 * np.pi * r / (RINGS_APART * grading.spacing_at(r) ** 2)
    return 1.0 + float(np.sum((density[1:] + density[:-1]) / 2 * np.diff(r)))


def _make_probes(ground: Terrain, at: GradingView, ground_m: float, nearest_m: Array) -> list[_ErrorProbe]:
    """Make a probe for each distance, for the range half way to its neighbours; the first also covers the ground under
    the eyes.
    """
    probes = []
    for k, distance in enumerate(nearest_m):
        low, high = (
            at.baseline_m + math.sqrt(max(d * d - at.height_m**2, 0.0))
            for d in (distance / math.sqrt(2.0), min(distance * math.sqrt(2.0), float(nearest_m[-1])))
        )
        probes.append(_ErrorProbe(ground, at, ground_m, 0.0 if k == 0 else low, high))
    return probes


def choose_vertex_spacing(ground: Terrain, settings: Settings) -> VertexSpacing:
    """Choose the grading that complete ``settings`` ask for on a ground (not yet curved). If more than ``mesh.most``
    vertices are needed, the spacing of fine relief grows first, then all spacings; ``error_px`` is the remaining error.
    """
    mesh, at, body = settings.mesh, make_grading_view(settings.rig), float(settings.terrain.body_radius_m)
    ground_m = float(ground.heights(at.x_m, at.y_m))
    farthest = max(min(find_farthest_ground_m(ground, at, ground_m, body), float(mesh.farthest_m)), 2.0 * at.height_m)
    last = float(at.nearest_m(farthest))
    nearest = np.geomspace(at.height_m, last, 1 + max(2, math.ceil(math.log2(last / at.height_m))))
    probes = _make_probes(ground, at, ground_m, nearest)
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
    wanted = _count_vertices(grading) + count_added(grading, settings.rig, mesh.most)
    if wanted <= mesh.most and grading.rings.vertices <= mesh.most:
        return made(error)  # with the final ``wanted``
    while relief is not None and grading.rings.vertices + count_added(grading, settings.rig, mesh.most) > mesh.most:
        coarser = relief.spacing_px * relief.parts / (relief.parts - 1) if relief.parts > 1 else math.inf
        relief = replace(relief, parts=relief.parts - 1, spacing_px=coarser) if relief.parts > 2 else None
        grading = made(error)
    # Then the error is raised; if the longest edges alone make too many vertices, they grow as well.
    worst = max(errors[0] for _, errors in curves)
    while _count_vertices(grading) > mesh.most and error < worst:
        error *= _ERROR_STEP
        grading = made(error)
    wider = max(1.0, math.sqrt(_count_vertices(grading) / mesh.most))
    while (grading := made(error, wider)).rings.vertices > mesh.most:
        wider *= _ERROR_STEP
    if wider == 1.0 and error == mesh.error_px:
        return grading
    left = [
        probe.error_px(spacing / distance * at.pixels_per_radian)
        for probe, spacing, distance in zip(probes, grading.spacing_m, nearest, strict=True)
    ]
    return replace(grading, error_px=max(left))
