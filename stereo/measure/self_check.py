"""The self-check: whether the two eyes of a pair agree with each other and with the truth.

A pair that fails counts in no average, so a sound pair must never fail, however difficult it is: a pair fails only by
more than its own uncertainty. A pixel is seen, sky, or not seen (a toed-in eye does not see the whole view of a
parallel one); pixels that are not seen are ignored. ``python benchmarks selfcheck`` measures how often a sound pair
fails and which faults are found.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...physics.camera.occlusion import find_matching_column, sample_at_columns
from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ..images.disparity_and_occlusion import find_visible_in_left, find_visible_in_right
from .eye_offsets import (
    FEWEST_PIXELS,
    FEWEST_TILES,
    FITTING_CORRELATION,
    Estimate,
    LightOffsets,
    TruthOffsets,
    measure_foreign_share,
    measure_light_correlation,
    measure_light_offsets,
    measure_truth_offsets,
)

#: Largest offsets between the truth of both eyes: px, relative f·B, rows. In sound pairs they are below 1e-4 px.
TRUTH_LIMITS = {"shift_px": 0.02, "scale": 0.001, "rows_px": 0.02}
#: Standard errors beyond which a number counts as wrong. Normal errors exceed them once in a million cases, but
#: highlights and edges of shadows in neighbouring tiles are correlated.
MAX_STANDARD_ERRORS = 5.0
#: Least gain of the correlation by a shift, in standard errors. A wide highlight moves the peak, but then the peak is
#: so flat that the gain is small.
GAIN_ERRORS = 3.0
#: Largest shift of the light, px, of a sound pair.
LIGHT_LIMIT_PX = 0.25
#: Least correlation of the light that determines anything.
MIN_CORRELATION = 0.3
#: Largest share, in a sound pair, of the places found in both images that are not where the truth has them.
FOREIGN_LIMIT = 0.05
#: Largest share of pixels, in a sound pair, that the other eye sees through. Thin rocks between two columns give a few.
CONTRADICTION_LIMIT = 0.02
#: Disparity, px, by which the other eye must see a farther surface to see through a pixel.
_CONTRADICTION_PX = 1.0


@dataclass(frozen=True)
class Eye:
    """The images of one eye on the parallel rig, all (H, W)."""

    grey: Array  # radiance
    depth: Array  # planar, m, NaN for sky
    seen: Array  # bool, whether its sensor sees the pixel
    hidden: Array | None = None  # bool, see exr.Truth


@dataclass(frozen=True)
class SelfCheck:
    """The result of the self-check. A number is None if common pixels, relief, light or texture are missing."""

    photometric_disagreement: float | None  # median relative difference of left and right radiance of a point
    photometric_offset_px: float | None  # shift of the right image that fits best; 0 in a right pair
    photometric_error_px: float | None  # standard error of ``photometric_offset_px``
    truth_offset_px: float | None  # shift of the right eye's truth that fits best
    contradictions: float | None  # share of an eye's pixels whose point the other eye sees through
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the pair may be averaged with others."""
        return not self.problems

    def to_json(self) -> dict[str, Any]:
        """Return the check as JSON, for the facts of a pair and for rows."""
        return {"ok": self.ok, **asdict(self), "problems": list(self.problems)}


def find_visibility(left: Eye, right: Eye, camera: StereoCamera) -> dict[str, Array]:
    """Find, per eye, the pixels, bool (H, W), that show a point which the other eye sees too."""
    first, second = (np.where(eye.seen, eye.depth, np.nan) for eye in (left, right))
    found = {
        "left": find_visible_in_right(first, second, camera, left.hidden),
        "right": find_visible_in_left(first, second, camera, right.hidden),
    }
    for name, own, other in (("left", first, right), ("right", second, left)):
        if not other.seen.all():
            found[name] &= sample_at_columns(other.seen, find_matching_column(camera.disparity(own), name)) == 1
    return found


def run_self_check(left: Eye, right: Eye, visible: dict[str, Array], camera: StereoCamera) -> SelfCheck:
    """Check a pair; ``visible``: see ``find_visibility``."""
    column = find_matching_column(camera.disparity(left.depth))
    truth = measure_truth_offsets(left.depth, right.depth, camera)
    light = measure_light_offsets(left.grey, right.grey, column, visible["left"])
    contradictions = _measure_contradictions(left, right, camera)
    problems = *_find_truth_problems(truth), *_find_contradictions(contradictions)
    if not problems:  # with a wrong truth the light gives no further result
        problems = tuple(_find_light_problems(left, right, visible, camera, column, light))
    offset = light.shift_px if _determines_fit(light) else Estimate()
    return SelfCheck(
        _measure_disagreement(left, right, column, visible["left"]),
        offset.number,
        None if offset.number is None else offset.error,
        truth.shift_px.number,
        contradictions,
        problems,
    )


