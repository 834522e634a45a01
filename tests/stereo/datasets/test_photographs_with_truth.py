"""The truth of photographed planes: by planes whose disparity is known, and by what both eyes see."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from icymoon.benchmarks.common import studies
from icymoon.benchmarks.stereo.photographs import calibrate, find_corners, fit_plane, write_boards
from icymoon.support.errors import IcyMoonError

SIZE_PX, FOCAL_PX, BASELINE_M, SQUARE_PX = (480, 360), 420.0, 0.1, 24
CAMERA = np.array([[FOCAL_PX, 0, 239.5], [0, FOCAL_PX, 179.5], [0, 0, 1]])


def _see(board, turn, place_m, side_m):
    """A flat picture (H, W), ``side_m`` metres long, at a pose in the left camera; seen by both cameras."""
    rotation, _ = cv2.Rodrigues(np.array(turn))
    metres = side_m / board.shape[1]
    into = np.array([[metres, 0, -side_m / 2], [0, metres, -metres * board.shape[0] / 2], [0, 0, 1]])
    views = []
    for shift in (0.0, BASELINE_M):
        at = np.array(place_m) - [shift, 0, 0]
        plane = CAMERA @ np.column_stack((rotation[:, 0], rotation[:, 1], at)) @ into
        views.append(cv2.warpPerspective(board, plane, SIZE_PX, flags=cv2.INTER_AREA, borderValue=(200,)))
    return [cv2.GaussianBlur(view, (0, 0), 0.8) for view in views]


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """The folder of images of a chessboard with 9 x 6 inner corners at known poses."""
    board = np.full((9 * SQUARE_PX, 12 * SQUARE_PX), 235, np.uint8)
    for row in range(7):
        for column in range(10):
            if (row + column) % 2 == 0:
                y, x = (row + 1) * SQUARE_PX, (column + 1) * SQUARE_PX
                board[y : y + SQUARE_PX, x : x + SQUARE_PX] = 25
    folder = tmp_path_factory.mktemp("boards")
    poses = [
        ((0.0, 0.35, 0.02), (0.03, 0.0, 0.62)),
        ((0.3, 0.0, 0.05), (0.08, 0.02, 0.6)),
        ((-0.3, 0.2, 0.0), (0.02, -0.04, 0.6)),
        ((0.25, -0.3, 0.1), (0.06, 0.03, 0.66)),
        ((-0.2, -0.35, -0.1), (0.05, 0.0, 0.58)),
        ((0.1, 0.1, 0.3), (0.04, 0.02, 0.64)),
    ]
    for k, (turn, place_m) in enumerate(poses, 1):
        for eye, view in zip(("left", "right"), _see(board, turn, place_m, 0.36), strict=True):
            cv2.imwrite(str(folder / f"{eye}{k:02d}.jpg"), view, [cv2.IMWRITE_JPEG_QUALITY, 98])
    return folder


def test_the_plane_through_its_corners_is_the_plane():
    """A plane Z = 1 + x / 4 + y / 2 has Z = f / (f - u / 4 - v / 2), so its disparity is linear in u and v."""
    random = np.random.default_rng(2)
    corners = random.uniform((40, 30), (200, 150), (54, 2))
    u, v = np.meshgrid(np.arange(240), np.arange(180))
    true = 40.0 * (1 - u / 4 / 200 - v / 2 / 200)
    there = 40.0 * (1 - corners[:, 0] / 4 / 200 - corners[:, 1] / 2 / 200)
    noise = random.normal(0, 0.1, 54)
    found, error_px = fit_plane(corners, corners - np.column_stack((there + noise, 0 * there)), true.shape)
    inside = np.isfinite(found)
    hull = cv2.convexHull(corners.astype(np.float32))
    assert inside.sum() == pytest.approx(cv2.contourArea(hull), rel=0.03)
    # Three of 54 degrees of freedom are fitted, and a fitted plane is off by 0.1 sqrt(3 / 54) px on average.
    assert np.abs(found - true)[inside].max() < 0.1
    assert error_px == pytest.approx(0.1, rel=0.3)


def test_both_eyes_see_the_same_at_the_true_disparity(boards, tmp_path):
    errors = dict(write_boards(boards, tmp_path))
    assert list(errors) == [f"left{k:02d}" for k in range(1, 7)]
    assert max(errors.values()) < 0.25  # half of what the eyes are shifted by below
    for name in errors:
        left, right = (
            cv2.imread(str(tmp_path / eye / f"{name}.png"), 0).astype(np.float32) for eye in ("left", "right")
        )
        truth = np.load(tmp_path / "disparity" / f"{name}.npy")
        row, column = np.mgrid[: truth.shape[0], : truth.shape[1]].astype(np.float32)
        apart = {}
        for off_px in (-0.5, 0.0, 0.5):
            there = cv2.remap(right, column - np.nan_to_num(truth) - np.float32(off_px), row, cv2.INTER_LINEAR)
            apart[off_px] = np.abs(there - left)[np.isfinite(truth)].mean()
        assert 2 * apart[0.0] < min(apart[-0.5], apart[0.5])


def test_the_calibration_is_the_camera_that_saw_the_board(boards):
    files = [[f"{eye}{k:02d}.jpg" for eye in ("left", "right")] for k in range(1, 7)]
    found = [[find_corners(cv2.imread(str(boards / file), 0), file) for file in pair] for pair in files]
    rig = calibrate(found, SIZE_PX)
    # The rectified image may be enlarged, so focal length times baseline is compared by the depth of a corner: the
    # first board's corners lie around its middle, 0.62 m away. Its squares have 0.03 m, the code's 0.025 m.
    corners = rig.corners[0]
    middle_px = (corners[0, :, 0] - corners[1, :, 0]).mean()
    assert rig.focal_px * rig.baseline_m / middle_px * 0.03 / 0.025 == pytest.approx(0.62, rel=0.02)
    assert np.abs(corners[0, :, 1] - corners[1, :, 1]).max() < 0.3


def test_a_folder_without_the_samples_is_named(tmp_path):
    with pytest.raises(SystemExit, match=r"aloeGT\.png: is missing, or no image; state the folder"):
        studies.run(["photographs", str(tmp_path), "--out", str(tmp_path / "out")])
    with pytest.raises(IcyMoonError, match="has no pair left01"):
        list(write_boards(tmp_path, tmp_path / "out"))


@pytest.mark.parametrize(("left", "said"), [(b"x", "is missing, or no image"), (None, "no chessboard of 9 x 6")])
def test_a_damaged_board_is_named(tmp_path, left, said):
    grey = np.full((120, 160), 128, np.uint8)
    for eye in ("left", "right"):
        cv2.imwrite(str(tmp_path / f"{eye}03.jpg"), grey)
    if left is not None:
        (tmp_path / "left03.jpg").write_bytes(left)
    with pytest.raises(IcyMoonError, match=rf"left03\.jpg: {said}"):
        list(write_boards(tmp_path, tmp_path / "out"))
