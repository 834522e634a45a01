"""Waves of frost with sharp crests, in fields between smooth ground."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

ICYMOON_API = 1
LABEL = "Frost Waves"

SETTINGS = {
    "height_m": {
        "default": 0.0,
        "minimum": 0.0,
        "maximum": 10.0,
        "label": "Height",
        "doc": "Height of the highest crests above the troughs. 0 turns the waves off",
    },
    "spacing_m": {
        "default": 1.5,
        "minimum": 0.05,
        "maximum": 100.0,
        "label": "Spacing",
        "doc": "Distance from crest to crest",
    },
    "azimuth_deg": {
        "default": 90.0,
        "minimum": 0.0,
        "maximum": 360.0,
        "label": "Azimuth",
        "doc": "Direction across the crests, clockwise from north",
    },
    "covered_share": {
        "default": 0.6,
        "minimum": 0.0,
        "maximum": 1.0,
        "label": "Covered Share",
        "doc": "About how much of the ground has waves",
    },
}


def height(x: np.ndarray, y: np.ndarray, settings: Mapping[str, Any]) -> np.ndarray:
    """Heights in metres at x metres east and y metres north: arrays of one shape, and of that shape."""
    spacing, azimuth = settings["spacing_m"], math.radians(settings["azimuth_deg"])
    random = np.random.default_rng(settings["seed"])
    across = (math.sin(azimuth) * x + math.cos(azimuth) * y) / spacing
    along = (math.cos(azimuth) * x - math.sin(azimuth) * y) / spacing

    # The crests bend, and fields of waves fade out: slow sums of sines, whose phases are random.
    bend, field = (
        sum(
            np.sin(2 * math.pi * (across / length + along / (1.3 * length)) + random.uniform(0, 2 * math.pi))
            for length in lengths
        )
        / len(lengths)
        for lengths in ((7.0, 11.0), (9.0, 16.0))
    )
    wave = 1.0 - np.abs(2.0 * ((across + 0.6 * bend) % 1.0) - 1.0)  # sharp at 1, and at 0
    cover = np.clip(0.5 + 2.0 * (field + 2.0 * settings["covered_share"] - 1.0), 0.0, 1.0)
    return settings["height_m"] * cover * wave**1.5


def finest_m(settings: Mapping[str, Any]) -> float:
    """The smallest length that a mesh must carry: half a wave. A coarser mesh omits the waves and reports it."""
    return float(settings["spacing_m"]) / 2.0
