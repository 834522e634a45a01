"""Stereo matchers, all with the same signature, each imported on its first use.

A matcher is a module of this package with ``OPTIONS``, ``PRESETS`` (named sets of options) and
``compute(left, right, options, camera)``. This function takes two uint8 images of one size, a complete dict of options
and the camera, if it is known, and returns a ``Result``. Images are grey (H, W), or RGB (H, W, 3) for a module with
``COLOUR``. A module may have three more functions: ``check(options)`` raises IcyMoonError if a file or program that the
options name does not exist, ``load(options)`` does work that is not part of matching a pair, ``files(options)``
returns words within options that may be files, and ``settle(options, ranges, shape)`` returns the options with numbers
for those that follow from the pair, and the ``SearchRange``. With ``SPARSE`` a pair without any measurement is a
result; otherwise it is an error.

Matchers of packages that the user installed are beside them, see ``plug_in``.
"""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...plugins.installed import Found, Plugin, find
from ...settings.topics.trust_boundary import OWN
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.suggestions import nearest
from ..images.image_values import describe_size, to_8_bit, to_grey
from ..measure.costs import COSTS
from .options import resolve
from .result import Result
from .search_range import SearchRange

#: Titles that readers see instead of the names of matchers, in tables, charts, sentences and in the window; and the
#: needs of some matchers beside the evaluator.
TITLES = {
    "bm": "StereoBM",
    "sgbm": "SGBM",
    "sgbm_wls": "SGBM with WLS",
    "jplv": "JPLV",
    "igev": "IGEV-Stereo",
    "dsmnet": "DSMNet",
}
NEEDS = {"igev": "PyTorch and a checkpoint", "dsmnet": "PyTorch and a checkpoint"}
#: Our matchers; each is the module of this name. The user sets up the last ones, with a file or a program.
MATCHERS = (*TITLES, "onnx", "resident", "stereo_matching", "external")
#: Names that mean something else where methods are named.
_TAKEN = (*MATCHERS, OWN, "prediction")


def find_plugins() -> Found:
    """The matchers of packages that are installed in this Python."""
    return find("matcher", _TAKEN)


def matcher_names() -> tuple[str, ...]:
    """All matchers of this Python: Icy Moon's, then the plug-ins'."""
    return (*MATCHERS, *find_plugins().usable)


def match(
    method: str,
    left: Array,
    right: Array,
    options: Mapping[str, Any] | None = None,
    camera: StereoCamera | None = None,
    ranges: Mapping[str, SearchRange] | None = None,
) -> tuple[Array, Array, dict[str, Any]]:
    """Compute the disparity of the left image with the matcher ``method``.

    ``left`` and ``right`` are rectified images of one size, uint8 or uint16 (scaled to 8 bits), grey (H, W) or colour
    (H, W, 3 or 4; BGR as OpenCV reads it; matchers without colour get the mean of the bands, or the grey that their
    option ``grey`` names). Values of ``options`` may be text. A program of the user's may ask for the ``camera``.
    ``ranges`` are the search ranges that options may name, see ``search_range.known_ranges``. Returns

    * disparity, float32 (H, W), px, left column minus right column, NaN where invalid;
    * valid, bool (H, W);
    * info: ``method``, the complete ``options``, the ``COSTS`` of the matching alone (including a program that it
      started; None where unknown), ``arrays``, ``counts`` and ``facts``, see ``Result``, and ``search``, the range that
      was searched, or None if the matcher has no range.

    A disparity of zero or less gives no depth and is invalid. Raises IcyMoonError for an unknown matcher or option,
    for images that cannot be used or are too small for the options, and if a matcher that measures everywhere gave no
    number at all.
    """
    module = _import_matcher(method)
    complete = check_options(method, options or {})
    prepare = _rgb if getattr(module, "COLOUR", False) else GREYS[complete.get("grey", "mean")]
    left, right = prepare(_check_image(left, "left")), prepare(_check_image(right, "right"))
    if left.shape[:2] != right.shape[:2]:
        raise IcyMoonError(
            f"The left image is {describe_size(left)}, the right one {describe_size(right)}; "
            "give two images of the same size."
        )
    search = None
    if settle := getattr(module, "settle", None):
        complete, search = settle(complete, ranges or {}, left.shape)
    if load := getattr(module, "load", None):
        load(complete)
    cpu, wall = _cpu_seconds(), time.perf_counter()
    result: Result = module.compute(left, right, complete, camera)
    costs = {"seconds": _cpu_seconds() - cpu, "wall_seconds": time.perf_counter() - wall}
    valid = (result.disparity > 0) & np.isfinite(result.disparity)
    if not valid.any() and not getattr(module, "SPARSE", False):
        what = "a positive number" if np.isfinite(result.disparity).any() else "a number"
        raise IcyMoonError(
            f"{TITLES.get(method, method)} gave no pixel {what}; its checkpoint or program is damaged, "
            "or writes disparities with the wrong sign or unit."
        )
    return (
        np.where(valid, result.disparity, np.nan).astype(np.float32),
        valid,
        {
            "method": method,
            "options": complete,
            **dict.fromkeys(COSTS),
            **costs,
            **result.costs,
            "arrays": result.arrays,
            "counts": result.counts,
            "facts": result.facts,
            "search": search,
        },
    )


