"""Calibrations in all formats: files written by hand, there and back, by OpenCV itself, and refused.

What a format holds comes back to 1e-12; numbers are written with all of their digits. The hand-written files state one
rig, ``HEAD``: two cameras that differ, the right one 0.2 m to the right, turned by 0.1 rad about y and raised by 1 cm.
"""

from __future__ import annotations

import math
import re
import struct
from typing import Any

import cv2
import numpy as np
import pytest
from icymoon.formats.calibrations.options import Stated, convert_to_brown, convert_to_cahvore, convert_to_fisheye
from icymoon.formats.calibrations.registry import FORMATS, format_of, read_calibration, write_calibration
from icymoon.formats.yaml_text import parse_yaml, write_number
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from icymoon.physics.camera.lens_models import Brown, Cahvore, Fisheye
from icymoon.physics.camera.rotations import from_vector, to_vector
from icymoon.support.errors import IcyMoonError

AXIS = (0.02, -0.01, math.sqrt(1 - 0.0005))
LENSES: dict[str, Any] = {
    "pinhole": Brown(),
    "k1, k2": Brown((-0.28, 0.09, 0, 0, 0)),
    "4": Brown((-0.28, 0.09, 4e-4, -3e-4, 0)),
    "5": Brown((-0.28, 0.09, 4e-4, -3e-4, -0.012)),
    "8": Brown((3.1, 0.9, -4e-4, 7e-4, 0.02, 3.3, 1.3, 0.08)),
    "12": Brown((3.1, 0.9, -4e-4, 7e-4, 0.02, 3.3, 1.3, 0.08, 2e-3, -1e-3, -3e-3, 5e-4)),
    "fisheye": Fisheye((-0.013, 0.021, -0.009, 0.0017)),
    "short fisheye": Fisheye((-0.013, 0.021, 0, 0)),
    "CAHVOR": Cahvore(AXIS, (0.001, -0.2, 0.05)),
    "CAHVORE": Cahvore(AXIS, (0.001, -0.02, 0.005), (0.001, 0.002, 0.003), 0.37),
    "CAHVOR of k1, k2": Cahvore((0.0, 0.0, 1.0), (0.0, -0.28, 0.09)),
}
#: The lenses that each format holds, by what its own documentation lists.
BROWN_4 = {"pinhole", "k1, k2", "4", "CAHVOR of k1, k2"}
FISHEYES = {"fisheye", "short fisheye"}
HELD = {
    "opencv": BROWN_4 | FISHEYES | {"5", "8", "12"},
    "ros": BROWN_4 | FISHEYES | {"5", "8", "12"},
    "kalibr": BROWN_4 | FISHEYES,
    "mrcal": BROWN_4 | {"5", "8", "12", "CAHVOR", "CAHVORE", "short fisheye"},
    "cahv": {"pinhole", "k1, k2", "CAHVOR", "CAHVORE", "CAHVOR of k1, k2", "short fisheye"},
    "colmap": BROWN_4 | FISHEYES | {"5", "8"},
    "transforms": BROWN_4 | FISHEYES | {"5"},
}
SUFFIXES = [(name, kind.suffix) for name, kind in FORMATS.items()] + [
    ("opencv", ".xml"), ("opencv", ".json"), ("opencv", ".npz"), ("cahv", ".lbl"),
]  # fmt: skip
WORLD: dict[str, Any] = {
    "rotation": from_vector(np.array([2.0, -1.0, 0.5])),
    "translation_m": np.array([10.0, -20.0, 3.0]),
}


def coefficients_of(camera: CalibratedCamera) -> tuple[float, ...]:
    assert not isinstance(camera.lens, Cahvore)
    return camera.lens.coefficients


def rig_of(lens, skew=0.0, world=True) -> CalibratedRig:
    left = CalibratedCamera(640, 480, 410.0, 395.0, 301.25, 262.5, lens, skew, name="left", **(WORLD if world else {}))
    turn = from_vector(np.array([0.01, -0.03, 0.02]))
    right = CalibratedCamera(
        1280, 960, 810.5, 795.25, 601.125, 462.5, lens, skew, turn @ left.rotation,
        turn @ left.translation_m + [-0.3, 0.01, 0.02], "right",
    )  # fmt: skip
    return CalibratedRig((left, right))


def paths_for(folder, name, suffix):
    paths = [folder / f"{eye}{suffix}" for eye in ("left", "right")] if FORMATS[name].each else [folder / f"x{suffix}"]
    if not suffix:
        paths[0].mkdir()
    return paths


def assert_same(found: CalibratedRig, wanted: CalibratedRig, px=1e-9):
    """Sizes, poses from the first eye to 1e-12, and pixels of points all over each image and its depths."""
    found, wanted = found.from_first(), wanted.from_first()
    assert [camera.size_px for camera in found.cameras] == [camera.size_px for camera in wanted.cameras]
    for one, other in zip(found.cameras, wanted.cameras, strict=True):
        assert np.abs(one.rotation - other.rotation).max() < 1e-12
        assert np.abs(one.translation_m - other.translation_m).max() < 1e-12 * 30  # of places 30 m from the origin
        grid = np.meshgrid(np.linspace(0, other.width_px - 1, 17), np.linspace(0, other.height_px - 1, 13))
        pixels = np.stack(grid, axis=-1)
        rays = other.unproject(pixels)
        assert np.abs(one.project((rays * 3 - other.translation_m) @ other.rotation) - pixels).max() < px
        assert np.abs(one.unproject(pixels) - rays).max() < px / other.fx_px