def _find_truth_problems(truth: TruthOffsets) -> Iterator[str]:
    if any(getattr(truth, name).exceeds(limit, MAX_STANDARD_ERRORS) for name, limit in TRUTH_LIMITS.items()):
        value = getattr(truth, truth.likeliest).value
        yield {
            "shift_px": f"the depth of the right eye fits that of the left one if it is shifted by {value:+.2f} px",
            "scale": f"the depths of the eyes fit each other if f·B is changed by {-100 * value:+.2f} %",
            "rows_px": f"the depth of the right eye fits that of the left one if it is shifted by {value:+.2f} rows",
        }[truth.likeliest]


def _find_contradictions(share: float | None) -> Iterator[str]:
    if share is not None and share > CONTRADICTION_LIMIT:
        yield f"at {100 * share:.1f} % of the pixels one eye sees through a surface that the other one sees"


def _find_light_problems(
    left: Eye, right: Eye, visible: dict[str, Array], camera: StereoCamera, column: Array, light: LightOffsets
) -> Iterator[str]:
    """Yield at most one problem, because no other problem can be found once the images are exchanged."""
    shifts = [
        f"the images fit best if the right one is shifted by {estimate.value:+.2f} {unit}"
        for estimate, gain, unit in ((light.shift_px, light.gain, "px"), (light.rows_px, light.rows_gain, "rows"))
        if _determines_fit(light)
        and estimate.exceeds(LIGHT_LIMIT_PX, MAX_STANDARD_ERRORS)
        and gain.exceeds(0.0, GAIN_ERRORS)
    ]
    if light.correlation > FITTING_CORRELATION and not shifts:
        return
    here = measure_light_correlation(left.grey, right.grey, column, visible["left"])
    mirrored = measure_light_correlation(
        left.grey, right.grey, find_matching_column(camera.disparity(right.depth), "right"), visible["right"]
    )
    if mirrored.value > MIN_CORRELATION and mirrored.value - here.value > MAX_STANDARD_ERRORS * np.hypot(
        mirrored.error, here.error
    ):
        yield "the images fit best with left and right exchanged"
        return
    foreign = measure_foreign_share(left.grey, right.grey, camera.disparity(left.depth), visible["left"])
    if foreign.value - MAX_STANDARD_ERRORS * foreign.error > FOREIGN_LIMIT:
        yield (
            f"{100 * foreign.value:.0f} % of the places that are found in both images are not where the depth puts them"
        )
    else:
        yield from shifts


def _determines_fit(light: LightOffsets) -> bool:
    """Return whether the light determines the shift at which it fits."""
    return light.correlation > MIN_CORRELATION and light.tiles >= FEWEST_TILES


def _measure_disagreement(left: Eye, right: Eye, column: Array, visible: Array) -> float | None:
    """Measure the median relative difference between the left radiance and the right radiance moved by the true
    disparity; None if nothing is visible.

    In a good pair this is render noise and the part of the light that is not Lambertian. With a wrong f·B or exchanged
    eyes it is the whole contrast of the texture.
    """
    if not visible.any():
        return None
    own = left.grey[visible].astype(np.float64)
    with np.errstate(invalid="ignore"):  # a pixel of a render may not be a number
        other = sample_at_columns(right.grey.astype(np.float64), column)[visible]
    brightness = (own + other) / 2
    lit = np.isfinite(brightness) & (brightness > 0)
    return float(np.median(np.abs(own - other)[lit] / brightness[lit])) if lit.any() else 0.0


def _measure_contradictions(left: Eye, right: Eye, camera: StereoCamera) -> float | None:
    """Measure the share of an eye's pixels that the other eye sees through, for the eye with the larger share."""
    disparity, other = camera.disparity(left.depth), camera.disparity(right.depth)
    shares = [
        _measure_seen_through(disparity, other, find_matching_column(disparity)),
        _measure_seen_through(other, disparity, find_matching_column(other, "right")),
    ]
    return max((share for share in shares if share is not None), default=None)


def _measure_seen_through(disparity: Array, other: Array, column: Array) -> float | None:
    """Measure the share of pixels through which the other eye sees: both columns around their point show something
    farther. Only points inside the other image count; None if they are too few.
    """
    with np.errstate(invalid="ignore"):
        inside = (column >= 0) & (column <= column.shape[1] - 1)
    if inside.sum() < FEWEST_PIXELS:
        return None
    behind, place = np.nan_to_num(other, nan=0.0), column[inside]  # sky is behind everything
    rows = np.nonzero(inside)[0] * column.shape[1]
    before, after = (behind.ravel().take(rows + around(place).astype(np.intp)) for around in (np.floor, np.ceil))
    return float(np.mean(np.maximum(before, after) < disparity[inside] - _CONTRADICTION_PX))
