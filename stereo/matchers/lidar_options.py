"""The options of range points in a method, as in ``sgbm+lidar:points=100``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .options import Option, resolve_options

#: Name of the method that only interpolates, and of the addition to a matcher.
LIDAR = "lidar"
#: The option with the folder of a scan.
RETURNS = "returns"
#: Values of ``rule``.
PICK, FILL, STEREO = "pick", "fill", "stereo"
#: Values of ``guide``.
NONE, PAINT, SEARCH = "none", "paint", "search"

_POINTS = (
    Option("points", 1000, "Number of range points in the left image", 3, 1_000_000),
    Option("noise_cm", 2.0, "Standard deviation of the noise that is added to each range, cm", 0.0, 1000.0),
    Option("shift_px", 0.0, "Shift of all points in the image by an error of their alignment, px", 0.0, 100.0),
    Option("seed", 0, "Seed of the points' places, their noise and painted patterns", 0, 2**31 - 1),
    Option(RETURNS, "", "Folder of icymoon lidar, whose scans replace samples of the true depth"),
)
_FUSION = (
    Option(
        "rule",
        PICK,
        "pick: at each pixel stereo, the interpolation or their mean, by expected errors; fill: stereo, and the "
        "interpolation where it has none; stereo: only what the matcher gives",
        choices=(PICK, FILL, STEREO),
    ),
    Option(
        "guide",
        NONE,
        "paint: patterns are painted into both images at the points; search: the matcher searches near the "
        "interpolation",
        choices=(NONE, PAINT, SEARCH),
    ),
    Option("patch", 5, "Side of a painted pattern, px", 1, 63, 2),
    Option("margin", 16, "Disparities that are searched on both sides of the interpolation, px", 8, 512, 8),
)

#: All options, for a matcher with range points.
LIDAR_OPTIONS = (*_POINTS, *_FUSION)


def complete_lidar_options(matcher: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Complete the options of range points for a ``matcher``, or for LIDAR alone. Values may be text. Raises
    IcyMoonError for unknown options and bad values.
    """
    return resolve_options(LIDAR, _POINTS if matcher == LIDAR else LIDAR_OPTIONS, {}, given)


def describe_lidar_options() -> str:
    """Describe the options in lines of text, for ``methods``."""
    return "\n".join(
        [
            "lidar: Range points of a LiDAR, interpolated; MATCHER+lidar joins them with a matcher",
            *(f"  {option.key}={option.default} ({option.range}) {option.doc}" for option in LIDAR_OPTIONS),
        ]
    )
