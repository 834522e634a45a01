"""The coarse ground of a preview: most of its vertices lie where the cameras look.

The mesh is the graded mesh of ``graded_mesh``, but its spacing is not measured on the ground, which takes longest. On
level ground the visible vertices are equally dense over the image. So the preview has the waves of the fine ground that
are as long as a few pixels, with the same roughness, and casts their shadows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..terrain.terrain import Terrain
from .finer_in_view import FineRelief
from .graded_mesh import GradedGround, GradedMesh
from .vertex_spacing import (
    VertexSpacing,
    count_added,
    find_farthest_ground_m,
    make_grading_view,
)

#: Number of parts into which the sides of visible triangles are cut. With more parts, more of the vertices are in view.
_PARTS_OF_SIDE = 4
#: Power of the distance with which the spacing grows. On level ground, whose image is foreshortened, vertices are then
#: equally dense over the image.
_SPACING_EXPONENT = 1.5
#: Spacing, in pixels, from which the search for the spacing starts, and number of its steps.
_FIRST_SPACING_PX, _SEARCH_STEPS = 16.0, 3
#: Number of points by which the farthest visible ground is found.
_POINTS_OF_FARTHEST = 200


@dataclass(frozen=True)
class PreviewGround(GradedGround):
    """Coarse ground for a view. On a ``flat`` patch, as a uniform grid is, the ground ends at the sides of the patch,
    does not follow the body's curvature, and has no wavelengths below ``shortest_m`` metres."""

    flat: bool = False
    shortest_m: float = 0.0

    @property
    def site_wavelength_m(self) -> float:
        """Shortest wavelength in metres that the mesh carries at the site, where it is in view."""
        return super().site_wavelength_m / (self.grading.relief.parts if self.grading.relief else 1)

    def heights(self, x_m: Numbers, y_m: Numbers, shortest_m: Numbers = 0.0) -> Array:
        """Compute heights in metres; see ``Surface.heights``."""
        if self.flat:
            return self.ground.heights(x_m, y_m, np.maximum(shortest_m, self.shortest_m))
        return super().heights(x_m, y_m, shortest_m)

    def compute_mesh_heights(self, x_m: Array, y_m: Array) -> Array:
        """Compute heights in metres with the wavelengths that the mesh carries at places (n, …)."""
        return self.heights(x_m, y_m, self.find_carried_wavelengths(x_m, y_m))

    def mesh_with_relief(self) -> GradedMesh:
        """Make the mesh; on a flat patch without the triangles beyond its sides."""
        made = super().mesh_with_relief()
        if not self.flat:
            return made
        a, b, c = (made.positions[made.faces[:, k], :2] for k in range(3))
        area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        kept = area > 0
        used = np.zeros(len(made.positions), bool)
        used[made.faces[kept]] = True
        number = np.cumsum(used) - 1
        return replace(
            made,
            positions=made.positions[used],
            faces=number[made.faces[kept]].astype(np.int32),
            spacing_m=None if made.spacing_m is None else made.spacing_m[used],
            fine=None if made.fine is None else made.fine[kept],
        )

    def _raise_to_ground(self, places: Array, step: Array) -> Array:
        """Compute the positions (n, 3) of the ground at places (n, 2). Places beyond a flat patch are moved to its
        sides.
        """
        half = self.size_m / 2
        return super()._raise_to_ground(np.clip(places, -half, half) if self.flat else places, step)


def make_preview_ground(ground: Terrain, settings: Settings, most: int) -> PreviewGround:
    """Make the coarse ground of complete ``settings`` with about ``most`` vertices."""
    flat = settings.mesh.kind == "GRID"
    return PreviewGround(
        ground,
        _space_vertices(ground, settings, most, flat),
        float(settings.terrain.body_radius_m),
        rig=settings.rig,
        flat=flat,
        shortest_m=2.0 * settings.terrain.size_m / (settings.terrain.resolution - 1) if flat else 0.0,
    )


def _space_vertices(ground: Terrain, settings: Settings, most: int, flat: bool) -> VertexSpacing:
    """Find the spacing with which the mesh has about ``most`` vertices."""
    at = make_grading_view(settings.rig)
    if flat:
        half = ground.size_m / 2
        farthest = math.hypot(half + abs(at.x_m), half + abs(at.y_m))
    else:
        ground_m = float(ground.heights(at.x_m, at.y_m))
        seen_m = find_farthest_ground_m(
            ground, at, ground_m, float(settings.terrain.body_radius_m), _POINTS_OF_FARTHEST
        )
        farthest = min(seen_m, float(settings.mesh.farthest_m))
    farthest = max(farthest, 2.0 * at.height_m)
    nearest = np.array([at.height_m, float(at.nearest_m(farthest))])

    def made(spacing_px: float) -> VertexSpacing:
        spacing = spacing_px * at.height_m / at.pixels_per_radian * (nearest / at.height_m) ** _SPACING_EXPONENT
        relief = FineRelief(0.0, _PARTS_OF_SIDE, spacing_px / _PARTS_OF_SIDE, everywhere=True)
        return VertexSpacing(at, nearest, spacing, farthest, 0.0, 0.0, relief)

    spacing_px = _FIRST_SPACING_PX
    for _ in range(_SEARCH_STEPS):
        grading = made(spacing_px)
        number = grading.rings.vertices + count_added(grading, settings.rig)
        spacing_px *= math.sqrt(number / most)
    return made(spacing_px)
