"""Measure a photographed pair and its twin: statistics of the images, and of each matcher on them.

Both get the same treatment. The brightness of the left image at one quantile becomes white, because the exposure of the
photographs is unknown, and matchers search the same range. The numbers of a pair are kept, and are measured again only
if its files, its twin or the methods change.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.occlusion import find_matching_column, is_in_frame
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES, read_unchanged_pair
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.file_schemas import COUNT, NUMBER, TEXT, Each, Maybe, read_record
from ...support.files import read_checksum, to_json_text, write_json
from ...support.foreign_bytes import MAX_BYTES
from ..images.colours import VIRIDIS, Scale, draw_depth
from ..images.develop import develop
from ..images.disparity_and_occlusion import find_scene_depth
from ..images.image_files import write_png
from ..images.image_statistics import (
    DARK_LEVEL,
    find_largest_square,
    measure_shares,
    measure_spectral_slope,
    measure_spectrum,
)
from ..images.image_values import find_white, stretch_to_8_bit
from ..images.lens import make_lens
from ..images.masks import erode
from ..images.views import read_eye
from ..matchers import match
from ..matchers.black_box_confidence import match_right_image
from ..matchers.methods import Method
from ..matchers.search_range import AUTO, SearchRange, find_rig_range, find_true_range
from ..measure.by_pixel_class import TEXTURE_WINDOW_PX, measure_texture
from ..measure.metrics import compute_disparity_metrics, find_wrong_share
from .photographs import Photographs, Rectification

#: Version of the measured numbers; files of another version are measured again.
VERSION = 1
#: The two sides of a comparison: the photographed pair and the rendered one.
SIDES = ("photograph", "twin")
#: The title of the colour bar of disparity maps.
DISPARITY_TITLE = "Disparity (px), log scale"
#: Largest difference of disparities of the eyes that agree, px.
CONSISTENT_PX = 1.0
#: Texture below which a pixel counts as smooth, grey levels per px.
SMOOTH_TEXTURE = 2.0
#: Bounds of the classes of grey levels, and of the classes of gradients in grey levels per px.
LEVEL_BOUNDS = tuple(range(0, 257, 8))
GRADIENT_BOUNDS = tuple(float(f"{step:.4g}") for step in np.geomspace(1.0, 256.0, 25))


@dataclass(frozen=True)
class Quantity:
    """A number of a pair: its key, title, unit, digits, whether it is a share from 0 to 1, and its meaning."""

    key: str
    title: str
    unit: str
    digits: int
    share: bool
    doc: str


STATISTICS = (
    Quantity("contrast", "Contrast", "", 3, False, "standard deviation of the grey levels over their mean"),
    Quantity("gradient", "Gradient", "levels/px", 2, False, "root mean square gradient"),
    Quantity("slope", "Spectral slope", "", 2, False, "α of the power spectrum f^-α; more is smoother"),
    Quantity(
        "texture",
        "Texture",
        "levels/px",
        2,
        False,
        "median gradient along the rows around each pixel",
    ),
    Quantity("smooth", "Smooth", "%", 1, True, f"pixels whose texture is below {SMOOTH_TEXTURE:g} levels/px"),
    Quantity("dark", "Dark", "%", 1, True, f"pixels below {100 * DARK_LEVEL:g} % of white"),
    Quantity("saturated", "Saturated", "%", 2, True, "pixels at the top of the numbers, before the stretch"),
)
MATCHED = (
    Quantity("coverage", "Coverage", "%", 1, True, "pixels with a disparity"),
    Quantity(
        "consistent", "Consistent", "%", 1, True, f"of these, within {CONSISTENT_PX:g} px of the right image's own"
    ),
    Quantity("wrong", "Missing or > 1 px off", "%", 1, True, "of the pixels with a true disparity in both images"),
    Quantity("epe_px", "Error of measured", "px", 3, False, "mean error of the disparities, where a truth is known"),
)
_NUMBERS_SHAPE = Each(Maybe(NUMBER, null=True), keys=TEXT)
_SIDE_SHAPE = {
    "statistics": _NUMBERS_SHAPE,
    "matched": Each(_NUMBERS_SHAPE, keys=TEXT),
    "curves": Each(Each(NUMBER), keys=TEXT),
}
_MEASURED_SHAPE = {
    "version": COUNT,
    "key": TEXT,
    "rendered": TEXT,
    **dict.fromkeys(SIDES, _SIDE_SHAPE),
    "disparity_scale_px": Each(NUMBER),
    "search_px": Each(NUMBER),
    "seen_share": NUMBER,
    "sky_share": NUMBER,
}


@dataclass(frozen=True)
class _Images:
    """The images of one side on the pixels of the rig: grey levels (H, W) by eye from 0 to 255, and the true disparity
    of the left eye, px, NaN where unknown; None without a truth.
    """

    grey: Mapping[str, Array]
    truth: Array | None


def read_or_measure(
    photographs: Photographs,
    rectification: Rectification,
    twin: Path,
    settings: Settings,
    methods: Sequence[Method],
    out: Path,
) -> dict[str, Any]:
    """Read or measure the numbers of a photographed pair and of its ``twin``, the folder of a complete pair.

    The complete ``settings`` have the camera's response. Pictures and numbers lie in ``out``. Raises IcyMoonError for
    photographs that cannot be read or do not fit.
    """
    file = out / f"{photographs.name}.json"
    key = _make_content_key(photographs, rectification, twin, settings, methods)
    if file.exists():
        known = read_record(file, _MEASURED_SHAPE, "remove it")
        if (known["version"], known["key"]) == (VERSION, key):
            return dict(known)
    measured = {"version": VERSION, "key": key, "rendered": twin.name}
    measured |= _measure(photographs, rectification, twin, settings, methods, out)
    write_json(file, measured)  # last, so that a folder with it is whole
    return measured


def _make_content_key(
    photographs: Photographs, rectification: Rectification, twin: Path, settings: Settings, methods: Sequence[Method]
) -> str:
    """Make a hash of everything that determines the numbers of a pair."""
    stated = [
        [read_checksum(path, MAX_BYTES) for path in photographs.files],
        photographs.depth is not None,
        twin.name,
        settings,
        [[method.label, method.name, {key: str(value) for key, value in method.options.items()}] for method in methods],
        rectification.camera.to_json(),
    ]
    found = hashlib.sha256(to_json_text(stated).encode())
    for eye in EYES:
        pixels = rectification.pixels[eye]
        found.update(b"same" if pixels is None else np.ascontiguousarray(pixels).tobytes())
    return found.hexdigest()


def _measure(
    photographs: Photographs,
    rectification: Rectification,
    twin: Path,
    settings: Settings,
    methods: Sequence[Method],
    out: Path,
) -> dict[str, Any]:
    rendered, lit, sky_share = _read_twin(twin, settings)
    sides = {"photograph": _read_photographs(photographs, rectification), "twin": rendered}
    seen = {eye: rectification.seen[eye] & lit[eye] for eye in EYES}
    search = choose_search_range(settings, [side.truth for side in sides.values()])
    found: dict[str, Any] = {}
    disparities: dict[tuple[str, str], Array] = {}
    for name, side in sides.items():
        shown, images, white = _prepare_images(side, seen)
        statistics, curves = measure_image(shown["left"], white, seen["left"])
        matched = {}
        for method in methods:
            disparities[name, method.file_name], matched[method.label] = measure_matcher(
                images["left"], images["right"], seen["left"], method, rectification.camera, search, side.truth
            )
        found[name] = {"statistics": statistics, "matched": matched, "curves": curves}
        for eye, image in images.items():
            write_png(out / f"{photographs.name}-{name}-{eye}.png", image)
    scale = _choose_scale(disparities.values())
    for (name, method_name), disparity in disparities.items():
        write_png(out / f"{photographs.name}-{name}-{method_name}.png", draw_depth(disparity, scale))
    return _replace_nan(
        found
        | {
            "disparity_scale_px": [scale.low, scale.high],
            "search_px": [search.least_px, search.most_px],
            "seen_share": float(seen["left"].mean()),
            "sky_share": sky_share,
        }
    )


def check_matchers(
    photographs: Photographs, rectification: Rectification, settings: Settings, methods: Sequence[Method]
) -> None:
    """Match a photographed pair once with each method, before its twin is rendered. Raises IcyMoonError if a matcher
    refuses: for images too small for its search range, or a program that fails.
    """
    side = _read_photographs(photographs, rectification)
    _, images, _ = _prepare_images(side, rectification.seen)
    ranges = {AUTO: choose_search_range(settings, [side.truth])}
    for method in methods:
        match(method.name, images["left"], images["right"], method.options, rectification.camera, ranges)


def _prepare_images(side: _Images, seen: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, Array], float]:
    """Return the grey levels of both eyes, black where not ``seen`` in both sides, the same with 8 bits, and the white
    level.
    """
    shown = {eye: np.where(seen[eye], side.grey[eye], 0.0) for eye in EYES}
    white = find_white(side.grey["left"][seen["left"]])
    return shown, {eye: stretch_to_8_bit(shown[eye], white) for eye in EYES}, white


def _replace_nan(value: Any) -> Any:
    """Replace numbers that are not finite by None, because JSON lacks them."""
    if isinstance(value, dict):
        return {key: _replace_nan(each) for key, each in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _read_photographs(photographs: Photographs, rectification: Rectification) -> _Images:
    grey = {eye: rectification.read_grey(path, eye) for eye, path in zip(EYES, photographs.files, strict=False)}
    truth = rectification.read_disparity(photographs.depth) if photographs.depth else None
    return _Images(grey, truth)


def _read_twin(folder: Path, settings: Settings) -> tuple[_Images, dict[str, Array], float]:
    """Read the images that the camera takes of the twin, the pixels that each sensor sees, bool (H, W), and the share
    of sky.
    """
    pair = read_unchanged_pair(folder)
    (left, view), (right, _) = (read_eye(pair, eye) for eye in EYES)
    images = develop(pair, left, right, settings)
    lenses = {eye: make_lens(pair.camera, settings.rig, eye) for eye in EYES}
    seen = {eye: np.ones(images.left.shape, bool) if lens is None else lens.sees for eye, lens in lenses.items()}
    depth = find_scene_depth(view)
    # With 8 bits, as photographs are read.
    grey = {eye: image.astype(np.float32) for eye, image in zip(EYES, images.for_matchers(), strict=True)}
    truth = pair.camera.rectified.disparity(np.where(seen["left"], depth, np.nan))
    return _Images(grey, truth), seen, float(np.isnan(depth).mean())


def choose_search_range(settings: Settings, truths: Sequence[Array | None]) -> SearchRange:
    """Choose the disparities that matchers search in both pairs: the rig's over unknown relief, and all true
    disparities.
    """
    ranges = [
        find_rig_range(settings, described=False),
        *(find_true_range(each) for each in truths if each is not None),
    ]
    known = [each for each in ranges if each is not None]
    if not known:
        return SearchRange(0, settings.rig.width_px // 4, "fixed")
    return SearchRange(min(each.least_px for each in known), max(each.most_px for each in known), known[0].source)


def measure_image(grey: Array, white: float, seen: Array) -> tuple[dict[str, float], dict[str, list[float]]]:
    """Measure the STATISTICS and the curves of the ``seen`` pixels of an image (H, W) of levels from 0 to 255.

    The image is stretched so that ``white`` is 255. The curves are shares of pixels by levels and by gradients, and
    cycles per pixel and power of the rings of the spectrum.
    """
    # Gradients reach one pixel beyond the window over which they are averaged.
    inner = erode(seen, TEXTURE_WINDOW_PX // 2 + 1)
    light = np.clip(grey / white, 0.0, 1.0) * 255
    down, across = np.gradient(light)
    gradient = np.hypot(down, across)[inner]
    texture = measure_texture(light)[inner]
    rows, columns = find_largest_square(seen)
    square = light[rows, columns]
    cycles, power = measure_spectrum(square)
    shown = light[seen]
    statistics = {
        "contrast": float(shown.std() / shown.mean()) if shown.any() else float("nan"),
        "gradient": float(np.sqrt(np.mean(gradient**2))) if gradient.size else float("nan"),
        "slope": measure_spectral_slope(square),
        "texture": float(np.median(texture)) if texture.size else float("nan"),
        "smooth": float(np.mean(texture < SMOOTH_TEXTURE)) if texture.size else float("nan"),
        "dark": measure_shares(light / 255, seen)[1],
        "saturated": measure_shares(grey / 255, seen)[0],
    }
    curves = {
        "levels": _compute_share_by_class(shown, LEVEL_BOUNDS),
        "gradients": _compute_share_by_class(gradient, GRADIENT_BOUNDS),
        "cycles": (cycles / max(len(square), 1)).tolist(),
        "power": power.tolist(),
    }
    return statistics, curves


def _compute_share_by_class(values: Array, bounds: Sequence[float]) -> list[float]:
    return (np.histogram(values, bounds)[0] / max(values.size, 1)).tolist()


def measure_matcher(
    left: Array,
    right: Array,
    seen: Array,
    method: Method,
    camera: StereoCamera,
    search: SearchRange,
    truth: Array | None,
) -> tuple[Array, dict[str, float]]:
    """Match grey images by a method; return the disparity (H, W), px, and the MATCHED numbers over the pixels that are
    ``seen``.

    The right image is matched too, mirrored and exchanged with the left image. Errors are NaN without a ``truth``. They
    count pixels whose true place is in the right image, also those that are hidden there, because no photograph shows
    which ones are.
    """
    ranges = {AUTO: search}

    def run(left: Array, right: Array, camera: StereoCamera | None) -> Array:
        return match(method.name, left, right, method.options, camera, ranges)[0]

    disparity = run(left, right, camera)
    measured = np.isfinite(disparity) & seen
    agrees = find_consistent(disparity, match_right_image(run, left, right, camera)) & measured
    numbers = {
        "coverage": float(measured.sum() / max(seen.sum(), 1)),
        "consistent": float(agrees.sum() / measured.sum()) if measured.any() else float("nan"),
        "wrong": float("nan"),
        "epe_px": float("nan"),
    }
    if truth is not None:
        judged = seen & np.isfinite(truth) & is_in_frame(find_matching_column(truth))
        numbers["wrong"] = find_wrong_share(disparity, truth, judged)
        numbers["epe_px"] = compute_disparity_metrics(disparity, np.where(judged, truth, np.nan))["epe_px"]
    return np.where(seen, disparity, np.nan), numbers


def find_consistent(left: Array, right: Array) -> Array:
    """Find the left pixels, bool (H, W), whose disparity agrees with the disparity of the right pixel to which it
    points; both are in px, NaN where unknown.
    """
    column = find_matching_column(left)
    inside = is_in_frame(column)
    at = np.where(inside, np.rint(np.nan_to_num(column)), 0).astype(int).clip(0, left.shape[1] - 1)
    with np.errstate(invalid="ignore"):
        return np.asarray(inside & (np.abs(np.take_along_axis(right, at, axis=1) - left) <= CONSISTENT_PX))


def _choose_scale(disparities: Any) -> Scale:
    """Choose the colour range of all disparity maps of a pair."""
    known = np.concatenate([each[np.isfinite(each)] for each in disparities])
    low, high = (float(q) for q in np.quantile(known, (0.01, 0.99))) if known.size else (1.0, 64.0)
    return Scale(max(low, 0.1), max(high, low * 1.05, 0.2), VIRIDIS, DISPARITY_TITLE)
