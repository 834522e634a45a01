"""Renders a scene that Icy Moon exported for Mitsuba 3, and writes radiance and depth as NumPy arrays.

    python mitsuba_render.py scene_left.xml [SAMPLES [SEED]]

Needs NumPy and Mitsuba 3.6 or later with its variant ``llvm_ad_rgb``, so an LLVM library, and nothing of Icy Moon.
Beside the scene it writes ``scene_left_radiance.npy``, (H, W, 3) in W/(m² sr), and ``scene_left_depth.npy``, (H, W)
planar depth in metres at pixel centres, NaN for sky.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np


def render(scene_file: Path, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Render the radiance (H, W, 3), W/(m² sr), and the depth (H, W), m, of a scene."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    for law in ("hapke", "snow"):
        if f"icymoon_{law}" in scene_file.read_text(encoding="utf-8"):
            # Import the module beside this file; code that comes with a scene is not run.
            importlib.import_module(f"mitsuba_{law}").register()
    scene = mi.load_file(str(scene_file))
    radiance = np.array(mi.render(scene, spp=samples, seed=seed))
    camera = ElementTree.parse(scene_file).getroot().find("sensor")
    assert camera is not None
    numbers = {each.get("name"): each.get("value", "") for each in camera.iter()}
    height, width = radiance.shape[:2]
    half = np.tan(np.radians(float(numbers["fov"])) / 2)
    right, down = (float(numbers[f"principal_point_offset_{axis}"]) for axis in "xy")
    x = (1 - 2 * ((np.arange(width) + 0.5) / width - right)) * half
    y = (1 - 2 * ((np.arange(height) + 0.5) / height - down)) * half * height / width
    matrix = camera.find("transform/matrix")
    assert matrix is not None
    pose = np.array([float(number) for number in matrix.get("value", "").split()]).reshape(4, 4)
    local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1).reshape(-1, 3)
    length = np.linalg.norm(local, axis=1)
    way = (local / length[:, None]) @ pose[:3, :3].T
    found = scene.ray_intersect(
        mi.Ray3f(
            mi.Point3f(*(np.full(len(way), axis, np.float32) for axis in pose[:3, 3])),
            mi.Vector3f(*way.T.astype(np.float32)),
        )
    )
    distance = np.array(found.t, np.float64)
    # The Sun's disk, 1e9 m away, is no ground.
    depth = np.where(np.isfinite(distance) & (distance < 1e8), distance / length, np.nan)
    return radiance, depth.reshape(height, width)


def main(arguments: list[str]) -> int:
    """Render the scene that the arguments name."""
    if not arguments:
        sys.exit(__doc__)
    file = Path(arguments[0])
    samples, seed = (int(number) for number in (*arguments[1:3], *("64", "1")[len(arguments) - 1 :]))
    radiance, depth = render(file, samples, seed)
    np.save(file.with_name(f"{file.stem}_radiance.npy"), radiance)
    np.save(file.with_name(f"{file.stem}_depth.npy"), depth)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
