"""Solids of the lander and its arm, one for each link, in the frame of the link.

The design is our own, but has the parts of published landers: a deck over a body in foil, legs with a shock absorber
and two struts, round pads, a mast, an arm of painted tubes between metal joints, cables, and a bucket with a blade.
Settings give the main sizes, from which the other dimensions follow.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from ...settings.topics.lander import ArmSettings, LanderSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from .kinematics import Capsule, make_rigid_transform
from .parametric_arm import RADII_M
from .solids import Solid, join_solids, make_ball, make_box, make_lathe, make_prism, make_rod, transform_solid

#: Materials of the lander.
METAL, BLACK, FOIL, WHITE, STEEL, TUBE = "metal", "black", "foil", "white", "steel", "tube"
#: Names of the parts that do not move: the body,
BODY = "body"
#: the mast under the cameras,
MAST = "mast"
#: and the legs.
LEGS = ("leg_left", "leg_right")
#: The housing of the cameras, which turns with the rig.
HEAD = "head"
#: Thickness of the deck in metres.
_DECK_M = 0.03
#: Depth of the body under the deck, in metres.
_BODY_DEPTH_M = 0.3
#: Pose whose x axis is the y axis: turns a solid of revolution about x into one about y.
_AXIS_X_TO_Y = make_rigid_transform(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
#: Pose that turns a solid of revolution about x into one about z.
_AXIS_X_TO_Z = make_rigid_transform(
    np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]) @ np.diag([-1.0, -1.0, 1.0])
)


def make_still_solids(settings: Settings, pads_m: Sequence[float] = (0.0, 0.0)) -> dict[str, Solid]:
    """Make the solids that do not move, by name, in the lander's frame: body, legs, and the mast if the cameras are
    above the deck. ``pads_m`` are the ground heights in metres under the left and the right pad, above the origin of
    that frame.
    """
    lander, top = settings.lander, settings.lander.deck_height_m
    mast = _make_mast(settings, top)
    return {
        BODY: _make_body(settings),
        **({MAST: join_solids(mast)} if mast else {}),
        **{
            leg: join_solids(_make_leg(lander, (x, y, ground - lander.pad_sink_m), _find_deck_extent(lander)))
            for leg, (x, y), ground in zip(LEGS, find_pad_centres(lander), pads_m, strict=True)
        },
    }


def make_arm_solids(arm: ArmSettings) -> dict[str, Solid]:
    """Make the solid of each link of the parametric arm by name, in the link's frame, in metres."""
    return {
        "turret": _make_turret(arm),
        "upper_arm": _make_segment(arm.upper_m, 0.042, 0.075, 1),
        "forearm": _make_segment(arm.fore_m, 0.034, 0.062, -1),
        "hand": _make_hand(arm),
        "scoop": _make_scoop(arm),
    }


def find_pad_centres(lander: LanderSettings) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (x, y) of the centres of the left and the right pad in the lander's frame, in metres."""
    return (lander.pad_ahead_m, lander.pad_apart_m / 2), (lander.pad_ahead_m, -lander.pad_apart_m / 2)


def _make_upright(
    material: str, outline: Sequence[tuple[float, float]], at: tuple[float, ...] | Array, sides: int = 40
) -> Solid:
    """Make a solid of revolution about a vertical axis through ``at``, from an outline of (height, radius)."""
    return transform_solid(make_lathe(material, outline, sides), make_rigid_transform(_AXIS_X_TO_Z[:3, :3], at))


def _make_drum(material: str, radius: float, width: float, bevel: float = 0.012) -> Solid:
    """Make the motor of a pitch joint: a cylinder along the y axis."""
    half = width / 2
    outline = [
        (-half, 0.0),
        (-half, radius - bevel),
        (bevel - half, radius),
        (half - bevel, radius),
        (half, radius - bevel),
        (half, 0.0),
    ]
    return transform_solid(make_lathe(material, outline), _AXIS_X_TO_Y)


