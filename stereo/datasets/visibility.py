"""Which pixels of the left eye the right one sees too, by a mask or by the right eye's truth; both are held against the
left eye's truth, which tells most of it by itself."""

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
from ..images.masks import intersection_over_union
from ..measure.fit_check import KINDS, TURNS, FitFault, find_fault, make_known_places, warp_to_other_eye
from .data_files import MapFile, read_image, read_map
from .input_faults import WRONG_SIGN, round_to_unit_factor

#: Numbers of a mask: hidden or unknown, known to the left eye only, seen by both. The share of pixels that may have
#: others, as edges of a mask that was made smaller do.
_SEEN, _NUMBERS, _OTHERS = 255, (0, 128, 255), 0.1
#: Hidden pixels from which on a mask is held against the truth; the least overlap, intersection over union, of the
#: hidden pixels by another reading of the mask and by the truth; and the least ratio to the stated reading's overlap.
_FEWEST, _FITS, _BETTER = 150, 0.5, 2.0


@dataclass(frozen=True)
class Mask:
    """Which pixels the right eye sees too, in image files.

    ``kind``: "seen" (255 where it does, as Middlebury's nocc), "hidden" (not 0 where it does not, in one of the files,
    as Sintel's occlusions), or "known" (there is a disparity where it does, as KITTI's noc).
    """

    kind: str
    files: tuple[Path, ...]


def read_mask(mask: Mask, disparity: Array) -> Array:
    """Boolean (H, W): the right eye sees the point of a pixel too, by ``mask``.

    Raises IcyMoonError if it has another size than the true ``disparity`` (H, W), px, NaN where unknown, or other
    numbers than a mask, if it marks no pixel with a truth, or if it fits the truth only in another reading.
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
        raise IcyMoonError(f"{first} fits the truth only {better}; write it so.")
    if not (seen & is_in_frame(find_matching_column(disparity))).any():
        raise IcyMoonError(
            f"{first} marks no pixel that by the truth is in both images; give the mask of what the "
            "right eye sees too, or leave it out."
        )
    return np.asarray(seen)


def _check_numbers(path: Path, mask: Array) -> None:
    levels = np.unique(mask)
    if len(levels) > len(_NUMBERS) and np.mean(~np.isin(mask, _NUMBERS)) > _OTHERS:
        raise IcyMoonError(
            f"{path} has many numbers between 0 and {_SEEN} and is no mask; write {_SEEN} where the "
            "right eye sees the point too and 0 elsewhere."
        )
    if 0 < levels[-1] < _SEEN:
        raise IcyMoonError(
            f"{path} has numbers up to {levels[-1]}, and {_SEEN} marks what the right eye sees too; "
            f"write {_SEEN} there."
        )


def find_better_reading(seen: Array, disparity: Array) -> str | None:
    """Another reading, in words, of ``seen``, a Boolean mask (H, W) of the pixels that the right eye sees, if it fits
    the left eye's true ``disparity`` (H, W), px, far better. None if no reading does or nearly nothing is hidden."""
    known = np.isfinite(disparity)
    hidden = known & ~(
        is_in_frame(find_matching_column(disparity))
        & ~find_hidden(disparity, warp_to_other_eye(disparity, "left"), "left")
    )
    if hidden.sum() < _FEWEST:
        return None
    shares = {words: intersection_over_union(known & ~reading, hidden) for words, reading in _list_readings(seen)}
    stated = intersection_over_union(known & ~seen, hidden)
    best = max(shares, key=lambda words: shares[words])
    return best if shares[best] >= max(_FITS, _BETTER * stated) else None


def _list_readings(seen: Array) -> Iterator[tuple[str, Array]]:
    yield "with seen and hidden exchanged", ~seen
    for name, turn in TURNS.items():
        yield KINDS[name], turn(seen)


def make_right_camera(camera: StereoCamera) -> StereoCamera:
    """The camera with the principal point of its right eye."""
    return replace(camera, cx_px=camera.cx_px + camera.doffs_px)


def check_right_truth(file: MapFile, values: Array, camera: StereoCamera, disparity: Array) -> list[str]:
    """Warnings about the map ``values`` (H, W) of the right eye that the left eye's true ``disparity`` (H, W), px, NaN
    where unknown, does not confirm.

    Raises IcyMoonError if it cannot be right, or fits the left eye's truth only in another reading.
    """
    known = np.isfinite(values)
    if not known.any():
        raise IcyMoonError(f"{file.path} has no known value in any pixel; give the right eye's truth, or leave it out.")
    what = "depths" if file.kind == "depth" else "disparities"
    if np.mean(values[known] < 0) >= WRONG_SIGN:
        raise IcyMoonError(f"{file.path} has negative {what}, and those of the left eye are positive; negate them.")
    fault = find_fault_of_right(values, file.kind, camera, disparity)
    if fault is None:
        return []
    if fault.kind == "nothing":
        return [
            f"{file.path} does not fit the left eye's truth: only {100 * fault.stated_share:.0f} % of its "
            f"{what} are those that the left eye's give; look at both maps."
        ]
    how = KINDS[fault.kind]
    if fault.kind == "factor":
        size = round_to_unit_factor(max(fault.factor, 1 / fault.factor))
        how = f"with {what} {'divided' if fault.factor > 1 else 'multiplied'} by {size:g}"
    elif fault.kind == "right_eye":
        how = "as the map of the left eye"
    raise IcyMoonError(
        f"{file.path} fits the left eye's truth only {how}; write what the right eye sees, in the unit "
        "and order of the left eye's map."
    )


def find_fault_of_right(values: Array, kind: str, camera: StereoCamera, disparity: Array) -> FitFault | None:
    """The fault of the right eye's map ``values`` (H, W), of ``kind`` "depth" (m) or "disparity" (px), by the left
    eye's true ``disparity`` (H, W); both NaN where unknown. None if they fit. "right_eye" is the left eye's map."""
    # Mirrored, the right eye is the left one of a pair. Its places are where the left eye's truth puts them.
    right = make_right_camera(camera)
    mirrored = replace(right, cx_px=camera.width_px - right.cx_px)
    return find_fault(values[:, ::-1], kind, mirrored, make_known_places(warp_to_other_eye(disparity, "left")[:, ::-1]))
