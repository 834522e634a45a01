"""Checks of whether a scene can be rendered as its settings describe it: the same for plans, renders and the window.

A refused scene would render wrong images without an error. Examples are an eye in the ground or in a rock, which sees
black; ice that reflects more light than it receives; ground on which no rock fits; and a date outside the years for
which the sky is known. ``settings`` are complete. Every reason is a sentence with the settings, their values and the
fix.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from ..settings.topics.camera import RigSettings
from ..settings.topics.rocks import RocksSettings
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from ..support.labels import LAMP_GROUPS
from .arm.collisions import find_link_around
from .arm.kinematics import Joint, find_joints_beyond_limits
from .arm.lander_arm import is_users_arm, joint_values, make_arm
from .arm.parametric_arm import JOINTS
from .camera.depth_accuracy import advise_on_coarse_triangles, advise_on_principal_point, measure_ground_row
from .camera.eyes import advise_on_calibrated_eyes, find_calibrated_reasons
from .excavation import arm_reach
from .excavation import dig_site as excavation
from .light.directions import camera_axes
from .light.lamps import read_factors
from .light.sky import check_body, compute_sky
from .rocks.rock_table import TABLE
from .rocks.size_laws import make_size_law
from .scene_requirements import advise_on_bake, surface_topics
from .surfaces.hapke import HapkeParameters, bidirectional_reflectance, hapke_from_settings
from .surfaces.photometry import hemispherical_albedo
from .terrain.standing_places import RockyGround, make_rocky_ground

#: Least height of an eye above the ground in metres: ten times the distance at which the lens clips.
MIN_EYE_HEIGHT_M = 1e-3
#: Cosines of the incidence, to 88.9 degrees, at which light returned by ice is compared with the light that it
#: receives.
_INCIDENCE_COSINES = np.array([1.0, 0.7, 0.4, 0.2, 0.1, 0.05, 0.02])
#: Largest share of light that Hapke's law may return, by H function. Shares above 1 come from the approximation, not
#: from the parameters: grains of w 1 that scatter evenly return 1.040 of the light with the H function of 1981, and
#: 0.993 with the others. The parameters published for Enceladus in 1994 return 1.016.
_MAX_RETURNED = {"1981": 1.045, "1993": 1.01, "2002": 1.01}

#: Settings that may put a camera beside the ground. A plan refuses such a camera; a render shows the ground from there,
#: with a warning.
OUTSIDE_SETTINGS = ("rig.x_m", "rig.y_m", "terrain.size_m")
_POSE_SETTINGS = ("rig.x_m", "rig.y_m", "rig.height_m", "rig.heading_deg", "rig.baseline_m")


class Reason(str):
    """A sentence, and the ``names`` (``topic.key``) of the settings at fault."""

    names: tuple[str, ...]

    def __new__(cls, text: str, *names: str) -> Reason:
        made = super().__new__(cls, text)
        made.names = names
        return made


def find_reasons(settings: Settings) -> list[Reason]:
    """Find all reasons why a scene cannot be rendered; empty if it can."""
    said = find_reasons_in_settings(settings)
    if settings.source.kind == "PROCEDURAL":
        try:
            (found,) = find_eye_reasons(make_rocky_ground(settings), [settings.rig])
        except IcyMoonError as error:
            found = Reason(str(error))
        said += [found] if found and found.names != OUTSIDE_SETTINGS and found not in said else []
    return said


def refuse_scene(settings: Settings) -> None:
    """Raise IcyMoonError with all reasons why a scene cannot be rendered, if there are any."""
    if said := find_reasons(settings):
        raise IcyMoonError(" ".join(said))


def find_reasons_in_settings(settings: Settings) -> list[Reason]:
    """Find the reasons that do not depend on the ground's heights."""
    return [
        *_find_ice_reasons(settings),
        *_find_rock_reasons(settings),
        *_find_sky_reasons(settings),
        *_find_near_sun_reasons(settings),
        *_find_reasons_against_lamps(settings),
        *_find_veil_reasons(settings),
        *_find_loose_reasons(settings),
        *find_lander_reasons(settings),
        *(Reason(text, name) for text, name in find_calibrated_reasons(settings)),
        *(Reason(text, "excavation.path") for text in excavation.find_refusals(settings)),
    ]