def _make_joint(radius: float, width: float) -> list[Solid]:
    """Make the solids of a joint: a cylinder along the y axis, with black caps and rings of bolts."""
    caps = [
        transform_solid(
            _make_drum(BLACK, radius * 0.72, 0.02, 0.004),
            make_rigid_transform(place=(0.0, side * (width / 2 + 0.008), 0.0)),
        )
        for side in (-1, 1)
    ]
    bolts = [
        make_rod(
            STEEL,
            (radius * 0.86 * math.cos(t), side * (width / 2 - 0.001), radius * 0.86 * math.sin(t)),
            (radius * 0.86 * math.cos(t), side * (width / 2 + 0.005), radius * 0.86 * math.sin(t)),
            0.005,
            sides=8,
        )
        for side in (-1, 1)
        for t in np.arange(8) * math.pi / 4
    ]
    return [_make_drum(METAL, radius, width), *caps, *bolts]


def _make_turret(arm: ArmSettings) -> Solid:
    """Make the link that turns with the yaw joint and carries the shoulder."""
    offset = max(arm.offset_m, 1e-3)
    below = min(0.22, arm.shoulder_z_m - 0.05)
    outline = [
        (-below, 0.0),
        (-below, 0.07),
        (-below + 0.01, 0.08),
        (-0.09, 0.08),
        (-0.075, 0.065),
        (-0.06, 0.065),
        (-0.05, 0.0),
    ]
    drum = transform_solid(make_lathe(METAL, outline), _AXIS_X_TO_Z)
    band = transform_solid(
        make_lathe(BLACK, [(-0.16, 0.0), (-0.16, 0.083), (-0.13, 0.083), (-0.13, 0.0)]), _AXIS_X_TO_Z
    )
    cheeks = [
        make_box(METAL, (offset + 0.09, 0.014, 0.12), (offset / 2 + 0.005, side * 0.062, -0.005), 0.006)
        for side in (-1, 1)
    ]
    floor = make_box(METAL, (offset + 0.05, 0.13, 0.03), (offset / 2 - 0.01, 0.0, -0.06), 0.006)
    motors = [
        transform_solid(_make_drum(BLACK, 0.045, 0.05), make_rigid_transform(place=(offset, side * 0.094, 0.0)))
        for side in (-1, 1)
    ]
    return join_solids([drum, band, *cheeks, floor, *motors])


def _make_segment(length: float, radius: float, joint: float, side: int) -> Solid:
    """Make an upper arm or forearm: a joint, a painted tube between metal fittings, a cable with clamps, and a fork."""
    width, inner = 1.45 * joint, joint * 1.05
    end = length - inner
    parts = [
        *_make_joint(joint, width if side > 0 else width * 0.9),
        make_rod(METAL, (joint * 0.6, 0, 0), (inner + 0.07, 0, 0), radius * 1.35, radius * 1.08, 0.08),
        make_rod(TUBE, (inner + 0.06, 0, 0), (end - 0.06, 0, 0), radius, sides=48),
        make_rod(METAL, (end - 0.07, 0, 0), (end - 0.005, 0, 0), radius * 1.08, radius * 1.35, 0.08),
    ]
    fork = radius * 1.7
    parts += [
        make_box(
            METAL, (inner + joint * 0.75, 0.012, joint * 1.25), (length - inner / 2 + joint * 0.1, s * fork, 0.0), 0.006
        )
        for s in (-1, 1)
    ]
    parts.append(make_box(METAL, (0.02, 2 * fork, joint * 1.25), (end - 0.004, 0, 0), 0.005))
    high = radius + 0.013
    cable = [
        (inner - 0.02, 0.0, joint * 0.7),
        (inner + 0.07, 0.012 * side, high),
        (length * 0.5, 0.016 * side, high),
        (end - 0.06, 0.012 * side, high),
        (length - 0.04, 0.02 * side, joint * 0.75),
    ]
    parts += [make_rod(BLACK, a, b, 0.009, bevel=0.0, sides=12) for a, b in itertools.pairwise(cable)]
    places = np.linspace(inner + 0.12, end - 0.12, 3)
    ring = make_lathe(WHITE, [(-0.012, 0.0), (-0.012, radius + 0.004), (0.012, radius + 0.004), (0.012, 0.0)])
    parts += [transform_solid(ring, make_rigid_transform(place=(x, 0.0, 0.0))) for x in places]
    parts += [make_box(STEEL, (0.022, 0.03, 0.02), (x, 0.014 * side, high - 0.003), 0.003) for x in places]
    return join_solids(parts)


