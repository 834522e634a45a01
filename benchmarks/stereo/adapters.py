"""The cost of a user's matcher besides matching: a resident program, a program that is started for each pair, ONNX.

    python benchmarks adapters           # without torch
    python benchmarks adapters --torch   # also programs that load torch

One 640 x 480 pair in colour. The programs return a constant, so only the exchange is measured: images
written and read, disparity written, read and checked, and libraries loaded. The columns are milliseconds of waiting and
of processor, of all processes, per pair: the mean of 50 pairs after the first one (of five for programs that are
started for each pair), and the start with the first pair. Needs Linux. Compare the ratios. The ONNX network compares
windows at 16 disparities, so its row is what a small network takes; it needs onnx and ONNX Runtime.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import shlex
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.stereo.matchers import match, resident_process

RESIDENT = """
{library}
import numpy as np
from icymoon_serve import serve
serve(lambda left, right, camera: np.full(left.shape[:2], 5, np.float32))
"""
ONCE = """
{library}
import sys
import cv2
import numpy as np
left = cv2.imread(sys.argv[1])
np.save(sys.argv[3], np.full(left.shape[:2], 5, np.float32))
"""
ROW = "{:<36}{:>10}{:>10}{:>12}{:>12}"


def cpu_s() -> float:
    """CPU seconds of this process, of its ended children, and on Linux of resident programs."""
    times = os.times()
    running = 0.0
    for each in resident_process._running.values():
        fields = Path(f"/proc/{each._process.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
        running += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return times.user + times.system + times.children_user + times.children_system + running


def measure(method: str, options: dict[str, Any], pairs: int) -> tuple[float, float, float, float]:
    """Milliseconds per pair, elapsed and of the processor, then the same for the start with the first pair."""
    random = np.random.default_rng(0)
    right = random.integers(0, 256, (480, 640, 3)).astype(np.uint8)
    left = np.roll(right, 7, axis=1)
    taken = []
    for _ in range(pairs + 1):
        wall, cpu = time.perf_counter(), cpu_s()
        match(method, left, right, options)
        taken.append((1000 * (time.perf_counter() - wall), 1000 * (cpu_s() - cpu)))
    first, *others = taken
    return (*(statistics.mean(column) for column in zip(*others, strict=True)), *first)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--torch", action="store_true", help="also programs that load torch")


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    libraries = {"numpy": ""} | ({"torch": "import torch"} if options.torch else {})
    print(ROW.format("", "wall ms", "CPU ms", "first wall", "first CPU"))
    with tempfile.TemporaryDirectory() as folder:
        for library, line in libraries.items():
            for method, text, fields, pairs in (
                ("resident", RESIDENT, "", 50),
                ("external", ONCE, " {left} {right} {out}", 5),
            ):
                script = Path(folder, f"{method}_{library}.py")
                script.write_text(text.format(library=line), encoding="utf-8")
                command = shlex.join([sys.executable, str(script)]) + fields
                show(f"{method}, {library}", measure(method, {"command": command}, pairs))
                resident_process.stop_residents()
        if importlib.util.find_spec("onnx") and importlib.util.find_spec("onnxruntime"):
            import onnx_networks

            path = onnx_networks.write_network(Path(folder, "net.onnx"))
            show("onnx, a network of 16 steps", measure("onnx", {"model": str(path)}, 5))
    show("bm, for comparison", measure("bm", {}, 9))


def show(name: str, numbers: tuple[float, ...]) -> None:
    """Print a row."""
    print(ROW.format(name, *(f"{number:.1f}" for number in numbers)), flush=True)
