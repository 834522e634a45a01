"""Synthetic pair folders with analytic truth, in the two layouts that Blenders write.

The scene is a textured, tilted plane, optionally with a rock in front of it and sky above. Both
eyes' depth and radiance are evaluated at the exact point that each pixel's ray meets, so the true
sub-pixel disparity is known to rounding.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from icymoon.physics.camera.blur import is_blurred
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.render.pairs.pair_folder import FORMAT, VERSION
from icymoon.settings.description import defaults, merged
from icymoon.support.arrays import Array

SKY_M = 1.0e10
#: What ``pair.json`` states of a pair with baked light.
BAKED = {"method": "BAKED", "share": 0.3, "noise": 0.001}


@dataclass(frozen=True)
class Scene:
    """Plane Z + slope_x X + slope_y Y = distance_m in the left camera's axes (x right, y down)."""

    distance_m: float = 2.0
    slope_x: float = 0.1
    slope_y: float = 0.6
    rock: bool = True  # a square of 0.5 m at 0.75 of the distance
    sky_rows: int = 0
    radiance: float = 3.0
    contrast: float = 0.8


def camera(width: int = 256, height: int = 144, baseline_m: float = 0.25) -> StereoCamera:
    """The paper's lens (f = 32/60 of the width) on a small image."""
    return StereoCamera(width, height, width * 32 / 60, width / 2, height / 2, baseline_m)


def view(scene: Scene, rig: StereoCamera, eye: str) -> tuple[Array, Array, Array]:
    """(depth with NaN sky, radiance, instance) of one eye, each (height, width) float64."""
    offset = rig.baseline_m if eye == "right" else 0.0
    x = ((np.arange(rig.width_px) + 0.5 - rig.cx_px) / rig.focal_px)[None, :]
    y = ((np.arange(rig.height_px) + 0.5 - rig.cy_px) / rig.focal_px)[:, None]
    depth = (scene.distance_m - scene.slope_x * offset) / (1 + scene.slope_x * x + scene.slope_y * y)
    instance = np.ones_like(depth)
    if scene.rock:
        near = 0.75 * scene.distance_m
        on_rock = (np.abs(x * near + offset) < 0.25) & (np.abs(y * near) < 0.25) & (near < depth)
        depth = np.where(on_rock, near, depth)
        instance = np.where(on_rock, 1000.0, instance)
    pixel_m = scene.distance_m / rig.focal_px
    light = scene.radiance * (1 + scene.contrast * _texture((x * depth + offset) / pixel_m, y * depth / pixel_m))
    depth = np.where(np.arange(rig.height_px)[:, None] < scene.sky_rows, np.nan, depth)
    return depth, np.where(np.isnan(depth), 0.0, light), np.where(np.isnan(depth), 0.0, instance)