def _make_hand(arm: ArmSettings) -> Solid:
    """Make the link between the wrist and the scoop."""
    length = arm.hand_m
    parts = [
        *_make_joint(0.042, 0.075),
        make_box(METAL, (length * 0.6, 0.05, 0.052), (length * 0.42, 0.0, 0.0), 0.008),
        make_rod(BLACK, (length * 0.55, 0, 0), (length * 0.94, 0, 0), 0.032),
        make_rod(STEEL, (length * 0.9, 0, 0), (length, 0, 0), 0.02),
    ]
    parts.append(make_box(WHITE, (length * 0.34, 0.03, 0.012), (length * 0.4, 0.0, 0.031), 0.003))
    return join_solids(parts)


def _make_plate(corners: Sequence[tuple[float, float]], y: float, thick: float) -> Solid:
    """Make a flat plate of metal with an outline of (x, z), between y - thick / 2 and y + thick / 2."""
    # make_prism takes its outline in x and y, with z as the height.
    turn = make_rigid_transform(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))
    return transform_solid(make_prism(METAL, corners, -y - thick / 2, -y + thick / 2), turn)


def _make_scoop(arm: ArmSettings) -> Solid:
    """Make an open bucket with its back at z = 0, a rounded heel at the hand and a blade at the tip; it opens to -z."""
    length, width, depth = arm.scoop_length_m, arm.scoop_width_m, arm.scoop_depth_m
    thick = 0.03 * min(length, width, depth) + 0.001
    heel = [(0.0, -depth), (0.0, -0.3 * depth), (0.12 * length, 0.0)]  # (x, z) of the rounded end
    outline = [
        (0.0, -depth),
        (0.82 * length, -0.45 * depth),
        (0.88 * length, 0.0),
        (0.12 * length, 0.0),
        (0.0, -0.3 * depth),
    ]
    sides = [_make_plate(outline, s * (width - thick) / 2, thick) for s in (-1, 1)]
    walls = [
        _make_wall((x0, z0), (x1, z1), width - 2 * thick, thick) for (x0, z0), (x1, z1) in itertools.pairwise(heel)
    ]
    back = _make_wall((0.12 * length, 0.0), (0.9 * length, 0.0), width - 2 * thick, thick)
    blade = make_box(STEEL, (0.3 * length, width * 1.02, thick), (0.85 * length, 0.0, -thick / 2), thick * 0.4)
    teeth = [
        make_box(STEEL, (0.05 * length, width * 0.1, thick * 1.6), (0.965 * length, y, -thick / 2), thick * 0.4)
        for y in np.linspace(-0.42, 0.42, 5) * width
    ]
    mount = [
        make_rod(METAL, (-0.02, 0.0, 0.0), (0.01, 0.0, 0.0), 0.03),
        make_box(METAL, (0.02, width * 0.7, 0.35 * depth), (0.002, 0.0, -0.3 * depth), 0.003),
        make_box(METAL, (0.5 * length, 0.012, 0.012), (0.4 * length, 0.0, 0.006), 0.003),
    ]
    return join_solids([*sides, *walls, back, blade, *teeth, *mount])


def _make_wall(start: tuple[float, float], end: tuple[float, float], width: float, thick: float) -> Solid:
    """Make a plate across y between two points (x, z); its thickness lies inward of the line between them."""
    along = math.hypot(end[0] - start[0], end[1] - start[1])
    angle = math.atan2(end[1] - start[1], end[0] - start[0])
    c, s = math.cos(angle), math.sin(angle)
    turned = make_rigid_transform(np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]), (start[0], 0.0, start[1]))
    return transform_solid(make_box(METAL, (along, width, thick), (along / 2, 0.0, -thick / 2), 0.0005), turned)


