"""The lamp of a sensor suite: its entries in a design, and its light at night.

The lamp shines equally in all directions from a point fixed to the left camera, as a ``POINT`` of ``light.lamps``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...physics.light.directions import camera_axes
from ...physics.light.lamps import intensity, pair_power_w
from ...settings.description import defaults, merged
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import NUMBER
from ..learning.grounds import Ground
from ..learning.radiance import Lighting, PointLamp
from .made_workspaces import look_down, place_camera

#: The table ``[lamp]`` of a design.
LAMP_SHAPE = {"efficiency": NUMBER, "right_m": NUMBER, "up_m": NUMBER}
_MAX_W, _FARTHEST_M = 1e5, 10.0


@dataclass(frozen=True)
class LampPlace:
    """Facts about the lamp that all suites share.

    ``efficiency`` is the share of its electric power that becomes light from 400 to 700 nm. ``right_m`` and ``up_m``
    are its place right of and above the left camera, in the camera's axes.
    """

    efficiency: float
    right_m: float
    up_m: float


@dataclass(frozen=True)
class SuiteLamp:
    """A lamp at its place, with its electric power in W."""

    power_w: float
    place: LampPlace


def read_place(table: Mapping[str, float], path: Path) -> LampPlace:
    """Read the table ``[lamp]`` of the design ``path``, of ``LAMP_SHAPE``. Raises IcyMoonError if a number is out of
    range.
    """
    place = LampPlace(**{key: float(value) for key, value in table.items()})
    if not 0 < place.efficiency <= 1:
        raise IcyMoonError(
            f"{path}: lamp.efficiency is {place.efficiency:g}; give the share of the power that becomes light, above 0 "
            "and up to 1."
        )
    for key in ("right_m", "up_m"):
        if abs(table[key]) > _FARTHEST_M:
            raise IcyMoonError(
                f"{path}: lamp.{key} is {table[key]:g}; give metres from the left camera, from {-_FARTHEST_M:g} to "
                f"{_FARTHEST_M:g}."
            )
    return place


def read_lamp(power_w: float | None, place: LampPlace | None, settings: Settings, where: str) -> SuiteLamp | None:
    """Return the lamp of a suite; None without a power.

    Raises IcyMoonError if the power is out of range, the table ``[lamp]`` is missing, or the lamp is under level
    ground.
    """
    if power_w is None:
        return None
    if not 0 < power_w <= _MAX_W:
        raise IcyMoonError(
            f"{where} has lamp_w = {power_w:g}; give the electric power of its lamp in watts, above 0 and up to "
            f"{_MAX_W:g}, or leave it out for no lamp."
        )
    if place is None:
        raise IcyMoonError(
            f"{where} states lamp_w, and the design has no table [lamp]; add one with {', '.join(LAMP_SHAPE)}, as in "
            "the shipped design, stereo/design/suites.toml."
        )
    lamp = SuiteLamp(float(power_w), place)
    above_m = float(settings.rig.height_m + _find_offset(lamp, settings)[2])
    if above_m <= 0:
        raise IcyMoonError(
            f"{where} has a lamp {-above_m:.3g} m under level ground; raise lamp.up_m or rig.height_m, or change "
            "lamp.right_m."
        )
    return lamp


def _find_offset(lamp: SuiteLamp, settings: Settings) -> Array:
    """Find the lamp's position (3,) east of, north of and above the left camera, m."""
    axes = camera_axes(settings.rig.heading_deg, settings.rig.pitch_deg)
    return np.asarray(lamp.place.right_m * axes[:, 0] - lamp.place.up_m * axes[:, 1])


def light_night(lamp: SuiteLamp, ground: Ground, day: Lighting, settings: Settings) -> Lighting:
    """Return the light of a ground at night, by the lamp alone of a lander with these settings.

    Raises IcyMoonError if the lamp is in the ground or in a rock.
    """
    position = place_camera(ground, settings) + _find_offset(lamp, settings)
    under_m = float(look_down(ground, position[:1], position[1:2])[0] - position[2])
    if under_m >= 0:
        raise IcyMoonError(
            f"The lamp is {under_m:.3g} m inside the ground or a rock, where it lights nothing; raise lamp.up_m or "
            "rig.height_m."
        )
    entry = {"kind": "POINT", "power_w": lamp.power_w, "efficiency": lamp.place.efficiency}
    (stated,) = merged(defaults(), {"light": {"lamps": [entry]}}).light.lamps
    shining = PointLamp(position, pair_power_w(stated, settings.light) * float(intensity(stated, 1.0)))
    return replace(day, irradiance_wm2=0.0, sky=0.0, lamp=shining)
