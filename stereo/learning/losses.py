"""The loss of a stereo network that gives disparities, costs of levels, and confidences."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812, its usual name

from ..networks.icynet_file import LEVEL_PX
from .trainable import Found

#: Weights of the parts: cross-entropy of the costs, and confidence.
_COST_WEIGHT, _CONFIDENCE_WEIGHT = 0.5, 0.3
#: Error in px above which the loss grows only with its logarithm, because such a pixel probably shows nothing to match.
_LARGE_ERROR_PX = 4.0
#: Weight of points that the right eye does not see.
_HIDDEN_WEIGHT = 0.3


def compute_loss(found: Found, sample: Mapping[str, Tensor], range_px: int) -> dict[str, Tensor]:
    """Compute the parts of the loss and their ``total``, scalars, and ``bad_1``, the share of errors above 1 px.

    A part is 0 if the network gives no confidence or no costs. ``sample`` has ``disparity_px``, ``valid`` and
    ``occluded``, all (N, H, W). The parts are:

    Disparity: smooth L1, and the logarithm of large errors. Costs: cross-entropy with the two nearest levels, where the
    right eye sees the point. Confidence: cross-entropy with exp(-error in px).
    """
    truth, hidden = sample["disparity_px"], sample["occluded"]
    known = sample["valid"] & (truth < range_px)
    weight = known * torch.where(hidden, _HIDDEN_WEIGHT, 1.0)
    error = (found.disparity - truth).abs()
    apart = F.smooth_l1_loss(found.disparity, truth, reduction="none")
    apart = _LARGE_ERROR_PX * torch.log1p(apart / _LARGE_ERROR_PX)
    smooth = (apart * weight).sum() / weight.sum().clamp(min=1.0)
    none = smooth.new_zeros(())
    sure = none if found.logit is None else _compare_confidence(found.logit, error, known)
    levels = none if found.costs is None else _compare_levels(found.costs, truth, known & ~hidden)
    return {
        "total": smooth + _COST_WEIGHT * levels + _CONFIDENCE_WEIGHT * sure,
        "disparity": smooth,
        "levels": levels,
        "confidence": sure,
        "bad_1": ((error > 1.0) & known).sum() / known.sum().clamp(min=1),
    }


def _compare_confidence(logit: Tensor, error: Tensor, known: Tensor) -> Tensor:
    """Return the cross-entropy of the confidence with exp(-error in px)."""
    apart = F.binary_cross_entropy_with_logits(logit, torch.exp(-error.detach()), reduction="none")
    return (apart * known).sum() / known.sum().clamp(min=1)


def _compare_levels(costs: Tensor, truth: Tensor, seen: Tensor) -> Tensor:
    """Return the cross-entropy of costs (N, D, H/4, W/4) with the truth at the pixels of the coarse grid."""
    coarse, there = truth[:, 2::4, 2::4] / LEVEL_PX, seen[:, 2::4, 2::4]
    first = coarse.floor().clamp(0, costs.shape[1] - 2)
    share = (coarse - first).clamp(0, 1)
    log = F.log_softmax(costs, 1)
    low, high = (log.gather(1, (first.long() + k)[:, None])[:, 0] for k in (0, 1))
    return -(((1 - share) * low + share * high) * there).sum() / there.sum().clamp(min=1)
