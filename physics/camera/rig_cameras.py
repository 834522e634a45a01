"""The two eyes of a scene's rig as calibrated cameras, for the formats of calibrations."""

from __future__ import annotations

from dataclasses import replace

from ...settings.topics.camera import RigSettings
from ...settings.topics.scene import Settings
from .calibrated_camera import CalibratedCamera, CalibratedRig
from .eyes import make_camera_with_eyes
from .lens_distortion import read_coefficients
from .lens_models import Brown
from .stereo_camera import StereoCamera


def make_calibrated_rig(settings: Settings) -> CalibratedRig:
    """Make calibrated cameras of both eyes of complete settings, in the axes of the left eye.

    Raises ValueError for numbers that no lens has.
    """
    pair = make_camera_with_eyes(settings)
    eyes = pair.eyes or tuple(_make_identical_eye(pair, settings.rig, eye) for eye in ("left", "right"))
    named = (replace(camera, name=name) for camera, name in zip(eyes, ("left", "right"), strict=True))
    return CalibratedRig(tuple(named)).from_first()


def _make_identical_eye(pair: StereoCamera, rig: RigSettings, eye: str) -> CalibratedCamera:
    """Make an eye of a pair with two identical eyes, in the axes of the left eye of the parallel rig."""
    focal, rotation = pair.focal_px, pair.eye_rotation(eye)
    return CalibratedCamera(
        pair.width_px,
        pair.height_px,
        focal,
        focal,
        pair.cx_px - 0.5,
        pair.cy_px - 0.5,
        Brown(read_coefficients(rig)),
        rotation=rotation,
        translation_m=-(pair.baseline_m if eye == "right" else 0.0) * rotation[:, 0],
    )
