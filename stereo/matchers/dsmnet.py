"""DSMNet (Zhang et al., ECCV 2020), one of the two networks of the GUISS paper; see ``networks.dsmnet``.

It normalises by the statistics of its input, so the result depends on the crop. The paper used the middle 384 x 640 px
(preset ``guiss``); by default the network gets the whole image. There is no half precision, because its rounding grows
to errors of several pixels in the sums over all disparities.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...support.arrays import Array
from . import network_matchers
from .plug_in import MatchContext

if TYPE_CHECKING:
    from torch import Tensor, nn

TITLE = "DSMNet"
NEEDS = "PyTorch and a checkpoint"
SET_UP = (5, "checkpoint", "DSMNet", "The network DSMNet with your own checkpoint")
COLOUR = True
SEARCHES = False

_CROP = {"default": 0, "minimum": 0, "maximum": 65536, "step": 64}
OPTIONS = network_matchers.OPTIONS | {
    "max_disparity": {"default": 192, "minimum": 16, "maximum": 1024, "step": 16, "doc": "Largest disparity, px"},
    "crop_height": {**_CROP, "doc": "Rows used, from the middle; 0 for all"},
    "crop_width": {**_CROP, "doc": "Columns used, from the middle; 0 for all"},
}

#: Least standard deviation of an image that is scaled to standard deviation 1 in training.
_MIN_DEVIATION = 1e-3

PRESETS = {"guiss": {"crop_height": 384, "crop_width": 640}}


def _build_network(max_disparity: int) -> nn.Module:
    from ..networks.dsmnet import DSMNet

    return DSMNet(max_disparity)


NETWORK = network_matchers.Network(
    "dsmnet",
    "the model trained on mixed data (mixed_epoch_6.pth)",
    "https://github.com/feihuzhang/DSMNet",
    _build_network,
)


def apply_in_training(network: nn.Module, left: Tensor, right: Tensor) -> Tensor:
    """Compute the disparities (N, H, W), px, of grey images (N, 1, H, W) from 0 to 1, with gradients."""
    return network(*(_standardise(image).expand(-1, 3, -1, -1) for image in (left, right)))


def _standardise(image: Tensor) -> Tensor:
    """Scale each image to mean 0 and standard deviation 1; a constant image becomes 0."""
    mean, spread = image.mean((1, 2, 3), keepdim=True), image.std((1, 2, 3), keepdim=True)
    return (image - mean) / spread.clamp(min=_MIN_DEVIATION)


def check(options: Mapping[str, Any]) -> None:
    """Raise IcyMoonError unless the network can run."""
    network_matchers.check(NETWORK, options)


def load(options: Mapping[str, Any]) -> None:
    """Read the checkpoint once for all runs with the same options."""
    network_matchers.load(NETWORK, options)


def match(left: Array, right: Array, context: MatchContext) -> tuple[Array, dict[str, Any]]:
    """Compute the disparity of uint8 RGB (H, W, 3) images, NaN outside the crop; also return facts on the network."""
    options = context.options
    model, facts = network_matchers.load(NETWORK, options)
    device = next(model.parameters()).device
    (top, height), (near, width) = (
        _crop_span(size, options[f"crop_{side}"]) for size, side in zip(left.shape, ("height", "width"), strict=False)
    )
    with network_matchers.guard_inference("dsmnet"):
        eyes = (
            network_matchers.to_batch(_crop_or_pad(_normalise(image), top, height, near, width), device)
            for image in (left, right)
        )
        seen = model(*eyes)[0].cpu().numpy()
    disparity = np.full(left.shape[:2], np.nan, np.float32)
    disparity[max(top, 0) : top + height, max(near, 0) : near + width] = seen[max(-top, 0) :, max(-near, 0) :]
    return disparity, facts


def _crop_span(size: int, crop: int) -> tuple[int, int]:
    """Return (first, count) of the middle rows or columns that are used; ``first`` is negative if the image has too
    few.
    """
    from ..networks.dsmnet import SIZE_STEP

    # At least two steps: with one, the coarsest features would be a single pixel, which has no variance.
    count = crop or max(-(-size // SIZE_STEP), 2) * SIZE_STEP
    return ((size - count) // 2 if size > count else size - count), count


def _normalise(image: Array) -> Array:
    """Scale every channel to mean 0 and variance 1 over the whole image; a constant channel becomes 0."""
    spread = image.std(axis=(0, 1))
    return (image - image.mean(axis=(0, 1))) / np.where(spread > 0, spread, 1)


def _crop_or_pad(image: Array, top: int, height: int, near: int, width: int) -> Array:
    frame = np.zeros((height, width, 3), np.float32)
    part = image[max(top, 0) : top + height, max(near, 0) : near + width]
    frame[max(-top, 0) :, max(-near, 0) :] = part
    return frame
