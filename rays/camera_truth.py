"""The truth of a camera of any projection at the centres of its pixels: distance, normals and labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..physics.camera.head_camera import Projection, make_rays_of_pixels
from ..support.arrays import Array
from .stereo_truth import Stage, find_first_surface, list_squares


@dataclass(frozen=True)
class CameraTruth:
    """The truth of a camera, arrays (rows, columns): ``distance_m`` along the rays, float32, infinite for the sky and
    for pixels that see nothing; ``normal`` (…, 3) float32 of the facet; ``label`` uint8 and ``number`` int64, see
    ``rays.shapes``."""

    distance_m: Array
    normal: Array
    label: Array
    number: Array


def trace_camera(stage: Stage, projection: Projection, pose: Array, near_m: float, far_m: float) -> CameraTruth:
    """Trace the truth of a camera with this pose (4, 4) in the world. The camera sees nothing nearer than ``near_m`` or
    farther than ``far_m``."""
    columns, rows = projection.size_px
    shape = rows, columns
    truth = CameraTruth(
        np.empty(shape, np.float32),
        np.empty((*shape, 3), np.float32),
        np.empty(shape, np.uint8),
        np.empty(shape, np.int64),
    )
    for pixels in list_squares(rows, columns):
        row, column = np.divmod(pixels, columns)
        origin, direction = make_rays_of_pixels(projection, np.stack([column, row], axis=1).astype(np.float64))
        origin, direction = origin @ pose[:3, :3].T + pose[:3, 3], direction @ pose[:3, :3].T
        lost = np.isnan(direction).any(axis=1)
        direction[lost] = pose[:3, 2]  # any direction; the hit is dropped
        # Rays from one place are traced faster.
        start = origin[0] if (origin == origin[0]).all() else origin
        seen = find_first_surface(stage, start, direction, near_m, far_m)
        for values in (seen.label, seen.number, seen.normal):
            values[lost] = 0
        seen.along[lost] = np.inf
        for target, values in (
            (truth.distance_m, seen.along),
            (truth.label, seen.label),
            (truth.number, seen.number),
        ):
            target.reshape(-1)[pixels] = values
        truth.normal.reshape(-1, 3)[pixels] = seen.normal
    return truth
