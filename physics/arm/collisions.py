"""Collisions of an arm with itself, the lander, the ground or an eye, found by capsules around its links."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from .kinematics import Arm, Capsule, forward_kinematics

#: Ground heights (n,) in metres at coordinates x (n,) and y (n,).
Heights = Callable[[Array, Array], Array]

#: Distance in metres between points on a capsule at which the ground height is compared.
_GROUND_STEP_M = 0.02


@dataclass(frozen=True)
class WorldCapsule:
    """A capsule in the world: start and end (3,), radius in metres, and the index of its link, -1 for the base."""

    link: int
    start: Array
    end: Array
    radius_m: float


def place_capsules(arm: Arm, joints_rad: Array, others: tuple[Capsule, ...] = ()) -> list[WorldCapsule]:
    """Place all capsules of an arm in the world. ``others`` are fixed capsules in the frame of the arm's base."""
    poses = forward_kinematics(arm, joints_rad)
    found = []
    for capsule in (*arm.capsules, *others):
        at = poses[capsule.link] if capsule.link >= 0 else arm.base
        start, end = (at[:3, :3] @ np.array(each) + at[:3, 3] for each in (capsule.start, capsule.end))
        found.append(WorldCapsule(capsule.link, start, end, capsule.radius_m))
    return found


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> float:
    """Compute the distance between the segments a-b and c-d.

    Source: Ericson 2005, *Real-Time Collision Detection*, section 5.1.9.
    """
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = u @ u, u @ v, v @ v, u @ w, v @ w
    denominator = uu * vv - uv * uv
    # On parallel segments, any point of the first segment can be chosen; the clamping below corrects it.
    s = np.clip((uv * vw - vv * uw) / denominator, 0.0, 1.0) if denominator > 1e-15 else 0.0
    t = np.clip((uv * s + vw) / vv, 0.0, 1.0) if vv > 0 else 0.0
    s = np.clip((uv * t - uw) / uu, 0.0, 1.0) if uu > 0 else 0.0
    return float(np.linalg.norm(w + s * u - t * v))


def capsule_clearance_m(one: WorldCapsule, other: WorldCapsule) -> float:
    """Compute the distance between two capsules in metres; negative where they overlap."""
    return segment_distance(one.start, one.end, other.start, other.end) - one.radius_m - other.radius_m


def find_self_collisions(arm: Arm, joints_rad: Array, others: tuple[Capsule, ...] = ()) -> list[tuple[str, str]]:
    """Find the pairs of link names whose capsules overlap; "lander" is the base. Links that share a joint are left out,
    because they always touch.
    """
    names = (*arm.links, "lander")  # -1 is the last
    lines, found = place_capsules(arm, joints_rad, others), []
    for k, one in enumerate(lines):
        for other in lines[k + 1 :]:
            if not _are_joined(arm, one.link, other.link) and capsule_clearance_m(one, other) < 0:
                found.append((names[one.link], names[other.link]))
    return list(dict.fromkeys(found))


def _are_joined(arm: Arm, one: int, other: int) -> bool:
    """Return whether two links are the same link or share a joint; -1 is the base."""
    return (
        one == other
        or (one >= 0 and arm.joints[one].parent == other)
        or (other >= 0 and arm.joints[other].parent == one)
    )


def ground_clearances_m(arm: Arm, joints_rad: Array, heights: Heights) -> dict[str, float]:
    """Compute the least height in metres of each moving link above the ground, by name; negative below the ground, NaN
    outside it. ``heights`` returns the ground height in metres at coordinates (n,).
    """
    found: dict[str, float] = {}
    for line in place_capsules(arm, joints_rad):
        count = 2 + int(np.linalg.norm(line.end - line.start) / _GROUND_STEP_M)
        points = line.start + np.linspace(0.0, 1.0, count)[:, None] * (line.end - line.start)
        above = points[:, 2] - line.radius_m - np.asarray(heights(points[:, 0], points[:, 1]))
        name = arm.links[line.link]
        least = float(np.nan if np.isnan(above).all() else np.nanmin(above))
        found[name] = float(np.fmin(found.get(name, np.nan), least))
    return found


def find_link_around(arm: Arm, joints_rad: Array, point: Array) -> str:
    """Return the name of the link whose capsule contains a world point (3,), m, such as an eye; empty if no capsule
    does.
    """
    for line in place_capsules(arm, joints_rad):
        if segment_distance(line.start, line.end, point, point) < line.radius_m:
            return arm.links[line.link]
    return ""
