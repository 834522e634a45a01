"""Heads like real ones: two cameras that are not alike, as settings and as a calibration."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pairs
from icymoon.commands.calibrated_eyes import make_calibrated_settings
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from icymoon.physics.camera.eyes import eyes_json, find_rays_in_rig, make_camera_with_eyes
from icymoon.physics.camera.lens_models import Brown, Cahvore, Fisheye
from icymoon.physics.camera.rotations import from_vector
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array


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


#: Heads as flown: a mast's pair of 60 degrees, whose eyes differ a little; two wide cameras near the ground of 120
#: degrees, verged and rolled; and two fisheyes of 180 degrees, whose circle lies within the images.
FLOWN = {
    "60 degrees": CalibratedRig(
        (
            CalibratedCamera(128, 96, 110.4, 110.1, 64.7, 46.9, Brown((-0.31, 0.12, 2e-4, -3e-4, -0.02)), name="left"),
            CalibratedCamera(
                128,
                96,
                110.9,
                110.7,
                62.1,
                48.8,
                Brown((-0.305, 0.115, -1e-4, 2e-4, -0.018)),
                **_pose((0.04, -0.11, 0.08), (0.424, 6e-4, -4e-4)),
                name="right",
            ),
        )
    ),
    "120 degrees, verged and rolled": CalibratedRig(
        (
            CalibratedCamera(128, 96, 61.0, 61.2, 63.1, 48.2, Fisheye((-0.02, 0.004, -1e-3, 1e-4)), name="left"),
            CalibratedCamera(
                128,
                96,
                60.4,
                60.6,
                64.6,
                47.1,
                Fisheye((-0.018, 0.003, -1e-3, 1e-4)),
                **_pose((0.8, 12.0, -4.0), (0.2, 4e-3, 6e-3)),
                name="right",
            ),
        )
    ),
    "180 degrees": CalibratedRig(
        (
            CalibratedCamera(100, 100, 30.6, 30.6, 49.5, 49.5, Fisheye(), name="left"),
            CalibratedCamera(
                104, 100, 31.0, 30.9, 50.9, 49.1, Fisheye((2e-3, -1e-3, 0.0, 0.0)),
                **_pose((0.4, 1.5, -0.6), (0.1, 1e-3, 0.0)), name="right",
            ),
        )
    ),
}  # fmt: skip


def head_settings(name: str, **rig: Any) -> Settings:
    """Complete settings with the eyes of a head; ``rig`` are more settings of the rig."""
    found, _ = make_calibrated_settings({**HEADS, **FLOWN}[name], "they differ", [Path("a.yaml")], "kalibr")
    return merged(defaults(), found, {"rig": rig})


def _rays(own: CalibratedCamera) -> Array:
    pixels = np.stack(np.meshgrid(np.arange(own.width_px), np.arange(own.height_px)), axis=-1)
    rays = find_rays_in_rig(own, pixels.astype(np.float64))
    return rays / rays[..., 2:]


def plane_seen(scene: pairs.Scene, own: CalibratedCamera, focal_px: float) -> tuple[Array, Array, Array]:
    """(depth along the eye's axis, depth along the rig's, light) that an eye's sensor sees of the plane of a scene."""
    rays = _rays(own)
    along = own.centre_m[0]
    ahead = (scene.distance_m - scene.slope_x * along) / (1 + rays[..., :2] @ [scene.slope_x, scene.slope_y])
    unit = scene.distance_m / focal_px
    x, y = (rays[..., 0] * ahead + along) / unit, rays[..., 1] * ahead / unit
    return ahead * (rays @ own.rotation[2]), ahead, scene.radiance * (1 + scene.contrast * pairs._texture(x, y))


def write_head(folder: Path, name: str, scene: pairs.Scene | None = None) -> Path:
    """Write a pair of a head that looks at a plane, with the truth on its sensors."""
    scene, settings = scene or pairs.Scene(rock=False), head_settings(name)
    camera = make_camera_with_eyes(settings)
    width, height = camera.rendered_px
    rendered = replace(
        camera.rectified,
        width_px=width,
        height_px=height,
        cx_px=camera.cx_px + camera.margin_x_px,
        cy_px=camera.cy_px + camera.margin_y_px,
    )
    pairs.write_pair(folder, scene, rendered)
    data = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    for eye, own in zip(("left", "right"), camera.eyes or (), strict=True):
        depth, _, light = plane_seen(scene, own, camera.focal_px)
        file = folder / f"{eye}_raw_truth.exr"
        pairs.write_exr(file, depth, light, np.ones_like(depth), "5.x", eye)
        content = file.read_bytes()
        data["files"][file.name] = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    data |= {"camera": camera.to_json(), "settings": settings, "eyes": eyes_json(camera, settings.rig)}
    (folder / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    return folder
