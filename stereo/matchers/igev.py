"""IGEV-Stereo (Xu, Wang, Ding, Yang, CVPR 2023), one of the two networks of the GUISS paper; see ``networks.igev``.

The paper ran it with 256 disparities and 256 iterations (preset ``guiss``); its authors train with 22 iterations and
test with 32. An iteration takes a sixth of the time that the rest of the network takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from . import network_matchers
from .plug_in import MatchContext

if TYPE_CHECKING:
    from torch import Tensor, nn

TITLE = "IGEV-Stereo"
NEEDS = "PyTorch and a checkpoint"
SET_UP = (4, "checkpoint", "IGEV", "The network IGEV-Stereo with your own checkpoint")
COLOUR = True
SEARCHES = False

OPTIONS = network_matchers.OPTIONS | {
    "iterations": {
        "default": 32,
        "minimum": 1,
        "maximum": 1024,
        "doc": "Number of refinements; 8 and 16 are faster and less accurate",
    },
    "max_disparity": {
        "default": 192,
        "minimum": 32,
        "maximum": 1024,
        "step": 32,
        "doc": "Largest disparity of the cost volume, px; refinement can go beyond",
    },
    "precision": {
        "default": "float32",
        "choices": ("float32", "bfloat16"),
        "doc": "Precision of features and costs; bfloat16 is faster if the processor has it, and "
        "changes disparities by a tenth of a pixel or more; float16 overflows in this network",
    },
}

#: Iterations in training; its authors take 22.
_TRAINING_ITERATIONS = 12

PRESETS = {"guiss": {"iterations": 256, "max_disparity": 256}}


def _build_network(max_disparity: int) -> nn.Module:
    from ..networks.igev import IGEVStereo

    return IGEVStereo(max_disparity)


NETWORK = network_matchers.Network("igev", "sceneflow.pth", "https://github.com/gangweiX/IGEV", _build_network)


def apply_in_training(network: nn.Module, left: Tensor, right: Tensor) -> Tensor:
    """Compute the disparities (N, H, W), px, of grey images (N, 1, H, W) from 0 to 1, with gradients."""
    eyes = (255.0 * image.expand(-1, 3, -1, -1) for image in (left, right))
    return network(*eyes, _TRAINING_ITERATIONS)[:, 0]


def check(options: Mapping[str, Any]) -> None:
    """Raise IcyMoonError unless the network can run."""
    network_matchers.check(NETWORK, options)


def load(options: Mapping[str, Any]) -> None:
    """Read the checkpoint once for all runs with the same options."""
    network_matchers.load(NETWORK, options)


def match(left: Array, right: Array, context: MatchContext) -> tuple[Array, dict[str, Any]]:
    """Compute the disparity of uint8 RGB (H, W, 3) images, everywhere; also return facts on the network."""
    import torch
    from torch.nn import functional as F  # noqa: N812, its usual name

    from ..networks.igev import SIZE_STEP

    options = context.options
    model, facts = network_matchers.load(NETWORK, options)
    device = next(model.parameters()).device
    half_precision = options["precision"] == "bfloat16"
    if half_precision and device.type == "cuda" and not torch.cuda.is_bf16_supported():
        raise IcyMoonError("This CUDA device has no bfloat16; use igev.precision=float32.")
    height, width = left.shape[:2]
    down, across = -height % SIZE_STEP, -width % SIZE_STEP
    top, near = down // 2, across // 2
    with network_matchers.guard_inference("igev"), torch.autocast(device.type, torch.bfloat16, enabled=half_precision):
        eyes = (
            F.pad(network_matchers.to_batch(image, device), (near, across - near, top, down - top), mode="replicate")
            for image in (left, right)
        )
        disparity = model(*eyes, options["iterations"])[0, 0, top : top + height, near : near + width]
        return disparity.float().cpu().numpy(), facts