def _find_deck_extent(lander: LanderSettings) -> tuple[float, float, float, float]:
    """Return the front, half width and top of the deck, and the floor of the body, in metres in the lander's frame."""
    top = lander.deck_height_m
    return lander.deck_front_m, lander.deck_width_m / 2, top, max(top - _DECK_M - _BODY_DEPTH_M, 0.3 * top)


def _make_body(settings: Settings) -> Solid:
    """Make the deck, the body under it in foil, and the equipment on it."""
    front, half, top, floor = _find_deck_extent(settings.lander)
    corner = 0.3 * half
    outline = [
        (front, -half + corner),
        (front, half - corner),
        (front - corner, half),
        (front - 1.1, half),
        (front - 1.4, half - corner),
        (front - 1.4, corner - half),
        (front - 1.1, -half),
        (front - corner, -half),
    ]
    under = top - _DECK_M
    parts = [
        make_prism(WHITE, outline, under, top, 0.008),
        make_prism(FOIL, [(x * 0.93 - 0.01, y * 0.9) for x, y in outline], floor, under - 0.002, 0.0, 0.86),
    ]
    parts += _make_deck_parts(front, half, corner, top)
    return join_solids([*parts, *_make_boom(settings, front, top)])


def _make_deck_parts(front: float, half: float, corner: float, top: float) -> list[Solid]:
    """Make the parts on the deck: a rail, boxes, a sample funnel and a colour target."""
    y = half - corner - 0.02
    rail = [make_rod(METAL, (front - 0.03, -y, top + 0.045), (front - 0.03, y, top + 0.045), 0.009, sides=16)]
    rail += [
        make_rod(METAL, (front - 0.03, at, top - 0.005), (front - 0.03, at, top + 0.045), 0.007, sides=12)
        for at in np.linspace(-y, y, 5)
    ]
    cone = [(0.0, 0.0), (0.0, 0.05), (0.05, 0.05), (0.1, 0.085), (0.104, 0.085), (0.06, 0.045), (0.02, 0.0)]
    funnel = _make_upright(METAL, cone, (front - 0.17, 0.32 * half, top))
    chip = [(0.0, 0.0), (0.0, 0.022), (0.016, 0.022), (0.016, 0.0)]
    target = [
        make_box(BLACK, (0.12, 0.12, 0.012), (front - 0.13, -0.45 * half, top + 0.006), 0.003),
        *(
            _make_upright(name, chip, (front - 0.13 + dx, -0.45 * half + dy, top), 24)
            for name, dx, dy in ((WHITE, 0.03, 0.03), (FOIL, 0.03, -0.03), (METAL, -0.03, 0.03), (TUBE, -0.03, -0.03))
        ),
    ]
    boxes = [
        make_box(FOIL, (0.3, 0.34, 0.2), (front - 0.75, 0.5 * half, top + 0.1), 0.012),
        make_box(BLACK, (0.22, 0.26, 0.12), (front - 0.7, -0.55 * half, top + 0.06), 0.008),
    ]
    return [*rail, funnel, *target, *boxes]


