"""Map systems on a sphere, as PROJ states them and as ours, for tests of projections in both directions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from icymoon.formats.map_projection import MapSystem
from icymoon.support.arrays import Array

EUROPA_M = 1560800.0
#: Degrees on a sphere, and the plane of its south pole, as PROJ states them.
LONLAT = f"+proj=longlat +R={EUROPA_M} +no_defs"
POLAR = f"+proj=stere +lat_0=-90 +R={EUROPA_M} +units=m +no_defs"
#: Systems on a sphere, as PROJ states them, and a place in metres.
ON_A_SPHERE = {
    "+proj=merc +lat_ts=0": (MapSystem("Mercator", "", EUROPA_M), (4e5, 2e6)),
    "+proj=merc +lat_ts=30 +lon_0=40": (MapSystem("Mercator", "", EUROPA_M, 40.0, parallel_deg=30.0), (-4e5, -1e6)),
    "+proj=eqc +lat_ts=0": (MapSystem("Equidistant cylindrical", "", EUROPA_M), (5e5, -1.9e6)),
    "+proj=eqc +lat_ts=45 +lon_0=180": (
        MapSystem("Equidistant cylindrical", "", EUROPA_M, 180.0, parallel_deg=45.0),
        (5e5, 1.2e6),
    ),
    "+proj=stere +lat_0=90 +lat_ts=90": (MapSystem("Polar stereographic", "", EUROPA_M, 0.0, 90.0, 90.0), (3e5, 5e5)),
    "+proj=stere +lat_0=-90 +lat_ts=-70 +lon_0=30 +x_0=1000 +y_0=2000": (
        MapSystem("Polar stereographic", "", EUROPA_M, 30.0, -90.0, -70.0, east_m=1000.0, north_m=2000.0),
        (3e5, -6e5),
    ),
    "+proj=stere +lat_0=20 +lon_0=10": (MapSystem("Stereographic", "", EUROPA_M, 10.0, 20.0), (7e5, -3e5)),
    "+proj=laea +lat_0=52 +lon_0=10": (MapSystem("Lambert azimuthal equal area", "", EUROPA_M, 10.0, 52.0), (5e5, 4e5)),
    "+proj=aeqd +lat_0=-15 +lon_0=60": (MapSystem("Azimuthal equidistant", "", EUROPA_M, 60.0, -15.0), (-9e5, 4e5)),
    "+proj=ortho +lat_0=10 +lon_0=-30": (MapSystem("Orthographic", "", EUROPA_M, -30.0, 10.0), (6e5, 7e5)),
    "+proj=sinu +lon_0=20": (MapSystem("Sinusoidal", "", EUROPA_M, 20.0), (4e5, 1e6)),
    "+proj=tmerc +lat_0=10 +lon_0=15 +k=0.9996": (
        MapSystem("Transverse Mercator", "", EUROPA_M, 15.0, 10.0, scale=0.9996),
        (2e5, 9e5),
    ),
    "+proj=lcc +lat_1=30 +lat_2=60 +lat_0=40 +lon_0=5": (
        MapSystem("Lambert conformal conic", "", EUROPA_M, 5.0, 40.0, 30.0, 60.0),
        (3e5, 2e5),
    ),
    "+proj=aea +lat_1=30 +lat_2=60 +lat_0=40 +lon_0=5": (
        MapSystem("Albers equal area", "", EUROPA_M, 5.0, 40.0, 30.0, 60.0),
        (3e5, 2e5),
    ),
    "+proj=aea +lat_1=-30 +lat_2=-60 +lat_0=-40": (
        MapSystem("Albers equal area", "", EUROPA_M, 0.0, -40.0, -30.0, -60.0),
        (3e5, -2e5),
    ),
    "+proj=lcc +lat_1=-45 +lat_0=-45": (
        MapSystem("Lambert conformal conic", "", EUROPA_M, 0.0, -45.0, -45.0, -45.0),
        (-3e5, 2e5),
    ),
}


def write_map(path: Path, crs: str, transform: Any, values: Array, **more: Any) -> Path:
    """A GeoTIFF of one band with its options, scales and offsets, by rasterio."""
    import rasterio

    rows, columns = values.shape
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": values.dtype.name}
    scales, offsets = more.pop("scales", None), more.pop("offsets", None)
    with rasterio.open(path, "w", **profile, crs=crs, transform=transform, **more) as out:
        out.write(values, 1)
        if scales:
            out.scales, out.offsets = scales, offsets
    return path
