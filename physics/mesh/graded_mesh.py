"""The graded mesh of procedural ground, round like the body; the docstring of this folder lists its steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ..rig.seen_points import is_in_view
from ..terrain.landforms import Walls
from ..terrain.skirts import Skirts
from ..terrain.terrain import Terrain
from .break_walls import SHARE_BEFORE_BREAKING, break_walls, breaks_walls
from .cut_along_lines import Line, cut_along_lines
from .finer_in_view import PARTS_OF_SIDE, nearest_ground_m, resolved_share
from .horizon import drop_m
from .split_triangles import split_triangles
from .vertex_spacing import CARRIED_WAVELENGTH, VertexSpacing, choose_vertex_spacing

#: Number of vertices that are processed together: neighbouring rings, whose noise is then in one small table.
_VERTICES_AT_ONCE = 16384
#: Replaces an infinite spacing before means are taken.
_LARGE_SPACING_M = 1.0e9


@dataclass(frozen=True)
class GradedMesh:
    """Positions (n, 3), triangles (m, 3) and sharp edges (k, 2) of a mesh, see ``GradedGround.mesh``. If the visible
    part is finer, ``spacing_m`` (n,) are the spacings of vertices that fine relief may move, infinite for other
    vertices, and ``fine`` (m,) is true for parts of a cut triangle. ``loose_m`` (n,) are thicknesses of loose material
    in metres, if they are asked for.
    """

    positions: Array
    faces: Array
    sharp: Array
    spacing_m: Array | None = None
    fine: Array | None = None
    loose_m: Array | None = None


@dataclass(frozen=True)
class GradedGround:
    """Ground on a sphere that touches the map at the site, and the grading of its mesh. ``rig`` is the settings of the
    cameras that see the finer part; None without a finer part. With ``breaks_walls`` the mesh has at most ``most``
    vertices; with ``measures_loose`` it has the thickness of loose material.
    """

    ground: Terrain
    grading: VertexSpacing
    body_radius_m: float
    cuts_crests: bool = False
    rig: RigSettings | None = None
    breaks_walls: bool = False
    most: int = 0
    measures_loose: bool = False

    @property
    def size_m(self) -> float:
        """Side in metres of the patch on which rocks lie."""
        return self.ground.size_m

    @property
    def site_wavelength_m(self) -> float:
        """Shortest wavelength in metres that the mesh carries at the site."""
        return CARRIED_WAVELENGTH * self.grading.finest_m

    def heights(self, x_m: Numbers, y_m: Numbers, shortest_m: Numbers = 0.0) -> Array:
        """Compute heights in metres above the tangent plane at the site; see ``Surface.heights``."""
        return self.ground.heights(x_m, y_m, shortest_m) - self.drop_m(x_m, y_m)

    def measure_loose(self, x_m: Numbers, y_m: Numbers, shortest_m: Numbers = 0.0) -> Array:
        """Compute thicknesses in metres of loose material; see ``Terrain.measure_loose``."""
        return self.ground.measure_loose(x_m, y_m, shortest_m)

    @property
    def skirts(self) -> Skirts | None:
        """The skirts of rocks on the ground."""
        return self.ground.skirts

    def without_skirts(self) -> GradedGround:
        """Return the same ground without skirts, on which rocks lie."""
        return replace(self, ground=self.ground.without_skirts())

    def compute_skirts(self, x_m: Array, y_m: Array) -> Array:
        """Compute the heights in metres of the skirts above the ground at places (n, …) of a ground with skirts, with
        the detail of the mesh.
        """
        assert self.skirts is not None
        return self.skirts.heights(x_m, y_m, self.find_carried_wavelengths(x_m, y_m))

    def find_carried_wavelengths(self, x_m: Array, y_m: Array) -> Array:
        """Find the shortest wavelengths in metres of the mesh at places (n, …), as on level ground."""
        at = self.grading.view
        east, north = np.asarray(x_m) - at.x_m, np.asarray(y_m) - at.y_m
        spacing = self.grading.spacing_at(np.hypot(east, north))
        relief = self.grading.relief
        if self.rig is not None and relief is not None and relief.everywhere:
            places = east.ravel(), north.ravel()
            seen = is_in_view(self.rig, *places, np.full(east.size, -at.height_m)).reshape(east.shape)
            spacing = np.where(seen, spacing / relief.parts, spacing)
        return CARRIED_WAVELENGTH * spacing

    def drop_m(self, x_m: Numbers, y_m: Numbers) -> Array:
        """Compute the depth in metres of the curved body below the tangent plane at the site."""
        at = self.grading.view
        return drop_m(
            np.hypot(np.asarray(x_m, np.float64) - at.x_m, np.asarray(y_m, np.float64) - at.y_m), self.body_radius_m
        )

    def mesh(self) -> tuple[Array, Array, Array]:
        """Make vertices (n, 3) in metres, triangles (m, 3) int32, counter-clockwise from above, and sharp edges (k, 2).

        Wavelengths much shorter than the spacing at a vertex are left out there. Vertex 0 is under the left eye.
        """
        made = self.mesh_with_relief()
        return made.positions, made.faces, made.sharp

    def mesh_with_relief(self) -> GradedMesh:
        """Make ``mesh`` with the finer part that the cameras see."""
        rings = self.grading.rings
        x, y = rings.map_positions()
        step = rings.spread_to_vertices(self.grading.spacing_at(rings.radius_m), self.grading.finest_m)
        places = np.stack(
            [_round_to_single(x + self.grading.view.x_m), _round_to_single(y + self.grading.view.y_m)], axis=1
        )
        faces, sharp = rings.faces(), np.empty((0, 2), np.int64)
        for line, apart_m in self._find_crest_lines():
            cut = cut_along_lines(places, faces, step, line, apart_m)
            places, faces, sharp = (
                _round_to_single(cut.places),
                cut.faces,
                np.concatenate([sharp, cut.find_sharp_edges()]),
            )
            step = self.grading.spacing_at(np.hypot(*self._relative_to_site(places)))
        loose = self._measure_loose_at(places, step) if self.measures_loose else None
        whole = GradedMesh(self._raise_to_ground(places, step), faces, sharp, loose_m=loose)
        if self.rig is not None and self.grading.relief is not None:
            whole = self._cut_for_relief(whole, step)
        for walls in (each.walls for each in self.ground.landforms if self.breaks_walls and each.walls):
            whole = self._break_visible_walls(whole, walls)
        return whole

    def _find_crest_lines(self) -> list[tuple[Line, float]]:
        """List the lines along which triangles are cut, each with the distance in metres to the next."""
        crests = [each.crests for each in self.ground.landforms if self.cuts_crests and each.crests]
        return [(line, each.apart_m) for each in crests for line in each.lines]

    def _relative_to_site(self, places: Array) -> Array:
        """Compute east and north (2, n) from the left eye, in metres, of places or positions (n, 2 or 3)."""
        return np.stack([places[:, 0] - self.grading.view.x_m, places[:, 1] - self.grading.view.y_m])

    def _raise_to_ground(self, places: Array, step: Array) -> Array:
        """Compute the positions (n, 3) of the ground at places (n, 2) of a mesh with spacings ``step`` (n,)."""
        positions = np.concatenate([places, np.zeros((len(places), 1))], axis=1)
        shortest = _round_to_single(CARRIED_WAVELENGTH * step)
        for start in range(0, len(places), _VERTICES_AT_ONCE):
            some = slice(start, start + _VERTICES_AT_ONCE)
            positions[some, 2] = self.heights(positions[some, 0], positions[some, 1], shortest[some])
        return positions

    def _measure_loose_at(self, places: Array, step: Array) -> Array:
        """Compute the thicknesses (n,) of loose material at places (n, 2) of a mesh with spacings ``step`` (n,)."""
        return self.ground.measure_loose(places[:, 0], places[:, 1], _round_to_single(CARRIED_WAVELENGTH * step))

    def _cut_for_relief(self, whole: GradedMesh, step: Array) -> GradedMesh:
        """Return the mesh with smaller triangles where the cameras see high enough fine relief, or everywhere in
        view.
        """
        relief, at = self.grading.relief, self.grading.view
        assert relief is not None
        assert self.rig is not None
        east, north = self._relative_to_site(whole.positions)
        near = np.flatnonzero(relief.is_cut(at.nearest_m(np.hypot(east, north))))
        # Vertex 0 is under the left eye.
        above = whole.positions[near, 2] - whole.positions[0, 2] - at.height_m
        seen = np.zeros(len(whole.positions), bool)
        seen[near] = is_in_view(self.rig, east[near], north[near], above)
        split = split_triangles(whole.faces, seen[whole.faces].any(axis=1), len(seen), relief.parts)
        positions, step = split.spread(whole.positions), split.spread(step)
        inside = ~split.bordering
        inside[: len(seen)] &= np.isin(np.arange(len(seen)), split.faces[split.cut])
        finer = np.flatnonzero(inside)
        finest = step[finer] / relief.parts
        # Otherwise the ground's own waves below the uncut spacing are left out; fine relief replaces them.
        places, carried = _round_to_single(positions[finer, :2]), finest if relief.everywhere else step[finer]
        positions[finer] = self._raise_to_ground(places, carried)
        spacing = np.full(len(positions), np.inf)
        spacing[finer] = finest
        loose = None if whole.loose_m is None else split.spread(whole.loose_m)
        if loose is not None:
            loose[finer] = self._measure_loose_at(places, carried)
        return GradedMesh(positions, split.faces, whole.sharp, spacing, split.cut, loose)

    def _break_visible_walls(self, whole: GradedMesh, walls: Walls) -> GradedMesh:
        """Return the mesh with broken walls where they are near enough and in view."""
        at = self.grading.view
        assert self.rig is not None
        east, north = self._relative_to_site(whole.positions)
        above = whole.positions[:, 2] - whole.positions[0, 2] - at.height_m
        pixel_m = np.where(
            is_in_view(self.rig, east, north, above), at.nearest_m(np.hypot(east, north)) / at.pixels_per_radian, np.inf
        )
        spacing = np.zeros(len(above)) if whole.spacing_m is None else np.minimum(whole.spacing_m, _LARGE_SPACING_M)
        broken = break_walls(whole.positions, whole.faces, walls, spacing, pixel_m, self.most, whole.loose_m)
        if whole.spacing_m is None or whole.fine is None:
            return GradedMesh(broken.positions, broken.faces, whole.sharp, loose_m=broken.loose_m)
        spacing = np.where(broken.spacing_m > spacing[spacing < _LARGE_SPACING_M].max(), np.inf, broken.spacing_m)
        fine = whole.fine[broken.of_face]
        return GradedMesh(broken.positions, broken.faces, whole.sharp, spacing, fine, broken.loose_m)

    def advice(self, settings: Settings) -> list[str]:
        """List sentences about a mesh that is coarser than the settings ask for."""
        wanted, mesh = self.grading.wanted_vertices, settings.mesh
        if self.grading.error_px <= mesh.error_px and wanted <= mesh.most:
            return []
        many = f"{wanted / 1e6:.3g} million" if wanted >= 1e5 else f"{wanted:.0f}"
        if self.grading.error_px <= mesh.error_px:
            return [self._relief_advice(settings, many)]
        return [
            f"A mesh within {mesh.error_px:g} px would take {many} vertices; this one keeps to mesh.most "
            f"({mesh.most}) and is within {self.grading.error_px:.2g} px. Raise mesh.most, or mesh.error_px and "
            "mesh.edge_px."
        ]

    def _relief_advice(self, settings: Settings, many: str) -> str:
        relief, at = self.grading.relief, self.grading.view
        if settings.mesh.seen == "FINE":
            parts = relief.parts if relief else 1
            return (
                f"Ground that is finer where the cameras see it takes a mesh of {many} vertices. This one keeps to "
                f"mesh.most ({settings.mesh.most}), so the sides of its triangles are cut into {parts} parts there, "
                f"not {PARTS_OF_SIDE}. Raise mesh.most, or set mesh.seen to EVEN."
            )
        spacing_m = relief.spacing_px * nearest_ground_m(settings.rig) / at.pixels_per_radian if relief else math.inf
        return (
            f"Fine relief as fine as the image takes a mesh of {many} vertices. This one keeps to mesh.most "
            f"({settings.mesh.most}), so {resolved_share(settings.surface, spacing_m):.0%} of the height of the "
            "nearest relief is geometry and the rest is bump. Raise mesh.most, or set surface.relief to BUMP."
        )


def _round_to_single(values: Array) -> Array:
    """Round values to single precision, as Blender stores them. Sines and powers differ between machines in the last
    bit of a double; rounded values do not.
    """
    return values.astype(np.float32).astype(np.float64)


def grade_ground(ground: Terrain, settings: Settings) -> GradedGround:
    """Grade the ground of complete ``settings``."""
    cuts_crests = settings.mesh.crests == "CUT" and any(each.crests for each in ground.landforms)
    broken, most = breaks_walls(settings), int(settings.mesh.most)
    # Spacings follow from the rounded crests, so that cutting along crests changes no spacing.
    grading = choose_vertex_spacing(
        ground, settings | {"mesh": settings.mesh | {"most": int(SHARE_BEFORE_BREAKING * most)}} if broken else settings
    )
    return GradedGround(
        ground.with_sharp_crests() if cuts_crests else ground,
        grading,
        float(settings.terrain.body_radius_m),
        cuts_crests,
        settings.rig,
        broken,
        most,
        bool(settings.quality.loose_thickness),
    )
