"""The export ``raw``: images of the sensors, not rectified, and the calibration to rectify them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...formats.calibrations.registry import FORMATS, write_calibration
from ...physics.camera.calibrated_camera import CalibratedRig
from ...physics.camera.eyes import eyes_json
from ...physics.camera.lens_distortion import read_coefficients
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES, describe_rolling_shutter
from ...support.arrays import Array
from ...support.files import write_json, write_text
from ..images.develop import describe_exposure
from ..images.image_files import write_npy, write_npz, write_png
from ..images.lens import make_lens
from ..images.views import read_sensor_depth, read_sensor_truth
from ..measure.prepare_pair import LoadedPair

TITLES = {"raw": "Raw: images of the sensors, not rectified, and the calibration that rectifies them"}
#: Formats of calibrations that are written if they can hold both calibrated eyes, and the names of their files.
_FORMATS = {
    "opencv": ("opencv.yaml",),
    "mrcal": ("left.cameramodel", "right.cameramodel"),
    "cahv": ("left.cahvor", "right.cahvor"),
}


def write_pair(pair: LoadedPair, folder: Path) -> None:
    """Write the images of both sensors, their depth and their calibration.

    The files are ``left.png`` (8-bit, or 16-bit with ``image_bits`` bits), ``depth_left.npy`` (metres along the axis of
    the eye, NaN for none), the same of the right eye, ``calibration.json``, and ``intrinsics.yml`` and
    ``extrinsics.yml`` in the format of OpenCV's stereo programs. The image of a colour sensor is its mosaic, by
    ``sensor.bayer_pattern``. Single exposures that were merged are not written.

    Calibrated eyes have no .yml files, but ``rectification_left.npz`` with ``map_x`` and ``map_y`` for OpenCV's
    ``remap`` and, if the pair has them, ``hidden_left.npy`` (bool, from the other eye) and ``normal_left.npy``. Their
    calibration is in ``opencv.yaml``, ``.cameramodel`` and ``.cahvor`` files, as far as these can hold both lenses.
    """
    for eye, numbers in (("left", pair.images.detected_left), ("right", pair.images.detected_right)):
        write_png(folder / f"{eye}.png", numbers.astype(np.uint8) if pair.images.bits == 8 else numbers)
        write_npy(folder / f"depth_{eye}.npy", read_sensor_depth(pair.pair, eye, pair.settings.rig))
    stated = _write_alike(pair, folder) if pair.pair.camera.eyes is None else _write_calibrated(pair, folder)
    write_json(
        folder / "calibration.json",
        {
            "pair": pair.pair.id,
            **stated,
            "poses_camera_to_world": pair.pair.data.get("poses_camera_to_world"),
            **describe_rolling_shutter(pair.pair),
            "sensor": pair.settings.sensor,
            **describe_exposure(pair.images),
            "self_check": pair.check.to_json(),
        },
    )


def _write_alike(pair: LoadedPair, folder: Path) -> dict[str, Any]:
    """Write the calibration of two identical eyes, and return its entries in ``calibration.json``."""
    camera, distortion = pair.pair.camera, read_coefficients(pair.settings.rig)
    opencv = make_opencv_calibration(camera, distortion)
    intrinsic = ("M1", "D1", "M2", "D2")
    write_text(folder / "intrinsics.yml", _to_opencv_yaml({key: opencv[key] for key in intrinsic}))
    write_text(folder / "extrinsics.yml", _to_opencv_yaml({k: v for k, v in opencv.items() if k not in intrinsic}))
    return {
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "toe_in_deg": camera.toe_in_deg,
        "pixel_centre": "(u + 0.5, v + 0.5)",
        "eyes": eyes_json(camera, pair.settings.rig),
        "opencv": {"pixel_centre": "(u, v)"} | {key: value.tolist() for key, value in opencv.items()},
    }


def _write_calibrated(pair: LoadedPair, folder: Path) -> dict[str, Any]:
    """Write the calibration of calibrated eyes, the maps that rectify their images, and their truth besides depth.

    Return the entries in ``calibration.json``.
    """
    camera, rig = pair.pair.camera, pair.settings.rig
    for eye in EYES:
        lens = make_lens(camera, rig, eye)
        assert lens is not None
        map_x, map_y = (np.ascontiguousarray(lens.rectified_in_sensor[..., k]) for k in (0, 1))
        write_npz(folder / f"rectification_{eye}.npz", {"map_x": map_x, "map_y": map_y})
        truth = read_sensor_truth(pair.pair, eye)
        for name, values in (("hidden", truth.hidden), ("normal", truth.normal)):
            if values is not None:
                write_npy(folder / f"{name}_{eye}.npy", values)
    cameras = CalibratedRig(tuple(replace(own, name=eye) for eye, own in zip(EYES, camera.eyes or (), strict=True)))
    held = [kind for kind in _FORMATS if not any(FORMATS[kind].why_not(each) for each in cameras.from_first().cameras)]
    for kind in held:
        write_calibration(cameras.from_first(), [folder / name for name in _FORMATS[kind]], kind)
    rectified = make_opencv_calibration(camera.rectified, ())
    return {
        "pixel_centre": "(u + 0.5, v + 0.5)",
        "eyes": eyes_json(camera, rig),
        "rectified": {
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "pixel_centre": "(u, v)",
            "R1": camera.eye_rotation("left").T.tolist(),
            "R2": camera.eye_rotation("right").T.tolist(),
            **{key: rectified[key].tolist() for key in ("P1", "P2", "Q")},
        },
        "files": {kind: list(_FORMATS[kind]) for kind in held},
    }


def make_opencv_calibration(camera: StereoCamera, distortion: tuple[float, ...]) -> dict[str, Array]:
    """Return the calibration under the names of OpenCV's stereo programs, lengths in metres, pixels counted from
    centres.

    M, D: matrix and distortion of each eye; x2 = R x1 + T; E, F: essential and fundamental matrix; R1, R2, P1, P2, Q:
    rectification to the parallel rig, to which the truth of the other exports belongs.
    """
    first, second = (camera.eye_rotation(eye) for eye in EYES)
    matrix = np.array(camera.matrix)
    matrix[:2, 2] -= 0.5
    rotation, shift = second @ first.T, -camera.baseline_m * second[:, 0]
    x, y, z = shift
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    inverse = np.linalg.inv(matrix)
    fundamental = inverse.T @ essential @ inverse
    projections = [np.column_stack([matrix, matrix @ [-along, 0.0, 0.0]]) for along in (0.0, camera.baseline_m)]
    to_space = np.array(
        [
            [1, 0, 0, -matrix[0, 2]],
            [0, 1, 0, -matrix[1, 2]],
            [0, 0, 0, camera.focal_px],
            [0, 0, 1 / camera.baseline_m, 0],
        ]
    )
    return {
        "M1": matrix,
        "D1": np.array([distortion]),
        "M2": matrix,
        "D2": np.array([distortion]),
        "R": rotation,
        "T": shift[:, None],
        "E": essential,
        "F": fundamental,
        "R1": first.T,
        "R2": second.T,
        "P1": projections[0],
        "P2": projections[1],
        "Q": to_space,
    }


def _to_opencv_yaml(values: dict[str, Any]) -> str:
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in values.items():
        storage.write(name, value)
    return str(storage.releaseAndGetString())