@pytest.mark.ci_takes(60)
@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(("name", "suffix"), SUFFIXES, ids=lambda value: value or "folder")
def test_what_is_written_is_read_again(tmp_path, name, suffix, lens):
    rig, paths = rig_of(LENSES[lens]), paths_for(tmp_path, name, suffix)
    if lens not in HELD[name]:
        with pytest.raises(IcyMoonError, match=r"has no .*camera left.*; choose \w") as caught:
            write_calibration(rig, paths, name)
        assert not any(path.is_file() for path in tmp_path.rglob("*"))
        for other in str(caught.value).removesuffix(".").rpartition("choose ")[2].split(" or "):
            assert lens in HELD[other], "the fix works"
        return
    write_calibration(rig, paths, name)
    assert [format_of(path) for path in paths] == [name] * len(paths)
    found = read_calibration(paths).rig
    assert_same(found, rig)
    for one, given in zip(found.cameras, rig.cameras, strict=True):
        same = convert_to_brown(given) or given
        if name != "cahv":  # which has other lenses for the same light
            assert np.abs(one.matrix - same.matrix).max() < 1e-12 * 1280


@pytest.mark.parametrize(("name", "suffix"), SUFFIXES, ids=lambda value: value or "folder")
def test_skew_is_held_by_opencvs_fisheye_alone(tmp_path, name, suffix):
    paths = paths_for(tmp_path, name, suffix)
    for lens in ("pinhole", "short fisheye"):
        rig = rig_of(LENSES[lens], 1.75)
        if (name, lens) == ("opencv", "short fisheye"):
            write_calibration(rig, paths, name)
            assert_same(read_calibration(paths).rig, rig)
        else:
            with pytest.raises(IcyMoonError, match=r"has no skew, which is 1\.75 px"):
                write_calibration(rig, paths, name)


def test_lenses_that_are_equal_stand_for_each_other():
    """1 + r0 of CAHVOR is a factor of the focal length."""
    one = CalibratedCamera(640, 480, 400.0, 390.0, 310.0, 250.0, Cahvore((0.0, 0.0, 1.0), (0.02, -0.2, 0.05)))
    brown = convert_to_brown(one)
    assert brown.fx_px == pytest.approx(408)
    assert_same(CalibratedRig((brown,)), CalibratedRig((one,)))
    fisheye = CalibratedCamera(640, 480, 400.0, 390.0, 310.0, 250.0, LENSES["short fisheye"])
    general = convert_to_cahvore(fisheye)
    assert isinstance(general.lens, Cahvore)
    assert_same(CalibratedRig((general,)), CalibratedRig((fisheye,)))
    assert convert_to_fisheye(general).lens == fisheye.lens
    assert (
        convert_to_brown(fisheye)
        is convert_to_cahvore(CalibratedCamera(9, 9, 9.0, 9.0, 4.0, 4.0, LENSES["fisheye"]))
        is None
    )


#: The rig of all files below. Its right camera differs in all but the size.
TURN = from_vector(np.array([0.0, 0.1, 0.0]))
SHIFT = -TURN @ [0.2, -0.01, 0.0]
HEAD = CalibratedRig(
    (
        CalibratedCamera(752, 480, 458.654, 457.296, 367.215, 248.375, Brown((-0.28, 0.07, 2e-4, 1.8e-5, 0))),
        CalibratedCamera(
            752, 480, 457.587, 456.134, 379.999, 255.238, Brown((-0.28, 0.07, -1e-4, -3.6e-5, 0)), 0.0, TURN, SHIFT
        ),
    )
)
R = [f"{value!r}" for value in TURN.ravel().tolist()]
T = [f"{value!r}" for value in SHIFT.tolist()]
T_MM = [f"{value * 1000!r}" for value in SHIFT.tolist()]
RT = [f"{value!r}" for value in (*to_vector(TURN).tolist(), *SHIFT.tolist())]
INTRINSICS = """%YAML:1.0
---
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 4.58654e+02, 0., 3.67215e+02, 0., 4.57296e+02,
       2.48375e+02, 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5, 0. ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 457.587, 0., 379.999, 0., 456.134, 255.238, 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.28, 0.07, -1.0e-4, -3.6e-5, 0. ]
"""
EXTRINSICS = f"""%YAML:1.0
---
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {", ".join(R)} ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ {", ".join(T_MM)} ]
"""
KALIBR = f"""cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [{", ".join([*R[0:3], T[0]])}]
  - [{", ".join([*R[3:6], T[1]])}]
  - - {R[6]}
    - {R[7]}
    - {R[8]}
    - {T[2]}
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, -0.0001,
    -3.6e-05]
  distortion_model: radtan
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""
MRCAL = """# generated on 2024-01-01 with mrcal-calibrate-cameras
# # the command, with 'quotes' and { braces
{
    'lensmodel':  'LENSMODEL_OPENCV4',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ %s,],

    'valid_intrinsics_region': [
    [ 1.0, 2.0 ],
    [ 3.0, 4.0 ],],

    # extrinsics are rt_fromref
    'extrinsics': [ %s,],

    'imagersize': [ 752, 480,],
    'icam_intrinsics': 0,
    'optimization_inputs': b'UEsDB{[(',
}
"""
MRCAL_FILES = (
    MRCAL % ("458.654, 457.296, 367.215, 248.375, -0.28, 0.07, 0.0002, 1.8e-05", "0.,0.,0.,0.,0.,0."),
    MRCAL % ("457.587, 456.134, 379.999, 255.238, -0.28, 0.07, -0.0001, -3.6e-05", ",".join(RT)),
)
HALF_TURN = math.cos(0.05), math.sin(0.05)
CAMERAS = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
1 OPENCV 752 480 458.654 457.296 367.715 248.875 -0.28 0.07 0.0002 1.8e-05
2 OPENCV 752 480 457.587 456.134 380.499 255.738 -0.28 0.07 -0.0001 -3.6e-05
"""
IMAGES = f"""# Image list with two lines of data per image:
1 1.0 0.0 0.0 0.0 0.0 0.0 0.0 1 the left.png
10.5 20.5 -1 30.5 40.5 7
2 {2 * HALF_TURN[0]!r} 0.0 {2 * HALF_TURN[1]!r} 0.0 {" ".join(T)} 2 right.png

"""


