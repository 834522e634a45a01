"""Folders of other data sets, written by hand, give the truth that was put in."""

from collections.abc import Callable
from pathlib import Path

import cv2
import foreign
import numpy as np
import OpenEXR
import pytest
from icymoon.stereo.datasets.dataset_layouts import find_foreign_pairs
from icymoon.stereo.datasets.foreign_pair import ForeignPair
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")


def only(path):
    (source,) = find_sources([path])
    return source, source.prepare({})


def check(prepared, focal_baseline, doffs=0.0):
    """Every known pixel has the disparity and the depth of the plane."""
    known = np.isfinite(prepared.truth)
    assert prepared.pair.camera.focal_baseline_px_m == pytest.approx(focal_baseline)
    np.testing.assert_allclose(prepared.truth[known], focal_baseline / (foreign.SHIFT_PX + doffs), rtol=1e-6)
    np.testing.assert_allclose(prepared.pair.camera.disparity(prepared.truth)[known], foreign.SHIFT_PX, rtol=1e-6)
    return known


def test_kitti_2015(tmp_path):
    for path in (foreign.kitti_2015(tmp_path), tmp_path / "training"):
        source, prepared = only(path)
        known = check(prepared, 350)
        np.testing.assert_array_equal(known.any(axis=1), [False] + [True] * (foreign.HEIGHT - 1))
        np.testing.assert_array_equal(prepared.visible[5], np.arange(foreign.WIDTH) >= 10)
    assert source.name == "000000_10"
    # The centre of KITTI's first pixel is 0, of ours 0.5.
    assert (prepared.pair.camera.cx_px, prepared.pair.camera.cy_px) == (48.5, 32.5)
    np.testing.assert_array_equal(prepared.left, foreign.eyes(colour=True, seed=0)[0])


def test_kitti_2012(tmp_path):
    source, prepared = only(foreign.kitti_2012(tmp_path))
    assert source.name == "000003_10"
    assert check(prepared, 350).all()
    # All of disp_noc is known here, but nothing beyond the right image is visible.
    np.testing.assert_array_equal(prepared.visible[5], np.arange(foreign.WIDTH) >= foreign.SHIFT_PX)


def test_middlebury_of_2014(tmp_path):
    for path in (foreign.middlebury(tmp_path), tmp_path / "Adirondack"):
        source, prepared = only(path)
        known = check(prepared, 20, doffs=20)
        assert np.argwhere(~known).tolist() == [[3, 5]]
    assert source.name == "Adirondack"
    assert not prepared.occlusion_known
    assert "Without a mask of hidden pixels" in prepared.facts["notes"][0]
    assert prepared.facts["warnings"] == []


def test_middlebury_3_and_eth3d(tmp_path):
    _, prepared = only(foreign.middlebury(tmp_path, official=True, doffs=0))
    known = check(prepared, 20)
    assert np.argwhere(~known).tolist() == [[3, 5]]
    np.testing.assert_array_equal(prepared.visible[9], np.arange(foreign.WIDTH) >= 12)
    assert prepared.occlusion_known


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cam0=[100 0 47.5; 0 100", "cam0=[100 0 47.5; 0 90", "90 px of cam0 in y, and 100 px of the left eye in x"),
        ("cam1=[100", "cam1=[120", "120 px of cam1 in x"),
    ],
)
def test_middlebury_with_pixels_that_are_no_squares_or_two_focal_lengths_is_refused(tmp_path, old, new, words):
    root = foreign.middlebury(tmp_path, doffs=12)
    path = root / "Adirondack" / "calib.txt"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(IcyMoonError, match=rf"calib\.txt states the focal length {words}.*; rectify the images"):
        only(root)


@pytest.mark.parametrize("without", ["doffs=12\n", "cam1=[100 0 59.5; 0 100 31.5; 0 0 1]\n"])
def test_middlebury_states_the_principal_points_in_either_way(tmp_path, without):
    root = foreign.middlebury(tmp_path, doffs=12)
    path = root / "Adirondack" / "calib.txt"
    text = path.read_text().replace("doffs=12.0", "doffs=12")
    assert without in text
    path.write_text(text.replace(without, ""))
    _, prepared = only(root)
    check(prepared, 20, doffs=12)


@pytest.mark.parametrize("negative", [False, True])
def test_sceneflow_of_either_sign(tmp_path, negative):
    driving, monkaa = find_foreign_pairs(foreign.sceneflow(tmp_path, negative))
    assert (driving.name, monkaa.name) == ("15mm_focallength-scene_forwards-fast-0001", "eating_camera2_x2-0001")
    assert isinstance(driving, ForeignPair)
    assert isinstance(monkaa, ForeignPair)
    assert driving.scene != monkaa.scene
    for source, focal in ((driving, 450), (monkaa, 1050)):
        prepared = source.prepare({})
        assert check(prepared, focal).all()
        # The right eye's truth tells what is hidden: here only what is outside of its image.
        np.testing.assert_array_equal(prepared.visible[9], np.arange(foreign.WIDTH) >= foreign.SHIFT_PX)


def test_sintel(tmp_path):
    source, prepared = only(foreign.sintel(tmp_path))
    assert source.name == "alley_1-frame_0001"
    assert check(prepared, 70).all()
    seen = np.arange(foreign.WIDTH)
    np.testing.assert_array_equal(prepared.visible[9], (seen >= foreign.SHIFT_PX) & ((seen < 40) | (seen >= 44)))


def test_sintel_without_cameras_says_what_to_add(tmp_path):
    with pytest.raises(IcyMoonError, match=r"camdata_left is missing.*; add this folder of Sintel's"):
        find_sources([foreign.sintel(tmp_path, camera=False)])


