"""Accuracy of a stereo camera on level ground: footprint, ground sampling distance, theoretical depth error.

In this module ``rig`` is the ``rig`` topic of the settings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.number_text import show_rounded
from ..rig.focal_length import focal_px

#: Width of the widest triangle, in heights of the camera, on which the depth of a plane is right to 1e-4.
_WIDEST_EXACT_TRIANGLE = 1000.0
#: Relative error of depth over the width of a triangle in heights of the camera. Measured on widths of 0.1 to 5e5
#: heights it is at most 0.9e-7, a rounding of single precision.
_DEPTH_ERROR_PER_WIDTH = 0.9e-7
#: Rounding of coordinates, in pixels, above which it is reported: a tenth of the accuracy of stereo matchers.
_REPORTED_ROUNDING_PX = 0.05
#: Largest plausible offset of a principal point from the middle, as a share of the image's size; real cameras have up
#: to 0.05.
_MAX_OFFSET_SHARE = 0.25


def coordinate_rounding_m(*coordinates_m: float) -> float:
    """Return the step in metres between neighbouring numbers of the renderer's single precision at these
    coordinates.
    """
    return float(np.spacing(np.float32(max(abs(c) for c in coordinates_m))))


def ground_rounding_px(rig: RigSettings, ground_m: float) -> float:
    """Return the largest shift, px, that rounded coordinates give the ground under the camera, or one eye relative to
    the other.

    It is half a step of the largest coordinate of the left camera, seen from the camera's height; ``ground_m`` is the
    height of the ground.
    """
    height = float(rig.height_m)
    return focal_px(rig) * coordinate_rounding_m(rig.x_m, rig.y_m, ground_m + height) / 2 / height


def advise_on_rounding(rig: RigSettings, ground_m: float) -> list[str]:
    """Return a sentence, in a list, about a camera so far from the origin that single precision is visible; else an
    empty list.
    """
    pixels = ground_rounding_px(rig, ground_m)
    if pixels <= _REPORTED_ROUNDING_PX:
        return []
    step = coordinate_rounding_m(rig.x_m, rig.y_m, ground_m + float(rig.height_m))
    return [
        f"The camera stands so far from the origin that ground and eyes are rounded to {step:.2g} m, up to "
        f"{show_rounded(pixels)} px; stand nearer to it (rig.x_m, rig.y_m), or move your own ground "
        "(source.centre, source.origin_x_m)."
    ]


def advise_on_principal_point(rig: RigSettings) -> list[str]:
    """List sentences that warn of a principal point far from the middle of the image.

    The principal point is stated in pixels, so a change of the image size does not move it.
    """
    said = []
    for key, size_key, ways in (
        ("principal_x_px", "width_px", ("to the right", "to the left")),
        ("principal_y_px", "height_px", ("down", "up")),
    ):
        offset, size = float(rig[key]), int(rig[size_key])
        if abs(offset) > _MAX_OFFSET_SHARE * size:
            where = "outside of the image" if abs(offset) > size / 2 else "far from the middle of the image"
            said.append(
                f"The principal point is {where}: rig.{key} puts it {abs(offset):g} px {ways[offset < 0]}, and "
                f"rig.{size_key} is {size}. It does not follow the size of the image; if that was changed, "
                f"change rig.{key} by the same factor."
            )
    return said


def advise_on_coarse_triangles(rig: RigSettings, edge_m: float) -> list[str]:
    """Return a sentence, in a list, about ground whose triangles of width ``edge_m`` are too wide for exact depth; else
    an empty list.
    """
    height = float(rig.height_m)
    if edge_m <= _WIDEST_EXACT_TRIANGLE * height:
        return []
    return [
        f"The triangles of the ground are {edge_m:.3g} m wide, {show_rounded(edge_m / height)} times the height of "
        f"the camera (rig.height_m {height:g} m); true depth may then have a relative "
        f"error of {_DEPTH_ERROR_PER_WIDTH * edge_m / height:.1g}, more than the stated 1e-4. Make them narrower "
        "(terrain.resolution, terrain.size_m), or stand higher."
    ]


def depth_error_m(depth_m: float, rig: RigSettings, disparity_error_px: float) -> float:
    """Compute the standard deviation of depth in metres, Z² σ / (f B), for a standard deviation σ of disparity in
    pixels.
    """
    return depth_m**2 * disparity_error_px / (focal_px(rig) * float(rig.baseline_m))


@dataclass(frozen=True)
class GroundRow:
    """Level ground in a row of the image; lengths in metres, infinite where the row looks above the horizon."""

    depth_m: float  # planar, along the optical axis
    distance_m: float  # on the ground, from below the camera
    width_m: float  # of the ground that the row shows
    across_m: float  # ground sampling distance along the row
    along_m: float  # ground sampling distance from this row to the next


def measure_ground_row(rig: RigSettings, row: float) -> GroundRow:
    """Measure the level ground that an image row shows; ``row`` is in pixel-corner coordinates, 0 at the top."""
    focal, pitch, height = focal_px(rig), math.radians(rig.pitch_deg), float(rig.height_m)
    v = (row - int(rig.height_px) / 2 - float(rig.principal_y_px)) / focal
    fall = math.sin(pitch) + v * math.cos(pitch)  # descent of a ray in metres per metre of planar depth
    if fall <= 1e-9:
        return GroundRow(*[math.inf] * 5)
    depth = height / fall
    across = depth / focal
    # Distance is (cos p - v sin p) Z with Z = h / (sin p + v cos p); its derivative with respect to v is -h / fall².
    return GroundRow(
        depth,
        depth * (math.cos(pitch) - v * math.sin(pitch)),
        across * int(rig.width_px),
        across,
        height / fall**2 / focal,
    )


def shared_width_px(rig: RigSettings, depth_m: float) -> float:
    """Count the columns of the rectified left image that both eyes see at a depth, in the row of the optical axis."""
    focal, width, turn = focal_px(rig), int(rig.width_px), math.radians(float(rig.toe_in_deg))
    centre, disparity = width / 2 + float(rig.principal_x_px), focal * float(rig.baseline_m) / depth_m

    def column(edge: float, angle: float) -> float:
        """Find the column of the rectified image at an edge of the image of an eye that is turned by an angle."""
        seen = math.atan((edge - centre) / focal) + angle
        return centre + focal * math.tan(seen) if abs(seen) < math.pi / 2 else math.copysign(math.inf, seen)

    left = max(0.0, column(0, turn)), min(width, column(width, turn))
    right = max(0.0, column(0, -turn)) + disparity, min(width, column(width, -turn)) + disparity
    return max(0.0, min(left[1], right[1]) - max(left[0], right[0]))
