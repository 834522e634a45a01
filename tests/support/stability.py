"""Numbers of three landing sites that every Blender is to give: of the ground, the true depth and the light.

    python tests/support/stability.py       make stability.json anew, with the Blender that this Python has (5.0)

The table holds what is rendered with several seeds, and how far one render is off their mean: the noise.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import bpy
import icymoon
import numpy as np
from icymoon.nodes.build_scene import Built, build_scene
from icymoon.render.pairs.pair_folder import EYES, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.stereo.images.exr import read_view
from icymoon.support.labels import ROCK
from rendering import empty_scene

TABLE = Path(__file__).with_name("stability.json")
#: Renders of the table, each with other light paths.
REPEATS = 8
SIZE: Parts = {
    "mesh": {"most": 20_000},
    "quality": {"samples": 32, "denoiser": "NONE", "threads": 2, "truth_by": "CYCLES", "files": "FULL"},
    "rig": {"width_px": 64, "height_px": 48, "overscan": 0.0},
    # The table is of the presets before they had a far field, patchy relief and faces that differ.
    "hills": {"rms_slope_deg": 0.0},
    "rocks": {"beyond_px": 0.0},
    "surface": {"grain_patchiness": 0.0, "face_variation": 0.0, "patch_raggedness": 0.0},
}
_NIGHT = {
    "sun_elevation_deg": -20.0,
    "sun_azimuth_deg": 30.0,
    "planet": True,
    "planet_elevation_deg": 40.0,
    "planet_azimuth_deg": 200.0,
}
#: The rocks of the block field before they were broken ice.
_SOLIDS = {"family": "MIXED", "angularity": 0.7, "tilt_deg": 15.0, "burial": 0.25}
#: A scene preset and what is changed in it.
SCENES: dict[str, tuple[str, Parts]] = {
    "snow": ("enceladus_fresh_snow", {"quality": {"walk_px": 0.0}}),
    "hapke of OSL": ("europa_ridged_plain_hapke", {"hapke": {"backend": "OSL"}}),
    "hapke of nodes": ("europa_ridged_plain_hapke", {"hapke": {"backend": "NODES"}}),
    "planetshine": ("enceladus_block_field", {"surface": {"model": "LAMBERT"}, "light": _NIGHT, "rocks": _SOLIDS}),
}
_REGIONS = (3, 4)  # rows and columns that an image is divided into
_VERTICES, _ROWS, _COLUMNS = 41, slice(3, None, 7), slice(3, None, 8)  # of which single numbers are kept


def built(name: str) -> Built:
    """Build one of the scenes."""
    preset, changes = SCENES[name]
    return build_scene(
        empty_scene(),
        description.merged(
            description.defaults(),
            *(description.check(part, name) for part in (preset_files.load_preset(preset), changes, SIZE)),
        ),
    )


def of_ground(scene: Built) -> dict[str, Any]:
    """How many vertices there are, the mean of their coordinates' magnitudes, and some of them, metres."""
    mesh = scene.terrain.data
    flat = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", flat)
    position = flat.reshape(-1, 3).astype(np.float64)
    some = position[np.linspace(0, len(position) - 1, _VERTICES).astype(int)]
    return {
        "vertices": len(position),
        "faces": len(mesh.polygons),
        "magnitude": np.abs(position).mean(axis=0).tolist(),
        "some": some.tolist(),
    }


def of_pair(scene: Built, folder: Path, repeat: int = 0) -> dict[str, Any]:
    """By eye: radiance of the regions, depth of some pixels (0 for sky), share of pixels that show blocks."""
    planned = expand_headings(scene.settings, f"repeat {repeat}")
    (made,) = render_pairs(scene, planned, folder, 1, 0.0, lambda *a, **k: None)
    pair, found = read_pair(made), {}
    for eye in EYES:
        view = read_view(pair.image(eye), eye)
        rows, columns = view.depth.shape
        regions = (
            view.radiance.mean(axis=-1, dtype=np.float64)
            .reshape(_REGIONS[0], rows // _REGIONS[0], _REGIONS[1], columns // _REGIONS[1])
            .mean(axis=(1, 3))
        )
        found[eye] = {
            "radiance": regions.ravel().tolist(),
            "blocks": float(np.mean(view.semantic == ROCK)),
            "depth": np.nan_to_num(view.depth[_ROWS, _COLUMNS]).ravel().tolist(),
        }
    return found


def table(name: str, folder: Path) -> dict[str, Any]:
    """The entry of a scene: what is above, the radiance the mean of all repeats, and its noise in one of them."""
    scene = built(name)
    repeats = [of_pair(scene, folder, k) for k in range(REPEATS)]
    entry: dict[str, Any] = {"ground": of_ground(scene)}
    for eye in EYES:
        radiance = np.array([each[eye]["radiance"] for each in repeats])
        mean = radiance.mean(axis=1)
        entry[eye] = repeats[0][eye] | {
            "radiance": radiance.mean(axis=0).tolist(),
            "noise": radiance.std(axis=0, ddof=1).tolist(),
            "mean_noise": float(mean.std(ddof=1)),
        }
    return entry


def _short(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _short(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_short(each) for each in value]
    return float(f"{value:.8g}") if isinstance(value, float) else value


def main() -> None:
    """Write the table, a line for each scene and eye."""
    icymoon.register()
    with tempfile.TemporaryDirectory() as folder:
        made = {name: _short(table(name, Path(folder))) for name in SCENES}
    lines = [
        f'  "{name}": {{\n' + ",\n".join(f'    "{key}": {json.dumps(value)}' for key, value in entry.items()) + "\n  }"
        for name, entry in made.items()
    ]
    TABLE.write_text(f'{{\n  "blender": "{bpy.app.version_string}",\n' + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)
