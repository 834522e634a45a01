"""The statements of pairs before their images are read: the ground, the group of the ground, and the devices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...render.pairs.pair_folder import Pair
from ...render.pairs.scene_splits import name_independent_ground
from ...settings.description import merged
from ...settings.table import TOPICS
from ...support.errors import IcyMoonError
from ...support.files import make_json_digest, shorten
from ...support.suggestions import suggest_nearest

#: Settings that aim a rig or move an arm. A plan varies them from pair to pair, so they do not describe a device.
_PLACE_SETTINGS = (
    *("x_m", "y_m", "z_m", "height_from", "heading_deg", "pitch_deg", "roll_deg", "frame", "stamp"),
    *("yaw_deg", "shoulder_deg", "elbow_deg", "wrist_deg", "joints"),
    *(f"{joint}_offset_deg" for joint in ("yaw", "shoulder", "elbow", "wrist", "roll")),
)
#: The topics of each device, in words of a sentence.
_TOPICS_BY_DEVICE = {
    "rig": ("rig", "left_eye", "right_eye", "calibration_error"),
    "camera response": ("sensor",),
    "render quality": ("quality",),
    "lander": ("lander", "arm"),
}
#: Settings that change at most the random noise of an image.
_SETTINGS_LEFT_OUT = ("noise_seed",)
CELLS, SIZE, TRUTH = "size of cells", "size of the workspace", "kind of true heights"


@dataclass(frozen=True)
class StatedPair:
    """The independent ground of a pair, its group, and digests of its devices by name."""

    ground: str
    group: str
    devices: Mapping[str, str]


def state_pair(
    pair: Pair, response: Mapping[str, Mapping[str, Any]], group_by: Sequence[str], cell_m: float
) -> StatedPair:
    """Return the statements of a pair that is developed with ``response``.

    ``group_by`` are names of settings, ``topic.key``. ``cell_m`` is the side of a cell if the pair states none.
    """
    settings = merged(pair.settings, response)
    devices = {
        name: make_json_digest(
            [
                [topic, setting.key, settings[topic][setting.key]]
                for topic in topics
                for setting in TOPICS[topic].settings
                if setting.effect != "run"
                and setting.key not in (*_PLACE_SETTINGS, *_SETTINGS_LEFT_OUT)
                and settings[topic][setting.key] != setting.default  # so that a new setting changes no digest
            ]
        )
        for name, topics in _TOPICS_BY_DEVICE.items()
    }
    stated = pair.data.get("workspace")
    devices[CELLS] = f"{float(stated['cell_m'] if stated else cell_m):g} m"
    devices[SIZE] = f"{settings['workspace']['size_m']:g} m"
    devices[TRUTH] = "exact" if stated else "from the depth of both eyes"
    return StatedPair(name_independent_ground(pair), name_group(settings, group_by), devices)


def join_statements(pairs: Sequence[StatedPair]) -> StatedPair:
    """Join the statements of the pairs that show one site. Ground and group are from the last pair.

    A device that differs between the pairs, as in exposure, becomes a digest of all its digests.
    """
    last = pairs[-1]
    devices = {name: sorted({pair.devices[name] for pair in pairs}) for name in last.devices}
    joined = {name: own[0] if len(own) == 1 else make_json_digest(own) for name, own in devices.items()}
    return StatedPair(last.ground, last.group, joined)


def name_group(settings: Mapping[str, Mapping[str, Any]], group_by: Sequence[str]) -> str:
    """Name the group by the values of its settings, such as ``light.sun_elevation_deg=30``; empty without settings."""
    values = [name.split(".") for name in group_by]
    return ", ".join(f"{topic}.{key}={_show_value(settings[topic][key])}" for topic, key in values)


def check_group_settings(group_by: Sequence[str]) -> None:
    """Raise IcyMoonError unless ``group_by`` are different settings by which a group can be named."""
    known = {
        f"{topic.key}.{setting.key}"
        for topic in TOPICS.values()
        for setting in topic.settings
        if setting.kind != "list" and not topic.plugin
    }
    for name in group_by:
        if name not in known:
            raise IcyMoonError(
                f"--groups: {shorten(name)} is not a setting, "
                f"{suggest_nearest(name, known, otherwise='such as light.sun_elevation_deg.')}"
            )
    if len(set(group_by)) < len(group_by):
        raise IcyMoonError("--groups names a setting twice; name each once.")


def _show_value(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
