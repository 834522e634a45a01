"""Networks that can be trained: icynet, IGEV, DSMNet, and a user's own.

A user's own network is a function ``make(range_px)`` that returns a ``torch.nn.Module``. The module takes the left and
the right image, float32 (N, 1, H, W) from 0 to 1, and returns the disparity of the left image in px, (N, H, W), or a
tuple of the disparity and the logit of a confidence, (N, H, W).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor, nn

from ...support.errors import IcyMoonError
from ..matchers import load_matcher
from ..networks.icynet import IcyNet


@dataclass(frozen=True)
class Found:
    """The result of a network for a batch.

    It has disparities (N, H, W) in px and, if the network gives them, logits of the confidence (N, H, W) and costs (N,
    D, H/4, W/4) of levels of 4 px.
    """

    disparity: Tensor
    logit: Tensor | None = None
    costs: Tensor | None = None


@dataclass(frozen=True)
class Trainable:
    """A network by its ``name``.

    ``make(range_px)`` makes a network with new weights. ``run(network, left, right, range_px)`` applies it to grey
    images (N, 1, H, W) from 0 to 1.
    """

    name: str
    make: Callable[[int], nn.Module]
    run: Callable[[nn.Module, Tensor, Tensor, int], Found]


def _run_icynet(network: nn.Module, left: Tensor, right: Tensor, range_px: int) -> Found:
    assert isinstance(network, IcyNet)
    network.range_px = range_px
    return Found(*network.forward_with_costs(left, right))


ICYNET = Trainable("icynet", IcyNet, _run_icynet)


def find_trainable(text: str) -> Trainable:
    """Find the network of a matcher's name, or of a user's ``MODULE:FUNCTION``. Raises IcyMoonError if it does not
    exist.
    """
    if text == ICYNET.name:
        return ICYNET
    module, _, name = text.partition(":")
    if not (module and name):
        return _find_matchers_network(text)
    try:
        make = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise IcyMoonError(
            f"{text} cannot be loaded ({error}); start the command where {module}.py is, and name a function of it."
        ) from None
    return Trainable(text, make, _run_own)


def _find_matchers_network(name: str) -> Trainable:
    """Find the network of a matcher whose module has ``NETWORK`` and ``apply_in_training``.

    Raises IcyMoonError if the matcher has none.
    """
    matcher = getattr(load_matcher(name), "loaded", None)
    network, apply = (getattr(matcher, each, None) for each in ("NETWORK", "apply_in_training"))
    if network is None or apply is None:
        raise IcyMoonError(f"The matcher {name} has no network to train; take icynet, igev, or MODULE:FUNCTION.")
    return Trainable(name, network.build, lambda net, left, right, range_px: Found(apply(net, left, right)))


def _run_own(network: nn.Module, left: Tensor, right: Tensor, range_px: int) -> Found:
    given = network(left, right)
    disparity, logit = given if isinstance(given, tuple) else (given, None)
    for name, each in (("disparity", disparity), ("confidence", logit)):
        shape = tuple(each.shape) if isinstance(each, Tensor) else type(each).__name__
        if shape != (left.shape[0], *left.shape[2:]) and (each is not None or name == "disparity"):
            raise IcyMoonError(
                f"The network gives a {name} of shape {shape} for images of {tuple(left.shape)}; return (N, H, W)."
            )
    return Found(disparity, logit)
