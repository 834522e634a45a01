"""The correlator of the Mars rovers (JPLV), bit for bit, with the reason why a pixel was rejected.

Images are halved ``pyramid_level`` times, filtered by a band-pass that removes their mean brightness, and compared by
sums of absolute differences; see ``jpl_correlator`` for the source. The Mars Exploration Rovers ran it at level 2 on
1024 x 1024 images (preset ``mer``).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from . import jpl_correlator as jpl
from .opencv_common import require_room
from .options import Option
from .result import ERROR_PX, Confidence, Result
from .search_range import AUTO, STATED, TRUTH, SearchRange, require_range
from .slanted_windows import refine_subpixel

TITLE = "JPLV"
ONE_PROCESSOR = True
SPARSE = True

_MAX_HALVED = 6

OPTIONS = (
    Option(
        "pyramid_level",
        AUTO,
        "How often the images are halved before they are compared. auto: as often as the "
        "search range needs, of which it can search 255 disparities at a time",
        0,
        _MAX_HALVED,
        words=(AUTO,),
    ),
    Option("window", 7, "Side of the square that is compared, px of the halved images, odd", 3, 63, 2),
    Option(
        "min_disparity",
        AUTO,
        "Least disparity searched, px of the full images. auto: that of the range, or 0 if max_disparity is a number",
        0,
        16384,
        words=(AUTO,),
    ),
    Option(
        "max_disparity",
        AUTO,
        "Largest disparity searched, px of the full images. auto: what the rig can see; "
        "truth: what the pair contains, which no camera knows",
        1,
        16384,
        words=(AUTO, TRUTH),
    ),
    Option(
        "blob_size",
        -4,
        "Connected patches of fewer pixels are removed; below zero, per cent of the halved image",
        -100,
        10**9,
    ),
    Option("uncertainty", 0, "Largest expected error that is accepted, in 1/256 px; 128 is usual, 0 for off", 0, 65536),
    Option(
        "subpixel",
        "parabola",
        "The parabola of the original, or a fit of affine windows, which does not prefer "
        "whole pixels and takes fifteen times as long",
        choices=("parabola", "affine"),
    ),
    Option("affine_window", 11, "Side of the square of the affine fit, px of the halved images, odd", 5, 31, 2),
)

PRESETS: dict[str, dict[str, Any]] = {"mer": {"pyramid_level": 2}}

_AFFINE_STEPS = 4  # more steps change the result by less than 0.002 px
_JOINED_PX = 1.0  # halved disparities that differ by more belong to different surfaces


def settle(
    options: dict[str, Any], ranges: Mapping[str, SearchRange], shape: tuple[int, ...]
) -> tuple[dict[str, Any], SearchRange]:
    """Return the options with a search range and a pyramid level in numbers, and this range."""
    least, most, level = options["min_disparity"], options["max_disparity"], options["pyramid_level"]
    source = STATED
    if isinstance(most, str):
        chosen = require_range("jplv", most, "max_disparity", ranges)
        least, most, source = (chosen.least_px if isinstance(least, str) else least), chosen.most_px, chosen.source
    least = 0 if isinstance(least, str) else least
    if isinstance(level, str):
        level = next((k for k in range(_MAX_HALVED) if (most >> k) - (least >> k) < jpl.MAX_LEVELS), _MAX_HALVED)
    return (
        options | {"min_disparity": least, "max_disparity": most, "pyramid_level": level},
        SearchRange(least, most, source),
    )


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 (H, W) images.

    The arrays belong to the halved images: ``jpl_disparity``, int32 in 1/256 of their px, 0x7FFF where rejected, always
    by the parabola of the original; and ``flags``, uint8, the index in ``FLAGS``. The confidence is the correlator's
    own expected error, which its ``uncertainty`` limits.
    """
    cv2.setNumThreads(1)
    level, window = options["pyramid_level"], options["window"]
    least, most = options["min_disparity"] >> level, options["max_disparity"] >> level
    if not 0 <= most - least < jpl.MAX_LEVELS:
        raise IcyMoonError(
            f"jplv would search disparities {least} to {most} at its pyramid level, but can search only "
            f"1 to {jpl.MAX_LEVELS} of them; change jplv.min_disparity or jplv.max_disparity, or raise "
            "jplv.pyramid_level."
        )
    (seen_left, rim), (seen_right, _) = (jpl.band_pass(image, level) for image in (left, right))
    margin = rim + window // 2
    require_room("jplv", left, 2 * margin < min(seen_left.shape), "window or jplv.pyramid_level")
    found = jpl.search_disparities(seen_left, seen_right, least, most, window, rim)
    judged = jpl.judge_matches(found, least, most, window, options["uncertainty"])
    error = jpl.compute_expected_error(found, judged[0], least, window)
    fixed, flags, error = (
        np.pad(part, margin, constant_values=outside)
        for part, outside in zip((*judged, error), (jpl.NO_DATA, jpl.BOUND, np.nan), strict=True)
    )
    size = options["blob_size"]
    blobs = jpl.find_blobs(fixed, size if size >= 0 else fixed.size * -size // 100)
    fixed[blobs], flags[blobs] = jpl.NO_DATA, jpl.BLOB
    disparity = np.where(flags == jpl.ACCEPT, fixed / jpl.ONE, np.nan)
    if options["subpixel"] == "affine":
        disparity = refine_subpixel(seen_left, seen_right, disparity, options["affine_window"], _AFFINE_STEPS)
    return Result(
        _enlarge_disparity(disparity, level, left.shape),
        {"jpl_disparity": fixed.astype(np.int32), "flags": flags},
        {name: int((flags == flag).sum()) for flag, name in enumerate(jpl.FLAGS)},
        confidence=Confidence(_enlarge_disparity(error, level, left.shape), ERROR_PX),
    )


def _enlarge_disparity(disparity: Array, level: int, shape: tuple[int, ...]) -> Array:
    """Enlarge the disparity of images that are halved ``level`` times to (H, W), px.

    Pixel i of a halved image is pixel i 2^level of the full one. The disparity is interpolated between four measured
    pixels of one surface; elsewhere it equals the nearest pixel's.
    """
    if level == 0:
        return disparity
    (top, bottom, down), (near, far, along) = (
        _find_neighbouring_pixels(np.arange(size) / 2**level, last - 1)
        for size, last in zip(shape, disparity.shape, strict=True)
    )
    corners = np.stack([disparity[np.ix_(rows, columns)] for rows in (top, bottom) for columns in (near, far)])
    weights = np.stack([np.outer(a, b) for a in (1 - down, down) for b in (1 - along, along)])
    smooth = np.ptp(corners, axis=0) <= _JOINED_PX  # False where one is NaN
    nearest = np.take_along_axis(corners, weights.argmax(axis=0)[None], axis=0)[0]
    return np.where(smooth, np.sum(weights * corners, axis=0), nearest) * 2**level


def _find_neighbouring_pixels(place: Array, last: int) -> tuple[Array, Array, Array]:
    """Find the integer positions on both sides of fractional positions, and the weight of the second. For an integer
    position both are the same.
    """
    before, after = np.floor(place).astype(int), np.ceil(place).astype(int)
    return before, np.minimum(after, last), place - before
