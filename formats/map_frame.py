"""The frame of a site on its map, from the entry ``map`` of a ``pair.json``: points, cameras and cells in map terms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.mesh.horizon import drop_m
from ..support.arrays import Array, Numbers
from ..support.file_schemas import is_number
from .geokeys import GeoKeys, geokeys_from_json
from .map_projection import MapSystem, find_local_scale, read_system

#: Horizontal part of a direction below which it points straight up or down.
_VERTICAL = 1e-6


@dataclass(frozen=True)
class MapFrame:
    """The position of a site on a map: the map coordinates of its ``origin`` in metres, the ``scale`` in metres of
    ground per metre of map along x and y, the file's unit in metres, and the height in metres at z = 0, in the file's
    system.

    ``bounds`` are the outer edges of the file (west, south, east, north) in its unit; ``system`` is None for an
    unsupported projection. ``body_radius_m`` is the radius of the body if the ground is curved, and 0 if the ground is
    as flat as its map.
    """

    origin: tuple[float, float]
    scale: tuple[float, float]
    unit_m: float
    height_zero_m: float
    geokeys: GeoKeys
    bounds: tuple[float, float, float, float]
    system: MapSystem | None
    body_radius_m: float = 0.0

    def find_drop_m(self, x_m: Numbers, y_m: Numbers) -> Array:
        """Find how many metres the body's surface at height 0 lies below z = 0, at points of the site."""
        away_m = np.hypot(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64))
        return drop_m(away_m, self.body_radius_m) if self.body_radius_m > 0 else np.zeros(away_m.shape)

    def to_map(self, x_m: Numbers, y_m: Numbers) -> tuple[Array, Array]:
        """Convert points, in metres east and north of the origin, to easting and northing in the unit of the file."""
        at = ((self.origin[k] + np.asarray(v) / self.scale[k]) / self.unit_m for k, v in enumerate((x_m, y_m)))
        east, north = at
        return east, north

    def to_site(self, easting: Numbers, northing: Numbers) -> tuple[Array, Array]:
        """Convert easting and northing back to points of the site; the inverse of ``to_map``."""
        at = ((np.asarray(v) * self.unit_m - self.origin[k]) * self.scale[k] for k, v in enumerate((easting, northing)))
        x, y = at
        return x, y

    def describe_camera(self, pose: Array) -> dict[str, Any]:
        """Describe the position and direction of a camera from the matrix (4, 4) from its OpenCV axes to the site.

        Azimuths are clockwise. They are the azimuth of the optical axis, or of the image's upper edge if the camera
        looks straight up or down. ``azimuth_grid_deg`` is counted from the map's up, on the map; ``azimuth_true_deg``
        from north, on the ground; ``convergence_deg`` is the angle, clockwise, from the map's up to north at the
        camera. The true azimuth is None for an unsupported projection.
        """
        x, y, z = (float(value) for value in pose[:3, 3])
        easting, northing = (float(value) for value in self.to_map(x, y))
        ahead = pose[:3, 2] if math.hypot(*pose[:2, 2]) > _VERTICAL else -pose[:3, 1]
        local = None
        if self.system is not None:
            try:
                local = find_local_scale(self.system, easting * self.unit_m, northing * self.unit_m)
            except (ValueError, OverflowError, ZeroDivisionError):
                local = None
        on_ground = math.degrees(math.atan2(ahead[0], ahead[1]))
        return {
            "easting": easting,
            "northing": northing,
            "height_m": z + self.height_zero_m + float(self.find_drop_m(x, y)),
            "longitude_deg": local and local.longitude_deg,
            "latitude_deg": local and local.latitude_deg,
            "azimuth_grid_deg": math.degrees(math.atan2(ahead[0] / self.scale[0], ahead[1] / self.scale[1])) % 360.0,
            "azimuth_true_deg": None if local is None else (on_ground - local.north_deg) % 360.0,
            "convergence_deg": local and local.north_deg,
        }


def map_frame_from_json(ground: object) -> MapFrame | None:
    """Read the frame from the entry ``ground`` of a ``pair.json``; None for an entry without a map system."""
    place = ground.get("map") if isinstance(ground, Mapping) else None
    if not isinstance(place, Mapping):
        return None
    geokeys = geokeys_from_json(place.get("geokeys"))
    stated = [place.get(key) for key in ("origin", "scale", "bounds")]
    lists = [each for each in stated if isinstance(each, list) and all(map(is_number, each))]
    unit_m, zero_m, radius_m = place.get("unit_m"), place.get("height_zero_m"), place.get("body_radius_m", 0.0)
    if geokeys is None or [len(each) for each in lists] != [2, 2, 4]:
        return None
    if not (is_number(unit_m) and is_number(zero_m) and is_number(radius_m)):
        return None
    (x, y), (along_x, along_y), (west, south, east, north) = lists
    if not (
        min(unit_m, along_x, along_y) > 0
        and 0 <= radius_m < math.inf
        and all(map(math.isfinite, (zero_m, unit_m, x, y, along_x, along_y, west, south, east, north)))
    ):
        return None
    system = read_system(geokeys.numbers(), unit_m)
    bounds = west, south, east, north
    return MapFrame((x, y), (along_x, along_y), unit_m, zero_m, geokeys, bounds, system, float(radius_m))


def describe_cameras(ground: object, poses: Mapping[str, Array]) -> dict[str, Any]:
    """Describe each camera of a pair in map coordinates, by its name; empty for ground without a map system."""
    frame = map_frame_from_json(ground)
    return {name: frame.describe_camera(np.asarray(pose, np.float64)) for name, pose in poses.items()} if frame else {}
