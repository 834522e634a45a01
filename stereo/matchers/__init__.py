"""Stereo matchers, all with the same signature, each imported on its first use.

A matcher is a plug-in, ours or from a package that the user installed; ``plugins/entry_points.txt`` declares ours. It
has ``match``, see ``plug_in``, or the longer interface of the modules here: ``OPTIONS``, ``PRESETS`` (named sets of
options) and ``compute(left, right, options, camera)``. ``compute`` takes two uint8 images of one size, a complete dict
of options and the camera, if it is known, and returns a ``Result``. Images are grey (H, W), or RGB (H, W, 3) for a
module with ``COLOUR``.

A module may have four more functions. ``check(options)`` raises IcyMoonError if a file or program that the options name
does not exist. ``load(options)`` does work that is not part of matching a pair. ``files(options)`` returns words within
options that may be files. ``settle(options, ranges, shape)`` returns the options with numbers for those that follow
from the pair, and the ``SearchRange``. With ``SPARSE`` a pair without any measurement is a result; otherwise it is an
error.

Lists show literals of the module, see ``plugins.installed.read_fact``. ``TITLE`` replaces its name, and ``NEEDS``
states its requirements beside the evaluator. ``ONE_PROCESSOR`` is true if it uses one processor and little memory. A
matcher that the user sets up in the preferences has ``SET_UP``: its place in their list, the option that is asked for,
a label and a description.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...plugins.installed import Found, Plugin, find_installed, load_plugin, read_fact
from ...settings.topics.trust_boundary import OWN_PREFIX
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.printer import show_controls
from ...support.suggestions import suggest_nearest
from ..images.image_values import describe_size, to_8_bit, to_grey
from .options import resolve_options
from .search_range import SearchRange
from .timed_match import match_timed

#: Names that no matcher can have, since they have another meaning in lists of methods.
_RESERVED_NAMES = (OWN_PREFIX, "prediction", "lidar")


def find_plugins() -> Found:
    """Find the matchers that this Python can load."""
    return find_installed("matcher", _RESERVED_NAMES)


def list_matcher_names() -> tuple[str, ...]:
    """List all matchers of this Python: Icy Moon's, then the installed packages'."""
    return tuple(find_plugins().usable)


def get_matcher_title(method: str) -> str:
    """Return a matcher's title for tables, charts, sentences and the window."""
    return _read_literal_text(method, "TITLE") or method


def get_matcher_needs(method: str) -> str:
    """Return the requirements of a matcher beside the evaluator, in words; "" if it has none."""
    return _read_literal_text(method, "NEEDS")


def list_matcher_titles() -> dict[str, str]:
    """List the titles, by name, of Icy Moon's matchers that need no setup by the user."""
    found = find_plugins().usable.items()
    return {name: title for name, plugin in found if plugin.built_in and (title := _read_literal_text(name, "TITLE"))}


def list_set_ups() -> list[tuple[str, tuple[int, str, str, str]]]:
    """List the matchers that need a setup by the user, with their ``SET_UP``, in the order of its numbers."""
    found = {name: read_fact(plugin, "SET_UP") for name, plugin in find_plugins().usable.items() if plugin.built_in}
    return sorted(((name, stated) for name, stated in found.items() if stated), key=lambda entry: entry[1])


def uses_one_processor(method: str) -> bool:
    """Return whether a matcher uses one processor and little memory. Other matchers may fill a GPU, or all
    processors.
    """
    plugin = find_plugins().usable.get(method)
    return plugin is not None and read_fact(plugin, "ONE_PROCESSOR") is True


def _read_literal_text(method: str, fact: str) -> str:
    plugin = find_plugins().usable.get(method)
    stated = read_fact(plugin, fact) if plugin else ""
    return show_controls(stated) if isinstance(stated, str) else ""


def match(
    method: str,
    left: Array,
    right: Array,
    options: Mapping[str, Any] | None = None,
    camera: StereoCamera | None = None,
    ranges: Mapping[str, SearchRange] | None = None,
) -> tuple[Array, Array, dict[str, Any]]:
    """Match with some options of the matcher, whose values may be text; the others get their defaults. For the rest see
    ``match_checked``. Raises IcyMoonError also for an unknown matcher or option.
    """
    return match_checked(method, left, right, check_options(method, options or {}), camera, ranges)


