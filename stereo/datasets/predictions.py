"""Reads disparities of other programs, one file per pair, which are evaluated like a method."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import is_of_file_manager
from ..images.bounded_decoding import decode
from ..images.image_files import read_png
from ..matchers.methods import Method, describe_method
from ..matchers.result import CONFIDENCE, ERROR_PX, Confidence
from ..measure.metrics import COSTS, is_usable
from ..measure.prepare_pair import PreparedPair
from .data_files import MapFile, read_map, resolve_inside
from .input_faults import check_prediction
from .markers import is_possible

#: Name of a method of predictions, in place of a matcher's name.
PREDICTION = "prediction"
#: Endings of prediction files; the first that exists counts.
PREDICTION_SUFFIXES = (".pfm", ".png", ".npy", ".npz", ".exr", ".tiff", ".tif")
#: Most files of a folder that are searched for a prediction under another name.
_MAX_SEARCHED_FILES = 1000
#: Quantities that a file beside a disparity may state. The file's name ends in the quantity.
_STATED = (CONFIDENCE, ERROR_PX)
_METHOD_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,59}")


def parse_predictions(texts: Sequence[str], pairs: Sequence[str], taken: Sequence[str] = ()) -> list[Method]:
    """Parse ``NAME=FOLDER`` texts to methods; ``pairs`` are the names of all pairs, ``taken`` the labels in use.

    A folder without any prediction is accepted beside other methods, and ``find_prediction`` reports it later. Raises
    IcyMoonError if a text has another form, a name is in use, a path is not a folder, or no method would have a result.
    """
    found: list[Method] = []
    empty: list[str] = []
    for text in texts:
        name, equals, folder = text.partition("=")
        if not (equals and folder and _METHOD_NAME.fullmatch(name)):
            raise IcyMoonError(
                f"--predictions {text}: write it as NAME=FOLDER, as in mynet=results/mynet; a name "
                "begins with a letter or digit."
            )
        if describe_method(name) in map(describe_method, (*taken, *(method.label for method in found))):
            raise IcyMoonError(f"--predictions {text}: there is already a method {name}; choose another name.")
        root = Path(folder).expanduser().absolute()
        if not any(_find_prediction_files(root, pair) for pair in pairs):
            shown = ", ".join(f"{pairs[0]}{ending}" for ending in PREDICTION_SUFFIXES[:3])
            empty.append(f"{folder} has no disparity of any pair; name the files after the pairs, such as {shown}.")
            if not root.is_dir():
                raise IcyMoonError(empty[-1])
        found.append(Method(name, PREDICTION, {"folder": str(root)}))
    if empty and len(empty) == len(found) and not taken:
        raise IcyMoonError(empty[0])
    return found


def find_prediction(method: Method, pair: str) -> Path:
    """Find the file with a pair's disparity. Raises IcyMoonError if no file or several exist."""
    root = Path(method.options["folder"])
    found = _find_prediction_files(root, pair)
    if not found:
        other = _find_misnamed_file(root, pair)
        fix = f"rename {other.name} to {pair}{other.suffix}" if other else f"add {pair}.pfm, or .png, .npy or .exr"
        raise IcyMoonError(f"{root} has no disparity of the pair {pair}; {fix}.")
    if len(found) > 1:
        raise IcyMoonError(
            f"{root} has {' and '.join(path.name for path in found)} of the pair {pair}; keep one of them."
        )
    return resolve_inside(root, found[0].relative_to(root))


def _find_prediction_files(root: Path, pair: str) -> list[Path]:
    return [path for ending in PREDICTION_SUFFIXES if (path := root / f"{pair}{ending}").is_file()]


def _find_misnamed_file(root: Path, pair: str) -> Path | None:
    """Find the only file that may be a prediction and whose name contains the ``pair`` as a whole word.

    None without such a file or with several.
    """
    named = re.compile(rf"(?<![A-Za-z0-9]){re.escape(pair)}(?![A-Za-z0-9])")
    try:
        found = [
            path
            for path in islice(root.iterdir(), _MAX_SEARCHED_FILES)
            if path.suffix in PREDICTION_SUFFIXES
            and named.search(path.stem)
            and not path.stem.endswith(tuple(f"_{kind}" for kind in _STATED))
            and not is_of_file_manager(path.name)
        ]
    except OSError:
        return None
    return found[0] if len(found) == 1 else None


def find_confidence(method: Method, pair: str) -> tuple[Path, str] | None:
    """Find the file with the confidence or the expected error of a pair's disparity, and the kind of its numbers.

    The file is PAIR_confidence or PAIR_error_px beside the disparity; None without one. Raises IcyMoonError if there
    are several.
    """
    root = Path(method.options["folder"])
    found = [(path, kind) for kind in _STATED for path in _find_prediction_files(root, f"{pair}_{kind}")]
    if len(found) > 1:
        names = " and ".join(path.name for path, _ in found)
        raise IcyMoonError(f"{root} has {names} of the pair {pair}; keep one of them.")
    return (resolve_inside(root, found[0][0].relative_to(root)), found[0][1]) if found else None


def _read_confidence(path: Path, kind: str, measured: Array) -> Array:
    """Read a confidence, float32 (H, W) from 0 to 1, of the ``measured`` pixels.

    In a PNG of a confidence the largest number, 255 or 65535, is 1; a PNG of an error has 256 steps per px. Unlike in a
    disparity, 0 is a number.
    """
    if kind == CONFIDENCE and path.suffix == ".png":
        image = read_png(path, decode)
        return Confidence(image / np.iinfo(image.dtype).max, kind).check(str(path), measured)
    return Confidence(read_map(MapFile(path, predicted=True, zero_is_unknown=False)), kind).check(str(path), measured)


def read_prediction(method: Method, prepared: PreparedPair) -> tuple[Array, dict[str, Any]]:
    """Read the disparity, float32 (H, W), NaN where invalid. Return it with an ``info`` as ``match`` returns.

    Raises IcyMoonError if the file is missing, damaged, or of another size, sign or unit.
    """
    path = find_prediction(method, prepared.pair.name)
    disparity = read_map(MapFile(path, predicted=True))
    check_prediction(path, disparity, prepared.truth, prepared.pair.camera)
    found = is_usable(disparity) & is_possible(disparity)
    stated = find_confidence(method, prepared.pair.name)
    return np.where(found, disparity, np.nan).astype(np.float32), {
        "method": PREDICTION,
        "options": method.options,
        **dict.fromkeys(COSTS),
        "arrays": {},
        "counts": {},
        "facts": {},
        "search": None,
        "confidence": stated and _read_confidence(*stated, found),
    }
