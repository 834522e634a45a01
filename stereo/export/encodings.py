"""Encodings that other data sets use: PFM, KITTI's disparities, COCO's masks."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from ...support.arrays import Array
from ...support.files import write_bytes
from .losses import Loss

#: KITTI and others store 256 times the disparity as 16-bit PNG; 0 means unknown.
KITTI_STEPS_PER_PX = 256.0
MM_PER_M = 1000.0
_MAX_STEPS = 65535
#: Steps per px of KITTI's flow, and the value for unknown flow. Middlebury's readers take all above 1e9 as unknown.
_FLOW_STEPS_PER_PX, _NO_FLOW = 64.0, 1e10


def write_pfm(path: Path, values: Array) -> None:
    """Write (H, W) or (H, W, 3; R, G, B) as a portable float map: float32, bottom row first, little-endian.

    A value that is not finite is written as infinity, which means unknown in Middlebury's files.
    """
    single = np.where(np.isfinite(values), values, np.inf).astype("<f4")
    kind = "PF" if single.ndim == 3 else "Pf"
    header = f"{kind}\n{single.shape[1]} {single.shape[0]}\n-1.0\n".encode("ascii")
    write_bytes(path, header + np.ascontiguousarray(single[::-1]).tobytes())


def quantise_to_16_bits(values: Array, scale: float, what: str, unit: str) -> tuple[Array, list[Loss]]:
    """Return ``values`` (H, W) times ``scale`` as uint16, 0 where undefined, and the loss.

    Values outside of 1 / scale to 65535 / scale are lost.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.rint(values * scale)
        fits = (steps >= 1) & (steps <= _MAX_STEPS)  # False for NaN
    known = np.isfinite(values)
    lost = int((known & ~fits).sum())
    why = (
        f"outside of {1 / scale:.3g} to {_MAX_STEPS / scale:.6g} {unit}, all that 16 bits hold at {scale:g} steps "
        f"per {unit}"
    )
    return np.where(fits, steps, 0).astype(np.uint16), [Loss(what, lost / int(known.sum()), why)] if lost else []


def encode_flo(flow_px: Array) -> bytes:
    """Encode a flow (H, W, 2) as Middlebury's .flo file: columns to the right and rows down; NaN is unknown."""
    head = struct.pack("<4sii", b"PIEH", flow_px.shape[1], flow_px.shape[0])
    return head + np.nan_to_num(flow_px, nan=_NO_FLOW).astype("<f4").tobytes()


def quantise_flow(flow_px: Array) -> tuple[Array, list[Loss]]:
    """Quantise a flow (H, W, 2), px, to KITTI's uint16 (H, W, 3), and return it with the loss: flow beyond 512 px.

    The order is B, G, R: known, rows, columns. A flow has 64 steps per px, from -512 px on.
    """
    with np.errstate(invalid="ignore"):
        steps = np.rint(flow_px * _FLOW_STEPS_PER_PX) + 32768
        fits = ((steps >= 0) & (steps <= _MAX_STEPS)).all(axis=-1)  # False for NaN
    known = np.isfinite(flow_px).all(axis=-1)
    lost = int((known & ~fits).sum())
    whole = np.concatenate([np.ones((*fits.shape, 1)), steps[..., ::-1]], axis=-1)
    why = f"beyond 512 px, all that 16 bits hold at {_FLOW_STEPS_PER_PX:g} steps per px"
    return np.where(fits[..., None], whole, 0).astype(np.uint16), (
        [Loss("flow", lost / int(known.sum()), why)] if lost else []
    )


def encode_run_lengths(pixels: Array, count: int) -> list[int]:
    """Encode a mask by COCO's uncompressed run lengths: alternating runs of zeros and ones, column by column.

    ``pixels`` are the ascending indices of the mask's pixels, in the same order, in an image of ``count`` pixels.
    """
    breaks = np.flatnonzero(np.diff(pixels) != 1)
    first = pixels[np.concatenate([[0], breaks + 1])]
    end = pixels[np.concatenate([breaks, [len(pixels) - 1]])] + 1
    edges = np.stack([first, end], axis=1).ravel()
    runs = np.diff(edges, prepend=0).tolist()
    return [*runs, count - int(end[-1])] if end[-1] < count else runs
