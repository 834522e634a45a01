"""Reads cameras from the calibration files of other data sets.

Their principal points count pixels from the centre of the first pixel, half a pixel less than ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from ...physics.camera.stereo_camera import CAMERA_SHAPE, StereoCamera
from ...support.errors import IcyMoonError
from ...support.file_schemas import NUMBER, PIXELS, Maybe, read_record
from ...support.foreign_bytes import read
from .data_files import read_fields, read_numbers

_PIXEL_CENTRE = 0.5
#: Difference, px, up to which two principal points count as equal. Files round to thousandths of a pixel.
_SAME_PX = 0.1
_EXPORT_SHAPE = {
    "camera": CAMERA_SHAPE,
    "saturation_radiance": Maybe(NUMBER, null=True),
}
#: The number with which Sintel's files of cameras begin.
_SINTEL_MARK = 202021.25
#: Largest relative difference of the focal lengths of rectified images. Files may have few digits.
_FOCAL_TOLERANCE = 1e-3
_DOWNLOAD_AGAIN = "download its camera data again"


def make_centred_camera(focal_px: float, baseline_m: float, width: int, height: int) -> StereoCamera:
    """Make a camera whose principal point is the middle of the image."""
    return StereoCamera(width, height, focal_px, width / 2, height / 2, baseline_m)


def make_common_camera(
    focal_px: float, cx: float, cy: float, baseline_m: float, width: int, height: int
) -> StereoCamera:
    """Make the camera that all images of a data set share."""
    return StereoCamera(width, height, focal_px, cx + _PIXEL_CENTRE, cy + _PIXEL_CENTRE, baseline_m)


def read_kitti_camera(path: Path, names: tuple[str, str], width: int, height: int) -> StereoCamera:
    """Read the camera from the two projection matrices ``names`` of the rectified eyes.

    Raises IcyMoonError if they are unusable.
    """
    fields = read_fields(path, ":")
    left, right = (read_numbers(path, fields, name, 12) for name in names)
    baseline = (left[3] - right[3]) / left[0] if left[0] else 0.0
    _check_camera(path, left[0], baseline)
    _check_square(
        path,
        left[0],
        {
            f"{name} in y" if k == 5 else f"{name} in x": matrix[k]
            for name, matrix in zip(names, (left, right), strict=True)
            for k in (0, 5)
        },
    )
    return StereoCamera(
        width, height, left[0], left[2] + _PIXEL_CENTRE, left[6] + _PIXEL_CENTRE, baseline, doffs_px=right[2] - left[2]
    )


def read_middlebury_camera(path: Path, width: int, height: int) -> StereoCamera:
    """Read the camera from ``calib.txt`` of Middlebury and ETH3D, with a baseline in mm.

    Raises IcyMoonError if the file is incomplete or contradicts itself.
    """
    fields = read_fields(path, "=")
    matrix = read_numbers(path, fields, "cam0", 9)
    baseline = read_numbers(path, fields, "baseline", 1)[0] / 1000
    _check_camera(path, matrix[0], baseline)
    right = read_numbers(path, fields, "cam1", 9) if "cam1" in fields else matrix
    _check_square(path, matrix[0], {"cam0 in y": matrix[4], "cam1 in x": right[0], "cam1 in y": right[4]})
    doffs = _find_principal_offset_px(path, fields, matrix[2])
    stated = [
        _read_pixel_count(path, fields, key) if key in fields else size
        for key, size in (("width", width), ("height", height))
    ]
    return StereoCamera(
        stated[0], stated[1], matrix[0], matrix[2] + _PIXEL_CENTRE, matrix[5] + _PIXEL_CENTRE, baseline, doffs_px=doffs
    )


def _check_square(path: Path, focal_px: float, others: Mapping[str, float]) -> None:
    """Raise IcyMoonError if one of the ``others`` differs from ``focal_px``, the focal length of the left eye in x."""
    for name, value in others.items():
        if abs(value - focal_px) > _FOCAL_TOLERANCE * focal_px:
            raise IcyMoonError(
                f"{path} states the focal length {value:g} px of {name}, and {focal_px:g} px of the "
                "left eye in x; rectify the images to square pixels and one focal length."
            )


def _find_principal_offset_px(path: Path, fields: dict[str, str], left_px: float) -> float:
    """Return the column of the right principal point minus ``left_px``, the column of the left one.

    The two matrices or ``doffs`` state it; without both it is 0. Raises IcyMoonError if they contradict each other.
    """
    by_cameras = read_numbers(path, fields, "cam1", 9)[2] - left_px if "cam1" in fields else None
    if "doffs" not in fields:
        return by_cameras or 0.0
    doffs = read_numbers(path, fields, "doffs", 1)[0]
    if by_cameras is not None and abs(by_cameras - doffs) > _SAME_PX:
        raise IcyMoonError(
            f"{path} states doffs {doffs:g} px, and the principal points of cam0 and cam1 are "
            f"{by_cameras:g} px apart; correct the one that is wrong."
        )
    return doffs


def read_row_offset_px(path: Path) -> float:
    """Read the largest vertical distance of matching points, px, from ``calib.txt``; 0 for rectified images."""
    fields = read_fields(path, "=")
    return read_numbers(path, fields, "dymax", 1)[0] if "dymax" in fields else 0.0


def read_disparity_count(path: Path) -> int | None:
    """Read the sufficient number of disparities from ``calib.txt``; None without that entry."""
    fields = read_fields(path, "=")
    return _read_pixel_count(path, fields, "ndisp") if "ndisp" in fields else None


def read_sintel_camera(path: Path, baseline_m: float, width: int, height: int) -> StereoCamera:
    """Read the camera from a ``.cam`` file: a first number, then the matrix as nine float64.

    Raises IcyMoonError if the file has other content.
    """
    mark, *matrix = read(
        path, lambda foreign: foreign.cursor().unpack("<f9d"), "a camera of Sintel", _DOWNLOAD_AGAIN, most=4096
    )
    if mark != _SINTEL_MARK:
        raise IcyMoonError(f"{path} is not a camera of Sintel; {_DOWNLOAD_AGAIN}.")
    _check_camera(path, matrix[0], baseline_m)
    return make_common_camera(matrix[0], matrix[2], matrix[5], baseline_m, width, height)


def read_exported_camera(path: Path, width: int, height: int) -> StereoCamera:
    """Read the camera from ``calibration.json`` of our own exports."""
    del width, height
    return StereoCamera.from_json(read_record(path, _EXPORT_SHAPE, "export the pair again")["camera"]).rectified


def read_saturation_radiance(path: Path) -> float | None:
    """Read the radiance of white in the images, W/(m² sr), from ``calibration.json``; None without this entry."""
    found = read_record(path, _EXPORT_SHAPE, "export the pair again").get("saturation_radiance")
    return None if found is None else float(found)


def _read_pixel_count(path: Path, fields: dict[str, str], key: str) -> int:
    """Read a number of pixels, rounded down, at least 1. Raises IcyMoonError for more pixels than an image can have."""
    value = max(1, int(read_numbers(path, fields, key, 1)[0]))
    if not PIXELS.fits(value):
        raise IcyMoonError(f"{path} states {key} {value:g}, not {PIXELS.name}; correct it.")
    return value


def _check_camera(path: Path, focal_px: float, baseline_m: float) -> None:
    for value, name in ((focal_px, "focal length"), (baseline_m, "baseline")):
        if not (math.isfinite(value) and value > 0):
            raise IcyMoonError(f"{path} gives a {name} of {value:g}, but it must be above 0; correct it.")
