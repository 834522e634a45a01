"""The share of a pair's texture that is below the render noise, from its two eyes, the truth and the error of its bake.

The right image is warped to the left image by the true disparity. The difference is then the noise of both, and a rest
from interpolation and from light that depends on the view. It is compared with the texture around each pixel: where the
texture is weaker than the noise (signal-to-noise ratio below 1), matchers compare noise.

Noise of baked light is fixed to the ground, so it does not differ between the eyes, and matchers take it for texture.
The pair contains a possible error as large as its baked light's; the variance of that error around a pixel counts as
noise.

The images are the matchers' without the noise and the rounding of the sensor, which belong to the evaluation. Light and
shadow are judged apart: a few grey levels decide in shadow, and mean nothing in the light.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from ...physics.camera.occlusion import find_matching_column
from ...support.arrays import Array, Numbers

CLEAN, NOISY, DECIDES = "clean", "noisy", "noise decides"
#: Verdict on a pair with baked light of unknown error, unless its other noise already decides.
UNKNOWN = "unknown"
#: Sources of the larger part of the noise.
RENDER, BAKE = "render", "bake"
#: Largest shares of the lit or shaded pixels with more noise than texture for the verdicts CLEAN and NOISY. On ten
#: scenes, with 64 down to 8 samples, each per cent of such pixels cost SGBM 0.09 to 0.31 points. So 1 % costs at most
#: 0.3 points, and 5 % at most 1.5.
VERDICT_LIMITS = ((0.01, CLEAN), (0.05, NOISY))
#: Least share of the image for light or shadow to count.
_MIN_PART_SHARE = 0.05
#: Disparity step between neighbours, px, above which a pixel is at an edge and interpolation mixes two surfaces.
_EDGE_PX = 0.25
#: Shadow is darker than this share of a quantile of the image's brightness, in an image blurred by this width.
_SHADOW_SHARE, _SHADOW_QUANTILE, _BLUR_PX = 0.25, 0.9, 3.0
#: Sides of the squares in which texture and noise are measured, px.
_TEXTURE_PX, _NOISE_PX = 5, 9
#: Upper bounds of the ratio of texture to noise, and the share of pixels within them that SGBM gets wrong or misses on
#: rough ice in a low Sun; without noise 1 %. On ten scenes the sum was 1.1 to 10 times the share that noise changed.
_RATIO_BOUNDS, _WRONG_SHARES, _WRONG_WITHOUT_NOISE = (
    (0.5, 1.0, 2.0, 4.0),
    np.array([0.45, 0.30, 0.12, 0.025, 0.01]),
    0.01,
)
#: Noise of an eye, in grey levels, below which it counts as none: rounding to 8 bits alone makes 0.29.
_NO_NOISE_DN = 0.1
#: Standard deviation of a normal distribution over its median absolute deviation.
_DEVIATION_OF_MEDIAN = 1.4826


@dataclass(frozen=True)
class LightPart:
    """Noise of the pixels in sunlight, or of the pixels in shadow."""

    share: float  # share of the pixels that could be compared
    noise_dn: float | None  # standard deviation of the noise of one eye, in grey levels of 255
    hidden: float | None  # share of its pixels with less texture than noise
    baked_dn: float | None  # standard deviation of the noise of baked light; None if unknown
    by_bake: float | None  # share of the hidden pixels where the larger part of the noise comes from baked light


@dataclass(frozen=True)
class RenderNoise:
    """The noise of a pair. ``verdict`` is CLEAN, NOISY, DECIDES or UNKNOWN; None if nothing could be compared."""

    verdict: str | None
    larger: str | None  # RENDER or BAKE, the source of the larger part of the hiding noise; None if nothing is hidden
    lit: LightPart
    shadow: LightPart
    #: Share of the pixels that noise may make wrong or missing, or right if it is fixed to the ground. Smaller
    #: differences between methods mean nothing.
    doubt: float | None

    @property
    def hidden(self) -> float | None:
        """The share of pixels that noise hides in light or in shadow, whichever is larger. A part that is smaller than
        a twentieth of the image does not count.
        """
        return _find_worst_part(self.lit, self.shadow)[0] if self.verdict else None

    def to_json(self) -> dict[str, Any]:
        """Return the noise as JSON, for the facts of a pair."""
        return asdict(self)


def judge_render_noise(
    left: Array,
    right: Array,
    disparity: Array,
    visible: Array,
    baked: Numbers | None = 0.0,
) -> RenderNoise:
    """Judge a pair by its images, float (H, W) in grey levels of 255, and its true disparity (H, W).

    ``baked`` (H, W) is the change of the left image, in the same levels, by a possible error as large as its baked
    light's: 0 if no light is baked, None if the error is unknown.
    """
    error, known = _measure_noise(left, right, disparity, visible)
    if not known.any():
        nothing = LightPart(0.0, None, None, None, None)
        return RenderNoise(None, None, nothing, nothing, None)
    fixed = np.broadcast_to(np.asarray(0.0 if baked is None else baked, np.float64), left.shape)
    noise, of_bake = _average_around(error * error, known), _average_around(_compute_local_variance(fixed), known)
    ratio = _compute_texture_over_noise(left, noise + of_bake)
    shadow = _find_shadow(left, known)
    lit, dark = (
        _judge_part(error, None if baked is None else fixed, ratio, of_bake > noise, known & where, int(known.sum()))
        for where in (~shadow, shadow)
    )
    hidden, by_bake = _find_worst_part(lit, dark)
    verdict = next((name for most, name in VERDICT_LIMITS if hidden <= most), DECIDES)
    if baked is None and verdict != DECIDES:
        verdict = UNKNOWN
    larger = (BAKE if by_bake > 0.5 else RENDER) if hidden > 0 else None
    wrong = _WRONG_SHARES[np.searchsorted(_RATIO_BOUNDS, ratio[known], side="right")]
    return RenderNoise(verdict, larger, lit, dark, float(np.mean(wrong - _WRONG_WITHOUT_NOISE)))


def measure_hidden_share(difference: Array, converged: Array, visible: Array) -> float | None:
    """Measure the share of pixels that the noise of a render truly hides, if a converged render is known. The verdict
    estimates this share from the render alone. None if nothing is ``visible``.

    ``difference`` (H, W) is the render less the ``converged`` one, in grey levels. Around a hidden pixel it varies more
    than the converged image does. A difference that is the same all around changes no pattern, and so no match.
    """
    shadow, hidden = (
        _find_shadow(converged, visible),
        _compute_local_variance(difference) > _compute_local_variance(converged),
    )
    return max(
        (
            float(hidden[part].mean())
            for part in (visible & ~shadow, visible & shadow)
            if part.any() and part.sum() >= _MIN_PART_SHARE * visible.sum()
        ),
        default=None,
    )


def _find_shadow(left: Array, known: Array) -> Array:
    """Find the pixels, bool (H, W), in shadow, which are much darker than most ``known`` pixels."""
    if not known.any():
        return np.zeros(left.shape, bool)
    blurred = cv2.GaussianBlur(left.astype(np.float64), (0, 0), _BLUR_PX, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred < _SHADOW_SHARE * np.quantile(blurred[known], _SHADOW_QUANTILE))


def _find_worst_part(*parts: LightPart) -> tuple[float, float]:
    """Find the largest ``hidden`` share of the parts with at least _MIN_PART_SHARE of the pixels, and the share of it
    that baked light causes.
    """
    return max(
        (part.hidden, part.by_bake or 0.0)
        for part in parts
        if part.hidden is not None and part.share >= _MIN_PART_SHARE
    )


def _measure_noise(left: Array, right: Array, disparity: Array, visible: Array) -> tuple[Array, Array]:
    """Measure the noise of one eye (H, W); also return the pixels with known noise."""
    filled = np.where(visible, disparity, 0.0)
    down, along = np.gradient(filled) if min(filled.shape) > 1 else np.zeros((2, *filled.shape))
    width = left.shape[1]
    column = find_matching_column(filled)
    whole = np.floor(column).astype(np.intp)
    known = visible & (down * down + along * along < _EDGE_PX**2) & (whole >= 1) & (whole + 2 < width)
    known = cv2.erode(
        known.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=(0,)
    ).astype(bool)
    weights = _compute_cubic_weights(column - whole)
    # Values from unknown columns do not count.
    place = np.arange(right.shape[0])[:, None] * width + np.clip(whole, 1, max(1, width - 3))
    taps = (np.take(right, place + k, mode="clip") for k in (-1, 0, 1, 2))
    difference = left - sum(weight * tap for weight, tap in zip(weights, taps, strict=True))
    # The warped image has the noise of four pixels, weighted.
    return difference / np.sqrt(1 + sum(weight**2 for weight in weights)), known


def _compute_cubic_weights(t: Array) -> tuple[Array, ...]:
    """Compute the weights of the four columns around a fractional one (Catmull and Rom)."""
    return (
        t * (-0.5 + t * (1 - 0.5 * t)),
        1 + t * t * (-2.5 + 1.5 * t),
        t * (0.5 + t * (2 - 1.5 * t)),
        t * t * (-0.5 + 0.5 * t),
    )


def _compute_local_variance(image: Array) -> Array:
    """Compute the variance (H, W) around each pixel."""
    values = image.astype(np.float64)
    mean, square = (
        cv2.boxFilter(each, -1, (_TEXTURE_PX, _TEXTURE_PX), borderType=cv2.BORDER_REPLICATE)
        for each in (values, values * values)
    )
    return np.maximum(square - mean * mean, 0.0)


def _average_around(values: Array, known: Array) -> Array:
    """Average the known values around each pixel, (H, W); 0 without known values."""
    count, total = (
        cv2.boxFilter(each, -1, (_NOISE_PX, _NOISE_PX), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for each in (known.astype(np.float64), np.where(known, values, 0.0))
    )
    return np.asarray(total / np.maximum(count, 1))


def _compute_texture_over_noise(left: Array, noise: Array) -> Array:
    """Compute the ratio (H, W) of the standard deviations of texture and of noise; infinite without noise. ``noise`` is
    a variance.

    A pixel with neither texture nor noise does not count as noisy.
    """
    texture = np.maximum(_compute_local_variance(left) - noise, 0.0)
    return np.sqrt(np.divide(texture, noise, out=np.full(noise.shape, np.inf), where=noise > _NO_NOISE_DN**2))


def _judge_part(error: Array, baked: Array | None, ratio: Array, is_bake: Array, where: Array, known: int) -> LightPart:
    count = int(where.sum())
    if not count:
        return LightPart(0.0, None, None, None, None)
    hidden = where & (ratio < 1)
    return LightPart(
        count / known,
        _compute_robust_deviation(error[where]),
        float(hidden.sum() / count),
        None if baked is None else _compute_robust_deviation(baked[where]),
        float(is_bake[hidden].mean()) if hidden.any() else None,
    )


def _compute_robust_deviation(values: Array) -> float:
    """Compute the standard deviation of values, robust to outliers."""
    return float(_DEVIATION_OF_MEDIAN * np.median(np.abs(values - np.median(values))))
