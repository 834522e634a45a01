"""The export ``raw``: images of the sensors, not rectified, and the calibration to rectify them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...physics.camera.lens_distortion import COEFFICIENTS, read_coefficients
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES
from ...support.arrays import Array
from ...support.files import write_json, write_text
from ..images.develop import describe_exposure
from ..images.image_files import write_npy, write_png
from ..images.views import read_sensor_depth
from ..measure.prepare import LoadedPair


def write_pair(pair: LoadedPair, folder: Path) -> None:
    """Write ``left.png`` (8-bit, or 16-bit with ``image_bits`` bits), ``depth_left.npy`` (metres
    along the axis of the eye, NaN for none), the same of the right eye, ``calibration.json``, and ``intrinsics.yml``
    and ``extrinsics.yml`` in the format of OpenCV's stereo programs.

    The image of a colour sensor is its mosaic, by ``sensor.bayer_pattern``. Single exposures that were merged are not
    written.
    """
    for eye, numbers in (("left", pair.images.detected_left), ("right", pair.images.detected_right)):
        write_png(folder / f"{eye}.png", numbers.astype(np.uint8) if pair.images.bits == 8 else numbers)
        write_npy(folder / f"depth_{eye}.npy", read_sensor_depth(pair.pair, eye, pair.settings.rig))
    camera, distortion = pair.pair.camera, read_coefficients(pair.settings.rig)
    opencv = make_opencv_calibration(camera, distortion)
    intrinsic = ("M1", "D1", "M2", "D2")
    write_text(folder / "intrinsics.yml", _to_opencv_yaml({key: opencv[key] for key in intrinsic}))
    write_text(folder / "extrinsics.yml", _to_opencv_yaml({k: v for k, v in opencv.items() if k not in intrinsic}))
    eyes = camera.eyes_json()
    write_json(
        folder / "calibration.json",
        {
            "pair": pair.pair.id,
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "toe_in_deg": camera.toe_in_deg,
            "pixel_centre": "(u + 0.5, v + 0.5)",
            "eyes": {eye: eyes[eye] | {"distortion": dict(zip(COEFFICIENTS, distortion, strict=True))} for eye in EYES},
            "opencv": {"pixel_centre": "(u, v)"} | {key: value.tolist() for key, value in opencv.items()},
            "poses_camera_to_world": pair.pair.data.get("poses_camera_to_world"),
            "sensor": pair.settings.sensor,
            **describe_exposure(pair.images),
            "self_check": pair.check.to_json(),
        },
    )


def make_opencv_calibration(camera: StereoCamera, distortion: tuple[float, ...]) -> dict[str, Array]:
    """The calibration under the names of OpenCV's stereo programs, lengths in metres, pixels counted from centres.

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
