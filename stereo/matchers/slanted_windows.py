"""Sub-pixel disparity from windows that follow the slant of the surface, by Gauss-Newton steps.

A parabola through three scores of a fixed window prefers whole pixels ("pixel locking") and assumes a fronto-parallel
surface. Here the window of the right image is resampled with the disparity d + a u + b v at the offset (u, v), and d,
a and b are fitted by least squares, as in Stein, Huertas, Matthies, "Attenuating stereo pixel-locking via affine window
adaptation", ICRA 2006. All gradients come from the left image (Baker, Matthews, "Lucas-Kanade 20 years on", IJCV
56(3), 2004), so the fit does not depend on the resampling of the right image.
"""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np

from ...support.arrays import Array

_SAMPLES_PER_PX = 8  # samples per pixel of the right image; interpolated linearly between them
_LANCZOS_LOBES = 3  # lobes of the Lanczos kernel
_ROWS_PER_STEP = 32  # rows that are processed at a time, so that all data stays in the processor's cache
_LARGEST_MOVE_PX = 1.0  # a fit that moves farther has found another point
_LARGEST_SLANT = 0.75  # disparity change per pixel; beyond it the right image is stretched fourfold
_SETTLED_PX = 0.05  # a fit whose last step was longer has not converged


def refine_subpixel(left: Array, right: Array, disparity: Array, window: int, steps: int) -> Array:
    """Refine a disparity that is right to about half a pixel; return float64 (H, W) px, NaN where invalid.

    ``left`` and ``right`` are (H, W) images, ``window`` the odd side of the fitted square. Without a fit, for example
    near the border, the given disparity is kept.
    """
    half = window // 2
    height, width = disparity.shape
    gradient = cv2.Sobel(left.astype(np.float32), cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    inverse = _find_inverse_normal_matrices(gradient, half)
    fine = _interpolate_rows(right.astype(np.float32))
    result = disparity.astype(np.float64)
    columns = slice(half + 1, width - half - 1)
    for top in range(half, height - half, _ROWS_PER_STEP):
        rows = slice(top, min(top + _ROWS_PER_STEP, height - half))
        if np.isfinite(disparity[rows, columns]).any():
            result[rows, columns] = _fit_affine_windows(
                left.astype(np.float32),
                gradient,
                fine,
                inverse[:, :, rows, columns],
                disparity[rows, columns],
                (rows.start, columns.start),
                half,
                steps,
            )
    return result


def _find_inverse_normal_matrices(gradient: Array, half: int) -> Array:
    """Find the inverse of Σ g² [1 u v]ᵀ[1 u v] over the window of every pixel, (3, 3, H, W); NaN if the matrix is
    singular.
    """
    offsets = np.arange(-half, half + 1.0)
    ones = np.ones_like(offsets)
    power = gradient.astype(np.float64) ** 2

    def moment(along: Array, down: Array) -> Array:
        return cv2.sepFilter2D(power, cv2.CV_64F, along, down, borderType=cv2.BORDER_CONSTANT)

    one, u, v = moment(ones, ones), moment(offsets, ones), moment(ones, offsets)
    uu, uv, vv = moment(offsets**2, ones), moment(offsets, offsets), moment(ones, offsets**2)
    cofactors = np.array(
        [
            [uu * vv - uv * uv, uv * v - u * vv, u * uv - uu * v],
            [uv * v - u * vv, one * vv - v * v, u * v - one * uv],
            [u * uv - uu * v, u * v - one * uv, one * uu - u * u],
        ]
    )
    determinant = one * cofactors[0, 0] + u * cofactors[0, 1] + v * cofactors[0, 2]
    # Windows without texture, or with all of it on one line, determine no plane.
    usable = determinant > 1e-6 * np.maximum(one, 1e-9) * np.maximum(uu, 1e-9) * np.maximum(vv, 1e-9)
    return np.where(usable, cofactors / np.where(usable, determinant, 1), np.nan).astype(np.float32)


def _interpolate_rows(image: Array) -> Array:
    """Interpolate the rows of an image at _SAMPLES_PER_PX points per pixel, by the Lanczos kernel; return (H, W *
    _SAMPLES_PER_PX).
    """
    height, width = image.shape
    padded = np.pad(image, ((0, 0), (_LANCZOS_LOBES - 1, _LANCZOS_LOBES)), mode="edge")
    fine = np.zeros((height, width, _SAMPLES_PER_PX), np.float32)
    for phase in range(_SAMPLES_PER_PX):
        distance = np.arange(2 * _LANCZOS_LOBES) - (_LANCZOS_LOBES - 1) - phase / _SAMPLES_PER_PX
        weight = np.sinc(distance) * np.sinc(distance / _LANCZOS_LOBES)
        for tap, share in enumerate((weight / weight.sum()).astype(np.float32)):
            fine[:, :, phase] += share * padded[:, tap : tap + width]
    return fine.reshape(height, width * _SAMPLES_PER_PX)


def _fit_affine_windows(
    left: Array,
    gradient: Array,
    fine: Array,
    inverse: Array,
    start: Array,
    corner: tuple[int, int],
    half: int,
    steps: int,
) -> Array:
    height, width = start.shape
    valid = np.isfinite(start)
    shift = np.where(valid, start, 0).astype(np.float32)
    slant = np.zeros((2, height, width), np.float32)
    column = np.arange(corner[1], corner[1] + width, dtype=np.float32)
    last = np.float32(fine.shape[1] - 2)
    step = np.zeros((3, height, width), np.float32)
    for _ in range(steps):
        moments = np.zeros((3, height, width), np.float32)
        for v, u in product(range(-half, half + 1), repeat=2):
            here = np.s_[corner[0] + v : corner[0] + v + height, corner[1] + u : corner[1] + u + width]
            place = (column + u - shift - u * slant[0] - v * slant[1]) * _SAMPLES_PER_PX
            np.clip(place, 0, last, out=place)
            before = place.astype(np.int32)
            place -= before
            before += (np.arange(corner[0] + v, corner[0] + v + height, dtype=np.int32) * fine.shape[1])[:, None]
            low = fine.ravel().take(before)
            before += 1
            seen = low + place * (fine.ravel().take(before) - low)
            weighted = gradient[here] * (seen - left[here])
            moments[0] += weighted
            moments[1] += u * weighted
            moments[2] += v * weighted
        step = np.einsum("ijhw,jhw->ihw", inverse, moments)
        step = np.where(np.isfinite(step), step, 0)
        shift += step[0]
        slant = np.clip(slant + step[1:], -_LARGEST_SLANT, _LARGEST_SLANT)
    fitted = (
        valid
        & np.isfinite(inverse[0, 0])
        & (np.abs(shift - np.where(valid, start, 0)) <= _LARGEST_MOVE_PX)
        & (np.abs(step[0]) <= _SETTLED_PX)
    )
    return np.where(fitted, shift, start)
