"""Writes ``mrcal.json``: pixels and files of mrcal 2.2, for ``tests/formats/test_cahvor.py``.

apt-get install python3-mrcal
/usr/bin/python3 tests/data/make_mrcal.py
"""

import json
import tempfile
from pathlib import Path

import mrcal
import numpy as np

CAHVOR = [820, 815, 319.5, 239.5, 0.02, -0.01, 0.001, -0.2, 0.05]
CAHVORE = [820, 815, 319.5, 239.5, 0.02, -0.01, 0.001, -0.02, 0.005, 0.001, 0.002, 0.003]
BROWN = [820, 820, 317.5, 241.5, -0.21, 0.09]
CASES = {
    "CAHV": ("LENSMODEL_PINHOLE", CAHVOR[:4]),
    "CAHVOR": ("LENSMODEL_CAHVOR", CAHVOR),
    "BROWN": ("LENSMODEL_OPENCV5", [*BROWN, 0, 0, 0]),
    "BROWN_ALL": ("LENSMODEL_OPENCV5", [*BROWN, 4e-4, -3e-4, 0.012]),
    **{
        f"CAHVORE_{linearity:g}": (f"LENSMODEL_CAHVORE_linearity={linearity:.2f}", CAHVORE)
        for linearity in (-0.5, 0, 0.37, 1)
    },
}

random = np.random.default_rng(1)
to_world = mrcal.Rt_from_rt(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]))
points = (random.normal(size=(20, 3)) * [0.35, 0.28, 0.0] + [0, 0, 1]) * random.uniform(0.5, 30, size=(20, 1))
found = {"R": to_world[:3].tolist(), "t": to_world[3].tolist(), "points_camera": points.tolist(), "cases": {}}
for name, (kind, numbers) in CASES.items():
    data = np.array(numbers, float)
    case = {"data": numbers, "pixels": mrcal.project(np.ascontiguousarray(points), kind, data).tolist()}
    model = mrcal.cameramodel(intrinsics=(kind, data), imagersize=(640, 480), extrinsics_Rt_toref=to_world)
    if not name.startswith("BROWN") and "=-" not in kind:  # it writes no negative linearity
        with tempfile.TemporaryDirectory() as folder:
            model.write(f"{folder}/a.cahvor")
            case["file"] = Path(folder, "a.cahvor").read_text()
    found["cases"][name] = case
Path(__file__).with_name("mrcal.json").write_text(json.dumps(found, indent=0) + "\n")