def frame(fx, fy, cx, cy, p1, p2, pose):
    flipped = (pose @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist()
    return (f'{{"file_path": "images/{cx}.png", "fl_x": {fx}, "fl_y": {fy}, "cx": {cx}, "cy": {cy}, '
            f'"p1": {p1}, "p2": {p2}, "transform_matrix": {flipped}}}')  # fmt: skip


TO_WORLD = np.block([[TURN.T, (-TURN.T @ SHIFT)[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
TRANSFORMS = (
    '{"camera_model": "OPENCV", "w": 752, "h": 480, "k1": -0.28, "k2": 0.07, "frames": ['
    + frame(458.654, 457.296, 367.715, 248.875, 0.0002, 1.8e-05, np.eye(4)) + ","
    + frame(457.587, 456.134, 380.499, 255.738, -0.0001, -3.6e-05, TO_WORLD) + "]}"
)  # fmt: skip


def colmap_bytes():
    """The model of ``CAMERAS`` and ``IMAGES`` as COLMAP's binary files."""
    cameras = struct.pack("<Q", 2)
    for line in CAMERAS.splitlines()[2:]:
        number, _, width, height, *numbers = line.split()
        cameras += struct.pack("<iiQQ8d", int(number), 4, int(width), int(height), *map(float, numbers))
    images = struct.pack("<Q", 2)
    for line, points in zip(IMAGES.splitlines()[1::2], (2, 0), strict=True):
        number, *placed, camera, name = line.split(maxsplit=9)
        images += struct.pack("<I7dI", int(number), *map(float, placed), int(camera)) + name.encode() + b"\0"
        images += struct.pack("<Q", points) + b"\xff" * 24 * points
    return cameras, images


def write(folder, **files):
    paths = []
    for name, content in files.items():
        paths.append(folder / name.replace("__", "."))
        paths[-1].write_bytes(content if isinstance(content, bytes) else content.encode())
    return paths


def kalibr_as(old, new):
    assert old in KALIBR
    return KALIBR.replace(old, new)


def test_files_of_opencvs_sample_are_read(tmp_path):
    """Intrinsics and extrinsics, without a size, and in millimetres."""
    paths = write(tmp_path, intrinsics__yml=INTRINSICS, extrinsics__yml=EXTRINSICS)
    found = read_calibration(paths, Stated("mm", ((752, 480),)))
    assert_same(found.rig, HEAD)
    assert found.notes == ("The baseline is in mm, as stated.",)
    with pytest.raises(IcyMoonError, match=r"T that is 200\.25 long in the unit of the board's squares.*add --unit "):
        read_calibration(paths, Stated(sizes=((752, 480),)))
    with pytest.raises(IcyMoonError, match="does not state the size of its images; add --size"):
        read_calibration(paths, Stated("mm"))
    with pytest.raises(IcyMoonError, match=r"has no R, .*; give the file of extrinsics too"):
        read_calibration(paths[:1], Stated("mm", ((752, 480),)))
    with pytest.raises(IcyMoonError, match=r"states 'D1' as intrinsics\.yml does"):
        read_calibration([paths[0], paths[0]], Stated("mm", ((752, 480),)))


def test_a_camchain_of_kalibr_is_read(tmp_path):
    (path,) = write(tmp_path, camchain__yaml=KALIBR)
    found = read_calibration([path])
    assert_same(found.rig, HEAD)
    assert [camera.name for camera in found.rig.cameras] == ["cam0", "cam1"]
    assert found.notes == ()


def test_models_of_mrcal_are_read(tmp_path):
    left, right = MRCAL_FILES
    assert_same(read_calibration(write(tmp_path, a__cameramodel=left, b__cameramodel=right)).rig, HEAD)
    newer = right.replace("'extrinsics'", "'rt_cam_ref'")
    assert_same(read_calibration(write(tmp_path, a__cameramodel=left, b__cameramodel=newer)).rig, HEAD)


def test_models_of_colmap_are_read(tmp_path):
    """As text, with a quaternion of any length, and as bytes."""
    write(tmp_path, cameras__txt=CAMERAS, images__txt=IMAGES)
    found = read_calibration([tmp_path])
    assert_same(found.rig, HEAD)
    assert [camera.name for camera in found.rig.cameras] == ["the left.png", "right.png"]
    assert "states no unit" in found.notes[0]
    assert read_calibration([tmp_path], Stated("cm")).rig.cameras[1].translation_m == pytest.approx(SHIFT / 100)
    cameras, images = colmap_bytes()
    folder = tmp_path / "bytes"
    folder.mkdir()
    write(folder, cameras__bin=cameras, images__bin=images)
    assert_same(read_calibration([folder]).rig, HEAD)
    write(folder, cameras__bin=cameras, images__bin=images[:-3])
    with pytest.raises(IcyMoonError, match="ends"):
        read_calibration([folder])


def test_a_transforms_json_is_read(tmp_path):
    (path,) = write(tmp_path, transforms__json=TRANSFORMS)
    assert_same(read_calibration([path]).rig, HEAD)


def test_a_pair_of_ros_is_the_pair_that_it_rectifies(tmp_path):
    """P and R are those that OpenCV computes of the same head."""
    left, right = HEAD.cameras
    distortion = [np.array(coefficients_of(camera)) for camera in HEAD.cameras]
    turned = cv2.stereoRectify(
        left.matrix, distortion[0], right.matrix, distortion[1], left.size_px, TURN, np.reshape(SHIFT, (3, 1)), alpha=0
    )
    files = {}
    for name, camera, rotation, projection in zip(("l", "r"), HEAD.cameras, turned[:2], turned[2:4], strict=True):
        matrices = {
            "camera_matrix": camera.matrix, "distortion_coefficients": np.array([coefficients_of(camera)]),
            "rectification_matrix": rotation, "projection_matrix": projection,
        }  # fmt: skip
        files[f"{name}__yaml"] = "image_width: 752\nimage_height: 480\ndistortion_model: plumb_bob\n" + "".join(
            f"{key}: {{rows: {value.shape[0]}, cols: {value.shape[1]}, data: {value.ravel().tolist()}}}\n"
            for key, value in matrices.items()
        )
    found = read_calibration(write(tmp_path, **files))
    assert_same(found.rig, HEAD)
    assert found.notes == ()
    rounded = {key: _with_digits(text, 5) for key, text in files.items()}
    found = read_calibration(write(tmp_path, **rounded))
    assert np.abs(found.rig.cameras[1].rotation - TURN).max() < 2e-5
    assert "rectification_matrix was rounded" in found.notes[0]


def _with_digits(text, digits):
    start, end = text.index("rectification_matrix"), text.index("projection_matrix")
    head, _, rest = text[start:end].partition("[")
    numbers = [f"{float(word):.{digits}f}" for word in rest.partition("]")[0].split(",")]
    return f"{text[:start]}{head}[{', '.join(numbers)}]}}\n{text[end:]}"


@pytest.mark.parametrize("suffix", [".yaml", ".xml", ".json"])
def test_opencv_reads_what_we_write_and_writes_what_we_read(tmp_path, suffix):
    rig = rig_of(LENSES["12"], world=False)
    ours, theirs = tmp_path / f"ours{suffix}", tmp_path / f"theirs{suffix}"
    write_calibration(rig, [ours], "opencv")
    storage = cv2.FileStorage(str(ours), cv2.FILE_STORAGE_READ)
    for number, camera in enumerate(rig.cameras, 1):
        assert np.array_equal(storage.getNode(f"M{number}").mat(), camera.matrix)
        assert tuple(storage.getNode(f"D{number}").mat().ravel()) == coefficients_of(camera)
        assert storage.getNode(f"image_size{number}").mat().ravel().tolist() == list(camera.size_px)
    rotation, translation = rig.relative_pose()
    assert np.array_equal(storage.getNode("R").mat(), rotation)
    assert np.array_equal(storage.getNode("T").mat().ravel(), translation)
    storage.release()
    storage = cv2.FileStorage(str(theirs), cv2.FILE_STORAGE_WRITE)
    for name, camera in zip(("left", "right"), rig.cameras, strict=True):
        storage.write(f"cameraMatrix_{name}", camera.matrix)
        storage.write(f"distCoeffs_{name}", np.array([coefficients_of(camera)]))
        storage.write(f"image_size_{name}", np.array(camera.size_px))
    storage.write("R", rotation)
    storage.write("T", translation * 1000)
    storage.write("rms", 0.21)
    storage.write("note", "measured: by hand # twice")
    storage.release()
    assert_same(read_calibration([theirs], Stated("mm")).rig, rig)


#: A vector as OpenCV 5 writes it; OpenCV 4 writes a matrix of one column.
VECTORS = {
    ".yaml": ": !!opencv-nd-matrix\n   sizes: [ 5 ]\n   dt: d\n   data: [ 0.1, -0.2, 0., 0., 0.03 ]\n",
    ".xml": ' type_id="opencv-nd-matrix"><sizes>5</sizes><dt>d</dt><data>0.1 -0.2 0. 0. 0.03</data></',
    ".json": ': {"type_id": "opencv-nd-matrix", "sizes": [ 5 ], "dt": "d", "data": [0.1, -0.2, 0, 0, 0.03]}',
}


@pytest.mark.parametrize("suffix", VECTORS)
def test_a_vector_of_opencv_5_is_read(tmp_path, suffix):
    key, matrix = "distortion_coefficients", "400, 0, 320, 0, 400, 240, 0, 0, 1"
    text = {
        ".yaml": "%YAML 1.2\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        f"   data: [ {matrix} ]\n{key}{VECTORS['.yaml']}image_size: [ 640, 480 ]\n",
        ".xml": '<?xml version="1.0"?><opencv_storage><camera_matrix type_id="opencv-matrix"><rows>3</rows>'
        f"<cols>3</cols><dt>d</dt><data>{matrix.replace(',', '')}</data></camera_matrix><{key}{VECTORS['.xml']}{key}>"
        "<image_size>640 480</image_size></opencv_storage>",
        ".json": '{"camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", '
        f'"data": [{matrix}]}}, '
        f'"{key}"{VECTORS[".json"]}, "image_size": [ 640, 480 ]}}',
    }[suffix]
    path = tmp_path / f"camera{suffix}"
    path.write_text(text, encoding="utf-8")
    assert coefficients_of(read_calibration([path]).rig.cameras[0]) == (0.1, -0.2, 0.0, 0.0, 0.03)


def test_an_archive_of_numpy_is_read(tmp_path):
    rig = rig_of(LENSES["5"], world=False)
    rotation, translation = rig.relative_pose()
    path = tmp_path / "stereo.npz"
    np.savez(
        path, mtxL=rig.cameras[0].matrix, distL=coefficients_of(rig.cameras[0]), mtxR=rig.cameras[1].matrix,
        distR=coefficients_of(rig.cameras[1]), R=rotation, T=translation / 0.0254, rms=0.2,
        images=np.zeros((20, 30, 40)),
    )  # fmt: skip
    found = read_calibration([path], Stated("in", ((640, 480), (1280, 960))))
    assert_same(found.rig, rig)


def test_a_single_camera_is_a_rig_of_one(tmp_path):
    text = INTRINSICS.partition("M2:")[0].replace("M1", "camera_matrix").replace("D1", "distortion_coefficients")
    (path,) = write(tmp_path, camera__yml=text + "image_width: 752\nimage_height: 480\n")
    found = read_calibration([path])
    assert len(found.rig.cameras) == 1
    assert_same(found.rig, CalibratedRig(HEAD.cameras[:1]))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("intrinsics: [458.654", "intrinsics: [-458.654", "cam0: fx is -458.654 px"),
        ("intrinsics: [458.654", "intrinsics: [.nan", "intrinsics has a number that is not finite"),
        ("intrinsics: [458.654", "intrinsics: [1e999", "intrinsics has a number that is not finite"),
        ("intrinsics: [458.654, ", "intrinsics: [", "intrinsics has 3 numbers, not 4"),
        ("resolution: [752, 480]\n  rostopic: /cam0", "rostopic: /cam0", "cam0: 'resolution' is missing"),
        ("resolution: [752, 480]", "resolution: [0, 480]", "a width of 0"),
        (f"[{R[0]}", "[1.1", "cam1: R is not a rotation: R times its transpose is off"),
        (f"[{R[0]}", f"[{float(R[0]) + 2e-6!r}", "R is not a rotation"),
        ("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 1.0, 1.0]", "the last row"),
        ("  T_cn_cnm1:", "  T_cam_imu:", "cam1: T_cn_cnm1 is missing"),
        ("camera_model: pinhole", "camera_model: omni", "camera model 'omni', but only pinhole"),
        ("distortion_model: radtan", "distortion_model: fov", "distortion model 'fov'"),
        ("cam0:", "cam0: !!python/object/apply:os.system [true]\ncam2:", "line 1: a tag, '!!python/object"),
        ("camera_model: pinhole", "camera_model: &a pinhole", "an anchor"),
        ("camera_model: pinhole", "camera_model: *a", "an alias"),
        ("camera_model: pinhole", "camera_model: |\n    pinhole", "a text over several lines"),
        ("camera_model: pinhole", "\tcamera_model: pinhole", "indented by a tab"),
        ("cam1:", "cam0:", "states 'cam0' again"),
        ("distortion_coeffs: [-0.28, 0.07, -0.0001,\n    -3.6e-05]", "distortion_coeffs: [-0.28", "is cut off"),
        ("cam_overlaps: [1]", f"cam_overlaps: {'[' * 5000}{']' * 5000}", "nested too deeply"),
        ("cam_overlaps: [1]", "cam_overlaps: [1 2", "is cut off"),
        ("cam_overlaps: [1]", "cam_overlaps: [1] 2", "follows the end"),
    ],
)
def test_a_wrong_camchain_is_a_sentence(tmp_path, old, new, words):
    (path,) = write(tmp_path, camchain__yaml=kalibr_as(old, new))
    with pytest.raises(IcyMoonError) as caught:
        read_calibration([path], name="kalibr")
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("4.58654e+02, 0., 3", "4.58654e+02, 1., 3", "a skew of 1 px in M1, which OpenCV's functions leave"),
        ("2.48375e+02, 0., 0., 1.", "2.48375e+02, 0., 1., 1.", "M1 is not a camera matrix"),
        ("4.58654e+02", "-4.58654e+02", "M1: fx is -458.654 px"),
        ("cols: 5\n   dt: d\n   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5, 0. ]",
         "cols: 4\n   dt: d\n   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5 ]", "4 coefficients in D1, .*; add --lens brown"),
        ("cols: 5\n   dt: d\n   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5, 0. ]",
         "cols: 6\n   dt: d\n   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5, 0., 0. ]", "D1: .*coefficients, not 6"),
        ("cols: 5\n   dt: d\n   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5, 0. ]",
         f"cols: 14\n   dt: d\n   data: [ {'0., ' * 13}0.1 ]", "has the tilted sensor of OpenCV"),
        ("cols: 5", "cols: 999999", "D1 has 5 numbers, not 999999"),
        ("D2:", "E2:", "has no distortion D2; write zeros for a pinhole.$"),
        ("M2:", "E2:", "has no camera matrix M2"),
        ("M1:", "lens_model1: tele\nM1:", "the lens model 'tele'"),
        ("%YAML:1.0", "%YAML:1.0\nimage_size: [752.5, 480]", "not width and height in pixels"),
    ],
)  # fmt: skip
def test_a_wrong_file_of_opencv_is_a_sentence(tmp_path, old, new, words):
    assert old in INTRINSICS
    paths = write(tmp_path, a__yml=INTRINSICS.replace(old, new, 1), b__yml=EXTRINSICS)
    with pytest.raises(IcyMoonError, match=words):
        read_calibration(paths, Stated("mm", () if "image_size" in new else ((752, 480),)))


def test_four_coefficients_are_what_the_user_states(tmp_path):
    short = "cols: 4\n   dt: d\n   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5 ]"
    text = INTRINSICS.replace("cols: 5\n   dt: d\n   data: [ -0.28, 0.07, 2.0e-4, 1.8e-5, 0. ]", short)
    paths = write(tmp_path, a__yml=text.partition("M2:")[0].replace("M1", "K").replace("D1", "D"))
    lenses = [
        read_calibration(paths, Stated(sizes=((752, 480),), lens=lens)).rig.cameras[0].lens
        for lens in ("brown", "fisheye")
    ]
    assert lenses == [Brown((-0.28, 0.07, 2e-4, 1.8e-5, 0.0)), Fisheye((-0.28, 0.07, 2e-4, 1.8e-5))]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.xml", "<!DOCTYPE a [<!ENTITY b 'c'>]><opencv_storage><M1>&b;</M1></opencv_storage>", "a document type"),
        ("x.xml", "<opencv_storage><M1>", "not a calibration of OpenCV"),
        ("x.npz", b"PK\x03\x04" + bytes(40), "list of members"),
        ("x.yaml", "", "is empty; give a calibration"),
        ("x.yaml", "- camera_matrix: 1\n- 2\n", "not a mapping"),
        ("x.yaml", b"image_width: \xff\xfe", "not text"),
        ("x.cameramodel", MRCAL_FILES[0].replace("OPENCV4", "SPLINED_STEREOGRAPHIC"), "mrcal-convert-lensmodel"),
        ("x.cameramodel", MRCAL_FILES[0].replace("OPENCV4", "OPENCV8"), "has 8 intrinsics, not 12"),
        ("x.cameramodel", MRCAL_FILES[0].replace("'extrinsics'", "'other'"), "extrinsics are missing"),
        ("x.cameramodel", MRCAL_FILES[0].replace("[ 458", "[ __import__('os'), 458"), "a mapping|a list"),
        ("x.cameramodel", MRCAL_FILES[0][:200], "cut off"),
        ("x.json", TRANSFORMS.replace('"k2": 0.07', '"k2": 0.07, "k4": 0.1'), "frames.0.: k4 is not 0"),
        ("x.json", TRANSFORMS.replace('"w": 752,', ""), "frames.0.: 'w' is missing"),
        ("x.json", TRANSFORMS.replace("OPENCV", "EQUIRECTANGULAR"), "EQUIRECTANGULAR"),
        ("x.json", '{"frames": []}', "no frames"),
        ("x.json", '{"frames": [3]}', "another kind"),
        ("x.json", TRANSFORMS[:300], "not a transforms.json"),
    ],
)
def test_a_hostile_or_wrong_file_is_a_sentence(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(IcyMoonError, match=words) as caught:
        read_calibration([path])
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("cameras", "images", "words"),
    [
        (CAMERAS.replace("OPENCV", "FOV"), IMAGES, "camera model 'FOV'"),
        (CAMERAS.replace(" 1.8e-05", ""), IMAGES, "line 3: OPENCV has 7 parameters"),
        (CAMERAS.replace("458.654", "0"), IMAGES, "line 3: fx is 0 px"),
        (CAMERAS.partition("\n2 ")[0], IMAGES, "'right.png' has the camera 2, which is not in the file"),
        (CAMERAS, IMAGES.replace("1 1.0 0.0", "1 0.0 0.0"), "quaternion has length 0"),
        (CAMERAS, IMAGES.replace("1 1.0 0.0", "1 nan 0.0"), "not finite"),
        (CAMERAS, IMAGES[:-60], "line 4 is not an image"),
        (CAMERAS, "", "at least one camera"),
    ],
)
def test_a_wrong_model_of_colmap_is_a_sentence(tmp_path, cameras, images, words):
    write(tmp_path, cameras__txt=cameras, images__txt=images)
    with pytest.raises(IcyMoonError, match=words):
        read_calibration([tmp_path])