def find_reasons_without_file(settings: Settings) -> list[Reason]:
    """Find why a scene can be rendered only from the .blend file in which it was built; empty if it needs no file. Only
    that file has the node groups that a surface may name.
    """
    topics = ("surface", "rock_surface") if settings.rocks.own_surface else ("surface",)
    return [
        Reason(
            f"{topic}.albedo_group names a node group, which only a .blend file has; render in the window of that "
            "file, or leave the setting empty.",
            f"{topic}.albedo_group",
        )
        for topic in topics
        if settings[topic].albedo_group
    ]


def advise_on_scene(settings: Settings) -> list[str]:
    """List sentences of advice about a scene that can be rendered but may not be as the user expects."""
    rig, patch = settings.rig, settings.terrain
    said = advise_on_principal_point(rig)
    if not math.isfinite(measure_ground_row(rig, float(rig.height_px)).depth_m):
        said.append(
            "The whole image is above the horizon and shows only sky where the ground is level; raise "
            f"rig.pitch_deg ({rig.pitch_deg:g}°)."
        )
    if settings.source.kind == "PROCEDURAL" and settings.mesh.kind == "GRID":
        said += advise_on_coarse_triangles(rig, patch.size_m / (patch.resolution - 1))
    said += advise_on_bake(settings)
    said += advise_on_calibrated_eyes(settings)
    dug = excavation.advise_on_excavation(settings)
    return said + dug + (arm_reach.advise_on_reach(settings) if not excavation.find_refusals(settings) else [])


def find_returned_share(parameters: HapkeParameters) -> tuple[float, float]:
    """Find the largest share of a beam that ice with Hapke's law returns, and the incidence of that beam in degrees."""
    share = hemispherical_albedo(
        partial(bidirectional_reflectance, parameters=parameters), np.arccos(_INCIDENCE_COSINES)
    )
    k = int(share.argmax())
    return float(share[k]), math.degrees(math.acos(_INCIDENCE_COSINES[k]))


@lru_cache(maxsize=64)
def _find_excess_light(parameters: HapkeParameters) -> tuple[float, float, float] | None:
    """Check whether ice returns too much light. If so, return the returned share, its incidence in degrees, and the
    largest allowed w with two digits; else None.
    """
    most = _MAX_RETURNED[parameters.h_function]
    share, incidence = find_returned_share(parameters)
    if share <= most:
        return None
    low, high = 0, math.ceil(100 * parameters.w)
    while high - low > 1:  # the share grows with w
        middle = (low + high) // 2
        low, high = (
            (middle, high) if find_returned_share(replace(parameters, w=middle / 100))[0] <= most else (low, middle)
        )
    return share, incidence, low / 100


def _find_ice_reasons(settings: Settings) -> Iterator[Reason]:
    hapke = settings.hapke
    if not any(settings[topic]["model"] == "HAPKE" for topic in surface_topics(settings)):
        return
    try:
        parameters = hapke_from_settings(hapke)
    except IcyMoonError as error:
        yield Reason(str(error), "hapke.filling_factor", "hapke.c")
        return
    # Smoother ice is brighter. The darkest values of an image of even greys are half its range below the mean.
    varies = math.radians(abs(hapke.theta_bar_range_deg)) / 2 if settings.textures.set != "NONE" else 0.0
    gain = _find_excess_light(replace(parameters, theta_bar=max(float(parameters.theta_bar) - varies, 0.0)))
    if gain is not None:
        share, incidence, w = gain
        others = [
            f" or hapke.{key} ({hapke[key]:g})"
            for key, width in (("filling_factor", 1.0), ("b_s0", hapke.h_s), ("b_c0", hapke.h_c))
            if hapke[key] > 0 and width > 0.05
        ]
        yield Reason(
            f"Hapke: level ice would return {share:.3g} times the sunlight that it gets from {incidence:.0f}° "
            f"off the zenith, with hapke.w {hapke.w:g}; lower hapke.w to {w:g}{''.join(others)}.",
            "hapke.filling_factor",
            "hapke.w",
        )


