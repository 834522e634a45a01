"""Whether the two eyes of a pair agree with each other and with the truth, before anything is measured by it.

The right image is fetched onto the left one by the true disparity. A wrong focal length or baseline,
swapped eyes, a wrong depth or a camera that toes in all show as images that fit better when shifted, or
as surfaces that one eye sees through.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..render.pair import StereoCamera
from .truth import matching_column, warped

#: Shifts, px, that the fit is tried at.
SHIFTS_PX = np.arange(-3.0, 3.01, 0.5)
#: Shift, px, of the best fit beyond which a pair is not to be trusted. Of sound pairs it is some hundredths; a
#: constant like the reference code's, 6 % off, gives this much from a disparity of 4 px on.
OFFSET_LIMIT_PX = 0.25
#: Share of pixels seen through from which it is not to be trusted. Thin blocks, met between two columns, make
#: single ones.
CONTRADICTION_LIMIT = 0.02
#: Disparity, px, by which a surface must be farther than the one in front of it to count as seen through.
_CONTRADICTION_PX = 1.0
#: Where the fit at the best shift is not at least this much better than at the worst one there is no
#: texture to tell by.
_DECISIVE = 0.9
#: Pixels below which an image cannot tell.
_FEWEST = 100


@dataclass(frozen=True)
class SelfCheck:
    """What was found. None where the pair cannot tell: no common pixel, no light, no texture."""

    photometric_disagreement: float | None  # median relative difference of left and fetched right radiance
    photometric_offset_px: float | None  # shift of the right image that fits best; 0 if all is right
    contradictions: float | None  # share of the left pixels whose point the right eye sees through
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the pair may be averaged with others."""
        return not self.problems

    def to_json(self) -> dict[str, Any]:
        """For pair facts and rows."""
        return {"ok": self.ok, **asdict(self), "problems": list(self.problems)}


def self_check(left_grey: np.ndarray, right_grey: np.ndarray, left_depth: np.ndarray, right_depth: np.ndarray,
               visible: np.ndarray, camera: StereoCamera) -> SelfCheck:
    """Check a pair: radiance and planar depth (m, NaN for sky) of both eyes, and where the left is ``visible``
    to the right one, all (H, W)."""
    disparity = camera.disparity(left_depth)
    column = matching_column(disparity)
    disagreement = photometric_disagreement(left_grey, right_grey, left_depth, visible, camera)
    fit = [_misfit(left_grey, right_grey, column + shift, visible) for shift in SHIFTS_PX]
    offset = _best_shift(fit)
    contradictions = _contradictions(left_depth, right_depth, column, camera)
    mirrored = _misfit(left_grey, right_grey, matching_column(disparity, "right"), visible)
    problems = []
    if mirrored < _DECISIVE * min(fit):
        problems.append("the images fit best with left and right exchanged")
    elif offset is not None and abs(offset) > OFFSET_LIMIT_PX:
        problems.append(f"the images fit best when the right one is shifted by {offset:+.2f} px")
    if contradictions is not None and contradictions > CONTRADICTION_LIMIT:
        problems.append(f"at {100 * contradictions:.1f} % of the pixels the right eye sees through what the left one "
                        "sees")
    return SelfCheck(disagreement if np.isfinite(disagreement) else None, offset, contradictions, tuple(problems))


def photometric_disagreement(left_grey: np.ndarray, right_grey: np.ndarray, left_depth: np.ndarray,
                             visible: np.ndarray, camera: StereoCamera) -> float:
    """Median relative difference of left radiance and right radiance fetched by the true disparity.

    Taken where ``visible``; NaN if nothing is. A good pair differs by its render noise and by how far the
    surface is from Lambertian, a wrong f·B or swapped eyes by its whole texture contrast.
    """
    if not visible.any():
        return float("nan")
    differences = _relative_differences(left_grey, right_grey, matching_column(camera.disparity(left_depth)), visible)
    return float(np.median(differences)) if differences.size else 0.0


def _relative_differences(left_grey: np.ndarray, right_grey: np.ndarray, column: np.ndarray,
                          where: np.ndarray) -> np.ndarray:
    left = left_grey[where].astype(np.float64)
    right = warped(right_grey.astype(np.float64), column)[where]
    brightness = (left + right) / 2
    lit = brightness > 0
    return np.abs(left - right)[lit] / brightness[lit]


def _misfit(left_grey: np.ndarray, right_grey: np.ndarray, column: np.ndarray, visible: np.ndarray) -> float:
    """Mean difference of the two images' gradients along the row, the right one fetched at ``column``; NaN if too
    few pixels land in it.

    The mean, unlike the median, also hears a texture that covers less than half of the image. Gradients, not
    brightness: glints and shading that changes with the direction of view, which both eyes need not share, do not
    decide, edges and texture do. That of the right image is between where a pixel and its left neighbour land.
    """
    inside = visible & (column >= 0) & (column <= column.shape[1] - 1)
    inside[:, 1:] &= inside[:, :-1].copy()
    inside[:, :1] = False
    if inside.sum() < _FEWEST:
        return float("nan")
    left = np.zeros(left_grey.shape)
    left[:, 1:] = np.diff(left_grey.astype(np.float64), axis=1)
    fetched = warped(right_grey.astype(np.float64), column)
    right = fetched - np.roll(fetched, 1, axis=1)
    return float(np.mean(np.abs(left - right)[inside]))


def _best_shift(misfit: list[float]) -> float | None:
    """The shift of SHIFTS_PX with the least misfit, refined by a parabola; None if none is clearly best."""
    best = int(np.argmin(misfit))
    if not misfit[best] < _DECISIVE * max(misfit):  # also if one of them is NaN
        return None
    if best in (0, len(misfit) - 1):
        return float(SHIFTS_PX[best])
    before, at, after = misfit[best - 1:best + 2]
    curvature = before - 2 * at + after
    step = float(SHIFTS_PX[1] - SHIFTS_PX[0])
    return float(SHIFTS_PX[best]) + (0.5 * step * (before - after) / curvature if curvature > 0 else 0.0)


def _contradictions(left_depth: np.ndarray, right_depth: np.ndarray, column: np.ndarray,
                    camera: StereoCamera) -> float | None:
    """Share of the left pixels, of those that land in the right image, where both columns around the point show
    something farther: the right eye looks through the surface."""
    inside = (column >= 0) & (column <= left_depth.shape[1] - 1)
    if inside.sum() < _FEWEST:
        return None
    other = np.nan_to_num(camera.disparity(right_depth), nan=0.0)
    place = np.nan_to_num(column)
    farthest_open = np.maximum(warped(other, np.floor(place)), warped(other, np.ceil(place)))
    return float(np.mean(farthest_open[inside] < camera.disparity(left_depth)[inside] - _CONTRADICTION_PX))