def test_a_folder_of_something_else_is_a_sentence(tmp_path):
    with pytest.raises(IcyMoonError, match=r"has no cameras\.txt or cameras\.bin"):
        read_calibration([tmp_path])


def test_a_large_file_is_refused_before_it_is_read(tmp_path):
    (path,) = write(tmp_path, x__yaml=b"cam0:\n" + b" " * 5_000_000)
    with pytest.raises(IcyMoonError, match="has 5 MB, and 4"):
        read_calibration([path])


def test_quotes_and_brackets_without_an_end_take_no_time(tmp_path):
    """Each would be looked at again from every place before it, by a pattern that searches."""
    count = 100_000
    for hostile in ('"\\' * count, "'[" * count, "a: [" + "1," * count, "{" * count, "# '" * count):
        (path,) = write(tmp_path, x__yaml="cam0:\n  a: " + hostile)
        with pytest.raises(IcyMoonError):
            read_calibration([path])


def test_a_principal_point_outside_the_image_is_told(tmp_path):
    """As where width and height are swapped."""
    (path,) = write(tmp_path, camchain__yaml=KALIBR.replace("[752, 480]", "[240, 480]"))
    notes = read_calibration([path]).notes
    assert len(notes) == 2
    assert notes[0].startswith("The principal point of cam0, (367.215, 248.375) px, is outside its images of 240 x 480")


