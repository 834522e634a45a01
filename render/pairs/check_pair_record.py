"""Checks ``pair.json`` against its own settings: derives its values from the settings again and compares them.

Poses and light of a scene that was edited by hand do not follow from its settings, so there only the entries are
compared with each other. Directions from kernels cannot be derived without the kernels. A missing entry, as from an
older version, counts as no contradiction. Imports no Blender.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...physics.camera.blur import find_blur
from ...physics.excavation.camera_jitter import jitter_rig
from ...physics.light.directions import camera_axes, direction_toward
from ...physics.light.lamps import describe_lamp, list_lamp_groups
from ...physics.light.scene_sun import sun_from_facts, sun_from_json
from ...physics.light.sky import azimuth_deg, describe_sky, elevation_deg
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import is_number
from ...support.files import quote
from .pair_sky import compute_pair_sky
from .workspace_cells import describe_workspace

#: Relative tolerance of settings, which have eight digits; a focal length is computed from three of them.
_SETTING_TOLERANCE = 1e-6
#: Relative tolerance of values that Blender stores in single precision: a baseline, a lamp's brightness, and sines,
#: since Blender decomposes a matrix into angles. A heading among equal turns has six digits, which is 9e-6.
_SINGLE_PRECISION = 2e-5
#: Rounding error of a noise, as a share of the light.
_NOISE_ROUNDING = 1e-5
#: Tolerated distance of an eye from its place, m, for each metre from the origin, since turns multiply both in
#: matrices.
_PLACE_TOLERANCE = 1e-6


def find_contradictions(
    data: Mapping[str, Any], settings: Settings, camera: Mapping[str, Any], eyes: Mapping[str, Any]
) -> Iterator[str]:
    """Yield a clause for each entry of a ``pair.json`` that contradicts its settings, with the key and both values.

    ``camera`` and ``eyes`` are the tables that follow from the settings, see ``StereoCamera`` and ``eyes.eyes_json``.
    """
    by_hand = bool(data.get("edited_by_hand"))
    yield from _compare_value("camera", data["camera"], camera)
    yield from _compare_value("eyes", data.get("eyes", {}), eyes)
    yield from _compare_poses(data, settings, eyes, by_hand)
    yield from _compare_light(data.get("light") or {}, settings, data.get("ground"), by_hand)
    indirect = data.get("indirect")
    is_baked = isinstance(indirect, Mapping) and indirect.get("method") == "BAKED"
    yield from _compare_indirect(indirect, data.get("light") or {}, settings)
    yield from _compare_value(
        "",
        data,
        {
            "device": settings.quality.device,
            "denoiser": "NONE" if is_baked else settings.quality.denoiser,
            "workspace": describe_workspace(settings.workspace),
            **_describe_blur(settings),
        },
    )


def _describe_blur(settings: Settings) -> dict[str, Any]:
    """Return the table "blur" with its numbers; empty if the camera response was changed to one that cannot be
    rendered."""
    try:
        blur = find_blur(settings)
    except IcyMoonError:
        return {}
    return {"blur": blur and {key: value for key, value in blur.to_json().items() if key != "truth"}}


def _compare_poses(
    data: Mapping[str, Any], settings: Settings, eyes: Mapping[str, Any], by_hand: bool
) -> Iterator[str]:
    """Yield contradictions in the poses of the eyes, except their height above the ground, which is not derived."""
    name = next((key for key in ("poses_rectified_to_world", "poses_camera_to_world") if data.get(key)), "")
    if not name or (name == "poses_camera_to_world" and settings.rig.toe_in_deg):
        return
    left, right = (np.array(data[name][eye], np.float64) for eye in ("left", "right"))
    if not by_hand:
        rig = jitter_rig(settings)
        wanted = np.eye(4)
        wanted[:3, :3] = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)
        wanted[:3, 3] = rig.x_m, rig.y_m, left[2, 3]
        if rig.height_from == "ZERO":
            wanted[2, 3] = rig.z_m + rig.height_m - settings.rig.height_m
        yield from _compare_pose(
            f"{name}.left", left, wanted, _SINGLE_PRECISION + _PLACE_TOLERANCE * float(np.linalg.norm(left[:3, 3]))
        )
    beside = left.copy()
    beside[:3, 3] += settings.rig.baseline_m * left[:3, 0]
    yield from _compare_pose(f"{name}.right", right, beside, _SINGLE_PRECISION * settings.rig.baseline_m)
    taken = data.get("poses_camera_to_world") or {}
    for eye, pose in (("left", left), ("right", right)) if taken else ():
        turned = pose.copy()
        turned[:3, :3] = pose[:3, :3] @ np.array(eyes[eye]["R"]).T
        yield from _compare_pose(
            f"poses_camera_to_world.{eye}",
            np.array(taken[eye], np.float64),
            turned,
            _SINGLE_PRECISION * settings.rig.baseline_m,
        )


def _compare_pose(name: str, stated: Array, wanted: Array, place_m: float) -> Iterator[str]:
    limits = np.full((4, 4), _SINGLE_PRECISION)
    limits[:3, 3] = place_m + 1e-12 * np.abs(wanted[:3, 3])  # a large number has fewer decimals
    for row, column in np.argwhere(np.abs(stated - wanted) > limits):
        yield _describe_contradiction(
            f"{name}[{row}][{column}]", float(stated[row, column]), float(wanted[row, column])
        )


def _compare_light(light: Mapping[str, Any], settings: Settings, ground: object, by_hand: bool) -> Iterator[str]:
    """Yield contradictions in the table "light": with the settings, and of angles with directions."""
    facts = {} if by_hand else _describe_sky(settings, ground)
    sun = sun_from_json(light)
    if sun is not None and (facts or "source" in light["sun"]):
        # A pair of a version without ``source`` has the angles of its settings, also if a lamp was turned by hand.
        wanted = sun_from_facts(facts["sun"], settings.light.directions_from) if facts else sun
        stated = {**light["sun"], "distance_m": sun.distance_m}
        yield from _compare_direction("light.sun", light["sun"], wanted.direction)
        yield from _compare_value(
            "light.sun",
            stated,
            {
                **({"source": settings.light.directions_from} if sun.source and not by_hand else {}),
                "irradiance_wm2": wanted.irradiance_wm2,
                "angular_diameter_deg": wanted.angular_diameter_deg,
                "distance_m": wanted.distance_m,
                "eclipse": wanted.eclipse,
            },
            _SINGLE_PRECISION,
        )
        yield from _compare_value(
            "light.sun",
            stated,
            {"ground_irradiance_wm2": wanted.ground_irradiance_wm2},
            _SINGLE_PRECISION,
            wanted.irradiance_wm2,
        )
    if light and not by_hand:
        yield from _compare_lamps(light.get("lamps", []), settings)
    if facts:
        yield from _compare_value("light", light, {"j2000_to_world": facts["j2000_to_world"]})
        yield from _compare_planet(light.get("planet"), facts["planet"])
        yield from _compare_value("light", light, {"moons": facts.get("moons", [])}, _SINGLE_PRECISION)


def _compare_lamps(stated: object, settings: Settings) -> Iterator[str]:
    """Yield contradictions in the lamps. A lamp at the cameras has no position in the settings."""
    lamps, light = settings.light.lamps, settings.light
    if not isinstance(stated, list) or len(stated) != len(lamps):
        yield _describe_contradiction("light.lamps", len(stated) if isinstance(stated, list) else stated, len(lamps))
        return
    for k, (entry, lamp, group) in enumerate(zip(stated, lamps, list_lamp_groups(light), strict=False)):
        wanted = {"group": group, **describe_lamp(lamp, light)}
        if lamp.place == "SITE":
            wanted["position_m"] = [lamp.x_m, lamp.y_m, lamp.z_m]
            wanted["direction_to_world"] = direction_toward(lamp.azimuth_deg, lamp.elevation_deg).tolist()
        name = f"light.lamps[{k}]"
        if isinstance(entry, Mapping):
            yield from _compare_value(name, entry, wanted, _SINGLE_PRECISION)
        else:
            yield _describe_contradiction(name, entry, wanted)


def _compare_indirect(stated: Any, light: Mapping[str, Any], settings: Settings) -> Iterator[str]:
    """Yield contradictions in the entry on indirect light: with the settings, the noise limit and the light groups."""
    asked = settings.quality.indirect == "BAKED"
    if asked != isinstance(stated, Mapping):
        yield _describe_contradiction("indirect", stated, {} if asked else None)
        return
    if not asked or stated.get("method") != "BAKED":  # light may be traced although the settings ask for a bake
        return
    noise, most = stated.get("noise"), settings.quality.bake_noise
    if not is_number(noise) or 0 < most < noise - _NOISE_ROUNDING:
        yield f"indirect.noise is {_show_value(noise)}, and its settings give at most {_show_value(most)}"
    sun, lights = sun_from_json(light), stated.get("lights")
    if sun is None or not isinstance(lights, Mapping):
        return
    planet = {"Planet"} & lights.keys() if light.get("planet") else set()
    wanted = sorted(planet | ({"Sun"} if sun.irradiance_wm2 > 0 or not planet else set()))
    if sorted(lights) != wanted:
        yield _describe_contradiction("indirect.lights", sorted(lights), wanted)


def _describe_sky(settings: Settings, ground: object) -> dict[str, Any]:
    """Return the table of ``sky.describe_sky``; empty if it needs kernels, or settings that are no longer accepted."""
    if settings.light.directions_from == "KERNELS":
        return {}
    try:
        return describe_sky(compute_pair_sky(settings, ground))
    except IcyMoonError:
        return {}


def _compare_planet(stated: object, wanted: Mapping[str, Any] | None) -> Iterator[str]:
    if wanted is None or not isinstance(stated, Mapping):
        yield from _compare_value("light.planet", stated, wanted)
        return
    yield from _compare_direction("light.planet", stated, np.array(wanted["direction_to_world"]))
    yield from _compare_value(
        "light.planet",
        stated,
        {
            key: wanted[key]
            for key in (
                "phase_deg",
                "angular_diameter_deg",
                "irradiance_wm2",
                "ground_irradiance_wm2",
                "above_ring_plane_deg",
            )
        },
    )


def _compare_direction(name: str, stated: Mapping[str, Any], wanted: Array) -> Iterator[str]:
    """Yield contradictions in a direction. Its angles are compared as a direction, since at the zenith every azimuth is
    valid, and north is both 0° and 360°."""
    yield from _compare_value(name, stated, {"direction_to_world": wanted.tolist()}, _SINGLE_PRECISION)
    angles = {"elevation_deg": elevation_deg(wanted), "azimuth_deg": azimuth_deg(wanted)}
    elevation, azimuth = (stated.get(key, angle) for key, angle in angles.items())
    if not (is_number(elevation) and is_number(azimuth)):
        yield from _compare_value(name, stated, angles)
    elif np.abs(direction_toward(azimuth, elevation) - wanted).max() > _SINGLE_PRECISION:
        is_high = abs(elevation - angles["elevation_deg"]) > math.degrees(_SINGLE_PRECISION)
        key = "elevation_deg" if is_high else "azimuth_deg"
        yield _describe_contradiction(f"{name}.{key}", stated[key], angles[key])


def _compare_value(
    name: str, stated: object, wanted: object, digits: float = _SETTING_TOLERANCE, scale: float = 1.0
) -> Iterator[str]:
    """Yield a clause if a value of the pair differs from the derived value. Numbers may differ by ``digits`` relative
    to the value or to ``scale``.
    """
    if stated == wanted:
        return
    if isinstance(wanted, Mapping) and isinstance(stated, Mapping):
        for key in (each for each in wanted if each in stated):
            yield from _compare_value(f"{name}.{key}" if name else key, stated[key], wanted[key], digits, scale)
    elif isinstance(wanted, list) and isinstance(stated, list) and len(wanted) == len(stated):
        for k, (own, other) in enumerate(zip(stated, wanted, strict=True)):
            yield from _compare_value(f"{name}[{k}]", own, other, digits, scale)
    elif not (
        is_number(wanted) and is_number(stated) and math.isclose(stated, wanted, rel_tol=digits, abs_tol=digits * scale)
    ):
        yield _describe_contradiction(name, stated, wanted)


def _describe_contradiction(name: str, stated: object, wanted: object) -> str:
    return f"{name} is {_show_value(stated)}, and its settings give {_show_value(wanted)}"


def _show_value(value: object) -> str:
    return "a table" if isinstance(value, Mapping) else "nothing" if value is None else quote(value)
