"""What the official networks gave for parameters and images that a rule makes: ``network_golden.npz``.

The networks were run in double precision by their authors' own code (gangweiX/IGEV e61a675, feihuzhang/DSMNet
6a2888e). Per case the file has its description as JSON, ``samples`` of the disparity, spread evenly over its pixels in
C order, and ``sum``, a sum over all pixels with weights that depend on their place.
"""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from icymoon.support.arrays import Array

#: Gains of the weights by the longest fitting start of the name: without them some stage would not matter.
_GAINS = {
    "igev": {"": 1.0, "feature.": 1.2, "desc.": 0.5, "corr_stem.": 4.0, "cost_agg.": 2.0, "classifier.": 3.0},
    "dsmnet": {"": 1.0, "cost_agg.": 1.4, "cost_agg.disp2.": 3.0},
}


def cases() -> dict[str, dict[str, Any]]:
    """name -> description with ``samples`` and ``sum``."""
    with np.load(Path(__file__).with_suffix(".npz")) as stored:
        return {
            name: json.loads(str(stored[name]))
            | {"samples": stored[f"{name}.samples"], "sum": float(stored[f"{name}.sum"])}
            for name in stored.files
            if "." not in name
        }


def sampled(disparity: Array, count: int) -> Array:
    """Pixels spread evenly in C order."""
    return disparity.ravel()[np.arange(count) * disparity.size // count]


def weighted_mean(disparity: Array) -> float:
    """Mean over all pixels with weights between -1 and 1 that depend on their place."""
    place = np.arange(disparity.size, dtype=np.uint64)
    weights = (place * 2654435761 % 2**32).astype(np.float64) / 2.0**31 - 1
    return float(np.mean(disparity.ravel().astype(np.float64) * weights))


def parameters(network: str, shapes: dict[str, tuple[int, ...]]) -> dict[str, Array]:
    """Every parameter drawn from a generator seeded with its name, float32."""
    # Two names of one tensor have one value.
    return {
        name: _parameter(network, name.replace(".downsample.1.", ".norm3."), shape) for name, shape in shapes.items()
    }


def checksum(state: dict[str, Array]) -> int:
    """CRC-32 over names and values in the order of the names."""
    total = 0
    for name in sorted(state):
        total = zlib.crc32(name.encode(), total)
        total = zlib.crc32(np.ascontiguousarray(state[name]).tobytes(), total)
    return total


def _parameter(network: str, name: str, shape: tuple[int, ...]) -> Array:
    random = np.random.default_rng(zlib.crc32(name.encode()))
    if name.endswith("num_batches_tracked"):
        return np.array(1, np.int64)
    if name.endswith("running_var"):
        values = random.uniform(0.5, 1.5, shape)
    elif name.endswith((".bias", "running_mean")):
        values = 0.05 * random.standard_normal(shape)
    elif len(shape) == 1:
        values = random.uniform(0.5, 1.5, shape) * (0.25 if ".getweights.0.bn." in name else 1)
    else:
        gains = _GAINS[network]
        gain = gains[max((start for start in gains if name.startswith(start)), key=len)]
        values = random.standard_normal(shape) * (gain / np.sqrt(np.prod(shape[1:])))
    return np.ascontiguousarray(values.astype(np.float32))


def images(spec: dict[str, Any]) -> tuple[Array, Array]:
    """Left and right, uint8 RGB (H, W, 3): texture shifted by a ramp of whole disparities, with boxes, and noise."""
    height, width = spec["height"], spec["width"]
    ramp = spec["d0"] + (spec["d1"] - spec["d0"]) * np.arange(height) // max(height - 1, 1)
    disparity = np.repeat(ramp[:, None], width, axis=1)
    for top, bottom, left, right, value in spec["boxes"]:
        disparity[top:bottom, left:right] = value
    texture = _texture(spec["seed"], height, width + int(disparity.max()) + 1, spec["weights"])
    row, column = np.indices((height, width))
    eyes = []
    for eye, image in enumerate((texture[:, :width], texture[row, column + disparity])):
        span = 2 * spec["noise"] + 1
        noise = [_lattice(spec["seed"] + 1000 + eye, 9, band, row, column) % span - spec["noise"] for band in range(3)]
        eyes.append(np.clip(image.astype(int) + np.stack(noise, axis=-1), 0, 255).astype(np.uint8))
    return eyes[0], eyes[1]


def _texture(seed: int, height: int, width: int, weights: list[int]) -> Array:
    def octaves(channel: int) -> Array:
        return np.sum(
            [weight * _value_noise(seed, octave, channel, height, width) for octave, weight in enumerate(weights)],
            axis=0,
        )

    common = octaves(3)
    return np.clip(np.stack([(3 * common + octaves(band)) >> 10 for band in range(3)], axis=-1), 0, 255)


def _value_noise(seed: int, octave: int, channel: int, height: int, width: int) -> Array:
    """Bilinear between random values 2^octave px apart, in whole numbers."""
    row, column = np.indices((height, width))
    side = 1 << octave
    down, across = row % side, column % side
    row, column = row >> octave, column >> octave
    corners = [
        (side - down, side - across, 0, 0),
        (side - down, across, 0, 1),
        (down, side - across, 1, 0),
        (down, across, 1, 1),
    ]
    return sum(a * b * _lattice(seed, octave, channel, row + r, column + c) for a, b, r, c in corners) >> 2 * octave


def _lattice(seed: int, octave: int, channel: int, row: Array, column: Array) -> Array:
    """0 to 255 for every whole place."""
    mixed = _mixed(np.full(row.shape, (seed * 7919 + octave * 104729 + channel * 1299709 + 1) % 2**32, np.uint64))
    mixed = _mixed(mixed ^ (row.astype(np.uint64) * 40503 + 17))
    return (_mixed(mixed ^ (column.astype(np.uint64) * 60493 + 29)) >> 24).astype(np.int64)


def _mixed(values: Array) -> Array:
    """A hash of 32 bits."""
    values = values % 2**32
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        values = (values ^ values >> shift) * factor % 2**32
    return values ^ values >> 16