@pytest.mark.parametrize(
    ("stated", "likely"),
    [
        ((480, 752), "752 x 480"),
        ((1504, 960), "752 x 480"),
        ((368, 249), "736 x 498"),
        ((752, 480), ""),
        ((900, 500), ""),
    ],
)
def test_a_size_of_which_another_is_likelier_is_told(tmp_path, stated, likely):
    """Exchanged, or of images that were scaled; a cropped image has no likelier size."""
    (path,) = write(tmp_path, camchain__yaml=KALIBR.replace("[752, 480]", str(list(stated))))
    notes = [note for note in read_calibration([path]).notes if "principal point of cam0" in note]
    ends = f"near the middle of images of {likely} px; is the size right?"
    assert [note.endswith(ends) for note in notes] == [True] * bool(likely)


def test_a_lens_that_folds_inside_the_image_is_told(tmp_path):
    (path,) = write(tmp_path, camchain__yaml=KALIBR.replace("[-0.28, 0.07, 0.0002", "[-0.58, 0.07, 0.0002"))
    (note,) = read_calibration([path]).notes
    assert "of the pixels of cam0 see nothing" in note


def test_files_of_two_formats_are_refused(tmp_path):
    paths = write(tmp_path, a__yaml=KALIBR, b__cameramodel=MRCAL_FILES[0])
    with pytest.raises(IcyMoonError, match="several kinds, kalibr, mrcal"):
        read_calibration(paths)


