"""The savings and losses of compact files: bytes of each pass by codec, level and size of floats, and rounding errors.

    python benchmarks half_floats out/workspaces

The pairs of a data set that was rendered with ``quality.files`` FULL. The first table contains bytes per pixel of the
first pair's left image, of 32 and of 16 bits, by OpenEXR's codecs (DWAA is lossy). The second one contains, of the
first pair, the bytes of each pass in full and in compact files, the CPU time of storing it compactly and the largest
error; the third the bytes and the CPU time of a compact pair by zlib's level. The last one contains, of each pair and
matcher, the mean error and the share that is wrong or missing, of full radiance and of rounded radiance. Needs the
evaluator's packages.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import OpenEXR
from icymoon.benchmarks.common.processor import Stopwatch
from icymoon.formats import exr_pixels
from icymoon.formats.exr_add import is_sum_of_lights
from icymoon.formats.exr_parts import Piece, assemble, read_pieces
from icymoon.formats.exr_pixels import Pixels, drop_passes, round_passes
from icymoon.render.pairs.pair_folder import find_pair_folders
from icymoon.stereo.images import exr
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.methods import Method, parse_methods
from icymoon.stereo.measure.metrics import is_usable
from icymoon.stereo.measure.prepare_pair import load_pair
from icymoon.support.arrays import Array
from icymoon.support.labels import IMAGE_PASS, list_rounded_passes

CODECS = ("ZIPS", "ZIP", "PIZ", "ZSTD", "HTJ2K256", "DWAA")


def size(channels: dict[str, Array], codec: int) -> int:
    """Bytes of a file with these channels."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "one.exr")
        header = {"compression": codec, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {name: OpenEXR.Channel(values) for name, values in channels.items()}) as file:
            file.write(path)
        return os.path.getsize(path)


def print_sizes(folder: Path) -> None:
    """Print bytes per pixel of each pass, by codec."""
    there = {
        name: getattr(OpenEXR, f"{name}_COMPRESSION") for name in CODECS if hasattr(OpenEXR, f"{name}_COMPRESSION")
    }
    print(f"{'bytes per pixel':32}" + "".join(f"{name:>16}" for name in there))
    for piece in read_pieces((folder / "left.exr").read_bytes()):
        pixels = Pixels(piece)
        values = pixels.decode()
        cells = []
        for codec in there.values():
            each = [
                size(
                    {
                        name.split(".")[-1]: np.ascontiguousarray(values[:, k].astype(kind))
                        for k, name in enumerate(pixels.channels)
                    },
                    codec,
                )
                / values[:, 0].size
                for kind in (np.float32, np.float16)
            ]
            cells.append(f"{each[0]:8.2f} {each[1]:7.2f}")
        print(f"{piece.name:32}" + "".join(cells), flush=True)


def compact(data: bytes) -> Iterator[tuple[Piece, Piece | None, float]]:
    """For each part of a full file: its bytes, its bytes in a compact file, and the processor seconds of compaction."""
    pieces = read_pieces(data)
    watch = Stopwatch()
    twice = {IMAGE_PASS} if is_sum_of_lights(pieces) else set[str]()
    spent = watch.lap()
    for piece in pieces:
        watch = Stopwatch()
        kept = drop_passes(piece, twice)
        kept = kept and round_passes(kept, list_rounded_passes("COMPACT", "NONE"))
        # The question whether the image is a sum counts as the image's time.
        yield piece, kept, watch.lap() + (spent if piece.name.split("-")[0] == IMAGE_PASS else 0.0)


def find_largest_error(piece: Piece, kept: Piece) -> str:
    """The largest angle between normals, the largest relative error of other passes."""
    full, less = (np.float64(Pixels(each).decode()) for each in (piece, kept))
    if "Normal" in piece.name:
        known = (full != 0).any(axis=1)
        sine = np.linalg.norm(np.cross(full, less, axis=1), axis=1) / np.linalg.norm(less, axis=1).clip(1e-9)
        angle = np.degrees(np.arcsin(sine[known].clip(0, 1)))
        return f"{angle.max():.4f}° (rms {np.sqrt(np.mean(angle**2)):.4f}°)"
    off = np.abs(full - less)
    if not off.any():
        return "none"
    relative = np.divide(off, np.abs(full), out=np.zeros_like(full), where=full != 0)
    return f"{relative.max():.2e} (rms {np.sqrt((off**2).sum() / (full**2).sum()):.2e})"