def _make_boom(settings: Settings, front: float, top: float) -> list[Solid]:
    """Make the support of the arm in front of the deck: beams and a plate, under the built-in turret or the first link
    of the user's arm.
    """
    arm = settings.arm
    below = 0.0 if settings.lander.kind == "OWN" else min(0.22, arm.shoulder_z_m - 0.05)
    x, y, low = arm.shoulder_x_m, arm.shoulder_y_m, arm.shoulder_z_m - below
    back = min(front - 0.05, x - 0.1)
    beams = [
        make_rod(METAL, (back, y + side * 0.14, top - 0.07), (x - 0.02, y + side * 0.05, low - 0.012), 0.024)
        for side in (-1, 1)
    ]
    props = [
        make_rod(
            METAL, (back - 0.03, y + side * 0.12, max(top - 0.28, 0.1)), (x - 0.01, y + side * 0.045, low - 0.03), 0.016
        )
        for side in (-1, 1)
    ]
    rim = [(-0.03, 0.0), (-0.03, 0.085), (-0.024, 0.092), (0.0, 0.092), (0.0, 0.0)]
    plate = _make_upright(METAL, rim, (x, y, low))
    cable = [
        (back, y + 0.17, top + 0.012),
        (front + 0.02, y + 0.16, top + 0.004),
        (x - 0.12, y + 0.09, low + 0.03),
        (x - 0.05, y + 0.06, low + 0.1),
    ]
    return [
        *beams,
        *props,
        plate,
        *(make_rod(BLACK, a, b, 0.011, bevel=0.0, sides=12) for a, b in itertools.pairwise(cable)),
    ]


def _make_mast(settings: Settings, top: float) -> list[Solid]:
    """Make the mast under the cameras, behind both eyes; no solids if the cameras are not above the deck."""
    height = settings.rig.height_m - 0.17
    if height < top + 0.1:
        return []
    back = -0.09
    return [
        make_rod(METAL, (back, 0.0, top), (back, 0.0, top + 0.05), 0.075, 0.06),
        make_rod(TUBE, (back, 0.0, top + 0.04), (back, 0.0, height), 0.035),
        *(
            make_rod(METAL, (back, 0.0, z), (back, 0.0, z + 0.04), 0.04)
            for z in np.linspace(top + 0.2, height - 0.05, 3)
        ),
    ]


def _make_leg(
    lander: LanderSettings, foot: tuple[float, float, float], deck: tuple[float, float, float, float]
) -> list[Solid]:
    """Make a main leg with a shock absorber, two struts, and a round pad on a ball. The pad's sole is at ``foot``."""
    (x, y, z), (front, half, top, floor), side = foot, deck, math.copysign(1.0, foot[1])
    r = lander.pad_diameter_m / 2
    ankle = np.array([x, y, z + 0.45 * r + 0.02])
    hip = np.array([front - 0.28, side * 0.93 * half, top - 0.09])
    knee = hip + 0.6 * (ankle - hip)
    parts = [
        make_rod(FOIL, tuple(hip), tuple(knee), 0.036),
        make_rod(STEEL, tuple(knee), tuple(ankle), 0.024),
        make_rod(BLACK, tuple(knee - 0.03 * (ankle - hip)), tuple(knee + 0.012 * (ankle - hip)), 0.042),
        make_box(METAL, (0.12, 0.05, 0.14), tuple(hip), 0.01),
        make_ball(METAL, tuple(ankle), 0.04),
    ]
    low = max(floor + 0.04, 0.12)
    for anchor in ((front - 0.05, side * 0.45 * half, low), (front - 0.75, side * 0.85 * half, low)):
        parts += [make_rod(METAL, anchor, tuple(hip + 0.82 * (ankle - hip)), 0.018), make_ball(METAL, anchor, 0.03)]
    dish = [
        (0.0, 0.0),
        (0.0, 0.55 * r),
        (0.05 * r, 0.7 * r),
        (0.24 * r, r),
        (0.3 * r, r),
        (0.32 * r, 0.95 * r),
        (0.24 * r, 0.75 * r),
        (0.3 * r, 0.28 * r),
        (0.42 * r, 0.2 * r),
        (0.42 * r, 0.0),
    ]
    return [*parts, _make_upright(METAL, dish, foot, 56)]