def test_a_number_of_files_that_does_not_fit_is_refused(tmp_path):
    rig = rig_of(LENSES["pinhole"])
    with pytest.raises(IcyMoonError, match="mrcal needs 2 files for these cameras, not 1"):
        write_calibration(rig, [tmp_path / "a.cameramodel"], "mrcal")
    with pytest.raises(IcyMoonError, match="ROS holds 2 cameras, not 3"):
        write_calibration(CalibratedRig((*rig.cameras, rig.cameras[0])), [tmp_path / "a"] * 3, "ros")
    with pytest.raises(IcyMoonError, match="ROS holds pairs, and this is one camera"):
        write_calibration(CalibratedRig(rig.cameras[:1]), [tmp_path / "a"], "ros")
    (path,) = write(tmp_path, a__yaml=KALIBR)
    with pytest.raises(IcyMoonError, match="a calibration of Kalibr has 1 file at most"):
        read_calibration([path, path])
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.yaml"]


@pytest.mark.parametrize("name", ["kalibr", "ros"])
def test_small_numbers_are_numbers_for_pyyaml(tmp_path, name):
    """YAML 1.1 takes 2e-05 for a text: its floats have a point."""
    yaml = pytest.importorskip("yaml")
    bent = Brown((-1e-5, 2e-5, 1e-300, 3e-7, 0))
    left = CalibratedCamera(640, 480, 410.0, 395.0, 301.25, 262.5, bent)
    rig = CalibratedRig((left, left.placed(np.eye(3), np.array([-1e-4, 0, 0]))))
    paths = paths_for(tmp_path, name, ".yaml")
    write_calibration(rig, paths, name)
    stated = yaml.safe_load(paths[0].read_text(encoding="utf-8"))
    numbers = stated["cam0"]["distortion_coeffs"] if name == "kalibr" else stated["distortion_coefficients"]["data"]
    assert tuple(numbers[:4]) == bent.coefficients[:4]


