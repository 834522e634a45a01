"""A small pair that states all that a rendered one does, as its settings give it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.physics.light.directions import camera_axes
from icymoon.physics.light.sky import compute_sky, describe_sky
from pairs import Scene, camera, write_pair
from plans import grid

PAIRS = grid(seeds=1, headings=(0.0,))


def whole(folder: Path, **more: Any) -> Path:
    """A small pair that says all that a rendered one does."""
    planned = PAIRS[0]
    write_pair(folder, Scene(), camera(32, 24), settings=planned.settings)
    path = folder / "pair.json"
    pose = np.eye(4)
    pose[:3, :3] = camera_axes(planned.settings.rig.heading_deg, planned.settings.rig.pitch_deg)
    beside = pose.copy()
    beside[:3, 3] = camera(32, 24).baseline_m * pose[:3, 0]
    poses = {"left": pose.tolist(), "right": beside.tolist()}
    data = json.loads(path.read_text()) | {
        "id": planned.id,
        "seeds": {"dataset": 0, "render": planned.render_seed},
        "versions": {"blender": "5.0.1"},
        "device": "CPU",
        "denoiser": "NONE",
        "platform": "here",
        "osl": True,
        "edited_by_hand": False,
        "own_files_sha256": "",
        "left_out": ["stars"],
        "blur": None,
        "peak_memory_mib": 300.0,
        "light": describe_sky(compute_sky(planned.settings.light)),
        "seconds": {"render": 1.5, "write": 0.1, "build": 0.5},
        "cpu_seconds": {"before": 1.0, "pair": 2.0},
        "poses_camera_to_world": poses,
        "poses_rectified_to_world": poses,
        **more,
    }
    path.write_text(json.dumps(data))
    return folder