def make_head(settings: Settings) -> Solid:
    """Make the housing of the cameras, behind both eyes, in the axes of the left eye (x right, y down, z forward)."""
    baseline = settings.rig.baseline_m
    width = baseline + 0.14
    parts = [
        make_box(WHITE, (width, 0.1, 0.13), (baseline / 2, 0.0, -0.105), 0.01),
        make_box(METAL, (0.09, 0.1, 0.09), (baseline / 2, 0.09, -0.12), 0.008),
    ]
    parts += [make_rod(BLACK, (x, 0.0, -0.05), (x, 0.0, -0.02), 0.038) for x in (0.0, baseline)]
    return join_solids(parts)


def make_body_capsules(settings: Settings) -> tuple[Capsule, ...]:
    """Make the capsules around deck, legs and mast, which the arm must not touch, in the frame of the arm's base."""
    lander, arm = settings.lander, settings.arm
    front, half, top = lander.deck_front_m, lander.deck_width_m / 2, lander.deck_height_m
    shoulder = np.array([arm.shoulder_x_m, arm.shoulder_y_m, arm.shoulder_z_m])
    thick = 0.06
    found: list[tuple[Sequence[float], Sequence[float], float]] = []
    for x in np.arange(front - thick, front - 1.4, -2 * thick):
        found.append(((x, -half + thick, top - thick), (x, half - thick, top - thick), thick))
    for x, y in find_pad_centres(lander):
        hip = (front - 0.28, math.copysign(0.93 * half, y), top - 0.09)
        found += [(hip, (x, y, 0.1), 0.045), ((x, y, 0.0), (x, y, 0.05), lander.pad_diameter_m / 2)]
    found.append(((-0.09, 0.0, top), (-0.09, 0.0, max(settings.rig.height_m - 0.1, top)), 0.05))
    found.append(((-0.1, -0.15, settings.rig.height_m), (-0.1, 0.15, settings.rig.height_m), 0.1))

    def local(point: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = np.asarray(point, float) - shoulder
        return float(x), float(y), float(z)

    return tuple(Capsule(-1, local(start), local(end), radius) for start, end, radius in found)


#: A point on a link: its name, the link's name, its position (3,) in the link's frame, and the largest distance in
#: metres of the point behind the surface. A joint's point is the middle of its drum, one radius behind the surface.
Keypoint = tuple[str, str, Array, float]


def list_arm_keypoints(arm: ArmSettings) -> list[Keypoint]:
    """List the points of the parametric arm."""
    w, d, length = arm.scoop_width_m / 2, arm.scoop_depth_m, arm.scoop_length_m
    points = [
        ("shoulder", "upper_arm", (0.0, 0.0, 0.0), 0.1),
        ("elbow", "forearm", (0.0, 0.0, 0.0), 0.09),
        ("wrist", "hand", (0.0, 0.0, 0.0), 0.07),
        ("hand_end", "hand", (arm.hand_m, 0.0, 0.0), RADII_M["hand"]),
        ("tip", "scoop", (length, 0.0, 0.0), 0.01),
        *((f"tip_{side}", "scoop", (length, sign * w, 0.0), 0.01) for side, sign in (("left", 1), ("right", -1))),
        *((f"heel_{side}", "scoop", (0.0, sign * w, -d), 0.01) for side, sign in (("left", 1), ("right", -1))),
    ]
    return [(name, link, np.array(place), radius) for name, link, place, radius in points]


def list_still_keypoints(lander: LanderSettings, pads_m: Sequence[float] = (0.0, 0.0)) -> list[Keypoint]:
    """List the points of deck and pads. ``pads_m`` are the ground heights in metres under the left and right pad."""
    points = [
        (f"pad_{side}", leg, (x, y, z - lander.pad_sink_m + 0.42 * lander.pad_diameter_m / 2), 0.06)
        for side, leg, (x, y), z in zip(("left", "right"), LEGS, find_pad_centres(lander), pads_m, strict=True)
    ]
    front, half, top = lander.deck_front_m, 0.7 * lander.deck_width_m / 2, lander.deck_height_m
    points += [(f"deck_{side}", BODY, (front, sign * half, top), 0.01) for side, sign in (("left", 1), ("right", -1))]
    return [(name, link, np.array(place), radius) for name, link, place, radius in points]
