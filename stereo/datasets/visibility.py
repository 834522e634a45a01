"""Finds the pixels of the left eye whose point is visible in the right eye, by a mask or by the right eye's truth.

Both are checked against the left eye's truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...physics.camera.occlusion import find_hidden, find_matching_column, is_in_frame
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..images.image_values import describe_size, to_grey
from ..images.masks import compute_intersection_over_union
from ..measure.fit_check import READINGS, TURN_BY_READING, FitFault, find_fault, make_true_places, warp_to_other_eye
from .data_files import MapFile, read_image, read_map
from .input_faults import WRONG_SIGN_SHARE, round_to_unit_factor

#: The mask's value for a point that both eyes see.
_SEEN = 255
#: Values of a mask: hidden or unknown, known to the left eye only, seen by both.
_MASK_VALUES = (0, 128, 255)
#: Most pixels with other values, as a share: edges of a mask that was scaled down have them.
_MAX_OTHER_VALUES = 0.1
#: Fewest hidden pixels for which a mask is checked against the truth.
_FEWEST_HIDDEN_PX = 150
#: Another reading of the mask counts as right if its hidden pixels overlap the truth's by at least the first number
#: (intersection over union), and by at least the second number times the overlap of the stated reading.
_MIN_OVERLAP, _MIN_OVERLAP_RATIO = 0.5, 2.0


@dataclass(frozen=True)
class Mask:
    """Image files that mark the pixels whose point is visible in the right eye.

    ``kind`` is "seen" (255 for a visible point, as in Middlebury's nocc), "hidden" (other than 0 in one of the files
    for a hidden point, as in Sintel's occlusions), or "known" (a disparity for a visible point, as in KITTI's noc).
    """

    kind: str
    files: tuple[Path, ...]


def read_mask(mask: Mask, disparity: Array) -> Array:
    """Return the pixels (H, W), bool, whose point the right eye sees according to ``mask``.

    ``disparity`` (H, W), px, is the left eye's truth, NaN where unknown. Raises IcyMoonError if the mask has another
    size or values that no mask has, if it marks no pixel with a truth, or if it fits the truth only in another reading.
    """
    first = mask.files[0]
    if mask.kind == "known":
        seen = np.isfinite(read_map(MapFile(first)))
    else:
        masks = [to_grey(read_image(path)) for path in mask.files]
        if mask.kind == "seen":
            _check_numbers(first, masks[0])
        seen = masks[0] == _SEEN if mask.kind == "seen" else np.logical_and.reduce([each == 0 for each in masks])
    if seen.shape != disparity.shape:
        raise IcyMoonError(
            f"{first} is {describe_size(seen)}, and the images are {describe_size(disparity)}; give a "
            "mask of these images."
        )
    better = find_better_reading(seen, disparity)
    if better is not None:
        raise IcyMoonError(f"{first} fits the truth only {better}; write it that way.")
    if not (seen & is_in_frame(find_matching_column(disparity))).any():
        raise IcyMoonError(
            f"{first} marks no pixel that both images show according to the truth; give the mask of the "
            "points that the right eye sees too, or leave it out."
        )
    return np.asarray(seen)


def _check_numbers(path: Path, mask: Array) -> None:
    levels = np.unique(mask)
    if len(levels) > len(_MASK_VALUES) and np.mean(~np.isin(mask, _MASK_VALUES)) > _MAX_OTHER_VALUES:
        raise IcyMoonError(
            f"{path} has many numbers between 0 and {_SEEN} and is not a mask; write {_SEEN} where the "
            "right eye sees the point too and 0 elsewhere."
        )
    if 0 < levels[-1] < _SEEN:
        raise IcyMoonError(
            f"{path} has numbers up to {levels[-1]}, and {_SEEN} marks points that the right eye sees too; "
            f"write {_SEEN} there."
        )


def find_better_reading(seen: Array, disparity: Array) -> str | None:
    """Return in words another reading of ``seen`` that fits the truth far better; None without one.

    ``seen`` (H, W), bool, marks the pixels that the right eye sees. ``disparity`` (H, W), px, is the left eye's truth.
    None also if almost nothing is hidden.
    """
    known = np.isfinite(disparity)
    hidden = known & ~(
        is_in_frame(find_matching_column(disparity))
        & ~find_hidden(disparity, warp_to_other_eye(disparity, "left"), "left")
    )
    if hidden.sum() < _FEWEST_HIDDEN_PX:
        return None
    shares = {
        words: compute_intersection_over_union(known & ~reading, hidden) for words, reading in _list_readings(seen)
    }
    stated = compute_intersection_over_union(known & ~seen, hidden)
    best = max(shares, key=lambda words: shares[words])
    return best if shares[best] >= max(_MIN_OVERLAP, _MIN_OVERLAP_RATIO * stated) else None


def _list_readings(seen: Array) -> Iterator[tuple[str, Array]]:
    yield "with seen and hidden exchanged", ~seen
    for name, turn in TURN_BY_READING.items():
        yield READINGS[name], turn(seen)


def make_right_camera(camera: StereoCamera) -> StereoCamera:
    """Return the camera with the right eye's principal point in place of the left's."""
    return replace(camera, cx_px=camera.cx_px + camera.doffs_px)


def check_right_truth(file: MapFile, values: Array, camera: StereoCamera, disparity: Array) -> list[str]:
    """Return warnings about a map ``values`` (H, W) of the right eye that contradicts the left eye's truth.

    ``disparity`` (H, W), px, is the left eye's truth, NaN where unknown. Raises IcyMoonError if the map is impossible,
    or fits the left eye's truth only in another reading.
    """
    known = np.isfinite(values)
    if not known.any():
        raise IcyMoonError(f"{file.path} has no known value in any pixel; give the right eye's truth, or leave it out.")
    what = "depths" if file.kind == "depth" else "disparities"
    if np.mean(values[known] < 0) >= WRONG_SIGN_SHARE:
        raise IcyMoonError(f"{file.path} has negative {what}, but the left eye's are positive; negate them.")
    fault = find_fault_of_right(values, file.kind, camera, disparity)
    if fault is None:
        return []
    if fault.kind == "nothing":
        return [
            f"{file.path} does not fit the left eye's truth: only {100 * fault.stated_share:.0f} % of its "
            f"{what} are those that the left eye's give; look at both maps."
        ]
    how = READINGS[fault.kind]
    if fault.kind == "factor":
        size = round_to_unit_factor(max(fault.factor, 1 / fault.factor))
        how = f"with {what} {'divided' if fault.factor > 1 else 'multiplied'} by {size:g}"
    elif fault.kind == "right_eye":
        how = "as the map of the left eye"
    raise IcyMoonError(
        f"{file.path} fits the left eye's truth only {how}; write the map of the right eye, in the "
        "unit and order of the left eye's map."
    )


def find_fault_of_right(values: Array, kind: str, camera: StereoCamera, disparity: Array) -> FitFault | None:
    """Find the fault of the right eye's map ``values`` (H, W) by the left eye's true ``disparity`` (H, W), px.

    ``kind`` is "depth" (m) or "disparity" (px) of the values; both maps are NaN where unknown. None if they fit. The
    fault "right_eye" means that the values are the left eye's map.
    """
    # In a mirror, the right eye is the left eye of a pair, and its points are where the left eye's truth puts them.
    right = make_right_camera(camera)
    mirrored = replace(right, cx_px=camera.width_px - right.cx_px)
    return find_fault(values[:, ::-1], kind, mirrored, make_true_places(warp_to_other_eye(disparity, "left")[:, ::-1]))
