"""A scan of three returns on the disk."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.formats.lidar_points import ReturnWriter
from icymoon.physics.lidar.instrument import make_pose
from icymoon.physics.lidar.measured_returns import Alarms
from icymoon.physics.lidar.returns import NO_RETURNS, Returns
from icymoon.physics.lidar.scan_patterns import ScanPattern
from icymoon.support.files import write_json

POSE = make_pose((100.0, -200.0, 3.0), (0.8, 0.0, 0.0, 0.6))
PATTERN = ScanPattern("SPINNING", 2, 3, 360, 20, 0, 0.3)
#: Directions of the three returns in the site's axes.
ALONG = np.array([[1.0, 0, 0], [0, 0.6, -0.8], [0, 0, -1]])
RANGE_M = np.array([2.0, 10.0, 4.0])
#: The second return is lost.
MEASURED_M = np.array([2.5, np.nan, 4.25])
#: A place in UTM zone 33 N (EPSG 32633), in a file of kilometres, on a body whose curvature the ground has.
MAP = {
    "origin": [4e5, 5.4e6],
    "scale": [0.5, 1.0],
    "unit_m": 1000.0,
    "height_zero_m": 40.0,
    "body_radius_m": 1e6,
    "bounds": [390.0, 5390.0, 410.0, 5410.0],
    "geokeys": {"directory": "1 1 0 1 3072 0 1 32633", "doubles": "", "text": ""},
}


def write_folder(folder: Path, measured: bool, place: dict[str, Any] | None = None) -> Path:
    """A scan of three returns, two of one beam, and a false alarm."""
    made = {
        field.name: np.zeros((3, *getattr(NO_RETURNS, field.name).shape[1:]), getattr(NO_RETURNS, field.name).dtype)
        for field in fields(Returns)
    }
    made |= {
        "beam": np.array([1, 1, 5]),
        "order": np.array([1, 2, 1], np.uint8),
        "of": np.array([2, 2, 1], np.uint8),
        "range_m": RANGE_M,
        "true_range_m": RANGE_M - 0.125,
        "energy_j": np.array([1e-15, 2e-15, 3e-15]),
        "point_m": POSE.position_m + ALONG * RANGE_M[:, None],
        "label": np.array([1, 2, 1], np.uint8),
        "number": np.array([0, 7, 2**40]),
    }
    beside = {
        "ice_edge_m": np.array([0.01, 0.02, 0.03]),
        **(
            {
                "measured_range_m": MEASURED_M,
                "measured_electrons": np.array([50.0, 0, 1e6]),
                "ice_delay_m": np.array([0.04, 0.05, 0.06]),
            }
            if measured
            else {}
        ),
    }
    alarms = Alarms(np.array([4]), np.array([9.0]), POSE.position_m[None] + [0, 9.0, 0]) if measured else None
    with ReturnWriter(folder, PATTERN) as writer:
        writer.add(Returns(**made), beside, alarms)
        writer.finish(folder / "lidar.npz")
    counts = {"returns": 3, "beams": 6, "beams_without_return": 4}
    write_json(
        folder / "lidar.json",
        {
            "title": "Test",
            "pattern": "SPINNING",
            "rows": 2,
            "columns": 3,
            "period_s": 0.3,
            "wavelength_nm": 532.0,
            "position_m": POSE.position_m.tolist(),
            "sensor_to_world": POSE.matrix.tolist(),
            "site": {"map": place} if place else {},
            **counts,
            **({"lost_returns": 1, "false_alarms": 1} if measured else {}),
        },
    )
    return folder
