"""A matcher's errors by classes of pixels, which the truth and the image define.

Only sums per class are kept, so that the sums of many pairs can be added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ...support.arrays import Array
from ...support.labels import LANDER, ROCK, TERRAIN
from .metrics import is_usable

#: Sums over the pixels of a class. ``true`` is the number with a true depth, and ``n`` the number of these that are
#: measured. Over the measured pixels follow |depth error| (m), |disparity error| (px), the numbers wrong by more than
#: 1 px and by more than 10 cm, and metres of depth per px of disparity, Z² / (f·B). ``fine`` is the number within 1 px,
#: and ``fine_epe_px`` the sum of their |disparity error|.
SUMS = ("true", "n", "l1_m", "epe_px", "bad_1", "l1_rate_10", "m_per_px", "fine", "fine_epe_px")

TEXTURE_WINDOW_PX = 9
#: A pixel is in shadow if its radiance is below this share of the radiance of lit ground of the same material.
_SHADOW_SHARE = 0.35
_LIT_QUANTILE = 0.9
#: Least cosine of incidence of facets from which the brightness of lit ground is found.
_MIN_INCIDENCE_COSINE = 0.2


@dataclass(frozen=True)
class PixelClassification:
    """A property by which pixels are classified: a number with bounds between its classes, or named classes."""

    key: str
    title: str
    bounds: tuple[float, ...] = ()
    names: tuple[str, ...] = ()

    @property
    def classes(self) -> tuple[str, ...]:
        """The names of all classes. The first and the last class of a number have no outer bound."""
        if self.names:
            return self.names
        inner = (f"{a:g}–{b:g}" for a, b in zip(self.bounds, self.bounds[1:], strict=False))
        return (f"< {self.bounds[0]:g}", *inner, f"> {self.bounds[-1]:g}")

    def of(self, values: Array) -> Array:
        """Return the class of each number, -1 for NaN."""
        found = np.zeros(values.shape, np.int8)
        for bound in self.bounds:  # faster than a search for each number
            found += values >= bound
        found[np.isnan(values)] = -1
        return found


RANGE = PixelClassification(
    "range", "True depth (m)", (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0, 96.0)
)
SLOPE = PixelClassification("slope", "Slope (°)", (5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0))
TEXTURE = PixelClassification("texture", "Texture (grey levels per px)", (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0))
SHADOW = PixelClassification("shadow", "Light", names=("sunlit", "shadow"))
OCCLUSION = PixelClassification("occlusion", "Visibility", names=("both eyes", "left only"))
MATERIAL = PixelClassification("material", "Material", names=("terrain", "rock", "lander"))
DEPOSITS = PixelClassification("deposits", "Lens", names=("clean", "deposits"))
FACTORS = (RANGE, SLOPE, TEXTURE, SHADOW, OCCLUSION, MATERIAL, DEPOSITS)
#: Least blocked light, of 255, of a pixel that counts as behind deposits on the left lens.
_MIN_BLOCKED = 13
#: The number of classes by each factor, with one more for pixels without a class.
_CLASS_COUNTS = tuple(1 + len(factor.classes) for factor in FACTORS)


def measure_texture(grey: Array) -> Array:
    """Measure the root mean square of the gradient along the rows around each pixel, grey levels per px, float64 (H,
    W).

    Matching depends on this gradient: the variance of a disparity is at least 2 σ² / Σ gradient², where σ is the noise
    of the grey levels (Matthies, Kanade and Szeliski 1989).
    """
    if grey.shape[1] < 2:
        return np.zeros(grey.shape)
    gradient = np.gradient(grey.astype(np.float64), axis=1)
    window = (TEXTURE_WINDOW_PX, TEXTURE_WINDOW_PX)
    mean = cv2.boxFilter(gradient**2, -1, window, borderType=cv2.BORDER_REPLICATE)
    return np.sqrt(np.maximum(mean, 0.0))  # rounding in running sums may give a value below zero


def find_shadow(grey: Array, normal: Array, toward_sun: Sequence[float], semantic: Array) -> Array:
    """Find the pixels, bool (H, W), that no sunlight reaches.

    Facets that face away from the Sun are in shadow. Other facets are in shadow if their radiance is below
    _SHADOW_SHARE of the radiance of lit ground of their material under the same incidence (Lambert), which follows from
    the brighter pixels. So cast shadows are found in the image itself, and a penumbra counts where it is dark enough.
    """
    cosine = np.nan_to_num(normal.astype(np.float64) @ np.asarray(toward_sun, np.float64))
    shadow = cosine <= 0
    for material in np.unique(semantic):
        facing = (semantic == material) & (cosine > 0)
        square = facing & (cosine >= _MIN_INCIDENCE_COSINE)
        if square.any():
            lit = float(np.quantile(grey[square] / cosine[square], _LIT_QUANTILE))
            shadow |= facing & (grey < _SHADOW_SHARE * lit * cosine)
    return np.asarray(shadow)


def classify_pixels(
    truth: Array,
    visible: Array,
    gradient: Array,
    grey: Array,
    normal: Array | None,
    semantic: Array | None,
    toward_sun: Sequence[float] | None,
    blocked: Array | None = None,
) -> dict[str, Array]:
    """Classify every pixel by every factor, int8 (H, W), -1 where it has no class or an argument is None.

    ``gradient`` is ``measure_texture`` of the left image that matchers get, ``grey`` its radiance; ``normal`` is in
    world axes. ``blocked`` is the light that deposits on the lens block, of 255; None without deposits.
    """
    nowhere = np.full(truth.shape, -1, np.int8)
    found = {
        RANGE.key: RANGE.of(truth),
        TEXTURE.key: TEXTURE.of(gradient),
        OCCLUSION.key: (~visible).astype(np.int8),
        SLOPE.key: nowhere,
        SHADOW.key: nowhere,
        MATERIAL.key: nowhere,
        DEPOSITS.key: nowhere if blocked is None else (blocked >= _MIN_BLOCKED).astype(np.int8),
    }
    if normal is not None:
        # The third component of normals, which compact files round, is too inexact for small angles.
        across = np.hypot(*np.moveaxis(normal[..., :2].astype(np.float64), -1, 0))
        found[SLOPE.key] = SLOPE.of(np.degrees(np.arctan2(across, normal[..., 2])))
    if semantic is not None:
        found[MATERIAL.key] = np.select(
            [semantic == k for k in (TERRAIN, ROCK, LANDER)], [np.int8(0), np.int8(1), np.int8(2)], np.int8(-1)
        )
    if normal is not None and semantic is not None and toward_sun is not None:
        found[SHADOW.key] = find_shadow(grey, normal, toward_sun, semantic).astype(np.int8)
    return found


class ClassCells:
    """The pixels with a true depth, grouped by their classes by all factors together.

    A number is then summed over the pixels once, and not once for each factor.
    """

    def __init__(self, classes: Mapping[str, Array], known: Array) -> None:
        """Group the pixels that have a true depth, ``known`` (H, W), bool, by their ``classes``, see
        ``classify_pixels``.
        """
        cell = np.zeros(int(known.sum()), np.int32)
        for factor, count in zip(FACTORS, _CLASS_COUNTS, strict=True):
            cell *= count
            cell += (classes[factor.key][known] + 1).astype(np.int32)
        sizes = np.bincount(cell, minlength=1)
        occupied = np.flatnonzero(sizes)
        self.sizes = sizes[occupied]
        self.bins = np.unravel_index(
            occupied, _CLASS_COUNTS
        )  # by factor, one more than the class of each occupied cell
        self.place = (np.cumsum(sizes > 0) - 1)[cell]  # of each pixel among the occupied cells


def sum_by_class(
    cells: ClassCells,
    depth: Array,
    truth: Array,
    disparity: Array,
    true_disparity: Array,
    doffs_px: float = 0.0,
) -> dict[str, dict[str, list[float]]]:
    """Compute the SUMS of each class of every factor of ``classify_pixels``; return {factor: {sum: a number per
    class}}.

    The arrays (pixels,) are of the pixels of ``cells``. ``doffs_px``: see ``StereoCamera``.
    """
    measured = is_usable(depth)
    place, true, true_px = cells.place[measured], truth[measured], true_disparity[measured]
    error_m, error_px = np.abs(depth[measured] - true), np.abs(disparity[measured].astype(np.float64) - true_px)
    fine = error_px <= 1

    def total(weights: Array | None = None, which: Array | slice = slice(None)) -> Array:
        return np.bincount(place[which], None if weights is None else weights[which], len(cells.sizes))

    by_cell = {
        "true": cells.sizes,
        "n": total(),
        "l1_m": total(error_m),
        "epe_px": total(error_px),
        "bad_1": total(which=~fine),
        "l1_rate_10": total(which=error_m > 0.1),
        "m_per_px": total(true / (true_px + doffs_px)),
        "fine": total(which=fine),
        "fine_epe_px": total(error_px, fine),
    }
    result: dict[str, dict[str, list[float]]] = {}
    for factor, bins in zip(FACTORS, cells.bins, strict=True):
        sums = {key: np.bincount(bins, by_cell[key], len(factor.classes) + 1)[1:] for key in SUMS}
        result[factor.key] = {key: [float(f"{value:.7g}") for value in values] for key, values in sums.items()}
    return result


def add_sums(one: Mapping[str, Any] | None, other: Mapping[str, Any]) -> dict[str, Any]:
    """Add the sums over two sets of pixels; ``one`` may be None for no pixels."""
    if one is None:
        return {factor: {key: list(values) for key, values in sums.items()} for factor, sums in other.items()}
    return {
        factor: {key: [a + b for a, b in zip(sums[key], other[factor][key], strict=True)] for key in SUMS}
        for factor, sums in one.items()
        if factor in other
    }  # an earlier version had fewer factors
