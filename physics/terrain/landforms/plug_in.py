"""Landforms of packages that the user installed; they follow the built-in ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ....plugins.landforms import (
    PREFIX,
    RELEASE,
    PluginLandform,
    describe_missing_landform,
    hash_name,
    load_landform_plugins,
)
from ....settings.topics.scene import Settings
from ....support.arrays import Array, Numbers
from ....support.errors import IcyMoonError
from .landform import Landform


def make_plugin_landforms(settings: Settings, generator: Callable[..., np.random.Generator]) -> dict[str, Landform]:
    """Make the landforms of plug-ins that are on, by the name of their table, in alphabetical order. ``generator``
    returns the random generator of a landform from its number. Raises IcyMoonError for a landform that this Python
    lacks or has in another version.
    """
    usable, _ = load_landform_plugins()
    made = {}
    for topic in sorted(key for key in settings if key.startswith(PREFIX)):
        values = settings[topic]
        landform = usable.get(topic)
        release = str(values.get(RELEASE, ""))
        if landform is None:
            raise IcyMoonError(f"This ground cannot be made: {describe_missing_landform(topic, release)}")
        if values[landform.settings[0].key] == 0:
            continue
        if release and release != landform.plugin.release:
            raise IcyMoonError(
                f"This ground cannot be made: {topic} was made by {release}, and "
                f"{landform.plugin.release} is installed; install {release}, or set "
                f"{topic}.{RELEASE} to an empty text for other ground."
            )
        seed = int(generator(hash_name(landform.plugin.name)).integers(0, 2**32))
        made[topic] = _make_landform(landform, landform.make_plugin_settings(values, seed))
    return made


def _make_landform(landform: PluginLandform, told: Any) -> Landform:
    def heights(x_m: Array, y_m: Array, shortest_m: Numbers) -> Array:
        x, y, _ = np.broadcast_arrays(x_m, y_m, shortest_m)
        return landform.heights(x, y, told)

    return Landform(landform.finest_m(told), heights)
