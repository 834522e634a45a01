"""Computes the sky of a pair: from its settings, or over the site of the map that its ground is from."""

from __future__ import annotations

from collections.abc import Mapping

from ...physics.light.sky import Sky, compute_sky
from ...physics.light.sky_over_map import find_sky_place
from ...settings.topics.scene import Settings
from ...support.file_schemas import is_number

_NUMBERS = ("latitude_deg", "longitude_deg", "north_deg")


def compute_pair_sky(settings: Settings, ground: object) -> Sky:
    """Compute the sky from a pair's settings and the entry ``ground`` of its ``pair.json``. Raises IcyMoonError as
    ``compute_sky`` does."""
    place = ground.get("map") if isinstance(ground, Mapping) else None
    known = isinstance(place, Mapping) and all(is_number(place.get(key)) for key in _NUMBERS)
    return compute_sky(settings.light, place=find_sky_place(settings, place if known else None))
