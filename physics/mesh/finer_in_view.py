"""A finer mesh of the ground that the cameras see: for fine relief, and for the ground's own short waves.

Fine relief is noise of four octaves. With ``surface.relief`` REAL, vertices carry the wavelengths that fit their
spacing, and bump carries shorter ones. Where the relief is higher than half the largest error of the mesh, in pixels,
the visible triangles of a graded mesh are cut into smaller ones, as fine as the image. A uniform grid stays as it is.
Ground from a file keeps its vertices, and its relief is bump. With ``mesh.seen`` FINE, all visible ground to the
horizon is cut and carries its own waves down to the smaller triangles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array
from ...support.number_text import show_rounded
from ..rig.focal_length import focal_px

#: Octaves of fine relief; each has half the wavelength and half the height of the previous one.
OCTAVES = 4
#: RMS height of fine relief over its amplitude, as measured by ``tests/nodes/surface/test_fine_relief.py``.
RMS_OVER_AMPLITUDE = 0.068
#: Height of fine relief over its RMS height: from two standard deviations below the mean to two above.
_HEIGHT_OVER_RMS = 4.0
#: Least height of relief that is geometry, in units of the mesh's largest error.
_MIN_HEIGHT = 0.5
#: Spacing of the vertices of fine relief in pixels, or in units of the largest error if that is larger. With 1.25 the
#: median angle between shading normal and facet is below 2 degrees, with 1.5 it is 3.5 (``python benchmarks
#: fine_relief``).
_SPACING_PX = 1.25
#: Share of the relief's height below which displacement is reported.
_REPORTED_SHARE = 0.95
#: Largest spacing of vertices, in wavelengths, that carry all of a wave; at one wavelength the wave is bump.
CARRIED_SPACING = 1.0 / 1.5
#: Number of parts into which sides of triangles are cut for fine relief; smaller if there would be too many vertices.
PARTS_OF_SIDE = 3
#: Settings of the surface on which a mesh with fine relief depends.
RELIEF_SETTINGS = ("relief", "grain_size_m", "grain_amplitude_m")
#: Settings of the rig on which such a mesh depends, beside ``vertex_spacing.GRADING_RIG_SETTINGS``.
RELIEF_RIG_SETTINGS = (
    "pitch_deg",
    "heading_deg",
    "roll_deg",
    "principal_x_px",
    "principal_y_px",
    "overscan",
    "toe_in_deg",
)


def relief_wavelengths_m(surface: SurfaceSettings) -> Array:
    """Compute the wavelengths (4,) of the octaves of fine relief in metres, longest first."""
    return np.asarray(surface.grain_size_m * 0.5 ** np.arange(OCTAVES))


def relief_height_m(surface: SurfaceSettings) -> float:
    """Compute the height of fine relief in metres, between the lowest and the highest 2 % of the surface."""
    return float(_HEIGHT_OVER_RMS * RMS_OVER_AMPLITUDE * surface.grain_amplitude_m)


def resolved_share(surface: SurfaceSettings, spacing_m: float) -> float:
    """Compute the share of the RMS height of fine relief that vertices ``spacing_m`` apart carry."""
    waves = relief_wavelengths_m(surface)
    share = np.clip((1.0 - spacing_m / waves) / (1.0 - CARRIED_SPACING), 0.0, 1.0)
    weight = 0.25 ** np.arange(OCTAVES)
    return math.sqrt(float(share**2 @ weight / weight.sum()))


def find_undisplaced_spacing_m(surface: SurfaceSettings) -> float:
    """Find the vertex spacing in metres above which fine relief does not move vertices; infinite if it may move all
    vertices.
    """
    return float(surface.grain_size_m) if surface.relief == "REAL" else math.inf


def advise_on_displacement(settings: Settings, spacing_m: float) -> list[str]:
    """Return a sentence, in a list, if displacement loses fine relief on a mesh whose nearest vertices are
    ``spacing_m`` apart; else an empty list.
    """
    surface = settings.surface
    if surface.relief != "DISPLACEMENT" or surface.grain_amplitude_m == 0.0:
        return []
    share = resolved_share(surface, spacing_m)
    if share > _REPORTED_SHARE:
        return []
    return [
        f"surface.relief is DISPLACEMENT, but the nearest vertices are {show_rounded(1e3 * spacing_m)} mm apart, "
        f"so the mesh has {share:.0%} of the height of the fine relief; set surface.relief to REAL, or make the "
        "mesh finer."
    ]


def nearest_ground_m(rig: RigSettings) -> float:
    """Compute the distance in metres of the nearest level ground that the images show; the camera's height if they look
    up.
    """
    half = (0.5 + float(rig.overscan)) * int(rig.height_px) + abs(float(rig.principal_y_px))
    down = math.radians(rig.pitch_deg) + math.atan(half / focal_px(rig))
    return float(rig.height_m) / math.sin(down) if 0 < down < math.pi / 2 else float(rig.height_m)


@dataclass(frozen=True)
class FineRelief:
    """The cut of the visible triangles for fine relief. Up to ``to_m`` metres from the nearer eye fine relief is
    geometry. There, sides of triangles are cut into ``parts``, and vertices are then ``spacing_px`` apart. With
    ``everywhere``, triangles beyond that distance are cut too, and all cut triangles carry shorter waves of the ground.
    """

    to_m: float
    parts: int
    spacing_px: float
    everywhere: bool = False

    @property
    def uncut_px(self) -> float:
        """Largest vertex spacing in pixels before triangles are cut."""
        return self.parts * self.spacing_px

    def is_cut(self, distance_m: Array) -> Array:
        """Return whether visible triangles at distances (n,) in metres from the nearer eye are cut."""
        return np.full(np.shape(distance_m), True) if self.everywhere else np.asarray(distance_m <= self.to_m)


def find_relief_in_mesh(settings: Settings, pixels_per_radian: float) -> FineRelief | None:
    """Find the fine relief in the graded mesh of complete ``settings``; None if the mesh has none."""
    if settings.mesh.kind != "GRADED" or settings.source.kind != "PROCEDURAL":
        return None
    error_px, everywhere = float(settings.mesh.error_px), settings.mesh.seen == "FINE"
    high = relief_height_m(settings.surface) if is_relief_geometry(settings) else 0.0
    farthest = high * pixels_per_radian / (_MIN_HEIGHT * error_px)
    if farthest <= nearest_ground_m(settings.rig) and not everywhere:
        return None
    return FineRelief(farthest, PARTS_OF_SIDE, _SPACING_PX * max(error_px, 1.0), everywhere)


def is_relief_geometry(settings: Settings) -> bool:
    """Return whether complete ``settings`` ask for fine relief as geometry, on procedural ground."""
    surface = settings.surface
    return bool(surface.relief == "REAL" and surface.grain_amplitude_m > 0.0 and settings.source.kind == "PROCEDURAL")


def is_carried_by_grid(settings: Settings) -> bool:
    """Return whether complete ``settings`` ask for fine relief as geometry on a uniform grid that carries part of
    it.
    """
    terrain = settings.terrain
    return (
        is_relief_geometry(settings)
        and resolved_share(settings.surface, terrain.size_m / (terrain.resolution - 1)) > 0.0
    )
