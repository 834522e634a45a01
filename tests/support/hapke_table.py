"""The truth table of Hapke's model beside this file."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from icymoon.physics.surfaces.hapke import HapkeParameters

_NAMES = {"w": "w", "b": "b", "c": "c", "BS0": "b_s0", "hS": "h_s", "BC0": "b_c0", "hC": "h_c", "phi": "filling_factor"}


def rows() -> list[dict[str, str]]:
    """The rows as text."""
    with (Path(__file__).parent / "hapke_truth.csv").open(encoding="utf-8") as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def angles(row: dict[str, str]) -> tuple[float, float, float]:
    """Incidence, emission and azimuth of a row in radians."""
    incidence, emission, azimuth = (float(np.radians(float(row[key]))) for key in ("i_deg", "e_deg", "psi_deg"))
    return incidence, emission, azimuth


def parameters(row: dict[str, str]) -> HapkeParameters:
    """Parameters of a row."""
    return HapkeParameters(
        **{name: float(row[key]) for key, name in _NAMES.items()},
        theta_bar=float(np.radians(float(row["theta_deg"]))),
        h_function=row["H"],
    )
