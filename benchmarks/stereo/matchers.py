"""The cost and accuracy of every matcher, compared with OpenCV's StereoBM with the GUISS paper's parameters.

    python benchmarks matchers               # matchers without torch
    python benchmarks matchers --networks    # also the networks, with random parameters; takes minutes

One synthetic 640 x 480 pair with noise. Each matcher runs in a separate process on one thread. The columns are the CPU
seconds of the fastest of three matches (of one for a network), and the peak memory in addition to images and libraries.
Compare the ratios. Errors are over the measured pixels. Locking is the spread, px, of the mean error over sixteen
classes of the fraction of the true disparity; it is large for a matcher that prefers whole pixels. Memory needs Linux.
With a CUDA device the networks also run there, and their results are compared with the processor's.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import pairs
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.own_process import call
from icymoon.benchmarks.common.processor import resident_mib
from icymoon.stereo.matchers import match
from icymoon.support.arrays import Array

REFERENCE = "bm:preset=guiss"
CLASSICAL = (
    REFERENCE,
    "bm",
    "sgbm:mode=3way",
    "sgbm:mode=sgbm",
    "sgbm:mode=hh",
    "sgbm_wls",
    "sgbm_wls:mode=3way",
    "jplv",
    "jplv:pyramid_level=1",
    "jplv:subpixel=affine",
)
NETWORKS = (
    "igev:iterations=8",
    "igev:iterations=16",
    "igev:iterations=32",
    "igev:iterations=8:precision=bfloat16",
    "dsmnet",
)
ROW = "{:<40}{:>9}{:>8}{:>9}{:>8}{:>10}{:>9}{:>8}{:>9}"


def pair() -> tuple[Array, Array, Array]:
    """Left, right and true disparity of a tilted plane with a cuboid in front of it, noise of 2 levels per eye."""
    scene, rig = pairs.Scene(contrast=0.4), pairs.camera(640, 480)
    random = np.random.default_rng(0)
    (depth, left, _), (_, right, _) = pairs.view(scene, rig, "left"), pairs.view(scene, rig, "right")
    eyes = [
        np.rint(light / (2 * scene.radiance) * 255 + random.normal(0, 2, light.shape)).clip(0, 255).astype(np.uint8)
        for light in (left, right)
    ]
    return eyes[0], eyes[1], rig.disparity(depth)


def measured(images: str, label: str, options: dict[str, str], runs: int) -> dict[str, Any]:
    """One matcher in this process."""
    with np.load(images) as stored:
        left, right, truth = (stored[name] for name in ("left", "right", "truth"))
    small = left[:64, :128], right[:64, :128]
    method = label.partition(":")[0]
    match(method, *small, options | ({"window": "5"} if method == "bm" else {}))  # loads libraries and parameters
    Path("/proc/self/clear_refs").write_text("5")  # forget the largest memory so far
    before = resident_mib()
    results = [match(method, left, right, options) for _ in range(runs)]
    memory = resident_mib("VmHWM") - before
    disparity, valid, info = min(results, key=lambda result: result[2]["seconds"])
    error = (disparity - truth)[valid]
    good = np.abs(error) < 1
    classes = np.floor(truth[valid][good] % 1 * 16).astype(int)
    means = np.bincount(classes, error[good], 16) / np.maximum(np.bincount(classes, minlength=16), 1)
    return {
        "seconds": info["seconds"],
        "memory_mb": memory,
        "coverage": float(valid.mean()),
        "epe": float(np.abs(error).mean()),
        "bad_1": float(1 - good.mean()),
        "locking": float(np.std(means)),
    }


def table(labels: tuple[str, ...], folder: Path) -> None:
    """Measure and print one line each."""
    left, right, truth = pair()
    np.savez(folder / "images.npz", left=left, right=right, truth=truth)
    print(ROW.format("", "CPU s", "ratio", "MB", "ratio", "coverage", "EPE px", "bad-1", "locking"))
    reference: dict[str, Any] = {}
    for label in labels:
        method, *given = label.split(":")
        options = dict(option.split("=") for option in given)
        if network := label in NETWORKS:
            options |= {"checkpoint": str(folder / f"{method}.pth"), "device": "cpu"}
        found = call(measured, str(folder / "images.npz"), label, options, 1 if network else 3)
        reference = reference or found
        # The errors of a network with random parameters mean nothing.
        errors = (
            ["–"] * 4
            if network
            else [
                f"{100 * found['coverage']:.1f} %",
                f"{found['epe']:.3f}",
                f"{100 * found['bad_1']:.2f} %",
                f"{found['locking']:.4f}",
            ]
        )
        print(
            ROW.format(
                label,
                f"{found['seconds']:.3f}",
                f"{found['seconds'] / reference['seconds']:.1f}",
                f"{found['memory_mb']:.0f}",
                f"{found['memory_mb'] / reference['memory_mb']:.1f}",
                *errors,
            ),
            flush=True,
        )


def write_random_checkpoints(folder: Path) -> None:
    """Checkpoints with the random parameters of a new network."""
    import torch
    from icymoon.stereo.networks.dsmnet import DSMNet
    from icymoon.stereo.networks.igev import IGEVStereo

    torch.manual_seed(0)
    for name, network in (("igev", IGEVStereo()), ("dsmnet", DSMNet())):
        torch.save(network.state_dict(), folder / f"{name}.pth")


def measure_on_cuda(folder: Path) -> None:
    """Seconds per pair on the device, and the difference from the processor's result."""
    left, right, _ = pair()
    for method, more in (
        ("igev", {"iterations": 8}),
        ("igev", {"iterations": 8, "precision": "bfloat16"}),
        ("dsmnet", {}),
    ):
        options = more | {"checkpoint": str(folder / f"{method}.pth")}
        match(method, left, right, options | {"device": "cuda"})
        start = time.perf_counter()
        there, valid, info = match(method, left, right, options | {"device": "cuda"})
        seconds = time.perf_counter() - start
        here, valid_here, _ = match(
            method,
            left,
            right,
            options | {"device": "cpu", "precision": "float32"} if method == "igev" else options | {"device": "cpu"},
        )
        difference = np.abs(there - here)[valid & valid_here]
        print(
            f"{method} {more} on {info['facts']['device']}: {seconds:.3f} s a pair, differs from the processor by "
            f"{np.median(difference):.2g} px in the median, {difference.max():.2g} px at most"
        )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--networks", action="store_true", help="also the networks, with random parameters")


def main(options: argparse.Namespace) -> None:
    """Measure and print."""
    with scratch() as folder:
        if not options.networks:
            table(CLASSICAL, folder)
            return
        import torch

        write_random_checkpoints(folder)
        table((REFERENCE, *NETWORKS), folder)
        if torch.cuda.is_available():
            measure_on_cuda(folder)
