"""Finds the outlines that have a scan, from the camera and the scans alone, before any render.

POLAR-Sim did not scan every outlined object, and the rebuilt scene contains only scanned ones. So outlines of rocks
without a scan, and the shadows that belong to them, are left out of the masks. An outline has a scan if at least half
of its area is within ``_NEAR_PX`` pixels of the pictures of the whole scans. A shadow belongs to a rock without a scan
if it touches more of such rocks than of the others. The agreement of the masks has no influence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...stereo.images.masks import dilate, fill_hulls, fill_polygons
from ...support.arrays import Array
from .camera import Calibration, find_extreme_points
from .data_set import HEIGHT_PX, ROCK, SHADOW, WIDTH_PX, Terrain, View

_MASK_SCALE = 0.25
_MASK_SHAPE = (int(HEIGHT_PX * _MASK_SCALE), int(WIDTH_PX * _MASK_SCALE))
#: Largest distance, in pixels of the photographs, of a scan from its outline or of a shadow from its rock.
_NEAR_PX = 10.0
_REACH_PX = round(_NEAR_PX * _MASK_SCALE)
_MIN_SCANNED_SHARE = 0.5


@dataclass(frozen=True)
class LeftOut:
    """The unscanned objects in a photograph: the outlines of rocks and of their shadows, each (n, 2) in pixels.

    ``share`` is the unscanned share of the area of all outlined rocks.
    """

    rocks: list[Array]
    shadows: list[Array]
    share: float


def find_left_out(terrain: Terrain, camera: Calibration, view: View, azimuth: int) -> LeftOut:
    """Find the outlines of a photograph that have no scan."""
    eye = camera.eyes[view]
    hulls = [eye.project(find_extreme_points(rock.vertices)) * _MASK_SCALE for rock in terrain.rocks]
    near = dilate(fill_hulls(_MASK_SHAPE, hulls), _REACH_PX)
    scanned, bare = np.zeros((2, *_MASK_SHAPE), bool)
    rocks = []
    for outline in terrain.polygons(view, azimuth, ROCK):
        mask = _fill_outline(outline)
        if np.count_nonzero(mask & near) >= _MIN_SCANNED_SHARE * np.count_nonzero(mask):
            scanned |= mask
        else:
            bare |= mask
            rocks.append(outline)
    shadows = []
    for outline in terrain.polygons(view, azimuth, SHADOW) if rocks else []:
        mask = dilate(_fill_outline(outline), _REACH_PX)
        if np.count_nonzero(mask & bare) > np.count_nonzero(mask & scanned):
            shadows.append(outline)
    area = np.count_nonzero(scanned | bare)
    return LeftOut(rocks, shadows, float(np.count_nonzero(bare & ~scanned) / area) if area else 0.0)


def _fill_outline(outline: Array) -> Array:
    return fill_polygons(_MASK_SHAPE, [outline * _MASK_SCALE], finer=3)
