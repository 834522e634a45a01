"""Photographs on the pixels of the rig: partners of images, OpenCV's rectification, depths along another axis."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from icymoon.physics.camera.lens_models import Brown
from icymoon.physics.camera.rotations import from_vector
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.stereo.images.image_files import write_png
from icymoon.stereo.twin.photographs import find_photographs, make_rectification
from icymoon.support.errors import IcyMoonError

SIZE = (160, 120)
RIG = StereoCamera(*SIZE, 150.0, 81.5, 58.5, 0.2)
BENT = Brown((-0.2, 0.05, 1e-3, -2e-3, 0.01)), Brown((-0.1, 0.02, 0.0, 1e-3, 0.0))
LEFT = CalibratedCamera(*SIZE, 148.0, 151.0, 80.0, 57.0, BENT[0], name="left")
RIGHT = CalibratedCamera(
    *SIZE, 155.0, 154.0, 77.0, 61.0, BENT[1],
    rotation=from_vector(np.array([0.02, -0.08, 0.03])), translation_m=np.array([-0.2, 0.004, 0.01]), name="right",
)  # fmt: skip
UNLIKE = CalibratedRig((LEFT, RIGHT))


def pinholes(shift_px: float = 0.0) -> CalibratedRig:
    """The two eyes of RIG, the principal point of the right one ``shift_px`` further right."""
    at = np.array([-0.2, 0, 0])
    return CalibratedRig((
        CalibratedCamera(*SIZE, 150.0, 150.0, 81.0, 58.0),
        CalibratedCamera(*SIZE, 150.0, 150.0, 81.0 + shift_px, 58.0, translation_m=at),
    ))  # fmt: skip


def stated_pose():
    """Rotation (3, 3) and translation (3, 1) of the right camera: OpenCV 5 takes columns only."""
    rotation, translation = UNLIKE.relative_pose()
    return rotation, translation[:, None]


def image(path, size=SIZE):
    values = np.random.default_rng(3).integers(0, 256, size[::-1]).astype(np.uint8)
    write_png(path, values)
    return values


def test_the_pixels_are_those_of_opencv():
    found = make_rectification(UNLIKE, RIG, "a.yml")
    bends = [np.array(lens.coefficients) for lens in BENT]
    turns = cv2.stereoRectify(LEFT.matrix, bends[0], RIGHT.matrix, bends[1], SIZE, *stated_pose())[:2]
    wanted = np.array(RIG.matrix)
    wanted[:2, 2] -= 0.5
    for eye, camera, lens, turn in zip(("left", "right"), UNLIKE.cameras, BENT, turns, strict=True):
        maps = cv2.initUndistortRectifyMap(camera.matrix, np.array(lens.coefficients), turn, wanted, SIZE, cv2.CV_32FC1)
        at = np.stack(maps, axis=-1) + 0.5
        inside = found.seen[eye]
        assert inside.mean() > 0.8
        # OpenCV's maps are in single precision, 1e-5 px here.
        assert np.abs(found.pixels[eye] - at)[inside].max() < 1e-4


def test_images_of_the_rig_itself_are_not_interpolated(tmp_path):
    found = make_rectification(pinholes(), RIG, "a.yml")
    assert not found.interpolates
    assert found.seen["right"].all()
    values = image(tmp_path / "left.png")
    assert np.array_equal(found.read_grey(tmp_path / "left.png", "left"), values)


def test_a_principal_point_further_right_is_a_shift_of_the_right_image(tmp_path):
    found = make_rectification(pinholes(7.0), RIG, "a.yml")
    values = image(tmp_path / "right.png")
    shifted = found.read_grey(tmp_path / "right.png", "right")
    assert np.array_equal(shifted[:, :-7], values[:, 7:])
    assert not found.seen["right"][:, -7:].any()
    assert found.seen["right"][:, :-7].all()
    assert found.pixels["left"] is None


def test_depths_are_turned_into_the_axis_of_the_rig(tmp_path):
    """A plane has the same disparities as seen by the rig itself, to the nearest pixel of the photograph."""
    found = make_rectification(UNLIKE, RIG, "a.yml")
    normal, distance = np.array([0.1, 0.5, 1.0]), 2.0  # in the left camera's own axes: normal · point = distance
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)
    rays = LEFT.unproject(grid)
    np.save(tmp_path / "depth.npy", distance / (rays @ normal) * rays[..., 2])
    disparity = found.read_disparity(tmp_path / "depth.npy")

    at = found.pixels["left"] - 0.5
    directions = LEFT.unproject(at)
    points = directions * (distance / (directions @ normal))[..., None]
    # The rig's axis is the third row of the rotation that OpenCV gives for the left eye.
    turn = cv2.stereoRectify(LEFT.matrix, np.zeros(5), RIGHT.matrix, np.zeros(5), SIZE, *stated_pose())[0]
    wanted = RIG.disparity(points @ turn[2])
    inside = found.seen["left"]
    assert np.isnan(disparity[~inside]).all()
    # From a pixel to the next the disparity changes by at most |normal| B / distance, 0.12 px; half of it either way.
    assert np.abs(disparity - wanted)[inside].max() < 0.12
    assert abs(np.mean((disparity - wanted)[inside])) < 0.01, "no offset, as a depth along the other axis would give"
    along_own_axis = RIG.disparity(points[..., 2])
    assert np.abs(along_own_axis - wanted)[inside].mean() > 0.05, "the test tells both axes"


def test_files_find_their_partners(tmp_path):
    names = [tmp_path / name for name in ("a.png", "b.png", "c.png", "d.png")]
    found = find_photographs(names)
    assert [(pair.left.name, pair.right.name) for pair in found] == [("a.png", "b.png"), ("c.png", "d.png")]
    assert [pair.name for pair in found] == ["a", "c"]
    twice = find_photographs([tmp_path / "one" / "left.png", names[0], tmp_path / "two" / "left.png", names[1]])
    assert len({pair.name for pair in twice}) == 2, "pairs of one name would overwrite each other's results"


def test_a_folder_has_names_of_both_eyes_or_two_folders(tmp_path):
    plain, sides = tmp_path / "plain", tmp_path / "sides"
    for name in ("left02.png", "Right02.png", "left01.png", "right01.png", "notes.txt"):
        (plain / name).parent.mkdir(exist_ok=True)
        (plain / name).touch()
    assert [(p.left.name, p.right.name) for p in find_photographs([plain])] == [
        ("left01.png", "right01.png"),
        ("left02.png", "Right02.png"),
    ]
    for name in ("left/x.png", "right/x.jpg"):
        (sides / name).parent.mkdir(parents=True, exist_ok=True)
        (sides / name).touch()
    assert [(p.left.name, p.right.name) for p in find_photographs([sides])] == [("x.png", "x.jpg")]


def test_what_has_no_partner_is_named(tmp_path):
    (tmp_path / "left1.png").touch()
    with pytest.raises(IcyMoonError, match=r"left1\.png has no image of the right eye"):
        find_photographs([tmp_path])
    with pytest.raises(IcyMoonError, match=r"c\.png has no partner"):
        find_photographs([tmp_path / "a.png", tmp_path / "b.png", tmp_path / "c.png"])
    with pytest.raises(IcyMoonError, match=r"absent is missing; give one folder"):
        find_photographs([tmp_path / "absent"])
    same = tmp_path / "there" / ".." / "left1.png"
    (tmp_path / "there").mkdir()
    with pytest.raises(IcyMoonError, match=r"left1\.png are one file; give the image of each eye"):
        find_photographs([tmp_path / "left1.png", same])
    (tmp_path / "left1.png").unlink()
    with pytest.raises(IcyMoonError, match="has no pairs of images"):
        find_photographs([tmp_path])
    with pytest.raises(IcyMoonError, match="--depth names 2 files for 1 pair"):
        find_photographs([tmp_path / "a.png", tmp_path / "b.png"], [tmp_path, tmp_path])


def test_images_and_depths_that_do_not_fit_are_named(tmp_path):
    found = make_rectification(pinholes(), RIG, "a.yml")
    image(tmp_path / "small.png", (80, 60))
    with pytest.raises(IcyMoonError, match=r"small\.png is 80 x 60 px, and the calibration is for 160 x 120"):
        found.read_grey(tmp_path / "small.png", "left")
    np.save(tmp_path / "mm.npy", np.full(SIZE[::-1], 2000.0))
    with pytest.raises(IcyMoonError, match=r"mm\.npy has a median depth of 2000 m.*millimetres"):
        found.read_disparity(tmp_path / "mm.npy")
    np.save(tmp_path / "none.npy", np.full(SIZE[::-1], -1.0))
    with pytest.raises(IcyMoonError, match="no depth above 0"):
        found.read_disparity(tmp_path / "none.npy")
    np.save(tmp_path / "size.npy", np.ones((60, 80)))
    with pytest.raises(IcyMoonError, match=r"size\.npy"):
        found.read_disparity(tmp_path / "size.npy")
    above = CalibratedRig((LEFT, RIGHT.placed(np.eye(3), np.array([0.0, -0.2, 0.0]))))
    with pytest.raises(IcyMoonError, match=r"^a\.yml.*above the other"):
        make_rectification(above, RIG, "a.yml")