def write_pair(
    folder: Path,
    scene: Scene | None = None,
    rig: StereoCamera | None = None,
    layout: str = "5.x",
    noise: float = 0.0,
    settings: dict[str, dict[str, Any]] | None = None,
    planet_share: float | None = None,
    baked_error: Array | None = None,
) -> Path:
    """Write a complete pair folder. ``layout`` '4.x' is one part per file, '4.x view' the same with the
    view's name in the channels, '5.x' one part per pass. ``noise`` is relative and independent per eye.
    With ``planet_share`` the light is in two groups, that share of it the planet's. With ``baked_error`` (H, W) the
    light is baked, and the left eye has this error of it."""
    scene, rig = scene or Scene(), rig or camera()
    folder.mkdir(parents=True)
    random = np.random.default_rng(int(hashlib.sha256(folder.name.encode()).hexdigest()[:8], 16))
    for eye in ("left", "right"):
        depth, light, instance = view(scene, rig, eye)
        light = light * (1 + noise * random.standard_normal(light.shape))
        write_exr(
            folder / f"{eye}.exr",
            depth,
            light,
            instance,
            layout,
            eye,
            planet_share,
            baked_error if eye == "left" else None,
        )
    complete = merged(
        settings or defaults(),
        {"rig": described(rig)},
        {} if baked_error is None else {"quality": {"indirect": "BAKED"}},
    )
    kinds = ["{}.exr"]
    if rig.toe_in_deg or is_blurred(complete.rig):
        kinds += ["{}_truth.exr", *(["{}_toed_truth.exr"] if rig.toe_in_deg else [])]
    names = [kind.format(eye) for kind in kinds for eye in ("left", "right")]
    for name in names[2:]:
        shutil.copy(folder / f"{name.split('_')[0]}.exr", folder / name)
    data = {
        "format": FORMAT,
        "version": VERSION,
        "id": id_of(folder.name),
        "camera": rig.to_json(),
        "settings": complete,
        **({} if baked_error is None else {"indirect": BAKED}),
        "files": {
            name: {
                "bytes": (folder / name).stat().st_size,
                "sha256": hashlib.sha256((folder / name).read_bytes()).hexdigest(),
            }
            for name in names
        },
    }
    (folder / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    return folder


def described(rig: StereoCamera) -> dict[str, Any]:
    """The ``rig`` settings that this camera is made of."""
    sensor_width_mm = defaults().rig.sensor_width_mm
    return {
        "width_px": rig.width_px,
        "height_px": rig.height_px,
        "baseline_m": rig.baseline_m,
        "sensor_width_mm": sensor_width_mm,
        "focal_length_mm": rig.focal_px * sensor_width_mm / rig.width_px,
        "principal_x_px": rig.cx_px - rig.width_px / 2,
        "principal_y_px": rig.cy_px - rig.height_px / 2,
        "overscan": rig.margin_x_px / rig.width_px,
        "toe_in_deg": rig.toe_in_deg,
    }


def id_of(name: str) -> str:
    """The id of a pair whose folder has this name."""
    return name if re.fullmatch("[0-9a-f]{12}", name) else hashlib.sha256(name.encode()).hexdigest()[:12]


def write_exr(
    path: Path,
    depth: Array,
    light: Array,
    instance: Array,
    layout: str,
    eye: str,
    planet_share: float | None = None,
    baked_error: Array | None = None,
) -> None:
    """One eye's file; ``depth`` has NaN for sky."""

    def single(values: Array) -> Array:
        return np.ascontiguousarray(values, np.float32)

    semantic = np.where(instance >= 1000, 2, np.minimum(instance, 1))
    ids = ("IndexOB", "IndexMA") if layout.startswith("4") else ("Object Index", "Material Index")
    passes = {
        ("Beauty", "Combined"): {band: single(light) for band in "RGB"} | {"A": single(light * 0 + 1)},
        ("Truth", "Depth"): {"Z": single(np.where(np.isnan(depth), SKY_M, depth))},
        ("Truth", "Normal"): {"X": single(depth * 0), "Y": single(depth * 0), "Z": single(depth * 0 + 1)},
        ("Truth", ids[0]): {"X": single(instance)},
        ("Truth", ids[1]): {"X": single(semantic)},
    }
    if planet_share is not None:
        for group, share in (("Sun", 1 - planet_share), ("Planet", planet_share)):
            passes["Beauty", f"Combined_{group}"] = {band: single(share * light) for band in "RGB"}
    if baked_error is not None:
        passes["Beauty", "BakedError"] = {"X": single(baked_error)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    word = f".{eye}" if layout == "4.x view" else ""
    if layout.startswith("4"):
        channels = {
            f"{layer}.{name}{word}.{component}": values
            for (layer, name), components in passes.items()
            for component, values in components.items()
        }
        OpenEXR.File(header, channels).write(str(path))
        return
    OpenEXR.File(
        [
            OpenEXR.Part(
                dict(header),
                {f"{layer}.{name}.{component}": values for component, values in components.items()},
                f"{layer}.{name}",
            )
            for (layer, name), components in passes.items()
        ]
    ).write(str(path))


def _texture(x: Array, y: Array) -> Array:
    """A fixed sum of waves of 5 to 40 units length in all directions, between -1 and 1."""
    random = np.random.default_rng(20)
    total = np.zeros(np.broadcast_shapes(x.shape, y.shape))
    waves = 40
    for wavelength, angle, phase in zip(
        np.geomspace(5, 40, waves), random.uniform(0, np.pi, waves), random.uniform(0, 2 * np.pi, waves), strict=True
    ):
        total += np.sin(2 * np.pi / wavelength * (x * np.cos(angle) + y * np.sin(angle)) + phase)
    return np.clip(total / np.sqrt(waves) / 2, -1, 1)
