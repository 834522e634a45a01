"""A finer mesh of the ground that the cameras see: for fine relief, and for the ground's own short waves.

Fine relief is noise of four octaves. With ``surface.relief`` REAL, wavelengths that the vertices carry are moved
vertices, and shorter ones are bump. The visible part of a graded mesh is as fine as the image wherever the relief is
higher, in pixels, than half the largest error of the mesh: its triangles there are cut into smaller ones. A uniform
grid is not made finer and carries what its vertices can. Ground from a file keeps its vertices, and its relief is bump.

With ``mesh.seen`` FINE, all that the cameras see is cut, to the horizon, and carries the ground's own waves down to the
smaller triangles.
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

#: Octaves of fine relief, each of half the wavelength and half the height of the one before.
OCTAVES = 4
#: RMS height of fine relief over its amplitude, as measured by ``tests/nodes/surface/test_fine_relief.py``.
DEVIATION = 0.068
#: Height of fine relief over its RMS height: from two standard deviations below the mean to two above.
_SPAN = 4.0
#: Height from which relief is geometry, in units of the mesh's largest error.
_LEAST = 0.5
#: Spacing of the vertices there, in pixels, or in units of the largest error if that is more. With 1.25 the median
#: angle between shading normal and facet is below 2 degrees, with 1.5 it is 3.5 (``python benchmarks fine_relief``).
_SPACING = 1.25
#: Displacement that carries less than this share of the height is reported.
_MOST_CARRIED = 0.95
#: A wave is moved vertices if the spacing is at most this share of its wavelength, bump if it is the whole wavelength.
CARRIED = 1.0 / 1.5
#: Parts into which sides of triangles are cut for fine relief; fewer if the vertices would be too many.
PARTS = 3
#: Settings of the surface and of the rig on which a mesh with fine relief depends, beside ``grading.OF_THE_RIG``.
OF_THE_SURFACE = ("relief", "grain_size_m", "grain_amplitude_m")
OF_THE_RIG = ("pitch_deg", "heading_deg", "roll_deg", "principal_x_px", "principal_y_px", "overscan", "toe_in_deg")


def relief_wavelengths_m(surface: SurfaceSettings) -> Array:
    """Wavelengths (4,) of the octaves of fine relief in metres, longest first."""
    return np.asarray(surface.grain_size_m * 0.5 ** np.arange(OCTAVES))


def relief_height_m(surface: SurfaceSettings) -> float:
    """Height of fine relief in metres, between the lowest and the highest 2 % of the surface."""
    return float(_SPAN * DEVIATION * surface.grain_amplitude_m)


def carried_share(surface: SurfaceSettings, spacing_m: float) -> float:
    """Share of the RMS height of fine relief that vertices ``spacing_m`` apart carry."""
    waves = relief_wavelengths_m(surface)
    share = np.clip((1.0 - spacing_m / waves) / (1.0 - CARRIED), 0.0, 1.0)
    weight = 0.25 ** np.arange(OCTAVES)
    return math.sqrt(float(share**2 @ weight / weight.sum()))


def still_spacing_m(surface: SurfaceSettings) -> float:
    """Spacing of vertices in metres from which fine relief does not move them; infinite if it may move all."""
    return float(surface.grain_size_m) if surface.relief == "REAL" else math.inf


def advise_on_displacement(settings: Settings, spacing_m: float) -> list[str]:
    """A sentence if displacement loses fine relief on a mesh whose nearest vertices are ``spacing_m`` apart."""
    surface = settings.surface
    if surface.relief != "DISPLACEMENT" or surface.grain_amplitude_m == 0.0:
        return []
    share = carried_share(surface, spacing_m)
    if share > _MOST_CARRIED:
        return []
    return [
        f"surface.relief is DISPLACEMENT, but the nearest vertices are {show_rounded(1e3 * spacing_m)} mm apart, "
        f"so the mesh has {share:.0%} of the height of the fine relief; set surface.relief to REAL, or make the "
        "mesh finer."
    ]


def nearest_ground_m(rig: RigSettings) -> float:
    """Distance in metres of the nearest level ground that the images show; the camera's height if they look up."""
    half = (0.5 + float(rig.overscan)) * int(rig.height_px) + abs(float(rig.principal_y_px))
    down = math.radians(rig.pitch_deg) + math.atan(half / focal_px(rig))
    return float(rig.height_m) / math.sin(down) if 0 < down < math.pi / 2 else float(rig.height_m)


@dataclass(frozen=True)
class FineRelief:
    """Distance from the nearer eye in metres up to which fine relief is geometry, the parts into which sides of
    triangles are cut there, and the spacing of the vertices after the cut in pixels. If it is ``everywhere``, triangles
    beyond that distance are cut too, and all cut triangles carry shorter waves of the ground."""

    to_m: float
    parts: int
    spacing_px: float
    everywhere: bool = False

    @property
    def uncut_px(self) -> float:
        """Largest vertex spacing in pixels before triangles are cut."""
        return self.parts * self.spacing_px

    def is_cut(self, distance_m: Array) -> Array:
        """Whether triangles at distances (n,) in metres from the nearer eye are cut if the cameras see them."""
        return np.full(np.shape(distance_m), True) if self.everywhere else np.asarray(distance_m <= self.to_m)


def find_relief_in_mesh(settings: Settings, pixels_per_radian: float) -> FineRelief | None:
    """The fine relief in the graded mesh of complete ``settings``; None if the mesh has none."""
    if settings.mesh.kind != "GRADED" or settings.source.kind != "PROCEDURAL":
        return None
    error_px, everywhere = float(settings.mesh.error_px), settings.mesh.seen == "FINE"
    high = relief_height_m(settings.surface) if is_relief_geometry(settings) else 0.0
    farthest = high * pixels_per_radian / (_LEAST * error_px)
    if farthest <= nearest_ground_m(settings.rig) and not everywhere:
        return None
    return FineRelief(farthest, PARTS, _SPACING * max(error_px, 1.0), everywhere)


def is_relief_geometry(settings: Settings) -> bool:
    """Whether complete ``settings`` ask for fine relief as geometry, on ground whose vertices are made here."""
    surface = settings.surface
    return bool(surface.relief == "REAL" and surface.grain_amplitude_m > 0.0 and settings.source.kind == "PROCEDURAL")


def is_carried_by_grid(settings: Settings) -> bool:
    """Whether complete ``settings`` ask for fine relief as geometry, and a uniform grid carries any of it."""
    terrain = settings.terrain
    return (
        is_relief_geometry(settings)
        and carried_share(settings.surface, terrain.size_m / (terrain.resolution - 1)) > 0.0
    )
