"""Stereo matchers: one signature, loaded when asked for.

A matcher is a module of this package with ``OPTIONS`` (what can be set), ``PRESETS`` (named sets of
options) and ``compute(left, right, options)``, which takes two uint8 (H, W) images and a complete
dict of options and returns disparity, float (H, W) px, NaN where there is no measurement.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np

from ...errors import IcyMoonError
from .options import nearest, resolve

#: Name -> module of this package.
METHODS = {"bm": "bm", "sgbm": "sgbm"}


def match(method: str, left: np.ndarray, right: np.ndarray,
          options: Mapping[str, Any] | None = None) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Disparity of the left image by ``method``.

    ``left`` and ``right`` are rectified images of one size, uint8 or uint16 (scaled to 8 bits), grey
    (H, W) or colour (H, W, 3 or 4; averaged). ``options`` may be given as text. Returns

    * disparity, float32 (H, W), px, left column minus right column, NaN where invalid;
    * valid, bool (H, W);
    * info: ``method``, the complete ``options``, ``seconds`` of CPU time of the matching alone.

    A disparity of zero or less is no depth, and invalid. Raises IcyMoonError for an unknown method
    or option, unusable images and images too small for the options.
    """
    module = _module(method)
    complete = check_options(method, options or {})
    left, right = _grey_8_bit(left, "left"), _grey_8_bit(right, "right")
    if left.shape != right.shape:
        raise IcyMoonError(f"The left image is {_size(left)}, the right one {_size(right)}; "
                           "give two images of one size.")
    start = time.process_time()
    disparity = module.compute(left, right, complete)
    seconds = time.process_time() - start
    valid = disparity > 0  # False for NaN
    return (np.where(valid, disparity, np.nan).astype(np.float32), valid,
            {"method": method, "options": complete, "seconds": seconds})


def check_options(method: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The complete options that ``match`` would run with. Raises IcyMoonError as it would."""
    module = _module(method)
    return resolve(method, module.OPTIONS, module.PRESETS, options)


def _module(method: str) -> ModuleType:
    if method not in METHODS:
        raise IcyMoonError(f"Unknown stereo method {method!r}, {nearest(method, METHODS)}")
    return importlib.import_module(f".{METHODS[method]}", __name__)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]} x {image.shape[0]} px"


def _grey_8_bit(image: np.ndarray, name: str) -> np.ndarray:
    image = np.asarray(image)
    if image.dtype not in (np.uint8, np.uint16):
        raise IcyMoonError(f"The {name} image has values of type {image.dtype}; give 8-bit or 16-bit grey values.")
    if image.size == 0 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (3, 4))):
        raise IcyMoonError(f"The {name} image has the shape {image.shape}; give a grey or colour image.")
    if image.ndim == 3:
        image = np.rint(image[..., :3].mean(axis=-1)).astype(image.dtype)
    if image.dtype == np.uint16:
        image = np.rint(image / 257.0).astype(np.uint8)
    return np.ascontiguousarray(image)
