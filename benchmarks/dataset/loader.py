"""Processor time of a training sample, whole and cropped, compared with decoding the same sample from 16-bit PNG files.

    python -m icymoon.stereo export DATASET --format webdataset --out SHARDS
    python benchmarks loader DATASET [--shards SHARDS] [--crop 320 240] [--set sensor.psf_sigma_px=0.5]

One process, ratios within one run: develop the pairs of a data set on the fly, or decode left, right and disparity of
the whole image, which is what a loader of plain files does for a crop too. A sample of the shards is read with all that
it contains.
"""

from __future__ import annotations

import argparse
import json
import tarfile
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from icymoon.benchmarks.common.processor import Stopwatch
from icymoon.settings.description import merged, override
from icymoon.stereo.torch_data import Dataset


def seconds_of(step: Callable[[int], object], count: int) -> float:
    """Processor seconds of a step, without its first call."""
    step(0)
    watch = Stopwatch()
    for k in range(count):
        step(k)
    return watch.lap() / count


def read_shards(folder: Path) -> Callable[[int], object]:
    """A function that reads the next sample of a webdataset repeatedly."""

    def samples() -> Iterator[dict[str, Any]]:
        for file in sorted(folder.glob("*.tar")):
            with tarfile.open(file) as shard:
                sample: dict[str, Any] = {}
                for member in shard:
                    key, name = member.name.split(".", 1)
                    if key != sample.get("key", key):
                        yield sample
                        sample = {}
                    content = shard.extractfile(member)
                    assert content is not None
                    sample |= {"key": key, name: content.read()}
                yield sample

    each = cycle(samples())

    def step(_: int) -> object:
        sample = next(each)
        return [
            json.loads(data)
            if name.endswith(".json")
            else cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            for name, data in sample.items()
            if name != "key"
        ]

    return step


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset")
    parser.add_argument("--shards", type=Path, help="the data set, exported as webdataset")
    parser.add_argument("--crop", type=int, nargs=2, default=(320, 240))
    parser.add_argument("--set", action="append", default=[], help="a setting of the sensor")
    parser.add_argument("--count", type=int, default=20)


def main(options: argparse.Namespace) -> None:
    """Print a row for each way."""
    response = merged(*(override(text) for text in options.set))
    whole, crops = Dataset(options.dataset), Dataset(options.dataset, crop_px=tuple(options.crop))
    for data in (whole, crops):
        data._response = response
    sample = whole.arrays(0)
    files = [
        cv2.imencode(".png", np.rint(65535 * np.moveaxis(sample[eye], 0, -1)).astype(np.uint16))[1]
        for eye in ("left", "right")
    ]
    files.append(cv2.imencode(".png", np.rint(256 * sample["disparity_px"]).astype(np.uint16))[1])

    def cropped(k: int) -> object:
        crops.set_epoch(k)
        return crops.arrays(k % len(crops))

    ways: dict[str, Callable[[int], object]] = {
        "16-bit PNG, decoded": lambda k: [cv2.imdecode(file, cv2.IMREAD_UNCHANGED) for file in files],
        "whole sample": lambda k: whole.arrays(k % len(whole)),
        "crop": cropped,
    }
    if options.shards:
        ways["of a shard"] = read_shards(options.shards)
    took = {name: seconds_of(step, options.count) for name, step in ways.items()}
    for name, seconds in took.items():
        print(f"{name:22}{1000 * seconds:8.1f} ms{seconds / took['16-bit PNG, decoded']:8.1f}")
