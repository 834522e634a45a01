"""icynet, a small network that `python -m icymoon.stereo train` trains on made pairs; see ``networks.icynet``.

It takes grey images of any size and searches the pair's own range.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...support.arrays import Array
from . import network_matchers
from .plug_in import MatchContext
from .result import LOGIT

if TYPE_CHECKING:
    from torch import nn

TITLE = "icynet"
NEEDS = "PyTorch and trained weights"
SET_UP = (6, "checkpoint", "icynet", "The network icynet with weights that you have trained")

OPTIONS = network_matchers.OPTIONS


def _build_network(most_px: int) -> nn.Module:
    from ..networks.icynet import IcyNet

    return IcyNet(most_px)


NETWORK = network_matchers.Network(
    "icynet",
    "weights.safetensors",
    "",
    _build_network,
    "train it (python -m icymoon.stereo train --out FOLDER) and copy weights.safetensors there",
    128,  # no weight depends on the search range, which ``match`` sets
    ".safetensors",
)


def check(options: Mapping[str, Any]) -> None:
    """Raise IcyMoonError unless it can run."""
    network_matchers.check(NETWORK, options)


def load(options: Mapping[str, Any]) -> None:
    """Read the weights once for all runs with the same options."""
    network_matchers.load(NETWORK, options)


#: What the third value that ``match`` returns states, see ``result``.
CONFIDENCE = LOGIT


def match(left: Array, right: Array, context: MatchContext) -> tuple[Array, dict[str, Any], Array]:
    """Disparity of uint8 grey (H, W) images, everywhere, facts on the network, and the logit of a confidence."""
    from torch.nn import functional as F  # noqa: N812, its usual name

    from ..networks.icynet import MULTIPLE

    model, facts = network_matchers.load(NETWORK, context.options)
    device = next(model.parameters()).device
    height, width = left.shape
    # The network searches from 0 on, so the right image moves by the least disparity.
    place = np.clip(np.arange(width) - context.least_px, 0, width - 1)
    model.range_px = context.most_px - context.least_px + 1
    with network_matchers.guard_inference("icynet"):
        eyes = (
            F.pad(
                network_matchers.to_batch(image[..., None] / 255.0, device),
                (0, -width % MULTIPLE, 0, -height % MULTIPLE),
                mode="replicate",
            )
            for image in (left, right[:, place])
        )
        disparity, logit = (each[0, :height, :width].cpu().numpy() for each in model(*eyes))
        return disparity + np.float32(context.least_px), facts, logit
