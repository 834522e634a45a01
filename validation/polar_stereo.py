"""Matchers on the photographs and on their twins: whether the twin predicts the errors on the photograph.

Errors are measured where scans give the truth: at pixels that both eyes see and that show a scanned rock in the labels
and in the twin, two pixels inside its outline. The truth is the twin's disparity. It contains the errors of the camera
and of the scans, which the rows of disparity state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..physics.camera.stereo_camera import StereoCamera
from ..stereo.images.disparity_and_occlusion import find_visible_in_right
from ..stereo.images.image_files import read_png
from ..stereo.images.image_values import find_white, stretch_to_8_bit
from ..stereo.images.masks import erode, sample_at_pixels
from ..stereo.inference import typical_scene
from ..stereo.matchers import check_options, match
from ..stereo.matchers.methods import describe_method
from ..stereo.matchers.search_range import AUTO, SearchRange, find_true_range
from ..stereo.measure.metrics import find_wrong_share
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from .comparison import Row
from .polar.camera import Calibration
from .polar.data_set import EYES, HEIGHT_PX, WIDTH_PX, Terrain, View
from .polar.scene import Frame, Masks

METHODS = ("bm", "sgbm", "sgbm_wls", "icynet")
#: Largest difference between the shares of wrong or missing pixels in the twin and in the photograph.
_MAX_SHARE_DIFFERENCE = 0.1
#: Least distance in pixels from an outline, inside it, of a judged pixel.
_INSET_PX = 2
#: Least number of judged pixels of a pair.
_FEWEST_JUDGED_PX = 100
#: Points of a photograph for each pixel of our rig, along both axes.
_SAMPLES_PER_PIXEL_SIDE = 4
_SOURCE = "NASA's photographs, matched; the truth is by POLAR-Sim's scans"
_WHY_NO_PHOTOGRAPHS = "FOLDER has no photographs/TT_P_off_AZ_E.png of both eyes"


def judge_stereo(
    terrain: Terrain, camera: Calibration, frames: Mapping[str, Frame], masks: Mapping[tuple[View, int], Masks]
) -> list[Row]:
    """Make the rows of the matchers that can run here: mean shares of wrong or missing pixels, and the interval of the
    typical difference."""
    methods = [method for method in METHODS if _can_run(method)]
    shares = []
    for position, azimuth in sorted({(view.position, azimuth) for view, azimuth in terrain.images}):
        eyes = {eye: (View(position, eye), azimuth) for eye in EYES}
        if all(at in terrain.images and at in masks for at in eyes.values()):
            seen = {eye: masks[at] for eye, at in eyes.items()}
            found = _measure_shares(methods, terrain, camera, frames[position], seen, eyes)
            shares += [found] if found is not None else []
    if not shares:
        nothing = float("nan")
        return [
            Row(
                "matchers on the photographs",
                nothing,
                nothing,
                _MAX_SHARE_DIFFERENCE,
                _SOURCE,
                unjudged=_WHY_NO_PHOTOGRAPHS,
            )
        ]
    return _make_share_rows(methods, np.array(shares))


def _can_run(method: str) -> bool:
    """Return whether the libraries of a matcher are installed."""
    try:
        check_options(method, {})
    except IcyMoonError:
        return False
    return True


def _make_share_rows(methods: Sequence[str], shares: Array) -> list[Row]:
    """Make rows from shares (pairs, 2, methods) of wrong or missing pixels, first of photographs, then of twins."""
    count, family = len(shares), typical_scene.compare_in_typical_scene(shares[:, 1] - shares[:, 0], 0)
    few = f"an interval takes {format_count(family.needed, 'pair')}, here are {count}" if count < family.needed else ""
    rows = []
    for k, method in enumerate(methods):
        name = f"{describe_method(method)} on {format_count(count, 'pair')}, wrong or missing on scanned rocks"
        photographed, twin = (float(each) for each in shares[:, :, k].mean(axis=0))
        farthest = max(family.low[k], family.high[k], key=abs)
        rows += [
            Row(
                f"{name}: mean of the twins and of the photographs", twin, photographed, _MAX_SHARE_DIFFERENCE, _SOURCE
            ),
            Row(
                f"{name}: farthest end of the 95 % interval of the typical difference",
                float(farthest),
                0.0,
                _MAX_SHARE_DIFFERENCE,
                _SOURCE,
                unjudged=few,
            ),
        ]
    return rows


def _measure_shares(
    methods: Sequence[str],
    terrain: Terrain,
    camera: Calibration,
    frame: Frame,
    masks: Mapping[str, Masks],
    eyes: Mapping[str, tuple[View, int]],
) -> Array | None:
    """Measure the shares (2, methods) of wrong or missing pixels in a photographed pair and in its twin; None if too
    few pixels count."""
    rig = StereoCamera(*frame.size, frame.focal_px, -float(frame.corner[0]), -float(frame.corner[1]), frame.baseline_m)
    left, right = (masks[eye].twin.depth for eye in EYES)
    truth = rig.disparity(left)
    visible = find_visible_in_right(left, right, rig)
    judged = erode(masks["L"].rock & masks["L"].our_rock, _INSET_PX) & visible & np.isfinite(truth)
    if np.count_nonzero(judged) < _FEWEST_JUDGED_PX:
        return None
    photographed = [
        _to_grey(rectify_photograph(frame, camera, eye, _read_photograph(terrain, eyes[eye]))) for eye in EYES
    ]
    twin = [_to_grey(masks[eye].twin.light) for eye in EYES]
    search = find_true_range(np.where(visible, truth, np.nan))
    assert search is not None
    return np.array(
        [
            [_find_wrong_share(method, pair, truth, judged, rig, search) for method in methods]
            for pair in (photographed, twin)
        ]
    )


def _find_wrong_share(
    method: str, pair: list[Array], truth: Array, judged: Array, rig: StereoCamera, search: SearchRange
) -> float:
    left, right = pair
    disparity, _, _ = match(method, left, right, camera=rig, ranges={AUTO: search})
    return find_wrong_share(disparity, truth, judged)


def _read_photograph(terrain: Terrain, at: tuple[View, int]) -> Array:
    path = terrain.images[at]
    image = read_png(path)
    if image.shape[:2] != (HEIGHT_PX, WIDTH_PX):
        raise IcyMoonError(
            f"{path}: has {image.shape[1]} x {image.shape[0]} pixels; a photograph has {WIDTH_PX} x {HEIGHT_PX}, so "
            "give it uncropped."
        )
    return np.asarray(image if image.ndim == 2 else image[..., :3].mean(axis=2), np.float32)


def rectify_photograph(frame: Frame, camera: Calibration, eye: str, image: Array) -> Array:
    """Resample a photograph (H, W) to our rig. Each pixel is the mean of its part of the photograph."""
    rows, columns = frame.shape
    at = np.stack(
        np.meshgrid(
            (np.arange(columns * _SAMPLES_PER_PIXEL_SIDE) + 0.5) / _SAMPLES_PER_PIXEL_SIDE,
            (np.arange(rows * _SAMPLES_PER_PIXEL_SIDE) + 0.5) / _SAMPLES_PER_PIXEL_SIDE,
        ),
        axis=-1,
    )
    fine = sample_at_pixels(image, frame.unrectify(camera, eye, at.reshape(-1, 2)).reshape(at.shape))
    return np.asarray(fine.reshape(rows, _SAMPLES_PER_PIXEL_SIDE, columns, _SAMPLES_PER_PIXEL_SIDE).mean(axis=(1, 3)))


def _to_grey(image: Array) -> Array:
    return stretch_to_8_bit(image, find_white(image))
