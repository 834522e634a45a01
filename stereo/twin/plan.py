"""The twin of each photographed pair: its complete settings, and its assumptions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics.camera.lens_distortion import find_overscan, read_coefficients
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES
from ...render.plans.planned_pair import PlannedPair, expand_headings
from ...settings import user_files
from ...settings.description import check, merged
from ...settings.topics.declaration import Parts
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ..measure.fit_check import READINGS, MatchedPlaces, find_common_places, find_fault
from .photographs import Photographs, Rectification
from .pose import Pose, fit_pose

#: Factor on the needed margin, for the rounding of settings.
_MARGIN_FACTOR = 1.01
#: Settings of the pose that a true depth gives.
POSE_KEYS = ("height_m", "pitch_deg", "roll_deg")
#: The images count as exchanged if exchanging them multiplies the number of matching places by more than this factor.
_EXCHANGED_RATIO = 2.0


@dataclass(frozen=True)
class Twin:
    """A photographed pair, the pair to render beside it, the pose from its true depth, if any, and sentences on
    possible faults of its files.
    """

    photographs: Photographs
    planned: PlannedPair
    pose: Pose | None
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Described:
    """The scene that the user states: complete settings ``below`` the settings of the calibrated ``rig``, and changes
    ``above`` them. ``own`` are the user's own files and changes in both.
    """

    below: Settings
    rig: Settings
    above: Settings
    own: Sequence[Parts]

    def states(self, topic: str, *keys: str) -> bool:
        """Return whether the user states one of these settings, apart from presets."""
        return any(key in part.get(topic, {}) for part in self.own for key in keys)

    def complete(self, *more: Parts) -> Settings:
        """Return the complete settings, with ``more`` between rig and changes. The lens gets the margin that it
        needs.
        """
        found = merged(self.below, self.rig, *more, self.above, {"dataset": {"headings": 1}})
        needed = find_overscan(found.rig) if any(read_coefficients(found.rig)) else 0.0
        if needed and not self.states("rig", "overscan"):
            found = merged(found, check({"rig": {"overscan": min(needed * _MARGIN_FACTOR, 2.0)}}, "the calibration"))
        return found


def plan_twins(pairs: Sequence[Photographs], described: Described, rectification: Rectification) -> list[Twin]:
    """Plan the twin of each pair. Twins have different seeds and so different grounds; the first has the seed in the
    settings.

    Height, pitch and roll follow from the true depth, unless the user states one of them. Raises IcyMoonError for a
    file that cannot be read; all files are read.
    """
    known = described.states("rig", *POSE_KEYS)
    twins, first = [], int(described.complete().dataset.seed)
    for number, photographs in enumerate(pairs):
        left, right = (rectification.read_grey(path, eye) for path, eye in zip(photographs.files, EYES, strict=False))
        places = find_common_places(left, right)
        doubts = [*_doubt_order(photographs, places)]
        pose, own = None, Settings()
        if photographs.depth:
            disparity = rectification.read_disparity(photographs.depth)
            doubts += _doubt_depth(photographs.depth, disparity, rectification.camera, places)
            if not known:
                pose = fit_pose(disparity, rectification.camera)
                own = check({"rig": {key: getattr(pose, key) for key in POSE_KEYS}}, str(photographs.depth))
        settings = merged(described.complete(own), {"dataset": {"seed": first + number}})
        (planned,) = expand_headings(settings, user_files.hash_content(settings))
        twins.append(Twin(photographs, planned, pose, tuple(doubts)))
    return twins


def _doubt_order(photographs: Photographs, places: MatchedPlaces) -> Iterator[str]:
    """Yield a sentence if the images match better with the right image first, or in too few places for the
    calibration.
    """
    stated, swapped = (int(np.isfinite(each).sum()) for each in (places.left, places.swapped))
    if not places.are_enough():
        yield (
            f"{photographs.left} and {photographs.right} match in few places along their rows: they have too little "
            "texture, or the calibration belongs to other images."
        )
    elif swapped > _EXCHANGED_RATIO * stated:
        yield (
            f"{photographs.left} and {photographs.right} match better with the right image first; exchange them if "
            "they are."
        )


def _doubt_depth(path: Path, disparity: Array, camera: StereoCamera, places: MatchedPlaces) -> Iterator[str]:
    """Yield a sentence if the true depth contradicts the images."""
    fault = find_fault(disparity, "disparity", camera, places)
    if fault is not None:
        fits = f"; it fits {READINGS[fault.kind]}" if fault.kind in READINGS else ""
        yield f"{path} contradicts the images{fits}. Errors of the photographs mean nothing then."
