"""Rows of the rocks of presets: their size laws as asked, and beside published counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..physics.terrain.standing_places import RockyGround
from ..physics.terrain.terrain import make_terrain
from ..settings.description import check, defaults, merged
from ..settings.preset_files import load_preset, preset_names
from ..settings.topics.rocks import RocksSettings
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from .comparison import Row
from .ground import published
from .ground.block_laws import fit_exponential_cover, fit_power_index

_KINDS = ("rocks", "terrains", "scenes")
#: The numbers that decide whether two presets have the same size law.
_LAW_KEYS = ("law", "coverage", "smallest_m", "largest_m", "power_index")
#: Presets whose sources name the blocks of comet 67P or floes of sea ice. Others are as on small bodies.
_COUNTED = {
    "block_field": published.COMET_BLOCKS,
    "settled_snow": published.COMET_BLOCKS,
    "brash_ice": published.SEA_ICE_FLOES,
}
#: Presets of Golombek's law, and the rock abundances that their sites have.
_ON_MARS = {
    "golombek_10": published.Range(published.SPIRIT_COVER, published.PATHFINDER_COVER, published.GOLOMBEK_SITES),
    "golombek_20": published.Range(
        published.PATHFINDER_COVER - published.COVER_ERROR,
        published.PATHFINDER_COVER + published.COVER_ERROR,
        published.GOLOMBEK_SITES,
    ),
}
#: Half the width of a 95 % interval in standard errors.
_WIDTH = 1.96
_ASKED = "the preset; allowed is the 95 % interval of the estimate"


@dataclass(frozen=True)
class PlacedRocks:
    """Diameters (n,), m, of the rocks on the patches of all seeds, the area of these patches, and the least drawn
    diameter."""

    diameters_m: Array
    area_m2: float
    smallest_m: float


def list_rock_presets() -> dict[str, RocksSettings]:
    """List the presets that have rocks, each size law once, by the last part of their names."""
    found: dict[str, RocksSettings] = {}
    laws: set[tuple[object, ...]] = set()
    for name in (name for kind in _KINDS for name in preset_names(kind)):
        rocks = merged(defaults(), load_preset(name)).rocks
        law = tuple(rocks[key] for key in _LAW_KEYS)
        if rocks.coverage > 0 and law not in laws:
            laws.add(law)
            short = name.split("/")[-1]
            found[name if short in found else short] = rocks
    return found


def place_rocks(rocks: RocksSettings, seeds: Sequence[int]) -> PlacedRocks:
    """Lay the rocks on the default ground, with nothing beyond its patch and no clear circle."""
    diameters, smallest, size_m = [], 0.0, 1.0
    for seed in seeds:
        settings = _make_settings(rocks, seed)
        ground = RockyGround(make_terrain(settings, seed), settings, settings.terrain.size_m / 2)
        laid = ground.rocks
        assert laid is not None  # the presets have rocks
        diameters.append(laid.diameter_m)
        smallest, size_m = max(smallest, laid.smallest_m), float(settings.terrain.size_m)
    return PlacedRocks(np.concatenate(diameters), len(seeds) * size_m**2, smallest)


def _make_settings(rocks: RocksSettings, seed: int) -> Settings:
    # Fragments, whose shapes are made fastest: the shape of a rock does not change its diameter. The law is of
    # rocks before any on high ground is left out, and not of their debris.
    changed = {
        **dict(rocks.items()),
        "beyond_px": 0.0,
        "clear_radius_m": 0.0,
        "low_ground_m": 0.0,
        "debris": 0.0,
        "family": "FRAGMENTS",
    }
    parts = check({"rocks": changed, "dataset": {"seed": seed}}, "rocks")
    return merged(defaults(), parts)


def make_rock_rows(seeds: Sequence[int]) -> list[Row]:
    """Make the rows of the rocks of all presets, drawn with some seeds."""
    rows = []
    for name, rocks in list_rock_presets().items():
        placed = place_rocks(rocks, seeds)
        make = make_exponential_rows if rocks.law == "GOLOMBEK" else make_power_rows
        rows += make(name, rocks, placed)
    return rows


def make_power_rows(name: str, rocks: RocksSettings, placed: PlacedRocks) -> list[Row]:
    """Make the rows of a power law: its fitted index beside the asked one, and beside published ones."""
    found = fit_power_index(placed.diameters_m, placed.smallest_m, float(rocks.largest_m))
    counted = _COUNTED.get(name, published.SMALL_BODY_BLOCKS)
    return [
        Row(
            f"`{name}`: index of the sizes of {len(placed.diameters_m)} rocks, asked",
            found.value,
            float(rocks.power_index),
            _WIDTH * found.error,
            _ASKED,
        ),
        Row(
            f"`{name}`: index of the sizes, published",
            found.value,
            counted.middle,
            counted.half_width,
            counted.source,
        ),
    ]


def make_exponential_rows(name: str, rocks: RocksSettings, placed: PlacedRocks) -> list[Row]:
    """Make the rows of Golombek's law: its fitted abundance and decay beside the asked and the published ones."""
    found = fit_exponential_cover(placed.diameters_m, placed.area_m2, placed.smallest_m, float(rocks.largest_m))
    k, asked = found.k, float(rocks.coverage)
    rows = [
        Row(
            f"`{name}`: abundance k of {len(placed.diameters_m)} rocks, asked", k.value, asked, _WIDTH * k.error, _ASKED
        ),
        Row(
            f"`{name}`: decay q of the covered share",
            found.q_per_m.value,
            published.golombek_decay_per_m(asked),
            _WIDTH * found.q_per_m.error,
            published.GOLOMBEK_LAW,
            "1/m",
        ),
    ]
    if name in _ON_MARS:
        sites = _ON_MARS[name]
        rows.append(
            Row(
                f"`{name}`: abundance k, landing sites on Mars",
                k.value,
                sites.middle,
                sites.half_width,
                sites.source,
            )
        )
    return rows
