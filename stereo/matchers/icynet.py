"""icynet, a small network whose weights come with Icy Moon, trained on pairs made by rays; see ``networks.icynet``.

It takes grey images of any size and searches the pair's own range. It runs in PyTorch, or else in ONNX Runtime; both
give the same numbers to 1e-4 px. Your own weights, from `python -m icymoon.stereo train`, are a safetensors file for
PyTorch, or an ONNX file for ONNX Runtime.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..networks.icynet_file import INPUTS, MULTIPLE, OUTPUTS, count_levels
from . import network_matchers, onnx
from .plug_in import MatchContext
from .result import LOGIT

if TYPE_CHECKING:
    import onnxruntime
    from torch import nn

TITLE = "icynet"
NEEDS = "PyTorch or ONNX Runtime"
SET_UP = (6, "checkpoint", "icynet", "The network icynet with weights that you have trained")

OPTIONS = {
    **network_matchers.OPTIONS,
    "checkpoint": {"default": "", "doc": "File with weights that you have trained; by default those of Icy Moon"},
}

#: Weights that come with Icy Moon, from one training, for PyTorch and for ONNX Runtime.
SHIPPED = {kind: Path(__file__).parents[1] / "networks" / f"icynet_weights.{kind}" for kind in ("safetensors", "onnx")}

#: Seconds that its ONNX file may take for a small image, as any network's by default, because a file may loop forever.
_TIMEOUT_S = 60.0


def _build_network(most_px: int) -> nn.Module:
    from ..networks.icynet import IcyNet

    return IcyNet(most_px)


NETWORK = network_matchers.Network(
    "icynet",
    "weights.safetensors",
    "",
    _build_network,
    "train it (python -m icymoon.stereo train --out FOLDER) and name its weights.safetensors",
    128,  # no weight depends on the search range, which ``match`` sets
)


def check(options: Mapping[str, Any]) -> None:
    """Raise IcyMoonError unless the network can run."""
    options = _name_weights(options)
    if not _is_onnx(options):
        network_matchers.check(NETWORK, options)
        return
    onnx.require_runtime("icynet")
    path = network_matchers.find_checkpoint(NETWORK, options)
    if not path.is_file():
        raise IcyMoonError(f"icynet.checkpoint names {path}, which is not a file; correct it.")


def load(options: Mapping[str, Any]) -> None:
    """Read the weights once for all runs with the same options."""
    options = _name_weights(options)
    _load_session(options) if _is_onnx(options) else network_matchers.load(NETWORK, options)


def _name_weights(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the options, with the shipped weights for the installed library unless they name a file."""
    if options["checkpoint"]:
        return options
    has_torch = all(importlib.util.find_spec(name) for name in ("torch", "safetensors"))
    return {**options, "checkpoint": str(SHIPPED["safetensors" if has_torch else "onnx"])}


#: The kind of the third value that ``match`` returns, see ``result``.
CONFIDENCE = LOGIT


def match(left: Array, right: Array, context: MatchContext) -> tuple[Array, dict[str, Any], Array]:
    """Compute the disparity of uint8 grey (H, W) images, everywhere; also return facts on the network, and the logit of
    a confidence.
    """
    height, width = left.shape
    # The network searches from 0 on, so the right image moves by the least disparity.
    place = np.clip(np.arange(width) - context.least_px, 0, width - 1)
    margins = (0, -height % MULTIPLE), (0, -width % MULTIPLE)
    eyes = [np.pad(image / np.float32(255), margins, mode="edge")[None, None] for image in (left, right[:, place])]
    options = _name_weights(context.options)
    run = _run_onnx if _is_onnx(options) else _run_torch
    found, facts = run(options, eyes, context.most_px - context.least_px + 1)
    disparity, logit = (each[0, :height, :width] for each in found)
    return disparity + np.float32(context.least_px), facts, logit


def _run_torch(options: Mapping[str, Any], eyes: list[Array], range_px: int) -> tuple[list[Array], dict[str, Any]]:
    import torch

    model, facts = network_matchers.load(NETWORK, options)
    model.range_px = range_px
    device = next(model.parameters()).device
    with network_matchers.guard_inference("icynet"):
        return [each.cpu().numpy() for each in model(*(torch.from_numpy(eye).to(device) for eye in eyes))], facts


def _is_onnx(options: Mapping[str, Any]) -> bool:
    return network_matchers.find_checkpoint(NETWORK, options).suffix == ".onnx"


def _run_onnx(options: Mapping[str, Any], eyes: list[Array], range_px: int) -> tuple[list[Array], dict[str, Any]]:
    session, facts = _load_session(options)
    given = dict(zip(INPUTS, [*eyes, np.arange(count_levels(range_px))], strict=True))
    most_s = onnx.find_most_s(_TIMEOUT_S, eyes[0].size)
    try:
        return onnx.run_bounded(session, given, most_s), facts
    except TimeoutError:
        raise IcyMoonError(
            f"icynet was stopped after {most_s:.0f} s; give weights.onnx of `icymoon.stereo train`, or smaller images."
        ) from None
    except Exception as error:  # its errors have no common base
        raise IcyMoonError(f"icynet failed in ONNX Runtime ({onnx.find_first_line(error)}).") from None


def _load_session(options: Mapping[str, Any]) -> tuple[onnxruntime.InferenceSession, dict[str, Any]]:
    path = network_matchers.find_checkpoint(NETWORK, options)
    check(options)
    state = path.stat()
    return _open_session(path, (state.st_mtime_ns, state.st_size), options["device"], options["threads"])


@lru_cache(maxsize=2)
def _open_session(
    path: Path, changed: tuple[int, int], device: str, threads: int
) -> tuple[onnxruntime.InferenceSession, dict[str, Any]]:
    """Open a session; return it and its facts. ``changed`` identifies the version of the file."""
    session, facts = onnx.open_session("icynet", path, device, threads)
    names = (tuple(each.name for each in declared) for declared in (session.get_inputs(), session.get_outputs()))
    if tuple(names) != (INPUTS, OUTPUTS):
        raise IcyMoonError(f"{path} is not icynet's network; give weights.onnx of `icymoon.stereo train`.")
    return session, facts
