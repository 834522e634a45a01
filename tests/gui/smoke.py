"""Use the installed extension in a real Blender without its window; runs inside it.

blender -b --addons bl_ext.user_default.icymoon --python-exit-code 1 --python tests/gui/smoke.py -- DATASET
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import bpy

dataset = Path(sys.argv[sys.argv.index("--") + 1])
operators = bpy.ops.icymoon

assert operators.load_preset(preset="scenes/europa_rough_ice") == {"FINISHED"}
group = bpy.context.scene.icymoon
group.terrain.resolution, group.quality.samples = 129, 2
group.rig.width_px, group.rig.height_px = 160, 120
group.dataset.folder = str(dataset)
for step in (operators.build_scene, operators.render_pair, operators.evaluate):
    assert step() == {"FINISHED"}, step
assert len(list(dataset.glob("pairs/*/pair.json"))) == 1
assert (dataset / "evaluation_scene" / "report.html").is_file()
plan = dataset / "plan.toml"
plan.write_text(
    '[plan]\ntitle = "Two"\n[mesh]\nkind = "GRID"\n[terrain]\nresolution = 65\n[rig]\nwidth_px = 64\n'
    'height_px = 48\n[quality]\nsamples = 1\n[[sweep]]\nkind = "panorama"\nheadings = 2\n'
)
group.dataset.plan, group.dataset.folder = str(plan), str(dataset / "set")
for step in (operators.plan_dry_run, operators.render_dataset):
    assert step() == {"FINISHED"}, step
assert len(list(dataset.glob("set/pairs/*/pair.json"))) == 2
assert operators.add_preset(title="Mine") == {"FINISHED"}
assert group.preset == "own/mine"  # which uninstalling removes too
assert operators.add_block() == {"FINISHED"}
assert operators.clear_scene() == {"FINISHED"}
assert not [c for c in bpy.data.collections if c.get("icymoon")]
# Scripts in Blender have the library, whose worker is another Blender.
library = importlib.import_module("bl_ext.user_default.icymoon")
scene = library.Scene(
    mesh={"kind": "GRID"}, terrain={"resolution": 65}, rig={"width_px": 64, "height_px": 48}, quality={"samples": 1}
)
for renderer in (library.Worker, library.InProcess):
    with renderer() as worker:
        pair = scene.render(dataset / renderer.__name__, renderer=worker)
    assert pair.left.radiance.shape == pair.right.radiance.shape == (48, 64, 3), renderer
print("SMOKE passed", bpy.app.version_string)
