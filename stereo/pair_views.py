"""A rendered pair as pictures for the window: the camera images and the true depth.

This needs only NumPy, which Blender has. OpenCV is needed to interpolate the images of a distorting lens, so the images
here come from pinhole cameras, and are not rectified if the eyes are toed in. Edge-aware demosaicing is OpenCV's too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.camera.calibration_error import list_stated_errors
from ..physics.camera.lens_distortion import COEFFICIENTS, read_coefficients
from ..physics.light.lamps import is_light_scaled
from ..render.pairs.pair_folder import EYES, Pair, read_unchanged_pair
from ..settings.description import merged
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.number_text import show_rounded
from .images.colours import DEPTH_ENDS, SKY_GREY, Scale, draw_colour_bar, draw_true_depth, make_depth_scale
from .images.develop import DevelopedImages, develop, to_8_bit
from .images.disparity_and_occlusion import find_scene_depth
from .images.exr import read_depth, read_light
from .images.lettering import measure_text_width_px, put_text

#: Columns or rows of an eye's image beyond which the views are reduced.
MAX_PX = 1280
_INK_GREY, _PAPER_GREY = 220, 29  # greys of captions, as Blender's own dark theme
_GAP_PX = 8  # between pictures that lie side by side, at size 1
_COLOUR_SHARE = 0.6  # opacity of the depth's colours over the left image
_CAPTION_PER_PX = 1 / 800  # size of captions per column of the whole picture
_MIN_LETTERED_PX = 400  # columns of an eye's image beside which captions and numbers have room


#: Share of the range of an image below which a pixel looks black, and the share of such pixels that a line names.
_BLACK_LEVEL, _MIN_BLACK_SHARE = 0.04, 0.5
#: An image whose brightest hundredth is below this share of the range has too little exposure everywhere.
_LIT_LEVEL = 0.2


def describe_darkness(levels: Array) -> str:
    """Describe, in a line of the sidebar, the share of an image that is nearly black, and the cause; "" if less than
    half is.

    ``levels``, of any shape, are the numbers of the image as shares of their range, as a screen shows them.
    """
    black = float(np.mean(levels < _BLACK_LEVEL))
    if black < _MIN_BLACK_SHARE:
        return ""
    cause = "shadow or sky" if np.quantile(levels, 0.99) >= _LIT_LEVEL else "low exposure"
    return f"{100 * black:.0f} % dark: {cause}"


@dataclass(frozen=True)
class PairViews:
    """The images of a pair, uint8, its true depth, and facts about both."""

    id: str
    left: Array  # (H, W), as matchers get it
    right: Array
    shown_left: Array  # (H, W, 3), R, G, B: in colour if the sensor sees it
    shown_right: Array
    depth: Array  # (H, W) of the left image's pixels, planar metres, NaN for sky and planet
    scale: Scale  # colour scale of the depth
    range_m: tuple[float, float] | None  # nearest and farthest depth; None if the image shows only sky
    exposures_s: tuple[float, ...]
    saturated: float  # share of the left pixels
    shift_px: int  # disparity of the median depth, whole pixels
    reduced: int  # factor by which width and height are reduced
    warnings: tuple[str, ...]  # effects that are left out, and warnings about the exposure
    darkness: str  # ``describe_darkness`` of the left image
    about: str  # its difference from other pairs: its Sun and the size of its images

    def pictures(self, view: str) -> list[Array]:
        """Return the picture of a view, uint8 RGB (H, W, 3), in a list; for FLICKER the two that alternate. Raises
        KeyError for an unknown view.
        """
        return {
            "SIDE_BY_SIDE": self._make_side_by_side,
            "LEFT": lambda: [self.shown_left],
            "RIGHT": lambda: [self.shown_right],
            "FLICKER": lambda: list(self._align(self.shown_left, self.shown_right)),
            "ANAGLYPH": self._make_anaglyph,
            "DEPTH": self._make_overlay,
        }[view]()

    @property
    def aligned(self) -> tuple[Array, Array]:
        """Left and right, grey, cropped so that ground at the median depth is in the same column of both."""
        return self._align(self.left, self.right)

    def _align(self, left: Array, right: Array) -> tuple[Array, Array]:
        width = left.shape[1] - self.shift_px
        return left[:, self.shift_px :], right[:, :width]

    @property
    def lines(self) -> list[str]:
        """Short lines about the pair: exposure, saturation, depth, and darkness if most of the left image is dark."""
        times = [_format_seconds(s) for s in dict.fromkeys((self.exposures_s[0], self.exposures_s[-1]))]
        share = "None saturated" if self.saturated == 0 else f"{show_rounded(100 * self.saturated)} % saturated"
        depth = "All sky" if self.range_m is None else f"Depth {self.range_m[0]:.3g} to {self.range_m[1]:.3g} m"
        size = [f"shown at 1/{self.reduced} of its size"] if self.reduced > 1 else []
        return [f"Exposure {' to '.join(times)}", share, ", ".join([depth, *size]), *filter(None, [self.darkness])]

    def _make_side_by_side(self) -> list[Array]:
        depth = draw_true_depth(self.depth, self.scale)[..., ::-1]
        left, right, depth = (_enlarge(picture) for picture in (self.shown_left, self.shown_right, depth))
        width = depth.shape[1]
        size = max(1.0, (3 * width) * _CAPTION_PER_PX)
        legend = self._draw_legend(width, size)
        columns = [
            np.vstack([left, _draw_caption("Left", legend.shape, size)]),
            np.vstack([right, _draw_caption("Right", legend.shape, size)]),
            np.vstack([depth, legend]),
        ]
        gap = np.full((len(columns[0]), round(_GAP_PX * size), 3), _PAPER_GREY, np.uint8)
        return [np.hstack([columns[0], gap, columns[1], gap, columns[2]])]

    def _make_anaglyph(self) -> list[Array]:
        left, right = self.aligned
        return [np.stack([left, right, right], axis=-1)]

    def _make_overlay(self) -> list[Array]:
        colour = draw_true_depth(self.depth, self.scale)[..., ::-1].astype(np.float32)
        mixed = np.rint(_COLOUR_SHARE * colour + (1 - _COLOUR_SHARE) * self.left[..., None]).astype(np.uint8)
        mixed = _enlarge(mixed)
        width = mixed.shape[1]
        return [np.vstack([mixed, self._draw_legend(width, max(1.0, 2 * width * _CAPTION_PER_PX))])]

    def _make_title(self, room_px: int, letter_px: float) -> str:
        """Choose the longest title of the colour bar that fits. It states the range of the colours if the depth exceeds
        it.
        """
        if self.range_m is None:
            return "No depth"
        low, high = self.range_m
        whole = f"True depth, {low:.3g} to {high:.3g} m"
        if self.scale.low <= low and high <= self.scale.high:
            return whole
        *longer, shortest = (
            f"{name}{DEPTH_ENDS}" for name in (f"{whole}, bar ", "True depth (m), ", "Depth (m), ", "")
        )
        fitting = (title for title in longer if measure_text_width_px(title, letter_px) <= room_px)
        return next(fitting, shortest.capitalize())

    def _draw_legend(self, width: int, size: float) -> Array:
        letter, baseline, swatch = 8 * size, round(40 * size), round(10 * size)
        has_sky = bool(np.isnan(self.depth).any())
        start = max(2 * swatch, width - swatch - measure_text_width_px("sky", letter))
        scale = replace(self.scale, title=self._make_title((start - 3 * swatch if has_sky else width - swatch), letter))
        legend = draw_colour_bar(width, scale, size, _INK_GREY, _PAPER_GREY)[..., ::-1].copy()
        if has_sky:
            put_text(legend, "sky", start, baseline, letter, _INK_GREY)
            legend[baseline - swatch : baseline, start - round(1.5 * swatch) : start - swatch // 2] = SKY_GREY
        return legend


def read_pair_views(folder: Path, response: Mapping[str, Mapping[str, Any]], most_px: int = MAX_PX) -> PairViews:
    """Read a pair and develop it as ``develop`` does; ``response`` overrides settings that need no new render.

    Images of more than ``most_px`` columns or rows are reduced. Raises IcyMoonError if the pair is missing, damaged or
    without depth.
    """
    pair = read_unchanged_pair(folder)
    settings = merged(pair.settings, response)
    images = _develop(pair, settings)
    depth = pair.camera.cropped(find_scene_depth(read_depth(pair.truth_of_image("left"), "left")))
    known = depth[np.isfinite(depth)]
    factor = -(-max(depth.shape) // most_px)
    left, right = images.for_matchers()
    shown = [_to_colour(to_8_bit(images.seen(eye), images.bits, images.encoding)) for eye in EYES]
    range_m = (float(known.min()), float(known.max())) if known.size else None
    return PairViews(
        pair.id,
        _reduce(left, factor),
        _reduce(right, factor),
        _reduce(shown[0], factor),
        _reduce(shown[1], factor),
        _sample_depth(depth, factor),
        make_depth_scale(depth),
        range_m,
        tuple(frame.seconds for frame in images.frames),
        images.saturated,
        _find_shift_px(pair, known) // factor,
        factor,
        (*_describe_left_out(pair, settings), *images.warnings),
        describe_darkness(left / 255),
        _describe_pair(pair),
    )


def _describe_pair(pair: Pair) -> str:
    """Describe a pair by the elevation of its Sun, if known, and the columns and rows of its images."""
    sun = [] if pair.sun is None else [f"Sun {pair.sun.elevation_deg:.0f}°"]
    return ", ".join([*sun, f"{pair.camera.width_px} x {pair.camera.height_px}"])


def _develop(pair: Pair, settings: Settings) -> DevelopedImages:
    """Develop a pair without its lens, and without OpenCV."""
    scaled = is_light_scaled(settings)
    left, right = (read_light(pair.image(eye), eye, groups=scaled) for eye in EYES)
    linear = {"sensor": {"demosaicing": "MALVAR"}} if settings.sensor.demosaicing == "EDGE_AWARE" else {}
    undistorted = {"rig": {f"distortion_{name}": 0.0 for name in COEFFICIENTS}}
    exact = {"calibration_error": dict.fromkeys(settings.calibration_error, 0.0)}
    plain = merged(settings, undistorted, exact, linear)
    return develop(replace(pair, camera=replace(pair.camera, toe_in_deg=0.0, eyes=None)), left, right, plain)


def _describe_left_out(pair: Pair, settings: Settings) -> list[str]:
    parts = [
        *(["lens distortion"] if any(read_coefficients(settings.rig)) else []),
        *(["the lenses of calibrated eyes"] if pair.camera.eyes else []),
        *(["the rectification of toed-in eyes"] if pair.camera.toe_in_deg else []),
        *(["the error of the calibration"] if list_stated_errors(settings.calibration_error) else []),
        *(
            ["edge-aware demosaicing"]
            if settings.sensor.colour == "BAYER" and settings.sensor.demosaicing == "EDGE_AWARE"
            else []
        ),
    ]
    return [f"Shown without {' and '.join(parts)}; Show Camera Image includes that."] if parts else []


def _find_shift_px(pair: Pair, depth: Array) -> int:
    """Find the disparity of the median depth, px; 0 for toed-in eyes, which need no alignment."""
    if pair.camera.toe_in_deg or not depth.size:
        return 0
    return min(round(float(pair.camera.disparity(np.median(depth)))), pair.camera.width_px // 2)


def _reduce(image: Array, factor: int) -> Array:
    """Average an image over squares of ``factor`` pixels to uint8, without incomplete squares at the right and
    bottom."""
    height, width = (n // factor for n in image.shape[:2])
    squares = image[: height * factor, : width * factor].reshape(height, factor, width, factor, *image.shape[2:])
    return image if factor == 1 else np.rint(squares.mean(axis=(1, 3))).astype(np.uint8)


def _enlarge(picture: Array) -> Array:
    """Enlarge a picture (H, W, 3) that is too small for letters, by repeating each pixel in a square."""
    factor = -(-_MIN_LETTERED_PX // picture.shape[1])
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def _sample_depth(depth: Array, factor: int) -> Array:
    """Sample the depth of one pixel in each square of ``factor`` pixels; depths are never averaged."""
    height, width = (n // factor for n in depth.shape)
    return depth[factor // 2 :: factor, factor // 2 :: factor][:height, :width]


def _to_colour(image: Array) -> Array:
    """Return a grey or colour image as R, G, B (H, W, 3)."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=-1)


def _draw_caption(text: str, shape: tuple[int, ...], size: float) -> Array:
    strip = np.full(shape, _PAPER_GREY, np.uint8)
    put_text(strip, text, round(8 * size), round(16 * size), 8 * size, _INK_GREY)
    return strip


def _format_seconds(seconds: float) -> str:
    """Write a time with its unit: '12.5 ms', '3 s', '80 µs'."""
    for unit, length in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} µs"
