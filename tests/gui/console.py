"""Use the installed extension as a library in a real Blender without its window; runs inside it.

blender -b --addons bl_ext.user_default.icymoon --python-exit-code 1 --python tests/gui/console.py -- FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
from bl_ext.user_default import icymoon

folder = Path(sys.argv[sys.argv.index("--") + 1])
small = {
    "rig": {"width_px": 96, "height_px": 72},
    "quality": {"samples": 2, "denoiser": "NONE"},
    "terrain": {"resolution": 65},
    "rocks": {"coverage": 0.0},
}
scene = icymoon.Scene("enceladus_fresh_snow", **small).with_heights(lambda x_m, y_m: 0.1 * x_m + 0.05 * y_m)
with icymoon.InProcess() as blender:
    pair = scene.render(folder / "pairs", renderer=blender)
    lit = [
        point.pair.left.radiance.mean()
        for point in icymoon.Sweep(scene, folder / "sweep", {"light.sun_elevation_deg": [20.0, 50.0]}, renderer=blender)
    ]
assert lit[0] < lit[1]
assert pair.left.radiance.shape == (72, 96, 3)
assert np.isfinite(pair.disparity_px).any()
assert pair.occluded.dtype == bool
assert pair.develop("sensors/mer_ccd").left.shape == (72, 96)
assert [each.id for each in icymoon.open_pairs(folder / "pairs")] == [pair.id]
with icymoon.Worker() as worker:  # a second Blender
    other = scene.change(light={"sun_elevation_deg": 20.0}).render(folder / "pairs", renderer=worker)
assert other.id != pair.id
(made,) = icymoon.export_ground(scene, folder / "maps", cell_m=0.5)
assert (made / "dem.tif").is_file()
sample = icymoon.torch.Dataset(folder / "pairs").arrays(0)
assert sample["left"].shape == (1, 72, 96)
message = ""
try:
    icymoon.evaluate(pair, ["bm"], folder / "evaluation")
except icymoon.IcyMoonError as error:
    message = str(error)
assert "crash inside Blender" in message, message
print("CONSOLE passed", bpy.app.version_string)