def check_options(method: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The complete options that ``match`` would use.

    Raises IcyMoonError where ``match`` would, also for a checkpoint or program that does not exist.
    """
    complete = complete_options(method, options)
    if check := getattr(_import_matcher(method), "check", None):
        check(complete)
    return complete


def complete_options(method: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The same, without checking that files and programs exist."""
    module = _import_matcher(method)
    return resolve(method, module.OPTIONS, module.PRESETS, options)


def option_keys(method: str) -> list[str]:
    """The options of a matcher, with ``preset`` and the names that OpenCV's manual has for them. Raises IcyMoonError
    for an unknown matcher."""
    return [
        "preset",
        *(name for option in _import_matcher(method).OPTIONS for name in (option.key, option.opencv) if name),
    ]


def files_of(method: str, options: Mapping[str, Any]) -> list[str]:
    """Words of complete options that may be files which the result depends on: the arguments of a command."""
    named = getattr(_import_matcher(method), "files", None)
    return list(named(options)) if named else []


def describe_matcher(method: str) -> str:
    """What a matcher is, and its options, as lines of text. Raises IcyMoonError for an unknown one."""
    module = _import_matcher(method)
    lines = [f"{method}: {(module.__doc__ or '').strip().splitlines()[0]}"]
    lines += [f"  {option.key}={option.default} ({option.range}) {option.doc}" for option in module.OPTIONS]
    lines += [
        f"  preset={name} " + " ".join(f"{key}={value}" for key, value in chosen.items())
        for name, chosen in module.PRESETS.items()
    ]
    return "\n".join(lines)


def release_of(method: str) -> str:
    """Package and version of the plug-in that a matcher is from; empty for one of ours."""
    plugin = None if method in MATCHERS else find_plugins().usable.get(method)
    return plugin.release if plugin else ""


def _import_matcher(method: str) -> Any:
    """The module of a matcher, or the loaded plug-in in its place. Raises IcyMoonError for an unknown one."""
    if method in MATCHERS:
        return importlib.import_module(f".{method}", __name__)
    found = find_plugins()
    if method in found.usable:
        return _load_plugin(found.usable[method])
    if method in found.refused:
        raise IcyMoonError(found.refused[method])
    raise IcyMoonError(f"Unknown matcher {method!r}, {nearest(method, (*MATCHERS, *found.usable))}")


@lru_cache(maxsize=64)
def _load_plugin(plugin: Plugin) -> Any:
    from .plug_in import PluginMatcher  # not at the top: it needs OpenCV

    return PluginMatcher(plugin)


def _cpu_seconds() -> float:
    """CPU seconds of this process and of the programs that it has waited for (Windows does not count these)."""
    children = os.times()
    return time.process_time() + children.children_user + children.children_system


def _check_image(image: Array, name: str) -> Array:
    image = np.asarray(image)
    if image.dtype not in (np.uint8, np.uint16):
        raise IcyMoonError(f"The {name} image has values of type {image.dtype}; give 8-bit or 16-bit grey values.")
    if image.size == 0 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (3, 4))):
        raise IcyMoonError(f"The {name} image has the shape {image.shape}; give a grey or colour image.")
    return image


def _luminance(image: Array) -> Array:
    """uint8 (H, W): 0.299 red, 0.587 green and 0.114 blue, in OpenCV's rounding, after the scaling to 8 bits."""
    import cv2  # not at the top: the window lists the matchers, and Blender has no OpenCV

    image = to_8_bit(image)
    return image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)


#: Functions that turn an image grey, by the value of a matcher's option ``grey``.
GREYS = {"mean": to_grey, "luminance": _luminance}


def _rgb(image: Array) -> Array:
    """uint8 (H, W, 3), red first."""
    return to_8_bit(np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image[..., 2::-1])
