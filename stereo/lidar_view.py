"""Points of a LiDAR scan for a view: a random part of them, coloured by a measured value.

Imports no Blender.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.random_numbers.seeds import make_generator
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from .export.lidar import ScanPoints, count_points, read_facts, read_points
from .images.colours import INVALID_GREY, Scale, colour_signed_errors

#: Most points of a scan that are kept for a view.
MAX_POINTS = 100_000
INTENSITY, RANGE_ERROR, ICE_DELAY, RETURN_NUMBER = "INTENSITY", "RANGE_ERROR", "ICE_DELAY", "RETURN_NUMBER"
#: Range error in metres that counts as right, and the error with the full colour; the same for the delay in ice.
_RIGHT_M, _FULL_M = 1e-3, 0.1
#: Colours (sRGB) by the number of a return: false alarms, first, second, third, and later ones.
_COLOURS_BY_RETURN = np.array(
    [(0xFF, 0x00, 0xBC), (0xF4, 0xF4, 0xF4), (0x2B, 0x5F, 0xC4), (0xE6, 0x9F, 0x00), (0xC4, 0x2B, 0x2B)], np.uint8
)


@dataclass(frozen=True)
class ShownPoints:
    """Points (k,) of scans in random order, so that the first n of them are a random part of the scans for any n.

    ``point_m`` (k, 3) is in the site's axes. ``range_m`` is the measured range, m, and ``error_m`` its error, m, NaN
    for a false alarm. ``light`` is in electrons or photons, and ``ice_m`` is the delay in ice, in metres of range.
    ``order`` is the number of the return, 0 for a false alarm. ``position_m`` (k, 3) is the place of the sensor,
    ``total`` the number of points of the scans, ``title`` the scanner's title. Of the ``beams``, ``returned`` gave a
    return.
    """

    point_m: Array
    range_m: Array
    error_m: Array
    light: Array
    ice_m: Array
    order: Array
    position_m: Array
    total: int
    title: str
    beams: int
    returned: int


_ARRAYS = ("point_m", "range_m", "error_m", "light", "ice_m", "order")


def read_shown_points(
    folders: Sequence[Path], most: int = MAX_POINTS, report: Callable[[float, str], object] = lambda share, text: None
) -> ShownPoints:
    """Read ``most`` random points of the scans in some folders, or all if there are fewer; every call returns the same
    points.

    ``report`` gets the share of the scans that is read, and the present work. Raises IcyMoonError if a scan is missing
    or damaged, or if the scans have no points.
    """
    scans = [(folder, read_facts(folder)) for folder in folders]
    total, seen = sum(count_points(facts) for _, facts in scans), 0
    random = make_generator(0, "range_points")
    rank, kept = np.zeros(0), {name: np.zeros((0, 3) if name == "point_m" else 0) for name in _ARRAYS}
    kept["position_m"] = np.zeros((0, 3))
    for folder, facts in scans:
        for part in read_points(folder, facts):
            _refuse_shape(folder, part)
            rank = np.concatenate([rank, random.random(len(part))])
            chosen = np.argsort(rank, kind="stable")[:most]
            rank = rank[chosen]
            places = np.broadcast_to(np.array(facts["position_m"], float), (len(part), 3))
            added = {name: getattr(part, name) for name in _ARRAYS} | {"position_m": places}
            kept = {name: np.concatenate([kept[name], values])[chosen] for name, values in added.items()}
            seen += len(part)
            report(min(1.0, seen / max(total, 1)), "Read points")
    if not seen:
        raise IcyMoonError(
            f"{folders[0] / 'lidar.npz'} has no points; scan again with the ground in the range of the scanner."
        )
    beams = sum(facts["beams"] for _, facts in scans)
    empty = sum(facts["beams_without_return"] for _, facts in scans)
    title = str(scans[0][1].get("title", ""))
    return ShownPoints(**kept, total=seen, title=title, beams=beams, returned=beams - empty)


def _refuse_shape(folder: Path, part: ScanPoints) -> None:
    arrays = [value for name, value in vars(part).items() if name != "waves"]
    known = part.point_m.ndim == 2 and all(len(values) == len(part) for values in arrays)
    if not known or not np.isfinite(part.point_m).all():
        raise IcyMoonError(f"{folder / 'lidar.npz'} has points without a place; scan the scene again.")


def make_scales(values: Mapping[str, Array]) -> dict[str, Scale]:
    """Make the scales of intensity and delay from ``light`` and ``ice_m`` (k,) of points. The intensity goes from the
    1st to the 99th percentile of the light, so that a glint does not darken the other points.
    """
    light = values[INTENSITY]
    lit = light[light > 0]
    low, high = np.quantile(lit, (0.01, 0.99)).tolist() if len(lit) else (1.0, 10.0)
    return {
        INTENSITY: Scale(low, max(high, low * 1.05), title="Intensity"),
        ICE_DELAY: Scale(_RIGHT_M, _FULL_M, title="Delay in ice"),
    }


def colour_points(kind: str, values: Mapping[str, Array]) -> Array:
    """Colour points, sRGB uint8 (k, 3), by one of their values; ``kind`` is ``INTENSITY`` or one of its neighbours.
    ``values`` has the arrays (k,) of all kinds.
    """
    stated = values[kind]
    if kind == RANGE_ERROR:
        return colour_signed_errors(stated, _FULL_M, _RIGHT_M)
    if kind == RETURN_NUMBER:
        return np.asarray(_COLOURS_BY_RETURN[np.clip(stated, 0, len(_COLOURS_BY_RETURN) - 1).astype(np.intp)])
    unknown = values[RETURN_NUMBER] == 0  # a false alarm has neither light nor a delay
    scale = make_scales(values)[kind]
    return np.ascontiguousarray(scale.colours(stated, {INVALID_GREY: unknown})[..., ::-1])


def describe_colours(kind: str, values: Mapping[str, Array]) -> tuple[tuple[str, str], ...]:
    """List the lines of the legend of ``colour_points``, each as (text, icon)."""
    order = values[RETURN_NUMBER]
    alarms = int((order == 0).sum())
    if kind == RETURN_NUMBER:
        first, second, later = (int(which.sum()) for which in (order == 1, order == 2, order > 2))
        lines = [
            (f"First, white: {first}", "BLANK1"),
            (f"Second, blue: {second}", "COLORSET_04_VEC"),
            (f"Later, orange or red: {later}", "COLORSET_01_VEC"),
        ]
        return (*lines, *([(f"False alarms, magenta: {alarms}", "COLORSET_05_VEC")] if alarms else []))
    grey = [(f"False alarms, grey: {format_count(alarms, 'point')}", "COLORSET_13_VEC")] if alarms else []
    if kind == RANGE_ERROR:
        found = values[kind][np.isfinite(values[kind])]
        median_mm = 1000 * float(np.median(found)) if len(found) else 0.0
        return (
            (f"Too far, red: {1000 * _FULL_M:g} mm and more", "COLORSET_01_VEC"),
            ("Too near, blue", "COLORSET_04_VEC"),
            (f"Within {1000 * _RIGHT_M:g} mm, white", "BLANK1"),
            (f"Median: {median_mm:.3g} mm", "BLANK1"),
            *grey,
        )
    scale = make_scales(values)[kind]
    factor, unit = (1000.0, " mm") if kind == ICE_DELAY else (1.0, "")
    return (
        (f"Dark violet: {scale.low * factor:.3g}{unit} and less", "BLANK1"),
        (f"Yellow: {scale.high * factor:.3g}{unit} and more", "BLANK1"),
        *grey,
    )


def list_values(points: ShownPoints) -> dict[str, Any]:
    """Return the arrays (k,) by which points can be coloured, by kind."""
    return {
        INTENSITY: points.light,
        RANGE_ERROR: points.error_m,
        ICE_DELAY: points.ice_m,
        RETURN_NUMBER: points.order,
    }
