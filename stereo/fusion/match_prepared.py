"""Runs a method on a prepared pair, and lists the inputs that determine its result."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...render.pairs.pair_folder import Pair
from ...support.arrays import Array
from ...support.files import read_checksum
from ..datasets.foreign_pair import PhotographedPair
from ..datasets.predictions import PREDICTION, read_prediction
from ..environment import packages
from ..matchers import describe_plugin_release, list_option_files
from ..matchers.lidar_options import LIDAR
from ..matchers.methods import Method
from ..matchers.search_range import AUTO, SearchRange, find_known_ranges
from ..measure.prepare_pair import PreparedPair
from .fuse import match_method


def find_shared_disparity(prepared: PreparedPair) -> Array:
    """Return the true disparities (H, W), px, of points that both eyes see; NaN elsewhere."""
    return np.where(prepared.visible, prepared.pair.camera.disparity(prepared.truth), np.nan)


def find_search_ranges(prepared: PreparedPair) -> dict[str, SearchRange]:
    """Find the search ranges that options may name."""
    pair, shared = prepared.pair, find_shared_disparity(prepared)
    if isinstance(pair, Pair):
        return find_known_ranges(pair.settings, shared, bool(pair.data.get("edited_by_hand")))
    ranges = find_known_ranges(None, shared)
    if isinstance(pair, PhotographedPair):
        ranges[AUTO] = pair.search_range
    return ranges


def match_prepared(
    method: Method, prepared: PreparedPair, ranges: Callable[[], Mapping[str, SearchRange]] | None = None
) -> tuple[Array, dict[str, Any]]:
    """Return the disparity (H, W), px, NaN where invalid, of a method, and an ``info`` as ``match_checked`` does.

    ``ranges`` finds the search ranges, by default ``find_search_ranges``, and may make the ground of the pair. A
    prediction needs no ranges.
    """
    if method.name == PREDICTION:
        return read_prediction(method, prepared)
    camera, pair = prepared.depth_camera, prepared.pair
    found = find_search_ranges(prepared) if ranges is None else ranges()
    return match_method(method, prepared.left, prepared.right, camera, found, pair, prepared.truth)


def list_method_inputs(method: Method) -> list[Any]:
    """List everything besides the images that determines a method's disparity.

    These are its options, the files that they name, and versions.
    """
    files = {
        key: read_checksum(Path(value))
        for key, value in method.options.items()
        if isinstance(value, str) and os.path.isfile(value)
    }
    if method.name not in (PREDICTION, LIDAR):
        files |= {
            text: read_checksum(Path(text))
            for text in list_option_files(method.name, method.options)
            if os.path.isfile(text)
        }
    versions = packages.find_versions()
    # A plug-in states its version; our methods have the version of Icy Moon.
    release = describe_plugin_release(method.name)
    return [
        method.name,
        method.options,
        files,
        {name: versions[name] for name in ("numpy", "cv2", "torch")},
        *([release] if release else []),
    ]