def _find_rock_reasons(settings: Settings) -> Iterator[Reason]:
    if settings.source.kind == "PROCEDURAL" and settings.rocks.coverage > 0:
        try:
            refuse_no_rocks(settings.rocks, float(settings.terrain.size_m), "terrain.size_m")
        except IcyMoonError as error:
            yield Reason(str(error), "rocks.largest_m", "rocks.smallest_m", "rocks.coverage", "terrain.size_m")
        if settings.rocks.low_ground_m > 0 and settings.rocks.skirt > 0:
            yield Reason(
                "rocks.low_ground_m leaves out rocks whose skirts would stay (rocks.skirt is "
                f"{settings.rocks.skirt:g}); set rocks.skirt to 0, or rocks.low_ground_m to 0.",
                "rocks.low_ground_m",
                "rocks.skirt",
            )
        if settings.rocks.at_rest and settings.rocks.skirt > 0:
            yield Reason(
                f"rocks.at_rest moves rocks away from their skirts (rocks.skirt is {settings.rocks.skirt:g}); set "
                "rocks.skirt to 0, or rocks.at_rest to false.",
                "rocks.at_rest",
                "rocks.skirt",
            )


def refuse_no_rocks(rocks: RocksSettings, size_m: float, size_is: str) -> None:
    """Raise IcyMoonError if ``rocks`` settings contradict each other, or give no rock on a square patch with sides of
    ``size_m``; ``size_is`` names the setting of this size.
    """
    if rocks.law == TABLE:
        return
    number = make_size_law(rocks).total_per_m2 * size_m**2
    if round(number) == 0:
        raise IcyMoonError(
            f"rocks.coverage is {rocks.coverage:g}, but a ground of {size_m:g} m ({size_is}) then has "
            f"{number:.2g} rocks of {rocks.smallest_m:g} m (rocks.smallest_m) to {rocks.largest_m:g} m "
            "(rocks.largest_m), so none; make the rocks smaller or the ground larger, or set rocks.coverage to 0."
        )


def _find_sky_reasons(settings: Settings) -> Iterator[Reason]:
    try:
        check_body(settings)
        if settings.light.directions_from == "DATE":  # kernels are read where SpiceyPy is
            compute_sky(settings.light)
    except IcyMoonError as error:
        yield Reason(str(error), "light.date_utc", "light.body", "terrain.body_radius_m")


def _find_near_sun_reasons(settings: Settings) -> Iterator[Reason]:
    """Yield reasons against a lamp near the ground, whose light has another direction at each point."""
    light, key = settings.light, "light.sun_distance_m"
    if light.sun_distance_m <= 0:
        return
    if light.directions_from != "ANGLES" or light.planet:
        yield Reason(
            f"{key} ({light.sun_distance_m:g} m) puts a lamp in place of the Sun, without a date or a planet; "
            "set light.directions_from to ANGLES and light.planet to false, or the distance to 0.",
            key,
            "light.directions_from",
            "light.planet",
        )
    if _has_law_in_osl(settings):
        yield Reason(
            f"{key} ({light.sun_distance_m:g} m): a law in OSL knows only a Sun that is far away; set "
            "hapke.backend to NODES.",
            key,
            "hapke.backend",
        )


