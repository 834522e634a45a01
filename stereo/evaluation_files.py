"""The files that an evaluation writes for each pair, in ``pairs/<pair>/`` of its folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors, remove_leftover_parts
from ..support.system import open_regular
from .images import colours
from .images.disparity_files import encode_confidences
from .images.image_files import write_disparity, write_png
from .matchers.methods import Method
from .measure.prepare_pair import PreparedPair
from .measure.row_metrics import disparity_to_depth

#: The files that an evaluation writes beside ``pairs/``, and the first bytes of each.
_FIRST_BYTES: Mapping[str, bytes] = {
    "results.jsonl": b'{"pair": ',
    "results.csv": b"pair,method,status,",
    "comparisons.csv": b"a,b,metric,kind,",
    "report.json": b'{\n "format": "icymoon-',
    "summary.json": b'{\n "format": "icymoon-',
    "report.html": b'<!DOCTYPE html>\n<html lang="en">\n<head>\n',
}


def check_output_folder(out: Path, pairs: Iterable[str], openings: Mapping[str, bytes] = _FIRST_BYTES) -> None:
    """Raise IcyMoonError if an evaluation of ``pairs`` would overwrite files in ``out`` that no evaluation wrote.

    Links are refused, because they may lead anywhere. ``openings`` are the files that are written beside ``pairs/``,
    with the first bytes of each; they tell these files from other programs' files with the same names.
    """
    folders = [out / "pairs", out / "curves", *(out / "pairs" / name for name in pairs)]
    for path in (*folders, *(out / name for name in openings)):
        if path.is_symlink():
            raise IcyMoonError(
                f"{path} is a link, and results are not written through one; remove it, or choose "
                "another folder for them."
            )
    if any((folder / "pair.json").exists() for folder in folders):
        raise IcyMoonError(
            f"{out} is a data set, and results would mix with its pairs; choose another folder for them."
        )
    there = [out / name for name in openings if (out / name).exists()]
    if there and not any(_was_written_by_evaluation(path, openings[path.name]) for path in there):
        raise IcyMoonError(
            f"{there[0]} was not written by an evaluation and is not overwritten; choose another folder "
            "for the results."
        )


def _was_written_by_evaluation(path: Path, begin: bytes) -> bool:
    """Return whether a file begins as an evaluation's file does. A shorter file counts too, because a run may have been
    killed while it wrote these bytes.
    """
    with explain_disk_errors("read", path), open_regular(path) as stream:
        return begin.startswith(found) if len(found := stream.read(len(begin))) < len(begin) else found == begin


def remove_leftovers(out: Path) -> None:
    """Remove the half-written files that a killed evaluation left in its folder."""
    for folder in (out, out / "curves", *(out / "pairs").glob("*/")):
        remove_leftover_parts(folder)


def has_named_files(entry: Mapping[str, Any], out: Path, pair: str) -> bool:
    """Return whether all files that a row or the facts of a pair name exist in the folder of the pair."""
    folder = out / "pairs" / pair
    return all((out / path).parent == folder and (out / path).is_file() for path in entry["images"].values())


def write_pair_pictures(prepared: PreparedPair, out: Path) -> dict[str, str]:
    """Write the left image, the right image and the true depth; return their paths relative to ``out``."""
    depth = colours.draw_true_depth(prepared.truth, prepared.scale)
    images = {
        "left": prepared.left,
        "right": prepared.right,
        "true_depth": colours.add_colour_bar(depth, prepared.scale),
    }
    return {key: _write_picture(prepared, out, f"{key}.png", image) for key, image in images.items()}


def write_method_pictures(
    prepared: PreparedPair,
    method: Method,
    disparity: Array,
    info: Mapping[str, Any],
    out: Path,
    confidences: Mapping[str, Array],
) -> dict[str, str]:
    """Write depth, error and disparity of one method; return their paths relative to ``out``. The npz file of the
    disparity also contains the ``confidences``, by measure.

    The first confidence is written as a picture too. So are ``flags``, the reason for each rejected pixel, if the
    matcher states them.
    """
    depth = disparity_to_depth(prepared, disparity)
    npz = _pair_folder(prepared, out) / f"{method.file_name}.npz"
    arrays = encode_confidences(confidences) | info["arrays"]
    write_disparity(npz, disparity, arrays, focal_baseline_px_m=prepared.depth_camera.focal_baseline_px_m)
    written = {
        "depth": colours.add_colour_bar(colours.draw_depth(depth, prepared.scale), prepared.scale),
        "error": colours.add_colour_bar(colours.draw_error(depth, prepared.truth), colours.ERROR_SCALE),
    }
    for confidence in list(confidences.values())[:1]:  # the matcher's own is the first
        picture = colours.draw_confidence(confidence, np.isfinite(disparity))
        written["confidence"] = colours.add_colour_bar(picture, colours.CONFIDENCE_SCALE)
    if "flags" in info["arrays"]:
        written["flags"] = colours.draw_outcomes(info["arrays"]["flags"], disparity.shape)
    return {
        **{
            key: _write_picture(prepared, out, f"{method.file_name}_{key}.png", image) for key, image in written.items()
        },
        "disparity": npz.relative_to(out).as_posix(),
    }


def _write_picture(prepared: PreparedPair, out: Path, name: str, image: Array) -> str:
    path = _pair_folder(prepared, out) / name
    write_png(path, image)
    return path.relative_to(out).as_posix()


def _pair_folder(prepared: PreparedPair, out: Path) -> Path:
    return out / "pairs" / prepared.pair.name
