"""What a stereo camera can measure on level ground: footprint, ground sampling, theoretical depth error.

``rig`` is the ``rig`` topic of the settings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...settings.topics.camera import RigSettings
from ...support.number_text import show_rounded
from ..rig.focal_length import focal_px

#: Width of triangles over the camera's height up to which the depth of a plane is right to 1e-4; and how far it is off
#: for each such height of width: at most 0.9e-7, measured from 0.1 to 5e5 heights, a rounding of single precision.
_WIDEST, _OFF = 1000.0, 0.9e-7
#: Rounding of coordinates, in pixels, that is told: a tenth of what stereo matchers measure.
_ROUNDED_PX = 0.05
#: Share of an image's size by which a principal point that is meant is off its middle at most; real ones by 0.05.
_FAR_FROM_MIDDLE = 0.25


def coordinate_rounding_m(*coordinates_m: float) -> float:
    """Step between the coordinates in metres that the renderer, which is of single precision, tells apart there."""
    return float(np.spacing(np.float32(max(abs(c) for c in coordinates_m))))


def ground_rounding_px(rig: RigSettings, ground_m: float) -> float:
    """Pixels by which rounded coordinates move the ground under the camera, or one eye from the other, at most.

    Half a step of the largest coordinate of the left camera, which stands over ground of this height, at its height.
    """
    height = float(rig.height_m)
    return focal_px(rig) * coordinate_rounding_m(rig.x_m, rig.y_m, ground_m + height) / 2 / height


def advise_on_rounding(rig: RigSettings, ground_m: float) -> list[str]:
    """Sentences about a camera so far from the origin that single precision is visible; none if it is not."""
    pixels = ground_rounding_px(rig, ground_m)
    if pixels <= _ROUNDED_PX:
        return []
    step = coordinate_rounding_m(rig.x_m, rig.y_m, ground_m + float(rig.height_m))
    return [
        f"The camera stands so far from the origin that ground and eyes are rounded to {step:.2g} m, up to "
        f"{show_rounded(pixels)} px; stand nearer to it (rig.x_m, rig.y_m), or move your own ground "
        "(source.centre, source.origin_x_m)."
    ]


def advise_on_principal_point(rig: RigSettings) -> list[str]:
    """Sentences that warn of a principal point far from the middle of the image; otherwise an empty list.

    The principal point is stated in pixels, so a change of the image size does not move it.
    """
    said = []
    for key, size_key, way in (("principal_x_px", "width_px", "to the right"), ("principal_y_px", "height_px", "down")):
        offset, size = float(rig[key]), int(rig[size_key])
        if abs(offset) > _FAR_FROM_MIDDLE * size:
            where = "outside of the image" if abs(offset) > size / 2 else "far from the middle of the image"
            said.append(
                f"The principal point is {where}: rig.{key} puts it {offset:g} px {way}, and "
                f"rig.{size_key} is {size}. It does not follow the size of the image; if that was changed, "
                f"change rig.{key} by the same factor."
            )
    return said


def advise_on_coarse_triangles(rig: RigSettings, edge_m: float) -> list[str]:
    """Sentences about ground whose triangles, ``edge_m`` wide, are too wide for exact depth; none if they are not."""
    height = float(rig.height_m)
    if edge_m <= _WIDEST * height:
        return []
    return [
        f"The triangles of the ground are {edge_m:.3g} m wide, {show_rounded(edge_m / height)} times the height of "
        f"the camera (rig.height_m {height:g} m); true depth may then have a relative "
        f"error of {_OFF * edge_m / height:.1g}, more than the stated 1e-4. Make them narrower "
        "(terrain.resolution, terrain.size_m), or stand higher."
    ]


def depth_error_m(depth_m: float, rig: RigSettings, disparity_error_px: float) -> float:
    """Standard deviation of depth, Z² σ / (f B), for a standard deviation σ of disparity in pixels."""
    return depth_m**2 * disparity_error_px / (focal_px(rig) * float(rig.baseline_m))


@dataclass(frozen=True)
class GroundRow:
    """A row of the image on level ground; lengths in metres, infinite where the row looks above the horizon."""

    depth_m: float  # planar, along the optical axis
    distance_m: float  # on the ground, from below the camera
    width_m: float  # of the ground that the row shows
    across_m: float  # ground sampling distance along the row
    along_m: float  # and from this row to the next


def measure_ground_row(rig: RigSettings, row: float) -> GroundRow:
    """The ground at the level of the site as an image row (pixel-corner coordinates, 0 top) shows it."""
    focal, pitch, height = focal_px(rig), math.radians(rig.pitch_deg), float(rig.height_m)
    v = (row - int(rig.height_px) / 2 - float(rig.principal_y_px)) / focal
    fall = math.sin(pitch) + v * math.cos(pitch)  # of a ray per unit of planar depth
    if fall <= 1e-9:
        return GroundRow(*[math.inf] * 5)
    depth = height / fall
    across = depth / focal
    # Distance is (cos p - v sin p) Z with Z = h / (sin p + v cos p); its derivative by v is -h / fall².
    return GroundRow(
        depth,
        depth * (math.cos(pitch) - v * math.sin(pitch)),
        across * int(rig.width_px),
        across,
        height / fall**2 / focal,
    )


def shared_width_px(rig: RigSettings, depth_m: float) -> float:
    """Columns of the rectified left image that both eyes see at a depth, in the row of the optical axis."""
    focal, width, turn = focal_px(rig), int(rig.width_px), math.radians(float(rig.toe_in_deg))
    centre, disparity = width / 2 + float(rig.principal_x_px), focal * float(rig.baseline_m) / depth_m

    def column(edge: float, angle: float) -> float:
        """Column of the rectified image at an edge of the image of an eye that is turned by an angle."""
        seen = math.atan((edge - centre) / focal) + angle
        return centre + focal * math.tan(seen) if abs(seen) < math.pi / 2 else math.copysign(math.inf, seen)

    left = max(0.0, column(0, turn)), min(width, column(width, turn))
    right = max(0.0, column(0, -turn)) + disparity, min(width, column(width, -turn)) + disparity
    return max(0.0, min(left[1], right[1]) - max(left[0], right[0]))
