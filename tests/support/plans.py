"""Small planned data sets for tests."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from icymoon.physics.camera.blur import describe_blur_identity
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.settings import description
from icymoon.settings.pair_ids import make_pair_id

TINY: dict[str, Any] = {
    "terrain": {"resolution": 33},
    "mesh": {"kind": "GRID"},
    "rig": {"width_px": 32, "height_px": 24},
    "quality": {"samples": 2, "threads": 1},
}


def planned(*parts: dict[str, Any]) -> PlannedPair:
    """One tiny pair with changes."""
    settings = description.merged(description.defaults(), *(description.check(p, "test") for p in (TINY, *parts)))
    return PlannedPair(make_pair_id(settings, describe_blur_identity(settings)), settings, 0.0)


def grid(
    seeds: int = 2,
    elevations: tuple[float, ...] = (20.0, 40.0),
    headings: tuple[float, ...] = (0.0, 90.0),
    more: Mapping[str, Any] = MappingProxyType({}),
) -> list[PlannedPair]:
    """Pairs of all combinations, headings innermost, with ``more`` settings."""
    return [
        planned(
            dict(more),
            {"dataset": {"seed": seed}, "light": {"sun_elevation_deg": elevation}, "rig": {"heading_deg": heading}},
        )
        for seed in range(seeds)
        for elevation in elevations
        for heading in headings
    ]
