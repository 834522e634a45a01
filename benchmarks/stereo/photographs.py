"""Photographs with a known disparity, made ready for ``evaluate``: from the samples that come with OpenCV.

    python benchmarks photographs SAMPLES --out FOLDER
    python -m icymoon evaluate FOLDER/aloe_2 --methods sgbm,icynet --out REPORT
    python -m icymoon evaluate FOLDER/boards --methods sgbm:disparities=112,icynet:disparities=112 --out REPORT_2

SAMPLES is ``/usr/share/doc/opencv-doc/examples/data`` with Debian's package ``opencv-doc``, or ``samples/data`` in the
source of OpenCV. It has a plant, Aloe of Middlebury 2006, whose disparity was measured by structured light; and
thirteen pairs of a chessboard in a room. The board is a plane, so its disparity is linear in the rectified image. A
plane through the disparities of its 54 corners is the truth inside them; no matcher has a part in it. The board is
nearer than ``evaluate`` searches for an unknown camera, so its matchers need a stated range.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import write_text

#: Sizes of Aloe, as parts of its width; its focal length in px and its baseline in m, as Middlebury states them.
_ALOE_PARTS, _ALOE_FOCAL_PX, _ALOE_BASELINE_M = (2, 3), 3740.0, 0.16
#: Columns and rows of the chessboard's inner corners. The side of a square is not stated; it scales depths only.
_BOARD, _SQUARE_M = (9, 6), 0.025
#: Size of the chessboard's pairs, as a part of their width: for their disparities, 50 to 102 px then, matchers need a
#: range of 112 px in place of 208.
_BOARD_PART = 2
#: Half of the window in which a corner is refined, px.
_CORNER_WINDOW_PX = (5, 5)
#: Where the samples are, for errors.
_WHERE = (
    "state the folder of Debian's package opencv-doc, /usr/share/doc/opencv-doc/examples/data, or samples/data in the "
    "source of OpenCV"
)
#: Steps, and least change in px, of a corner's refinement; of a calibration's too.
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-5)


class Rectified(NamedTuple):
    """A calibrated rig: maps of both eyes for ``cv2.remap``, corners (pairs, 2, N, 2) of the boards in the rectified
    images in px, focal length in px, and baseline in m."""

    maps: list[tuple[Array, Array]]
    corners: Array
    focal_px: float
    baseline_m: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("samples", type=Path, help="folder of OpenCV's sample images")
    parser.add_argument("--out", type=Path, required=True, help="folder of the data sets to write")


def read_sample(path: Path, depth: int = cv2.IMREAD_GRAYSCALE) -> Array:
    """An image (H, W) of the samples. Raises IcyMoonError if there is none."""
    image = cv2.imread(str(path), depth)
    if image is None:
        raise IcyMoonError(f"{path}: is missing, or no image; {_WHERE}.")
    return np.asarray(image)


def shrink(image: Array, part: int) -> Array:
    """An image (H, W) at a ``part`` of its width and height, each pixel the mean of its part of the image."""
    height, width = image.shape
    return np.asarray(cv2.resize(image, (width // part, height // part), interpolation=cv2.INTER_AREA))


def write_pair(folder: Path, name: str, eyes: Sequence[Array], disparity: Array) -> None:
    """Write a left and a right image (H, W), uint8, and the disparity (H, W), px, NaN where it is unknown."""
    for part, image in zip(("left", "right"), eyes, strict=True):
        (folder / part).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / part / f"{name}.png"), image)
    (folder / "disparity").mkdir(exist_ok=True)
    np.save(folder / "disparity" / f"{name}.npy", disparity.astype(np.float32))


def write_layout(folder: Path, focal_px: float, baseline_m: float) -> None:
    """Write the file by which ``evaluate`` reads a folder of ``write_pair``."""
    write_text(
        folder / "pairs.toml",
        '[images]\nleft = "left/{pair}.png"\nright = "right/{pair}.png"\n'
        '[truth]\ndisparity = "disparity/{pair}.npy"\n'
        f"[camera]\nfocal_px = {focal_px}\nbaseline_m = {baseline_m}\n",
    )


def write_aloe(samples: Path, part: int, folder: Path) -> None:
    """Write Aloe at a ``part`` of its width. The truth is of the middle of each pixel: a mean of two depths is on
    neither."""
    truth = read_sample(samples / "aloeGT.png", cv2.IMREAD_UNCHANGED).astype(np.float32)
    eyes = [shrink(read_sample(samples / file), part) for file in ("aloeL.jpg", "aloeR.jpg")]
    middle = truth[part // 2 :: part, part // 2 :: part]
    write_pair(folder, "aloe", eyes, middle[: eyes[0].shape[0], : eyes[0].shape[1]] / part)
    write_layout(folder, _ALOE_FOCAL_PX / part, _ALOE_BASELINE_M)


def find_corners(image: Array, name: str) -> Array:
    """The inner corners (N, 2) of the board in an image, px. Raises IcyMoonError if image ``name`` shows no board."""
    is_found, corners = cv2.findChessboardCorners(image, _BOARD)
    if not is_found:
        raise IcyMoonError(
            f"{name}: no chessboard of {_BOARD[0]} x {_BOARD[1]} inner corners is found; remove this pair's two files."
        )
    return np.asarray(cv2.cornerSubPix(image, corners, _CORNER_WINDOW_PX, (-1, -1), _STOP)).reshape(-1, 2)


def calibrate(found: Sequence[Sequence[Array]], size: tuple[int, int]) -> Rectified:
    """Calibrate the rig by the corners (N, 2) of the board in pairs of images of a width and height, px."""
    board = np.zeros((np.prod(_BOARD), 3), np.float32)
    board[:, :2] = _SQUARE_M * np.mgrid[: _BOARD[0], : _BOARD[1]].T.reshape(-1, 2)
    seen = [board] * len(found)
    left, right = ([pair[eye] for pair in found] for eye in (0, 1))
    (k1, d1), (k2, d2) = (
        cv2.calibrateCamera(seen, points, size, np.eye(3), np.zeros(5))[1:3] for points in (left, right)
    )
    _, k1, d1, k2, d2, turn, step, _, _ = cv2.stereoCalibrate(seen, left, right, k1, d1, k2, d2, size, criteria=_STOP)
    turn1, turn2, view1, view2, *_ = cv2.stereoRectify(k1, d1, k2, d2, size, turn, step, alpha=0)
    eyes = ((left, k1, d1, turn1, np.asarray(view1)), (right, k2, d2, turn2, np.asarray(view2)))
    maps = [
        cv2.initUndistortRectifyMap(camera, lens, rotation, view[:, :3], size, cv2.CV_32FC1)
        for _, camera, lens, rotation, view in eyes
    ]
    corners = np.array(
        [
            [np.asarray(cv2.undistortPoints(each, camera, lens, R=rotation, P=view))[:, 0] for each in points]
            for points, camera, lens, rotation, view in eyes
        ]
    ).swapaxes(0, 1)
    return Rectified(maps, corners, float(eyes[0][4][0, 0]), float(np.linalg.norm(step)))


def fit_plane(left: Array, right: Array, shape: tuple[int, ...]) -> tuple[Array, float]:
    """The disparity of a plane (``shape``), px, by its corners (N, 2) in both rectified images; NaN outside them.

    Second, the root mean square of the corners' distances from it, px.
    """
    place = np.column_stack((left, np.ones(len(left))))
    disparity = left[:, 0] - right[:, 0]
    plane, *_ = np.linalg.lstsq(place, disparity, rcond=None)
    row, column = np.mgrid[: shape[0], : shape[1]]
    inside = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(inside, np.rint(cv2.convexHull(left.astype(np.float32))).astype(np.int32), (1,))
    found = plane[0] * column + plane[1] * row + plane[2]
    return np.where(inside > 0, found, np.nan), float(np.sqrt(np.mean((place @ plane - disparity) ** 2)))


def write_boards(samples: Path, folder: Path) -> Iterator[tuple[str, float]]:
    """Write the pairs of the chessboard; yield each one's name, and how far its corners are from its plane, px.

    Raises IcyMoonError if there is no pair, or if an image shows no board.
    """
    files = [(samples / f"left{k:02d}.jpg", samples / f"right{k:02d}.jpg") for k in range(1, 15)]
    files = [pair for pair in files if all(file.exists() for file in pair)]
    if not files:
        raise IcyMoonError(f"{samples}: has no pair left01.jpg and right01.jpg of a chessboard; {_WHERE}.")
    pairs = [[read_sample(file) for file in pair] for pair in files]
    height, width = pairs[0][0].shape
    found = [
        [find_corners(eye, str(file)) for eye, file in zip(*each, strict=True)]
        for each in zip(pairs, files, strict=True)
    ]
    rig = calibrate(found, (width, height))
    for (file, _), pair, (left, right) in zip(files, pairs, rig.corners, strict=True):
        eyes = [
            shrink(cv2.remap(eye, *maps, cv2.INTER_LINEAR), _BOARD_PART)
            for eye, maps in zip(pair, rig.maps, strict=True)
        ]
        # The middle of the first pixel is at 0 in both sizes.
        left, right = ((points + 0.5) / _BOARD_PART - 0.5 for points in (left, right))
        disparity, error_px = fit_plane(left, right, eyes[0].shape)
        write_pair(folder, file.stem, eyes, disparity)
        yield file.stem, error_px
    write_layout(folder, rig.focal_px / _BOARD_PART, rig.baseline_m)


def main(options: argparse.Namespace) -> None:
    """Write the data sets, and print how exact the truth of the boards is."""
    for part in _ALOE_PARTS:
        write_aloe(options.samples, part, options.out / f"aloe_{part}")
    errors = dict(write_boards(options.samples, options.out / "boards"))
    print(f"boards: {len(errors)} pairs, corners off their plane by {min(errors.values()):.2f} to", end=" ")
    print(f"{max(errors.values()):.2f} px (root mean square)")