@pytest.mark.parametrize("value", [2e-5, -1e-300, 1e22, 1e16, 0.0, -0.0, 1.5e-7, 3, 123456.789, 5e-324])
def test_a_number_is_written_as_a_float_of_yaml_1_1(value):
    """By the rule of yaml.org/type/float.html, which has a point in all of them."""
    word = write_number(value)
    assert re.fullmatch(r"[-+]?[0-9][0-9_]*\.[0-9_]*([eE][-+][0-9]+)?", word)
    assert float(word) == value
    assert parse_yaml(f"a: {word}") == {"a": value}


def test_a_matrix_of_opencv_has_numbers_of_yaml_1_1(tmp_path):
    left = CalibratedCamera(640, 480, 410.0, 395.0, 301.25, 262.5, Brown((2e-5, 0, 0, 0, 0)))
    write_calibration(CalibratedRig((left,)), [tmp_path / "a.yaml"], "opencv")
    assert "2.0e-05" in (tmp_path / "a.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("cut", [60, 200, 230, -3])
def test_a_model_of_mrcal_that_is_cut_off_is_told_so(tmp_path, cut):
    (path,) = write(tmp_path, a__cameramodel=MRCAL_FILES[0][:cut])
    with pytest.raises(IcyMoonError, match="the file is cut off"):
        read_calibration([path])


@pytest.mark.parametrize("suffix", ["kalibr", "mrcal", "ros", "cahv"])
def test_what_a_file_states_cannot_be_stated_otherwise(tmp_path, suffix):
    paths = paths_for(tmp_path, suffix, FORMATS[suffix].suffix)
    rig = rig_of(Brown(), world=False)
    write_calibration(rig, paths, suffix)
    for stated, words in (
        (Stated("mm"), "states metres; leave out --unit mm, or write metres into the file"),
        (Stated(sizes=((640, 480),)), "images have 1280 x 960 px in the file; leave out --size"),
        (Stated(sizes=((640, 480),) * 3), "--size states 3 sizes, and there are 2 cameras"),
        (Stated(lens="fisheye"), "states its lens; leave out --lens fisheye"),
    ):
        with pytest.raises(IcyMoonError, match=words):
            read_calibration(paths, stated)
    same = read_calibration(paths, Stated("m", ((640, 480), (1280, 960)))).rig
    assert_same(same, read_calibration(paths).rig)


def test_a_file_of_opencv_keeps_what_it_states(tmp_path):
    path = tmp_path / "a.yml"
    write_calibration(HEAD, [path], "opencv")
    for stated, words in (
        (Stated("mm"), "states lengths in m; leave out --unit mm"),
        (Stated(sizes=((640, 480),)), "images have 752 x 480 px in the file; leave out --size"),
        (Stated(lens="fisheye"), "states the lens brown; leave out --lens fisheye"),
    ):
        with pytest.raises(IcyMoonError, match=words):
            read_calibration([path], stated)
    assert_same(read_calibration([path], Stated("m", ((752, 480),), "brown")).rig, HEAD)
    path.write_text(path.read_text(encoding="utf-8").replace('unit: "m"', 'unit: "ell"'), encoding="utf-8")
    with pytest.raises(IcyMoonError, match="unit is 'ell'; write one of m, cm, mm, in there"):
        read_calibration([path])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("data: [ 4.58654e+02", "data: [ .nan"),
        (f"data: [ {R[0]}", f"data: [ {-float(R[0])!r}"),
        ("2.48375e+02, 0., 0., 1.", "2.48375e+02, 0., 1., 1."),
    ],
)
def test_a_wrong_number_is_not_taken_for_a_missing_matrix(tmp_path, old, new):
    texts = [INTRINSICS, EXTRINSICS]
    assert any(old in text for text in texts)
    paths = write(tmp_path, a__yml=texts[0].replace(old, new), b__yml=texts[1].replace(old, new))
    with pytest.raises(
        IcyMoonError, match=r"a\.yml with .*b\.yml: is not .*; correct that value, or calibrate again\.$"
    ):
        read_calibration(paths, Stated("mm", ((752, 480),)))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "docker-compose.yml",
            "services:\n  web:\n    image: nginx\n    width: 3\n",
            "no .*OpenCV.*, no .*ROS.* and no .*Kal",
        ),
        ("a.yaml", bytes(range(256)), "is not a known calibration"),
        ("a.yaml", "\n \n", "is empty; give a calibration"),
        ("a.json", "", "is empty; give a calibration"),
        ("a.npz", "", "is empty; give a calibration"),
        ("a.cahvor", "", "is empty; give a calibration"),
    ],
)
def test_a_file_of_something_else_is_no_calibration(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(IcyMoonError, match=words) as caught:
        read_calibration([path])
    assert str(path) in str(caught.value)
    assert "camera_calibration" not in str(caught.value)
