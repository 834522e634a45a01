"""What 16-bit floats save and cost: bytes of each pass by codec, and what matchers make of rounded radiance.

    python benchmarks/half_floats.py out/workspaces

The pairs of a data set that was rendered with ``quality.half_floats`` NONE. The first table contains bytes per pixel of
the first pair's left image, of 32 and of 16 bits, by OpenEXR's codecs (DWAA is lossy). The second one contains, of each
pair and matcher, the mean error and the share that is wrong or missing, of full radiance and of rounded radiance.
Needs the evaluator's packages.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import OpenEXR
from icymoon.formats.exr_parts import assemble, read_pieces
from icymoon.formats.exr_pixels import Pixels, round_passes
from icymoon.labels import ROUNDED
from icymoon.render.pairs.pair_folder import find_pair_folders
from icymoon.stereo.images import exr
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.metrics import usable
from icymoon.stereo.measure.prepare import load

CODECS = ("ZIPS", "ZIP", "PIZ", "ZSTD", "HTJ2K256", "DWAA")


def size(channels: dict[str, np.ndarray], codec: int) -> int:
    """Bytes of a file with these channels."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "one.exr")
        header = {"compression": codec, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {name: OpenEXR.Channel(values) for name, values in channels.items()}) as file:
            file.write(path)
        return os.path.getsize(path)


def print_sizes(folder: Path) -> None:
    """Print bytes per pixel of each pass, by codec."""
    there = {name: getattr(OpenEXR, f"{name}_COMPRESSION") for name in CODECS
             if hasattr(OpenEXR, f"{name}_COMPRESSION")}
    print(f"{'bytes per pixel':32}" + "".join(f"{name:>16}" for name in there))
    for piece in read_pieces((folder / "left.exr").read_bytes()):
        pixels = Pixels(piece)
        values = pixels.decode()
        cells = []
        for codec in there.values():
            each = [size({name.split(".")[-1]: np.ascontiguousarray(values[:, k].astype(kind))
                          for k, name in enumerate(pixels.channels)}, codec) / values[:, 0].size
                    for kind in (np.float32, np.float16)]
            cells.append(f"{each[0]:8.2f} {each[1]:7.2f}")
        print(f"{piece.name:32}" + "".join(cells), flush=True)
    for choice in ROUNDED:
        total = sum(len(assemble([round_passes(piece, ROUNDED[choice]) for piece in read_pieces(
            (folder / f"{eye}.exr").read_bytes())])) for eye in ("left", "right"))
        print(f"a pair with half_floats {choice}: {total / 1e6:.1f} MB")


def disparity_errors(folder: Path, methods: Any) -> dict[str, tuple[float, float]]:
    """By method the mean error in px of what it measures, and the share that is wrong by 1 px or missing."""
    pair = load(folder, {})
    camera = pair.pair.camera
    left, right = pair.images.for_matchers()
    true = np.where(pair.visible["left"], camera.disparity(pair.depth["left"]), np.nan)
    found = {}
    for method in methods:
        disparity = match(method.name, left, right, method.options, camera)[0]
        off = np.where(usable(disparity), np.abs(disparity - true), np.nan)[np.isfinite(true)]
        found[method.label] = float(np.nanmean(off)), float(np.mean(~(off <= 1)))
    return found


def print_errors(folders: list[Path], methods: Any) -> None:
    """Print what rounding changes, pair by pair, and the means with their standard errors."""
    whole = exr._read_whole
    changes: dict[str, list[tuple[float, float]]] = {}

    def rounded(*arguments: Any) -> Any:
        return [(view, {name: values.astype(np.float16).astype(np.float32) if name.startswith("Beauty.Combined")
                        else values for name, values in channels.items()}) for view, channels in whole(*arguments)]

    for folder in folders:
        full = disparity_errors(folder, methods)
        with patch.object(exr, "_read_whole", rounded):
            less = disparity_errors(folder, methods)
        for label, (error, wrong) in full.items():
            other, missing = less[label]
            changes.setdefault(label, []).append((other - error, missing - wrong))
            print(f"{folder.name} {label:5} {error:.4f} -> {other:.4f} px, {wrong:.2%} -> {missing:.2%}", flush=True)
    for label, each in changes.items():
        mean, spread = np.mean(each, axis=0), np.std(each, axis=0, ddof=1) / len(each) ** 0.5
        print(f"{label}, {len(each)} pairs: {mean[0]:+.4f} ± {spread[0]:.4f} px, {mean[1]:+.3%} ± {spread[1]:.3%}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--pairs", type=int, default=10, help="pairs that are matched at most")
    given = parser.parse_args()
    pairs = find_pair_folders(given.dataset)[:given.pairs]
    print_sizes(pairs[0])
    print_errors(pairs, parse_methods("bm,sgbm"))
