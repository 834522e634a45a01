"""The lander whose decisions are studied on grounds by rays, and the terrains on which it stands."""

from __future__ import annotations

from ...settings.description import defaults, merged
from ...settings.preset_files import load_preset

#: The terrains of training on which most workspaces with few rocks or none have a safe site: chosen by the truth alone.
GENTLE_TERRAINS = ("europa_ridged_plain", "low_1", "low_2", "low_3", "smooth", "sublimation_pits")
#: The camera of the plan ``datasets/workspaces``, and a workspace to its right: without knowledge of the relief, block
#: matchers search up to some 110 px, and measure nothing in as many columns at the left.
LANDER = merged(
    merged(merged(defaults(), load_preset("rigs/guiss")), load_preset("sensors/default")),
    {
        "rig": {"focal_length_mm": 64.0, "width_px": 320, "height_px": 240},
        "workspace": {"cell_m": 0.02, "size_m": 1.2, "east_m": 0.3, "north_m": 1.6},
    },
)
#: Rays of a pixel of its images.
RAYS_PER_PIXEL = 2
