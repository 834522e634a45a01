"""Sequences: pairs that are frames of one trajectory in one scene, in the order of time."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ...physics.camera.blur import MOTION
from ...render.pairs.pair_folder import read_pair
from ...settings.description import Restorer
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError

#: Settings of the rig in which the frames of a sequence differ.
_OF_A_FRAME = (
    *("x_m", "y_m", "z_m", "height_m", "heading_deg", "pitch_deg", "roll_deg", "frame", "stamp"),
    *MOTION,
)


def make_sequence_key(settings: Settings) -> str:
    """Make a key of a sequence, equal for all its frames; "" for a pair outside any sequence."""
    if not settings.rig.stamp:
        return ""
    rig = {key: value for key, value in settings.rig.items() if key not in _OF_A_FRAME}
    return json.dumps(settings | {"rig": rig}, sort_keys=True)


def sort_by_time(folders: Sequence[Path]) -> list[Path]:
    """Sort folders of pairs: each sequence by time, at the position of its first frame. Other folders keep their order,
    also unreadable ones.
    """
    restore, places = Restorer(), dict[str, int]()
    order = []
    for k, folder in enumerate(folders):
        try:
            settings = read_pair(folder, restore).settings
        except IcyMoonError:  # the error is reported where the pair is needed
            order.append((k, 0))
            continue
        key = make_sequence_key(settings)
        order.append((places.setdefault(key, k) if key else k, int(settings.rig.frame)))
    return [folders[k] for k in sorted(range(len(folders)), key=order.__getitem__)]
