"""Commands of GDAL that convert other files to a GeoTIFF that Icy Moon reads, for the ends of sentences.

The commands run in the folder of the file (gdal.org/programs). Imports no Blender.
"""

from __future__ import annotations

import re
from pathlib import Path

#: Names that shells take as they are.
_PLAIN_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*")
_PACKED_OPTIONS = ("-co COMPRESS=DEFLATE", "-co BIGTIFF=IF_SAFER")
_TILED_OPTIONS = (*_PACKED_OPTIONS, "-co TILED=YES")
#: Height maps that GDAL reads and Icy Moon does not, by suffix.
SUFFIXES = {
    ".asc": "an ASCII grid",
    ".hgt": "an SRTM tile",
    ".lbl": "a PDS label",
    ".img": "an image with a label of its own",
    ".cub": "an ISIS cube",
    ".jp2": "JPEG 2000",
    ".dem": "a USGS elevation model",
    ".dt0": "DTED",
    ".dt1": "DTED",
    ".dt2": "DTED",
    ".grd": "a grid of Surfer or GMT",
    ".nc": "netCDF",
    ".vrt": "a virtual raster of GDAL",
    ".bil": "an ESRI raster",
    ".flt": "an ESRI raster",
}
#: Suffixes of files that state no map system, so that their numbers may be degrees.
_SUFFIXES_WITHOUT_SYSTEM = (".asc", ".grd", ".bil", ".flt")
_TILE_NAME = re.compile(r"[NSns]\d{2}[EWew]\d{3}")


def quote_name(name: str) -> str:
    """Quote a file's name so that it is one word of a command."""
    if _PLAIN_NAME.fullmatch(name):
        return name
    safe = f"./{name}" if name.startswith("-") else name
    return '"' + re.sub(r'([\\"$`])', r"\\\1", safe) + '"'


def _converted_name(name: str) -> str:
    """Return the name of the file into which another is converted."""
    stem = Path(name).stem or name
    return f"{stem}_new.tif" if name == f"{stem}.tif" else f"{stem}.tif"


def make_translate_command(name: str, *options: str) -> str:
    """Make the ``gdal_translate`` command that copies the first band of a file, packed, with ``options``."""
    return " ".join(
        ["gdal_translate", "-b 1", *options, *_PACKED_OPTIONS, quote_name(name), quote_name(_converted_name(name))]
    )


def make_tile_command(name: str, *options: str) -> str:
    """Make the ``gdal_translate`` command that copies the first band of a file in tiles; a site needs only a few
    tiles."""
    return " ".join(
        ["gdal_translate", "-b 1", *options, *_TILED_OPTIONS, quote_name(name), quote_name(_converted_name(name))]
    )


def make_warp_command(name: str, *options: str) -> str:
    """Make the ``gdalwarp`` command that aligns a map with its axes, with NaN where the file has no heights."""
    return " ".join(
        [
            "gdalwarp",
            *options,
            "-r bilinear -ot Float64 -dstnodata nan",
            *_PACKED_OPTIONS,
            quote_name(name),
            quote_name(_converted_name(name)),
        ]
    )


def make_edit_command(name: str, *options: str) -> str:
    """Make the ``gdal_edit.py`` command that changes the metadata of a file."""
    return " ".join(["gdal_edit.py", *options, quote_name(name)])


def make_transform_command(source: str, target: str, point: tuple[float, float]) -> str:
    """Make the ``gdaltransform`` command that converts a point from one coordinate system to another."""
    return f'echo {point[0]:.12g} {point[1]:.12g} | gdaltransform -s_srs "{source}" -t_srs "{target}"'


def make_sphere_option(radius_m: float) -> str:
    """Return the option of ``make_translate_command`` for a file in degrees on a sphere."""
    return f'-a_srs "+proj=longlat +R={radius_m:.12g} +no_defs"'


def advise(path: Path, start: bytes, body_radius_m: float) -> str:
    """Return the end of a sentence about a height map of ``SUFFIXES``, with the command that converts it to GeoTIFF.
    Its first bytes ``start`` show whether an image contains its label."""
    suffix, name = path.suffix.lower(), path.name
    kind = SUFFIXES[suffix]
    if suffix == ".hgt" and not _TILE_NAME.match(name):
        return (
            f"is {kind}, whose name must state its south-west corner, such as N46E007.hgt; rename it and convert "
            f"it in its folder with: {make_tile_command('N46E007.hgt')}"
        )
    if suffix == ".img":
        label = _find_label(path, start)
        if label is None:
            return f"is {kind}, and {path.with_suffix('.lbl').name} is not beside it; put it there and give it."
        name = label.name
    degrees = (
        f"if its coordinates are degrees, add {make_sphere_option(body_radius_m)}; "
        if suffix in _SUFFIXES_WITHOUT_SYSTEM
        else ""
    )
    return f"is {kind}, which Icy Moon does not read; {degrees}convert it in its folder with: {make_tile_command(name)}"


def _find_label(path: Path, start: bytes) -> Path | None:
    """Find the file that GDAL opens for an image: the image itself if it contains its label or has a header beside it,
    else its label. None without label and header."""
    if start.startswith((b"PDS_VERSION_ID", b"CCSD", b"EHFA_HEADER_TAG", b"ODL_VERSION_ID", b"LBLSIZE=")):
        return path
    if any(path.with_suffix(suffix).is_file() for suffix in (".hdr", ".HDR")):
        return path
    return next((label for suffix in (".lbl", ".LBL") if (label := path.with_suffix(suffix)).is_file()), None)
