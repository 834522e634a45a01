"""Pairs of a workspace: level ground with a rock, seen straight from above, with its true heights."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pairs
from icymoon.physics.light.directions import direction_toward
from icymoon.physics.light.ephemeris import find_positions
from icymoon.settings.description import defaults, merged
from icymoon.support.files import hash_file

#: A left eye that looks straight down from 2 m: OpenCV's y points south, its z down.
DOWN = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
CELL_M = 0.04


def write(folder: Path, scene: pairs.Scene | None = None, exact: bool = True, noise: float = 0.0) -> Path:
    """A pair of level ground with a rock of 0.5 m beside it, seen from above, with its true heights if ``exact``."""
    rig = pairs.camera(256, 144)
    settings = merged(
        defaults(),
        {
            "rig": {"heading_deg": 0.0, "pitch_deg": 90.0},
            "light": {"directions_from": "ANGLES", "sun_elevation_deg": 90.0},
            "workspace": {"cell_m": CELL_M if exact else 0.0, "east_m": 0.0, "north_m": 0.0, "size_m": 1.2},
        },
    )
    pairs.write_pair(folder, scene or pairs.Scene(slope_x=0.0, slope_y=0.0), rig, noise=noise, settings=settings)
    data = json.loads((folder / "pair.json").read_text())
    right = DOWN.copy()
    right[0, 3] = rig.baseline_m
    data["poses_camera_to_world"] = {"left": DOWN.tolist(), "right": right.tolist()}
    data["light"] = {"sun": {"direction_to_world": [0.0, 0.0, 1.0]}}
    if exact:
        ground = np.zeros((30, 30), np.float32)
        east, north = np.meshgrid(*2 * [(np.arange(30) + 0.5) * CELL_M - 0.6])
        top = np.where((np.abs(east) < 0.25) & (np.abs(north) < 0.25), 0.5, ground)
        np.save(folder / "workspace.npy", np.stack([top, ground]).astype(np.float32))
        data["workspace"] = {"file": "workspace.npy", "cell_m": CELL_M, "origin_m": [-0.6, 0.6], "shape": [30, 30]}
        data["files"]["workspace.npy"] = {
            "bytes": (folder / "workspace.npy").stat().st_size,
            "sha256": hash_file(folder / "workspace.npy"),
        }
    (folder / "pair.json").write_text(json.dumps(data))
    return folder


def write_under_sun(
    folder: Path,
    azimuth_deg: float,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    id_of: Path | None = None,
    noise: float = 0.0,
) -> Path:
    """A pair as of ``write``, under a Sun of 60 degrees; ``settings`` changes some, ``id_of`` is a pair whose noise it
    has.
    """
    write(folder, noise=noise)
    data = json.loads((folder / "pair.json").read_text())
    data["light"]["sun"]["direction_to_world"] = direction_toward(azimuth_deg, 60.0).tolist()
    data["settings"]["light"] |= {"sun_elevation_deg": 60.0, "sun_azimuth_deg": azimuth_deg}
    for topic, values in (settings or {}).items():
        data["settings"][topic] |= values
    light = data["settings"]["light"]
    if light["directions_from"] == "DATE":
        place = light["latitude_deg"], light["longitude_deg"]
        sun = find_positions(light["body"], light["date_utc"], *place).sun
        data["light"]["sun"]["direction_to_world"] = sun.tolist()
    if id_of is not None:
        data["id"] = json.loads((id_of / "pair.json").read_text())["id"]
    (folder / "pair.json").write_text(json.dumps(data))
    return folder