def test_guiss(tmp_path):
    source, prepared = only(foreign.guiss(tmp_path))
    assert source.name == "view_0000"
    assert check(prepared, foreign.WIDTH * 32 / 60 * 0.25).all()
    # Of the size of their images it is 85.333, not the 80 of their code.
    assert source.camera_reader(640, 480).focal_baseline_px_m == pytest.approx(85.3333, abs=1e-4)


def write_exr(path, values):
    OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage},
        {"Z": np.ascontiguousarray(values, np.float32)},
    ).write(str(path))


MAPS: dict[str, Callable[[Path, Array], object]] = {
    "a.pfm": foreign.write_pfm,
    "a.exr": write_exr,
    "a.npy": np.save,
    "a.png": lambda path, values: foreign.write_image(path, foreign.steps(values)),
    "a.tiff": foreign.write_image,
    "a.npz": lambda path, values: np.savez_compressed(path, disparity=values[None], other=values),
}


@pytest.mark.parametrize("name", MAPS)
def test_a_plain_folder_takes_disparities_in_every_format(tmp_path, name):
    root = foreign.plain(tmp_path, f'disparity = "truth/{{pair}}.{name[2:]}"')
    (root / "truth").mkdir()
    MAPS[name](root / "truth" / name, foreign.constant())
    source, prepared = only(root)
    assert source.name == "a"
    assert check(prepared, 70).all()


def test_a_plain_folder_takes_depths_with_steps_masks_and_both_eyes(tmp_path):
    root = foreign.plain(
        tmp_path, 'depth = "d/{pair}/left.png"\nsteps = 1000\nvisible = "seen/{pair}.png"', "cx_px = 40\ndoffs_px = 3\n"
    )
    foreign.write_image(root / "d" / "a" / "left.png", foreign.steps(foreign.constant(70 / 10), 1000))
    mask = np.full((foreign.HEIGHT, foreign.WIDTH), 255, np.uint8)
    mask[:, 50:] = 0
    foreign.write_image(root / "seen" / "a.png", mask)
    _, prepared = only(root)
    assert check(prepared, 70, doffs=3).all()
    assert prepared.pair.camera.cx_px == 40
    column = np.arange(foreign.WIDTH)
    np.testing.assert_array_equal(prepared.visible[5], (column >= foreign.SHIFT_PX) & (column < 50))


def test_photographs_may_be_jpeg_or_of_16_bits(tmp_path):
    root = foreign.plain(tmp_path, 'disparity = "truth/{pair}.npy"', file=foreign.constant())
    left, right = foreign.eyes()
    for eye, image in (("left", left), ("right", right)):
        (root / eye / "a.png").unlink()
        foreign.write_image(root / eye / "a.png", image.astype(np.uint16) * 257)
    np.testing.assert_array_equal(only(root)[1].left, left)
    text = (root / "pairs.toml").read_text().replace(".png", ".jpg")
    (root / "pairs.toml").write_text(text)
    for eye, image in (("left", left), ("right", right)):
        cv2.imwrite(str(root / eye / "a.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 95])
    assert np.abs(only(root)[1].left.astype(int) - left).mean() < 3


@pytest.mark.parametrize(("ndisp", "most"), [("ndisp=60\n", 63), ("ndisp=5\n", 15), ("ndisp=9999\n", 95), ("", 31)])
def test_the_range_that_is_searched_is_the_stated_one_or_a_quarter_of_the_width(tmp_path, ndisp, most):
    root = foreign.middlebury(tmp_path)
    path = root / "Adirondack" / "calib.txt"
    path.write_text(path.read_text().replace("ndisp=60\n", ndisp))
    searched = only(root)[1].pair.search_range
    assert (searched.least_px, searched.most_px) == (0, most)


def test_several_data_sets_at_once_need_different_names(tmp_path):
    one, two = foreign.middlebury(tmp_path / "one"), foreign.middlebury(tmp_path / "two")
    with pytest.raises(IcyMoonError, match="different pairs of the same name, Adirondack"):
        find_sources([one, two])
    assert len(find_sources([one, foreign.kitti_2015(tmp_path / "k", frames=2), one])) == 3


def test_pairs_of_a_sequence_are_one_scene_and_others_are_not(tmp_path):
    root = foreign.kitti_2015(tmp_path, frames=3)
    assert len({source.prepare({}).facts["scene"] for source in find_sources([root])}) == 3


@pytest.mark.parametrize(
    "layout",
    [
        foreign.kitti_2015,
        foreign.kitti_2012,
        foreign.middlebury,
        foreign.sceneflow,
        foreign.sintel,
        foreign.guiss,
        lambda root: foreign.plain(root, 'disparity = "truth/{pair}.npy"', file=foreign.constant()),
    ],
)
def test_what_file_managers_leave_is_no_pair(tmp_path, layout):
    """As macOS leaves beside each file and folder on other disks: the same names behind a dot and a line."""
    root = layout(tmp_path)
    names = [pair.name for pair in find_foreign_pairs(root)]
    assert names
    for path in [*root.rglob("*")]:
        path.with_name(f"._{path.name}").write_bytes(b"\0\5\x16\7" + bytes(4092))
        for name in (".DS_Store", "Thumbs.db", "desktop.ini"):
            path.with_name(name).write_bytes(bytes(100))
    (root / "._scene").mkdir()
    for path in root.rglob("im?.png"):
        (root / "._scene" / path.name).write_bytes(bytes(9))
    assert [pair.name for pair in find_foreign_pairs(root)] == names
    assert all(isinstance(pair, ForeignPair) for pair in find_foreign_pairs(root))
