"""Read the multilayer EXR files of a pair, from any version of Blender.

Blender 4.x writes all passes into one part, as ``Truth.Depth.Z`` or, with the name of the view, as
``Truth.Depth.left.Z``. Blender 5.x writes one part per pass, with the same channel names and the view in the header of
the part. So a channel is found by its layer (first word), pass (second word) and component (last word).

The files are decoded in NumPy, with the same values, where the OpenEXR package is missing, and in Blender, where the
package crashes.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from ...formats.exr_layout import KIND, MAX_BYTES, check_decodable
from ...formats.exr_pixels import decode_parts
from ...render.pairs.pair_folder import EYES
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, Parsed, explain_errors
from ...support.foreign_bytes import read as read_foreign
from ...support.labels import (
    BAKED_ERROR_AOVS,
    BAKED_ERROR_PASSES,
    BEAUTY,
    DISTANCE,
    GROUP_PASSES,
    HIDDEN,
    IMAGE_PASS,
    INSTANCE_AOV,
    LAMP_GROUPS,
    LIGHT_GROUPS,
    LOOSE,
    NORMAL_AOV,
    SKY_DEPTH_M,
    TRUTH,
)
from ...support.temporary_folders import open_scratch_folder
from ..environment.packages import is_in_blender
from .exr_passes import keep_passes, keep_row_chunks, remove_passes

#: Passes that tell objects apart, and passes with normals.
OBJECT_PASSES = tuple(f"{TRUTH}.{name}" for name in ("Object Index", "IndexOB", INSTANCE_AOV))
NORMAL_PASSES = tuple(f"{TRUTH}.{name}" for name in ("Normal", NORMAL_AOV))

_RENDER_AGAIN = "render the pair again"
_SEMANTIC_PASSES = ("Material Index", "IndexMA")  # the pass with the semantic labels, by version

_Channels = dict[tuple[str, str, str], Array]  # (layer, pass, component) -> (height, width)


@dataclass(frozen=True)
class Light:
    """The light in the EXR file of one eye: (H, W, 3) float32, linear, W/(m² sr) in the bands R, G, B."""

    radiance: Array
    groups: dict[str, Array]  # parts of the light by their source, see labels.LIGHT_GROUPS; may be empty


@dataclass(frozen=True)
class Truth:
    """The truth in the EXR file of one eye, of height H and width W, sampled at pixel centres."""

    depth: Array  # (H, W) float64, planar metres, NaN for sky
    normal: Array | None  # (H, W, 3) float32, world axes: of the facet, else the shading normal
    instance: Array | None  # (H, W) int32, see labels
    semantic: Array | None  # (H, W) int32, see labels.SEMANTIC
    # (H, W) bool: hidden from the other eye by a nearer surface; None if no rays were traced.
    hidden: Array | None = None
    loose_m: Array | None = None  # (H, W) float32: thickness of loose material, m; None without quality.loose_thickness


@dataclass(frozen=True)
class View(Truth, Light):
    """Light and truth of one camera."""


def read_view(path: Path, eye: str | None = None, without: Collection[str] = (), rows: range | None = None) -> View:
    """Read ``left.exr`` or ``right.exr`` if it contains both light and truth. ``eye`` selects the view in a file with
    two views.

    ``without`` leaves out passes (``LAYER.PASS``), and ``rows`` limits the rows, both for speed. Raises IcyMoonError if
    the file is missing, damaged or lacks radiance or depth.
    """
    channels = _read_channels(path, eye, without=without, rows=rows)
    truth = _make_truth(channels, path)
    light = _make_light(channels, path, not set(GROUP_PASSES) <= set(without))
    return join_light_and_truth(light, truth)


def join_light_and_truth(light: Light, truth: Truth) -> View:
    """Join light and truth of one camera to one view."""
    return View(**{each.name: getattr(of, each.name) for of in (light, truth) for each in fields(of)})


def read_truth(path: Path, eye: str | None = None, without: Collection[str] = (), rows: range | None = None) -> Truth:
    """Read the truth alone, ``without`` some passes, and only the ``rows`` if they are given.

    Raises IcyMoonError if the file is missing, damaged or lacks depth.
    """
    return _make_truth(_read_channels(path, eye, without=without, rows=rows), path)


def read_depth(path: Path, eye: str | None = None) -> Truth:
    """Read only the depth and the labels that distinguish the planet from the ground; other arrays may be None."""
    passes = [f"{layer}.{name}" for layer in (BEAUTY, TRUTH) for name in ("Depth", *_SEMANTIC_PASSES)]
    return _make_truth(_read_channels(path, eye, passes), path)


def read_distances(path: Path) -> Truth:
    """Read the truth of a camera beside a pair, with distances along the rays of its pixels, m, instead of depths.

    Raises IcyMoonError if the file is missing, damaged or lacks distances.
    """
    return _make_truth(_read_channels(path, None), path, DISTANCE)


def _make_truth(channels: _Channels, path: Path, name: str = "Depth") -> Truth:
    with_light = (BEAUTY, name, "Z") in channels  # the truth is stored with the light
    with np.errstate(invalid="ignore"):  # NaN stays NaN
        depth = _find_channel(channels, BEAUTY if with_light else TRUTH, name, "Z", path).astype(np.float64)
    depth[~(depth < SKY_DEPTH_M) | (depth <= 0)] = np.nan
    hidden = channels.get((TRUTH, HIDDEN, "X"))
    return Truth(
        depth,
        _find_normals(channels, path),
        _find_instances(channels),
        _find_labels(channels, _SEMANTIC_PASSES),
        None if hidden is None else hidden > 0,
        channels.get((TRUTH, LOOSE, "X")),
    )


def read_light(path: Path, eye: str | None = None, groups: bool = True, rows: range | None = None) -> Light:
    """Read the light alone, with or without its ``groups``, and only the ``rows`` if they are given. This is far faster
    than ``read_view`` if the file has a part for each pass.
    """
    passes = [IMAGE_PASS, *(GROUP_PASSES if groups else ())]
    return _make_light(_read_channels(path, eye, passes, rows=rows), path, groups)


def read_baked_error(path: Path, eye: str | None = None) -> dict[str, Array]:
    """Read the error of baked light by its light group, float64 (H, W), see ``labels.BAKED_ERROR_AOVS``; {} if the file
    has none.

    Raises IcyMoonError if the file is missing or damaged.
    """
    channels = _read_channels(path, eye, BAKED_ERROR_PASSES.values())
    return {
        group: channels[BEAUTY, name, "X"].astype(np.float64)
        for group, name in BAKED_ERROR_AOVS.items()
        if (BEAUTY, name, "X") in channels
    }


def _make_light(channels: _Channels, path: Path, groups: bool) -> Light:
    """Make the light from its channels, with or without its ``groups``. Without a stored image, sum the groups."""
    found = {
        group: _find_radiance(channels, f"Combined_{group}", path)
        for group in (*LIGHT_GROUPS, *LAMP_GROUPS)
        if (BEAUTY, f"Combined_{group}", "R") in channels
    }
    is_sum = found.keys() >= LIGHT_GROUPS.keys() and (BEAUTY, "Combined", "R") not in channels
    radiance = np.sum(list(found.values()), axis=0) if is_sum else _find_radiance(channels, "Combined", path)
    return Light(radiance, found if groups else {})


def _find_radiance(channels: _Channels, pass_name: str, path: Path) -> Array:
    bands = [_find_channel(channels, BEAUTY, pass_name, band, path) for band in "RGB"]
    return np.stack(bands, axis=-1).astype(np.float32, copy=False)


def _read_channels(
    path: Path, eye: str | None, passes: Collection[str] = (), without: Collection[str] = (), rows: range | None = None
) -> _Channels:
    """Read the channels of an eye: all, or at least the ``passes`` (``LAYER.PASS``), or all except ``without``."""
    if not path.is_file():
        raise IcyMoonError(f"{path} is missing; {_RENDER_AGAIN}.")
    channels: _Channels = {}
    for view_of_part, pixels in _read_parts(path, passes, without, rows):
        for name, values in pixels.items():
            words = name.split(".")
            view = view_of_part or next((word for word in words if word in EYES), None)
            if len(words) < 3 or (eye and view and view != eye):
                continue
            channels[words[0], words[1], words[-1]] = values
    # Blender 4 writes all passes in one part, which can only be read as a whole.
    unread = set(without) - (set() if (BEAUTY, "Combined", "R") in channels else set(GROUP_PASSES))
    channels = {key: values for key, values in channels.items() if ".".join(key[:2]) not in unread}
    if len({values.shape for values in channels.values()}) > 1:
        raise IcyMoonError(f"{path} has parts of unequal size; {_RENDER_AGAIN}.")
    return channels


def _read_file(path: Path, parse: Callable[[ForeignBytes], Parsed]) -> Parsed:
    return read_foreign(path, parse, KIND, _RENDER_AGAIN, most=MAX_BYTES)


def _read_parts(
    path: Path, passes: Collection[str], without: Collection[str], rows: range | None
) -> list[tuple[str, dict[str, Array]]]:
    """Read each part of a file: its view ("" without one) and its channels by name."""
    if rows is None:
        return _read_with_openexr(path, passes, without)
    data, before = _read_file(
        path, lambda foreign: keep_row_chunks(_drop_passes(foreign.content(), passes, without), rows)
    )
    with open_scratch_folder() as folder:
        file = folder / path.name
        file.write_bytes(data)
        found = _read_with_openexr(file, (), ())
    return [
        (view, {name: values[before : before + len(rows)] for name, values in channels.items()})
        for view, channels in found
    ]


def _read_with_openexr(
    path: Path, passes: Collection[str], without: Collection[str]
) -> list[tuple[str, dict[str, Array]]]:
    if is_in_blender():
        return _decode_with_numpy(path, passes, without)
    try:
        import OpenEXR
    except ImportError:
        return _decode_with_numpy(path, passes, without)
    # The library gets only headers and chunks that were checked. It raises RuntimeError, ValueError and its own types.
    with (
        explain_errors(path, KIND, _RENDER_AGAIN),
        silence_openexr(),
        _make_smaller_file(path, passes, without) as file,
    ):
        parts_announced = len(OpenEXR.File(file, separate_channels=True, header_only=True).parts)
        parts = OpenEXR.File(file, separate_channels=True).parts
    # OpenEXR leaves out a part that it cannot decode, and reports it only on standard output.
    if len(parts) < parts_announced:
        raise IcyMoonError(f"{path} is damaged or incomplete; {_RENDER_AGAIN}.")
    return [
        (
            part.header.get("view") or "",
            {name: _to_single_precision(channel.pixels) for name, channel in part.channels.items()},
        )
        for part in parts
    ]


def _to_single_precision(values: Array) -> Array:
    """Convert a channel of 16-bit floats to float32, because arithmetic with 16 bits would round again."""
    return values.astype(np.float32) if values.dtype == np.float16 else values


def _decode_with_numpy(
    path: Path, passes: Collection[str], without: Collection[str]
) -> list[tuple[str, dict[str, Array]]]:
    """Decode the parts of a file in NumPy, as ``_read_with_openexr`` does; this is enough for files from Blender."""
    return _read_file(path, lambda foreign: list(decode_parts(_drop_passes(foreign.content(), passes, without))))


@contextmanager
def _make_smaller_file(path: Path, passes: Collection[str], without: Collection[str]) -> Iterator[str]:
    """Make a file with only the ``passes`` in ``path``, or with the passes not in ``without``, and yield its name.

    Raises IcyMoonError if the file is damaged, or may not be decoded.
    """
    if not (passes or without):
        _read_file(path, check_decodable)
        yield str(path)
        return
    data = _read_file(path, lambda foreign: _drop_passes(foreign.content(), passes, without))
    # This must be a file, because older versions of the OpenEXR package read no stream.
    with open_scratch_folder() as folder:
        file = folder / path.name
        file.write_bytes(data)
        yield str(file)


def _drop_passes(data: bytes, passes: Collection[str], without: Collection[str]) -> bytes:
    if passes:
        return keep_passes(data, passes)
    return remove_passes(data, without) if without else data


def _find_channel(channels: _Channels, layer: str, pass_name: str, component: str, path: Path) -> Array:
    try:
        return channels[layer, pass_name, component]
    except KeyError:
        raise IcyMoonError(f"{path} has no channel {layer}.{pass_name}.{component}; {_RENDER_AGAIN}.") from None


def _find_normals(channels: _Channels, path: Path) -> Array | None:
    """Find the normals of facets. The user's own objects have shading normals instead, because their materials write no
    facet normals.
    """
    found = [
        [_find_channel(channels, TRUTH, name, axis, path) for axis in components]
        for name, components in ((NORMAL_AOV, "RGB"), (NORMAL_AOV, "XYZ"), ("Normal", "XYZ"))
        if (TRUTH, name, components[0]) in channels
    ]
    if not found:
        return None
    normal = np.stack(found[0], axis=-1)
    if len(found) == 2:
        x, y, z = found[0]
        missing = (x == 0) & (y == 0) & (z == 0)
        normal[missing] = np.stack([axis[missing] for axis in found[1]], axis=-1)
    return normal


def _find_instances(channels: _Channels) -> Array | None:
    """Find the labels of objects and of rocks. Each rock has its own label and no object index."""
    objects, rocks = _find_labels(channels, ("Object Index", "IndexOB")), _find_labels(channels, (INSTANCE_AOV,))
    return objects if rocks is None or objects is None else np.where(rocks > 0, rocks, objects)


def _find_labels(channels: _Channels, passes: tuple[str, ...]) -> Array | None:
    for name in passes:
        for layer in (TRUTH, BEAUTY):  # with the light, for a pair without separate truth
            if (layer, name, "X") in channels:
                with np.errstate(invalid="ignore"):  # a label that no renderer gives becomes an arbitrary number
                    return np.rint(np.nan_to_num(channels[layer, name, "X"])).astype(np.int32)
    return None


@contextmanager
def silence_openexr() -> Iterator[None]:
    """Discard the output of OpenEXR about a damaged file. Its Python part prints on standard output, where our results
    go, and its C++ part on standard error.
    """
    with suppress(OSError, ValueError, AttributeError):  # it is absent or closed
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # nobody reads it
        kept = -1
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        try:
            os.dup2(nowhere.fileno(), 2)
            with redirect_stdout(nowhere):
                yield
        finally:
            if kept >= 0:
                os.dup2(kept, 2)
                os.close(kept)
            elif nowhere.fileno() != 2:
                os.close(2)