def _find_reasons_against_lamps(settings: Settings) -> Iterator[Reason]:
    """Yield reasons against the lamps of ``light.lamps``."""
    lamps, key = settings.light.lamps, "light.lamps"
    if len(lamps) > len(LAMP_GROUPS):
        yield Reason(f"{key} has {len(lamps)} lamps; {len(LAMP_GROUPS)} are the most.", key)
    if lamps and _has_law_in_osl(settings):
        yield Reason(
            f"{key}: a law in OSL follows only the Sun and the planet; set hapke.backend to NODES.",
            key,
            "hapke.backend",
        )
    try:
        read_factors(settings.light)
    except IcyMoonError as error:
        yield Reason(str(error), key, "light.lamp_scales")


def _has_law_in_osl(settings: Settings) -> bool:
    models, backend = {settings[topic]["model"] for topic in surface_topics(settings)}, settings.hapke.backend
    return ("HAPKE" in models and backend != "NODES") or ("SNOW" in models and backend == "OSL")


def _find_veil_reasons(settings: Settings) -> Iterator[Reason]:
    """Yield reasons against a veil, which needs light and truth traced separately by Cycles."""
    depth, key = settings.veil.optical_depth, "veil.optical_depth"
    if depth <= 0:
        return
    if settings.quality.truth != "FULL":
        yield Reason(
            f"{key} ({depth:g}): without full truth, depth comes with the light, and a path that a grain scatters has "
            "no depth; set quality.truth to FULL.",
            key,
            "quality.truth",
        )
    if _has_law_in_osl(settings):
        yield Reason(
            f"{key} ({depth:g}): a law in OSL traces its light past the grains; set hapke.backend to NODES.",
            key,
            "hapke.backend",
        )


def _find_loose_reasons(settings: Settings) -> Iterator[Reason]:
    """Yield reasons against the thickness of loose material, which rays find in the full truth of procedural ground."""
    key = "quality.loose_thickness"
    if not settings.quality.loose_thickness:
        return
    for name, needed, why in (
        ("source.kind", "PROCEDURAL", "nothing tells what is loose on ground from a file"),
        ("rig.images", "PAIR", "it belongs to the truth of a pair"),
        ("quality.truth", "FULL", "it belongs to the full truth"),
        ("quality.truth_by", "RAYS", "only rays find it"),
    ):
        topic, _, setting = name.partition(".")
        if settings[topic][setting] != needed:
            yield Reason(f"{key} is true, but {why}; set {name} to {needed}, or {key} to false.", key, name)


def _make_limit_reason(joint: Joint, value: float) -> Reason:
    unit, scale = (" m", 1.0) if joint.slides else ("°", 180.0 / math.pi)
    low, high, there = (f"{scale * each:.4g}{unit}" for each in (joint.low, joint.high, value))
    return Reason(
        f"lander.joints puts the joint {joint.name} at {there}, but its limits in the URDF are {low} to "
        f"{high}; change lander.joints.",
        "lander.joints",
    )


def find_lander_reasons(settings: Settings) -> Iterator[Reason]:
    """Yield reasons against a lander: joints beyond their limits, and an arm around an eye, which would see only
    black.
    """
    if settings.lander.kind == "NONE":
        return
    try:
        arm, joints, rig = make_arm(settings), joint_values(settings), settings.rig
    except IcyMoonError as error:
        yield Reason(str(error), "lander.file", "lander.joints")
        return
    for k in find_joints_beyond_limits(arm, joints):
        name = arm.joints[k].name
        if is_users_arm(settings):
            yield _make_limit_reason(arm.joints[k], float(joints[k]))
            continue
        low, high = settings.arm[f"{name}_low_deg"], settings.arm[f"{name}_high_deg"]
        yield Reason(
            f"arm.{name}_deg puts the joint {name} at {math.degrees(joints[k]):.4g}°, fault included, but its "
            f"limits are {low:g}° to {high:g}°; turn it back, or change arm.{name}_low_deg or "
            f"arm.{name}_high_deg.",
            *(f"arm.{name}_{key}" for key in ("deg", "offset_deg", "low_deg", "high_deg")),
        )
    right = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)[:, 0]
    for eye, aside in (("left", 0.0), ("right", float(rig.baseline_m))):
        if link := find_link_around(arm, joints, np.array([rig.x_m, rig.y_m, rig.height_m]) + aside * right):
            yield Reason(
                f"The {eye} eye is inside the arm's {link.replace('_', ' ')}; turn the joints of the topic "
                "arm, or change rig.height_m.",
                *(f"arm.{name}_deg" for name in JOINTS),
                "rig.height_m",
            )


