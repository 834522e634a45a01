"""Heads like real ones: two cameras that are not alike, as settings and as a calibration."""

from __future__ import annotations

from typing import Any

import numpy as np
from icymoon.commands.calibrated_eyes import calibrated_settings
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from icymoon.physics.camera.lens_models import Brown, Cahvore, Fisheye
from icymoon.physics.camera.rotations import from_vector
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.scene import Settings


def _pose(degrees: tuple[float, float, float], centre_m: tuple[float, float, float]) -> dict[str, Any]:
    rotation = from_vector(np.radians(degrees))
    return {"rotation": rotation, "translation_m": -rotation @ np.array(centre_m)}


#: Nearly alike, as a mast's two cameras of one make; verged and rolled with another lens and size; two wide lenses.
HEADS = {
    "nearly alike": CalibratedRig(
        (
            CalibratedCamera(96, 72, 98.31, 98.29, 47.9, 36.2, Brown((-0.11, 0.021, 3e-4, -5e-4, 0.002)), name="left"),
            CalibratedCamera(
                96,
                72,
                99.02,
                98.97,
                45.1,
                35.0,
                Brown((-0.105, 0.018, -2e-4, 4e-4, 0.001)),
                **_pose((0.05, 0.21, -0.12), (0.12, 2e-4, -7e-4)),
                name="right",
            ),
        )
    ),
    "verged and rolled": CalibratedRig(
        (
            CalibratedCamera(
                96, 72, 120.5, 117.0, 50.2, 33.4, Brown((0.2, -0.3, 1e-3, -2e-3, 0.05, 0.4, -0.2, 0.03)), name="left"
            ),
            CalibratedCamera(
                128, 64, 131.0, 133.0, 60.5, 30.0, skew_px=0.7, **_pose((1.0, 9.0, -4.0), (0.3, 0.01, 0.02)),
                name="right",
            ),
        )
    ),
    "fisheye and CAHVORE": CalibratedRig(
        (
            CalibratedCamera(96, 72, 60.0, 61.0, 47.0, 36.0, Fisheye((0.03, -0.01, 0.004, -0.001)), name="left"),
            CalibratedCamera(
                90,
                80,
                66.0,
                66.0,
                44.0,
                41.0,
                Cahvore((0.01, -0.02, float(np.sqrt(1 - 5e-4))), (1e-3, 0.02, -0.01), (1e-3, 2e-4, -1e-4), 0.4),
                **_pose((-0.6, 3.0, 1.0), (0.2, 0.0, 0.0)),
                name="right",
            ),
        )
    ),
}  # fmt: skip


def head_settings(name: str, **rig: Any) -> Settings:
    """Complete settings with the eyes of a head; ``rig`` are more settings of the rig."""
    found, _ = calibrated_settings(HEADS[name], "they differ", ["a.yaml"], "kalibr")
    return merged(defaults(), found, {"rig": rig})
