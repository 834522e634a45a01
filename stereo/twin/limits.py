"""Sentences on the limits of a twin, which follow from its input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...support.number_text import format_count, show_rounded
from .photographs import LOSSY_SUFFIXES, Rectification
from .plan import Described, Twin

#: Ratio of relief to height above which the sentence on the pose names the relief; least share of sky or unseen pixels
#: that is named.
_REPORTED_RELIEF, _REPORTED_SHARE = 0.05, 0.005


def list_limits(
    twins: Sequence[Twin],
    records: Sequence[Mapping[str, Any]],
    described: Described,
    rectification: Rectification,
    needed: int,
    ground: str,
) -> list[str]:
    """List the sentences on limits, the most important first.

    ``needed`` is the number of pairs for an interval of the differences; ``ground`` is the file of the user's own
    ground, "" without one.
    """
    return [
        *_tell_ground(twins, ground),
        *_tell_truth(twins),
        *_tell_pose(twins, described),
        *_tell_light(twins, described),
        *_tell_images(twins, records, rectification),
        *_tell_search(records),
        *_tell_number(len(twins), needed, ground),
    ]


def _tell_ground(twins: Sequence[Twin], ground: str) -> list[str]:
    if ground:
        return [
            f"The ground of the twin is {ground}: whatever is smaller than its cells is missing, unless settings add "
            "it, and its albedo is that of the settings."
        ]
    each = "The ground of the twin is" if len(twins) == 1 else "Each twin has a ground of its own,"
    return [
        f"{each} made by code: no stone, crack or shadow of the photograph is in it, so compare numbers, not places."
    ]


def _tell_truth(twins: Sequence[Twin]) -> list[str]:
    if any(twin.photographs.depth for twin in twins):
        return [
            "The true depth of the photographs has errors of its own, which are among the errors of the matchers "
            "there; that of the twin has none.",
            "Errors count pixels that the other eye does not see too: no photograph tells which these are.",
        ]
    return [
        "There is no true depth of the photographs, so only the twin has errors. Coverage and consistency do not tell "
        "whether a disparity is right."
    ]


def _tell_pose(twins: Sequence[Twin], described: Described) -> list[str]:
    poses = [twin.pose for twin in twins if twin.pose]
    if poses:
        found = [
            "Height, pitch and roll are those over the plane that fits the true depth, which is taken to be level: "
            + _format_range([pose.height_m for pose in poses], "m")
            + " high, "
            + _format_range([pose.pitch_deg for pose in poses], "degrees")
            + " down, "
            + _format_range([pose.roll_deg for pose in poses], "degrees")
            + " clockwise."
        ]
        relief = max(pose.relief_m / pose.height_m for pose in poses)
        if relief > _REPORTED_RELIEF:
            found.append(
                f"The true points are off that plane by up to {show_rounded(100 * relief)} % of the height (root mean "
                "square), so depths of photograph and twin differ."
            )
        return found
    rig = twins[0].planned.settings.rig
    stated = described.states("rig", "height_m", "pitch_deg")
    rolled = f", rolled {rig.roll_deg:g} degrees clockwise" if rig.roll_deg else ""
    return [
        f"The camera of the twin is {rig.height_m:g} m above the ground and looks {rig.pitch_deg:g} degrees "
        f"down{rolled}, as "
        + ("stated" if stated else "in the preset; state rig.height_m, rig.pitch_deg and rig.roll_deg of yours")
        + "."
    ]


def _format_range(values: Sequence[float], unit: str) -> str:
    ends = [show_rounded(end, 3) for end in (min(values), max(values))]
    return f"{ends[0]} {unit}" if ends[0] == ends[1] else f"{ends[0]} to {ends[1]} {unit}"


def _tell_light(twins: Sequence[Twin], described: Described) -> list[str]:
    light = twins[0].planned.settings.light
    if described.states("light", "sun_elevation_deg", "sun_azimuth_deg", "directions_from"):
        return []
    return [
        f"The Sun is {light.sun_elevation_deg:g} degrees high, as in the preset; state light.sun_elevation_deg and "
        "light.sun_azimuth_deg of yours."
    ]


def _tell_images(
    twins: Sequence[Twin], records: Sequence[Mapping[str, Any]], rectification: Rectification
) -> list[str]:
    found = [
        "Exposure, gamma, noise and sharpness of the real camera are in no calibration. All images are stretched to "
        "the same white, so their brightness is not compared; noise and sharpness of the twin are those of its sensor "
        "settings."
    ]
    if rectification.interpolates and not _is_distorted(twins):
        found.append(
            "The photographs were interpolated when they were rectified, which takes away fine detail; the twin was "
            "rendered as it is."
        )
    if any(
        path.suffix.lower() in LOSSY_SUFFIXES
        for twin in twins
        for path in (twin.photographs.left, twin.photographs.right)
    ):
        found.append("Photographs in files such as JPEG have lost detail to compression; the twin has not.")
    if (denoiser := twins[0].planned.settings.quality.denoiser) != "NONE":
        found.append(f"The twin was denoised ({denoiser}), which makes matchers look better than they are on it.")
    unseen = 1 - min(record["seen_share"] for record in records)
    if unseen > _REPORTED_SHARE:
        found.append(f"{show_rounded(100 * unseen)} % of the rectified image, which no sensor sees, do not count.")
    sky = max(record["sky_share"] for record in records)
    if sky > _REPORTED_SHARE:
        found.append(
            f"Up to {show_rounded(100 * sky)} % of a twin are sky, which counts as dark and without a disparity."
        )
    return found


def _is_distorted(twins: Sequence[Twin]) -> bool:
    rig = twins[0].planned.settings.rig
    return any(rig[f"distortion_{name}"] for name in ("k1", "k2", "p1", "p2", "k3"))


def _tell_search(records: Sequence[Mapping[str, Any]]) -> list[str]:
    least, most = zip(*(record["search_px"] for record in records), strict=True)
    return [
        f"Matchers that follow the rig search {np.min(least):.0f} to {np.max(most):.0f} px in both; nearer and farther "
        "points are missed."
    ]


def _tell_number(count: int, needed: int, ground: str) -> list[str]:
    alike = ["All twins see the same ground from the same place, so they are not independent."] if ground else []
    if count < needed:
        return [
            *(alike if count > 1 else []),
            f"Intervals of the differences take {format_count(needed, 'pair')}, and there "
            f"{'is' if count == 1 else 'are'} {count}: whether a difference is more than chance, these do not tell.",
        ]
    return [*alike, "Intervals hold for pairs that were chosen independently; images of one site or drive are not."]