def find_eye_reasons(ground: RockyGround, rigs: Sequence[RigSettings]) -> list[Reason | None]:
    """Find, for each rig on procedural ground, the reason why its camera cannot stand there; None if it can. Raises
    IcyMoonError if the settings of ground or rocks contradict each other.
    """
    x, y, height, z = (np.array([rig[key] for rig in rigs], float) for key in ("x_m", "y_m", "height_m", "z_m"))
    stated = np.array([rig.height_from == "ZERO" for rig in rigs])
    height = np.where(stated, z - ground.heights(x, y), height)
    aside = [rig.baseline_m * camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)[:, 0] for rig in rigs]
    eyes = ground.eyes(x, y, height, np.array(aside))
    return [
        Reason(describe_buried_eye(rig, "left", -float(left)), "rig.z_m", *_POSE_SETTINGS)
        if left < MIN_EYE_HEIGHT_M
        else _find_eye_reason(rig, float(above), bool(inside))
        for rig, left, above, inside in zip(rigs, height, eyes.above_m, eyes.in_rock, strict=True)
    ]


def _find_eye_reason(rig: RigSettings, above_m: float, in_rock: bool) -> Reason | None:
    if not math.isfinite(above_m):
        return Reason(
            f"{_find_camera_place(rig)}, stands outside the ground; change rig.x_m, rig.y_m or terrain.size_m.",
            *OUTSIDE_SETTINGS,
        )
    if above_m < MIN_EYE_HEIGHT_M:
        return Reason(describe_buried_eye(rig, "right", -above_m), *_POSE_SETTINGS)
    return Reason(describe_eye_in_rock(rig, "right"), *_POSE_SETTINGS) if in_rock else None


def _find_camera_place(rig: RigSettings) -> str:
    return f"The camera at east {rig.x_m:g} m, north {rig.y_m:g} m, heading {rig.heading_deg:g}°"


def describe_buried_lamp(number: int, depth_m: float | None) -> str:
    """Describe in a sentence the buried lamp with this number in the list; empty for a lamp above the ground.
    ``depth_m`` is its depth under the ground, infinite in a rock, and negative or None above the ground.
    """
    if depth_m is None or depth_m < 0:
        return ""
    where = "inside a rock" if math.isinf(depth_m) else f"{depth_m:.3g} m under the ground"
    return f"light.lamps[{number}] is {where}, so it lights nothing; raise its z_m, or change x_m or y_m."


def describe_buried_eye(rig: RigSettings, eye: str, depth_m: float) -> str:
    """Describe in a sentence an eye ``depth_m`` under the ground, or (negative) less than ``MIN_EYE_HEIGHT_M`` above
    it.
    """
    height = "rig.z_m" if rig.height_from == "ZERO" else "rig.height_m"
    return (
        f"{_find_camera_place(rig)}, has its {eye} eye {describe_depth(depth_m)}; raise {height} "
        f"({rig[height[4:]]:g} m), or change the site, rig.heading_deg or rig.baseline_m."
    )


def describe_depth(depth_m: float) -> str:
    """Describe the position of a camera that is too low; ``depth_m`` is its depth under the ground, negative above
    it.
    """
    if depth_m >= 0:
        return f"{depth_m:.3g} m under the ground"
    return f"{-depth_m:.2g} m above the ground, less than {MIN_EYE_HEIGHT_M:g} m"


def describe_eye_in_rock(rig: RigSettings, eye: str) -> str:
    """Describe in a sentence an eye that is inside a rock."""
    return f"{_find_camera_place(rig)}, has its {eye} eye in a rock; change the site or raise rocks.clear_radius_m."
