"""The lander whose decisions are studied on ray-traced grounds, and the terrains on which it stands."""

from __future__ import annotations

from ...settings.description import defaults, merged
from ...settings.preset_files import load_preset

#: The training terrains on which most workspaces with few or no rocks have a safe site. The truth alone decided this.
GENTLE_TERRAINS = ("europa_ridged_plain", "low_1", "low_2", "low_3", "smooth", "sublimation_pits")
#: The camera of the plan ``datasets/workspaces``, and a workspace to its right. Without knowledge of the relief, block
#: matchers search up to some 110 px, and measure nothing in the same number of columns at the left.
LANDER = merged(
    merged(merged(defaults(), load_preset("rigs/guiss")), load_preset("sensors/default")),
    {
        "rig": {"focal_length_mm": 64.0, "width_px": 320, "height_px": 240},
        "workspace": {"cell_m": 0.02, "size_m": 1.2, "east_m": 0.3, "north_m": 1.6},
    },
)
#: Rays per pixel of the lander's images.
RAYS_PER_PIXEL = 2
