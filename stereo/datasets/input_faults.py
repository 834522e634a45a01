"""Finds faults in truth and predictions whose numbers are readable but have a wrong meaning.

Icy Moon uses the pixels of images as stored. But a truth and a calibration may be for the image as viewers show it,
turned by the orientation in its EXIF data. So the truth must confirm such images.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Protocol

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..images.image_headers import UPRIGHT
from ..measure.fit_check import READINGS, FitFault, MatchedPlaces, find_fault, find_misfit, make_true_places
from ..measure.metrics import is_usable
from .data_files import MapFile, read_orientation

#: Share of negative numbers above which the sign counts as wrong.
WRONG_SIGN_SHARE = 0.99
#: Factors between units: steps of a PNG, steps of OpenCV's disparities, millimetres.
_UNIT_FACTORS = (256.0, 16.0, 1000.0)
#: A median ratio of prediction and truth counts as a factor between units if it differs from the factor by at most the
#: first share, and half of the pixels' ratios by at most the second share. The ratios of a failing matcher scatter.
_MEDIAN_TOLERANCE, _RATIO_TOLERANCE = 0.03, 0.1
#: Factors by which numbers may be wrong: units, scales of images, feet and inches.
_WRONG_FACTORS = (2.0, 3.0, 4.0, 8.0, 10.0, 16.0, 32.0, 64.0, 100.0, 128.0, 256.0, 1000.0, 1 / 0.3048, 1 / 0.0254)
#: Usual baselines, m, and focal lengths, as shares of the width, of stereo heads and data sets: views of 1.9 to 147°.
_BASELINES_M, _FOCAL_SHARES = (1e-3, 3.0), (0.15, 30.0)
#: Ratio of the mean values of both eyes' images above which a warning is given. Auto-exposures differ by less.
_MAX_BRIGHTNESS_RATIO = 2.0


class PairFiles(Protocol):
    """The files of a pair, for error messages."""

    @property
    def left(self) -> Path:
        """The left image."""

    @property
    def right(self) -> Path:
        """The right image."""

    @property
    def truth(self) -> MapFile:
        """The true map."""


def check_truth(pair: PairFiles, values: Array, camera: StereoCamera, places: MatchedPlaces) -> list[str]:
    """Return warnings about the numbers (H, W) of a true map that the images contradict.

    Raises IcyMoonError if the numbers are impossible, or if the images fit them better in another reading.
    """
    path, kind = pair.truth.path, pair.truth.kind
    known = np.isfinite(values)
    if not known.any():
        raise IcyMoonError(f"{path} has no known value in any pixel; give the file with the truth.")
    if np.mean(values[known] < 0) >= WRONG_SIGN_SHARE:
        raise IcyMoonError(
            f"{path} has negative disparities (left column minus right column must be positive); negate "
            "them (truth.steps = -1 in pairs.toml), or exchange the images."
            if kind == "disparity"
            else f"{path} has negative depths; negate them (truth.steps = -1 in pairs.toml)."
        )
    fault = find_fault(values, kind, camera, places)
    if fault is None or fault.kind == "nothing":
        misfit = find_misfit(values, kind, camera, places)
        if misfit is not None:
            return [f"{path} {_describe_misfit(misfit, kind, camera)}."]
    if fault is None:
        return []
    if fault.kind == "nothing":
        return [
            f"{path} does not fit the images: of the places that are found in both of them, "
            f"{100 * fault.stated_share:.0f} % are where it puts them. It fits no better "
            f"{_list_tried_factors()}; look at "
            "it beside the images."
        ]
    if fault.kind == "swapped":
        raise IcyMoonError(
            f"{pair.left} and {pair.right} fit the truth only if left and right are exchanged; exchange the images."
        )
    raise IcyMoonError(f"{path} {_describe_fault(fault, kind)}{_describe_other_causes(fault, kind)}.")


def _describe_other_causes(fault: FitFault, kind: str) -> str:
    """Describe other faults with the same symptoms as wrong numbers in the map, as the end of a sentence."""
    if fault.kind != "factor":
        return ""
    if kind == "disparity":
        return ", or state truth.steps in pairs.toml"
    size, large = _measure_fault_size(fault)
    return (
        ", or state truth.steps in pairs.toml, unless camera.focal_px or camera.baseline_m there is "
        f"{size:g} times too {'small' if large else 'large'}, which looks the same; then correct that"
    )


def _describe_misfit(fault: FitFault, kind: str, camera: StereoCamera) -> str:
    """Describe a map that almost fits, as the end of a sentence without a full stop."""
    if fault.kind == "zoom":
        return (
            f"fits the images better as the map of a camera with a focal length of about "
            f"{round(fault.factor * camera.focal_px, -1):g} px at the same place, and {camera.focal_px:g} px are "
            "stated; give the map of the left image's own camera, or correct the focal length"
        )
    share = abs(fault.factor - 1)
    what = "depths" if kind == "depth" else "disparities"
    other = "" if kind == "disparity" else ", or the focal length or the baseline is off by as much"
    return (
        f"fits the images better with another scale: its {what} seem to be about {100 * share:.0f} % too "
        f"{'large' if fault.factor > 1 else 'small'}{other}; look at the unit and at the calibration"
        ", as all errors in metres are off by that"
    )


def _measure_fault_size(fault: FitFault) -> tuple[float, bool]:
    """Return the factor of a fault, at least 1, and whether it makes the numbers too large."""
    large = fault.factor > 1
    return round_to_unit_factor(fault.factor if large else 1 / fault.factor), large


def warn_unlikely_camera(camera: StereoCamera) -> list[str]:
    """Return warnings about a camera unlike most stereo heads.

    Disparities alone do not show that one of its lengths has a wrong unit.
    """
    found = []
    least, most = _BASELINES_M
    if not least <= camera.baseline_m <= most:
        found.append(
            f"The baseline is {camera.baseline_m:g} m, outside of {least:g} to {most:g} m, and all depths are "
            "in proportion to it; look whether it is stated in metres (in mm in Middlebury's calib.txt)."
        )
    least, most = (share * camera.width_px for share in _FOCAL_SHARES)
    if not least <= camera.focal_px <= most:
        found.append(
            f"The focal length is {camera.focal_px:g} px, outside of {least:g} to {most:g} px for images of "
            f"{camera.width_px} px, and all depths are in proportion to it; look whether it is stated in px "
            "of these images."
        )
    return found


def warn_dark_images(left: Array, right: Array) -> list[str]:
    """Return a warning if one of two grey images (H, W) is too dark beside the other.

    Matchers compare grey values.
    """
    means = float(np.mean(left)), float(np.mean(right))
    if max(means) <= _MAX_BRIGHTNESS_RATIO * min(means):
        return []
    times = f"{max(means) / min(means):.1f} times" if min(means) > 0 else "infinitely"
    which = "left" if means[0] > means[1] else "right"
    return [
        f"The {which} image is {times} as bright as the other, and matchers compare values; look whether both have "
        "the same exposure, and as many of their bits in use."
    ]


def _list_tried_factors() -> str:
    *first, last = READINGS.values()
    return f"{', '.join(first)} or {last}"


def _describe_fault(fault: FitFault, kind: str) -> str:
    """Describe a map whose numbers are not ``kind``, "depth" or "disparity", and the remedy.

    The text is the end of a sentence without a full stop.
    """
    what = "depths" if kind == "depth" else "disparities"
    if fault.kind == "factor":
        size, large = _measure_fault_size(fault)
        return (
            f"has {what} that are {size:g} times too {'large; divide' if large else 'small; multiply'} them by {size:g}"
        )
    return {
        "ray": 'has distances along the ray, not depths along the optical axis; state truth.along = "ray" in '
        "pairs.toml",
        "depth": "has depths in metres, not disparities; state it as truth.depth in pairs.toml",
        "disparity": "has disparities in px, not depths; state it as truth.disparity in pairs.toml",
        "inverse": f"has 1 / depth in 1/m, not {what}; write depths in metres",
        "upside_down": "is upside down beside the images; write its rows in the other order",
        "mirrored": "is mirrored from left to right beside the images; write its columns in the other order",
        "turned": "is turned by 180° beside the images; turn it",
        "right_eye": "is the map of the right eye; give the left one's",
    }[fault.kind]


def round_to_unit_factor(size: float) -> float:
    """Round a measured factor to a factor between units within 3 %, else to three digits."""
    near = min(_WRONG_FACTORS, key=lambda factor: abs(size / factor - 1))
    return near if abs(size / near - 1) <= _MEDIAN_TOLERANCE else float(f"{size:.3g}")


def check_prediction(path: Path, disparity: Array, true_depth: Array, camera: StereoCamera) -> None:
    """Raise IcyMoonError if a ``disparity`` map (H, W), px, has another size, sign, unit or orientation than the pair.

    ``true_depth`` (H, W), m, is the pair's truth. Both maps are NaN where unknown.
    """
    true_disparity = camera.disparity(true_depth)
    check_map_size(path, disparity.shape, true_disparity.shape, "disparity")
    known = np.isfinite(disparity)
    if not known.any():
        raise IcyMoonError(f"{path} has no number in any pixel; run the method on this pair again.")
    if np.mean(disparity[known] < 0) >= WRONG_SIGN_SHARE:
        raise IcyMoonError(f"{path} has negative disparities, as of optical flow; negate them.")
    both = is_usable(disparity) & is_usable(true_disparity)
    if not both.any():
        return
    ratio = disparity[both] / true_disparity[both]
    for unit in _UNIT_FACTORS[:2]:
        if _is_unit_factor(ratio, unit):
            raise IcyMoonError(f"{path} has disparities that are {unit:g} times too large; divide them by {unit:g}.")
        if _is_unit_factor(ratio, 1 / unit):
            raise IcyMoonError(f"{path} has disparities that are {unit:g} times too small; multiply them by {unit:g}.")
    for factor, share in ((2, "half"), (3, "a third of"), (4, "a quarter of")):
        if _is_unit_factor(ratio, 1 / factor):
            raise IcyMoonError(f"{path} has disparities of images of {share} the width; multiply them by {factor}.")
    if _is_unit_factor(ratio, 1 / true_disparity.shape[1]):
        raise IcyMoonError(
            f"{path} has disparities as shares of the width; multiply them by {true_disparity.shape[1]}."
        )
    if _is_unit_factor(disparity[both] / true_depth[both], 1.0) and not _is_unit_factor(ratio, 1.0):
        raise IcyMoonError(f"{path} has depths in metres; give disparities in px of the left image.")
    fault = find_fault(
        np.where(is_usable(disparity), disparity, np.nan), "disparity", camera, make_true_places(true_disparity)
    )
    if fault is not None and fault.kind in ("depth", "inverse"):
        what = "depths" if fault.kind == "depth" else "1 / depth"
        raise IcyMoonError(f"{path} has {what}; give disparities in px of the left image.")
    if fault is not None and fault.kind not in ("nothing", "factor"):
        raise IcyMoonError(f"{path} {_describe_fault(fault, 'disparity')}.")


def check_map_size(
    path: Path, shape: tuple[int, ...], wanted: tuple[int, ...], kind: str, beside: str = "the pair is"
) -> None:
    """Raise IcyMoonError if the ``shape`` of a map of ``kind`` "depth" or "disparity" differs from ``wanted``.

    ``wanted`` is the shape of the data that ``beside`` names. The message proposes the likely change of size.
    """
    if shape != wanted:
        raise IcyMoonError(
            f"{path} is {shape[1]} x {shape[0]} px, and {beside} {wanted[1]} x {wanted[0]} px; "
            f"{_find_resize(shape, wanted, kind)}."
        )


def _find_resize(shape: tuple[int, ...], wanted: tuple[int, ...], kind: str) -> str:
    share = Fraction(shape[1], wanted[1])
    if Fraction(shape[0], wanted[0]) == share and 1 in (share.numerator, share.denominator):
        change = "enlarge" if share < 1 else "reduce"
        numbers = (
            "keep its depths as they are"
            if kind == "depth"
            else (f"multiply its disparities by {1 / share}" if share < 1 else f"divide its disparities by {share}")
        )
        return f"{change} the map to that size and {numbers}"
    if shape == wanted[::-1]:
        return "exchange its rows and columns"
    return f"give a {kind} for each pixel of the image"


def _is_unit_factor(ratio: Array, factor: float) -> bool:
    return bool(
        abs(np.median(ratio) / factor - 1) <= _MEDIAN_TOLERANCE
        and np.mean(np.abs(ratio / factor - 1) <= _RATIO_TOLERANCE) >= 0.5
    )


def find_rotated_images(images: Sequence[Path]) -> dict[Path, int]:
    """Find the images that viewers rotate. Return their EXIF orientations, 2 to 8, by path."""
    stated = {path: read_orientation(path) for path in images if path.suffix != ".pfm"}
    return {path: orientation for path, orientation in stated.items() if orientation != UPRIGHT}


def refuse_rotated_images(turned: Mapping[Path, int]) -> None:
    """Raise IcyMoonError with the remedy if images are ``turned``, see ``find_rotated_images``."""
    for path, orientation in turned.items():
        raise IcyMoonError(
            f"{path} states the EXIF orientation {orientation}, by which viewers turn it, and the truth "
            "does not confirm its pixels as they are stored; save it turned, as mogrify -auto-orient "
            "does, or without the tag, whichever the truth is for."
        )