def print_compact(folder: Path) -> None:
    """Print the bytes of each pass in full and in compact files, and of a compact pair by zlib's level."""
    print(f"{'MB of a pair':32}{'full':>8}{'compact':>9}{'CPU-s':>7}  largest error of the left image")
    rows: dict[str, list[float]] = {}
    errors: dict[str, str] = {}
    files = [(folder / f"{eye}.exr").read_bytes() for eye in ("left", "right")]
    for data in files:
        for piece, kept, spent in compact(data):
            name = piece.name.split("-")[0]
            sizes = (sum(map(len, each.chunks)) / 1e6 if each else 0.0 for each in (piece, kept))
            rows[name] = [a + b for a, b in zip(rows.get(name, [0.0] * 3), (*sizes, spent), strict=True)]
            errors.setdefault(name, find_largest_error(piece, kept) if kept else "is the sum of its lights")
    for name, (before, after, spent) in rows.items():
        print(f"{name:32}{before:8.3f}{after:9.3f}{spent:7.3f}  {errors[name]}")
    before, after, spent = np.sum(list(rows.values()), axis=0)
    print(f"{'all':32}{before:8.3f}{after:9.3f}{spent:7.3f}", flush=True)
    compress = zlib.compress
    for level in (1, 4, 6, 9):
        with patch.object(exr_pixels.zlib, "compress", lambda data, _, level=level: compress(data, level)):
            watch = Stopwatch()
            total = sum(len(assemble([kept for _, kept, _ in compact(data) if kept])) for data in files)
            print(f"zlib's level {level}: {total / 1e6:.3f} MB, {watch.lap():.2f} CPU-s", flush=True)


def measure_disparity_errors(folder: Path, methods: Sequence[Method]) -> dict[str, tuple[float, float]]:
    """By method the mean error in px of the measured pixels, and the share that is wrong by 1 px or missing."""
    pair = load_pair(folder, {})
    camera = pair.pair.camera
    left, right = pair.images.for_matchers()
    true = np.where(pair.visible["left"], camera.disparity(pair.depth["left"]), np.nan)
    found = {}
    for method in methods:
        disparity = match(method.name, left, right, method.options, camera)[0]
        off = np.where(is_usable(disparity), np.abs(disparity - true), np.nan)[np.isfinite(true)]
        found[method.label] = float(np.nanmean(off)), float(np.mean(~(off <= 1)))
    return found


def print_errors(folders: list[Path], methods: Sequence[Method]) -> None:
    """Print the effect of rounding, pair by pair, and the means with their standard errors."""
    whole = exr._read_with_openexr
    changes: dict[str, list[tuple[float, float]]] = {}

    def rounded(*arguments: Any) -> object:
        return [
            (
                view,
                {
                    name: values.astype(np.float16).astype(np.float32) if name.startswith("Beauty.Combined") else values
                    for name, values in channels.items()
                },
            )
            for view, channels in whole(*arguments)
        ]

    for folder in folders:
        full = measure_disparity_errors(folder, methods)
        with patch.object(exr, "_read_with_openexr", rounded):
            less = measure_disparity_errors(folder, methods)
        for label, (error, wrong) in full.items():
            other, missing = less[label]
            changes.setdefault(label, []).append((other - error, missing - wrong))
            print(f"{folder.name} {label:5} {error:.4f} -> {other:.4f} px, {wrong:.2%} -> {missing:.2%}", flush=True)
    for label, each in changes.items():
        mean, spread = np.mean(each, axis=0), np.std(each, axis=0, ddof=1) / len(each) ** 0.5
        print(f"{label}, {len(each)} pairs: {mean[0]:+.4f} ± {spread[0]:.4f} px, {mean[1]:+.3%} ± {spread[1]:.3%}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--pairs", type=int, default=10, help="pairs that are matched at most")


def main(options: argparse.Namespace) -> None:
    """Print the tables."""
    pairs = find_pair_folders(options.dataset)[: options.pairs]
    print_sizes(pairs[0])
    print_compact(pairs[0])
    print_errors(pairs, parse_methods("bm,sgbm,jplv"))