def match_checked(
    method: str,
    left: Array,
    right: Array,
    options: Mapping[str, Any],
    camera: StereoCamera | None = None,
    ranges: Mapping[str, SearchRange] | None = None,
) -> tuple[Array, Array, dict[str, Any]]:
    """Compute the disparity of the left image with the matcher ``method``; ``options`` are complete, as
    ``check_options`` returns them.

    ``left`` and ``right`` are rectified images of one size, uint8 or uint16 (scaled to 8 bits), grey (H, W) or colour
    (H, W, 3 or 4; BGR as OpenCV reads it). Matchers without colour get the mean of the bands, or the grey that their
    option ``grey`` names. A program of the user's may ask for the ``camera``. ``ranges`` are the search ranges that
    options may name, see ``search_range.find_known_ranges``. Returns

    * disparity, float32 (H, W), px, left column minus right column, NaN where invalid;
    * valid, bool (H, W);
    * info: ``method``, the complete ``options``, the costs from ``match_timed``, and ``arrays``, ``counts`` and
      ``facts``, see ``Result``; ``search``, the range that was searched, or None if the matcher has no range; and
      ``confidence``, float32 (H, W) from 0 to 1, 0 where invalid, or None if the matcher states none.

    A disparity of zero or less gives no depth and is invalid. Raises IcyMoonError for images that cannot be used or are
    too small for the options, if a matcher that measures everywhere gave no number at all, and for a confidence that
    cannot be used.
    """
    module = load_matcher(method)
    complete = dict(options)
    prepare = _to_rgb if getattr(module, "COLOUR", False) else GREY_CONVERSIONS[complete.get("grey", "mean")]
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
    result, costs = match_timed(module.compute, left, right, complete, camera)
    valid = (result.disparity > 0) & np.isfinite(result.disparity)
    if not valid.any() and not getattr(module, "SPARSE", False):
        what = "a positive number" if np.isfinite(result.disparity).any() else "a number"
        raise IcyMoonError(
            f"{get_matcher_title(method)} gave no pixel {what}; its checkpoint or program is damaged, "
            "or writes disparities with the wrong sign or unit."
        )
    return (
        np.where(valid, result.disparity, np.nan).astype(np.float32),
        valid,
        {
            "method": method,
            "options": complete,
            **costs,
            "arrays": result.arrays,
            "counts": result.counts,
            "facts": result.facts,
            "search": search,
            "confidence": result.confidence and result.confidence.check(get_matcher_title(method), valid),
        },
    )


def check_options(method: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the complete options that ``match`` would use.

    Raises IcyMoonError where ``match`` would, also for a checkpoint or program that does not exist.
    """
    complete = complete_options(method, options)
    if check := getattr(load_matcher(method), "check", None):
        check(complete)
    return complete


def complete_options(method: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the complete options as ``check_options`` does, without a check that files and programs exist."""
    module = load_matcher(method)
    return resolve_options(method, module.OPTIONS, module.PRESETS, options)


def list_option_keys(method: str) -> list[str]:
    """List the options of a matcher, with ``preset`` and the names of the options in OpenCV's manual. Raises
    IcyMoonError for an unknown matcher.
    """
    return [
        "preset",
        *(name for option in load_matcher(method).OPTIONS for name in (option.key, option.opencv) if name),
    ]


def list_option_files(method: str, options: Mapping[str, Any]) -> list[str]:
    """List words of complete options that may name files on which the result depends, such as the arguments of a
    command.
    """
    named = getattr(load_matcher(method), "files", None)
    return list(named(options)) if named else []


def describe_matcher(method: str) -> str:
    """Describe a matcher and its options in lines of text. Raises IcyMoonError for an unknown matcher."""
    module = load_matcher(method)
    lines = [f"{method}: {(module.__doc__ or '').strip().splitlines()[0]}"]
    lines += [f"  {option.key}={option.default} ({option.range}) {option.doc}" for option in module.OPTIONS]
    lines += [
        f"  preset={name} " + " ".join(f"{key}={value}" for key, value in chosen.items())
        for name, chosen in module.PRESETS.items()
    ]
    return "\n".join(lines)


def describe_plugin_release(method: str) -> str:
    """Return the package and version of a matcher's plug-in; "" for a built-in matcher."""
    plugin = find_plugins().added.get(method)
    return plugin.release if plugin else ""


def load_matcher(method: str) -> Any:
    """Load a matcher, with the interface of a module of this package. Raises IcyMoonError for an unknown matcher."""
    found = find_plugins()
    if method in found.usable:
        return _load_plugin(found.usable[method])
    if method in found.refused:
        raise IcyMoonError(found.refused[method])
    raise IcyMoonError(f"Unknown matcher {method!r}, {suggest_nearest(method, found.usable)}")


@lru_cache(maxsize=64)
def _load_plugin(plugin: Plugin) -> Any:
    if plugin.built_in and not hasattr(loaded := load_plugin(plugin), "match"):
        return loaded
    from .plug_in import PluginMatcher  # imported here, because it needs OpenCV

    return PluginMatcher(plugin)


def _check_image(image: Array, name: str) -> Array:
    image = np.asarray(image)
    if image.dtype not in (np.uint8, np.uint16):
        raise IcyMoonError(f"The {name} image has values of type {image.dtype}; give 8-bit or 16-bit grey values.")
    if image.size == 0 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (3, 4))):
        raise IcyMoonError(f"The {name} image has the shape {image.shape}; give a grey or colour image.")
    return image


def _to_luminance(image: Array) -> Array:
    """Convert an image to grey, uint8 (H, W): 0.299 red, 0.587 green and 0.114 blue, rounded as OpenCV does, after the
    scaling to 8 bits.
    """
    import cv2  # imported here, because the window lists the matchers, and Blender has no OpenCV

    image = to_8_bit(image)
    return image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)


#: Functions that convert an image to grey, by the value of a matcher's option ``grey``.
GREY_CONVERSIONS = {"mean": to_grey, "luminance": _to_luminance}


def _to_rgb(image: Array) -> Array:
    """Convert an image to uint8 (H, W, 3), red first."""
    return to_8_bit(np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image[..., 2::-1])
