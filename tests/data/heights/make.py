"""Write the height maps of this folder with GDAL, a writer that knows nothing of the reader under test.

    pip install rasterio && python tests/data/heights/make.py

Every file holds the same hill: metres above the body at metres east and north, in whatever unit, scale, order
and direction the file is made to state. Made with GDAL 3.10.3.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from icymoon.support.arrays import Array
from rasterio.transform import Affine

FOLDER = Path(__file__).parent
EUROPA = "+proj=stere +lat_0=90 +R=1560800 +units="
FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937
GRID = (11, 13)  # rows and columns
WEST_M, NORTH_M, EAST_STEP_M, SOUTH_STEP_M = 1000.0, -500.0, 2.0, 3.0  # corner and size of the pixels on the ground


def hill(east_m: Array, north_m: Array) -> Array:
    """The height in metres: the same in tests/formats/test_geotiff.py."""
    return 40.0 + 0.5 * (east_m - 1000.0) + 0.25 * (north_m + 500.0) + 0.01 * (east_m - 1000.0) * (north_m + 500.0)


def write(
    name: str,
    *,
    kind: str = "float32",
    unit: str = "m",
    metres: float = 1.0,
    shape: tuple[int, int] = GRID,
    flips: tuple[bool, bool] = (False, False),
    height_m: float = 1.0,
    scale: float = 1.0,
    offset: float = 0.0,
    tags: dict[str, str] | None = None,
    unit_name: str = "",
    crs: str | None = "",
    nodata: float | None = None,
    holes: str = "",
    **options: Any,
) -> None:
    """Write one file; ``flips`` are east-west and north-south, ``holes`` 'nodata' or 'mask' on the diagonal."""
    rows, columns = shape
    row, column = np.mgrid[0:rows, 0:columns] + 0.5
    heights = hill(WEST_M + EAST_STEP_M * column, NORTH_M - SOUTH_STEP_M * row)
    values = (heights / height_m - offset) / scale
    values = values[:, ::-1] if flips[0] else values
    values = values[::-1] if flips[1] else values
    values = (np.rint(values) if np.dtype(kind).kind in "iu" else values).astype(kind)
    diagonal = np.eye(rows, columns, dtype=bool)
    if holes == "nodata":
        values[diagonal] = nodata
    west = WEST_M + (columns * EAST_STEP_M if flips[0] else 0.0)
    north = NORTH_M - (rows * SOUTH_STEP_M if flips[1] else 0.0)
    transform = Affine(EAST_STEP_M * (-1 if flips[0] else 1), 0, west, 0, SOUTH_STEP_M * (1 if flips[1] else -1), north)
    transform = Affine.scale(1 / metres) * transform
    with (
        rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
        rasterio.open(
            FOLDER / f"{name}.tif",
            "w",
            driver="GTiff",
            height=rows,
            width=columns,
            count=1,
            dtype=kind,
            crs=EUROPA + unit if crs == "" else crs,
            transform=transform,
            nodata=nodata,
            **options,
        ) as file,
    ):
        file.update_tags(**(tags or {}))
        file.write(values, 1)
        if (scale, offset) != (1.0, 0.0):
            file.scales, file.offsets = (scale,), (offset,)
        if unit_name:
            file.units = (unit_name,)
        if holes == "mask":
            file.write_mask(~diagonal)
            file.build_overviews([2])


def main() -> None:
    """Write all of them."""
    warnings.simplefilter("ignore")
    write("plain")
    write("point", tags={"AREA_OR_POINT": "Point"})
    write("kilometres", unit="km", metres=1000.0)
    write("survey_feet", unit="us-ft", metres=SURVEY_FOOT)
    write("own_unit", crs="+proj=tmerc +R=1560800 +to_meter=123.5", metres=123.5)
    write("utm_by_number", crs="EPSG:32633", GEOTIFF_VERSION="1.1")
    write("feet_by_number", crs="EPSG:2263", metres=SURVEY_FOOT, GEOTIFF_VERSION="1.1")
    write("degrees", crs="+proj=longlat +R=1560800", metres=27240.0)
    write("no_system", crs=None)
    write("height_feet", crs="EPSG:32633+8228", height_m=FOOT, GEOTIFF_VERSION="1.0")
    write("height_feet_by_number", crs="EPSG:32633+6360", height_m=SURVEY_FOOT, GEOTIFF_VERSION="1.1")
    write("depths", crs="EPSG:32633+5715", GEOTIFF_VERSION="1.1")
    write("unit_name", unit_name="ft", height_m=FOOT)
    write("unit_unknown", unit_name="furlong")
    write("scaled", kind="int16", scale=0.004, offset=-20.0, nodata=-32768.0, holes="nodata")
    write("south_up", flips=(False, True))
    write("mirrored", flips=(True, False))
    write("both_turned", flips=(True, True), kind="float64", ENDIANNESS="BIG", BIGTIFF="YES")
    write("mask", holes="mask", compress="DEFLATE", tiled=True, blockxsize=16, blockysize=16)
    write("lzw_words", kind="int16", scale=0.004, compress="LZW", predictor=2, ENDIANNESS="BIG")
    write("lzw_floats", compress="LZW", predictor=3, tiled=True, blockxsize=16, blockysize=16)
    write("lzw_long", kind="float32", shape=(40, 50), compress="LZW")
    write("differenced_floats", compress="DEFLATE", predictor=2)
    write("zstd", compress="ZSTD", predictor=3)
    write("lzma", compress="LZMA")
    write("packbits", kind="int16", scale=0.004, compress="PACKBITS")
    write("lerc", compress="LERC")
    write("half_floats", NBITS=16)
    write("long_words", kind="int64", scale=0.001)


if __name__ == "__main__":
    main()
