"""Exports icynet as an ONNX file, for images and search ranges of any size, by ONNX Runtime without PyTorch."""

from __future__ import annotations

import importlib.util
import io
import warnings

import torch
from torch import Tensor, nn

from ...support.errors import IcyMoonError
from ..networks.icynet import IcyNet
from ..networks.icynet_file import INPUTS, MULTIPLE, OUTPUTS

_OPSET = 18


class _AtLevels(nn.Module):
    """The network with its levels of disparity as an input."""

    def __init__(self, network: IcyNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, left: Tensor, right: Tensor, levels: Tensor) -> tuple[Tensor, Tensor]:
        return self.network.forward_at_levels(left, right, levels)


def export_onnx(network: IcyNet) -> bytes:
    """Return the bytes of an ONNX file of the network in use: its batch normalisation is a part of its convolutions.

    Raises IcyMoonError without the package onnx.
    """
    if importlib.util.find_spec("onnx") is None:
        raise IcyMoonError('The export needs the package onnx; run: pip install "icymoon[networks]".')
    was_training = network.training
    free = {"left": {2: "height", 3: "width"}, "right": {2: "height", 3: "width"}, "levels": {0: "levels"}}
    example = torch.zeros(1, 1, 2 * MULTIPLE, 4 * MULTIPLE)
    stream = io.BytesIO()
    network.eval()
    try:
        with warnings.catch_warnings():
            # The other exporter needs one more package and minutes; the tracer warns of sizes that it leaves free.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                _AtLevels(network).eval(),
                (example, example, torch.arange(MULTIPLE // 2)),
                stream,
                input_names=INPUTS,
                output_names=OUTPUTS,
                dynamic_axes=free,
                opset_version=_OPSET,
                dynamo=False,
            )
    finally:
        network.train(was_training)
    return stream.getvalue()
