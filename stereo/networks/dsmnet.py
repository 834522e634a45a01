"""DSMNet: domain-invariant stereo matching (Zhang, Qi, Yang, Prisacariu, Wah, Torr, ECCV 2020).

Written from the paper and the behaviour of the official code, feihuzhang/DSMNet (MIT), its model
``DSMNet2x2``; its checkpoints load. Its two filters run in plain torch, on any device.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812, its usual name

from .dsmnet_layers import BasicConv, CostAggregation, DomainNorm, Features, Guidance

SIZE_STEP = 64  # image sides are multiples of this
DISPARITY_STEP = 16  # max_disparity is a multiple of this


class DSMNet(nn.Module):
    """Disparity by a volume of features, aggregated along the surfaces of the left image.

    ``max_disparity`` px, a multiple of 16, is the largest possible output.
    """

    def __init__(self, max_disparity: int = 192) -> None:
        super().__init__()
        if max_disparity <= 0 or max_disparity % DISPARITY_STEP:
            raise ValueError(f"max_disparity is {max_disparity}, not a multiple of {DISPARITY_STEP}")
        self.max_disparity = max_disparity
        self.conv_start = nn.Sequential(BasicConv(3, 16), BasicConv(16, 32))
        self.conv_x, self.conv_y = BasicConv(32, 32), BasicConv(32, 32)
        self.conv_refine = nn.Conv2d(32, 32, 3, padding=1, bias=False)
        self.bn_relu = nn.Sequential(DomainNorm(32), nn.ReLU())
        self.feature = Features()
        self.guidance = Guidance()
        self.cost_agg = CostAggregation(max_disparity)

    def forward(self, left: Tensor, right: Tensor) -> Tensor:
        """Compute the disparity of the left image, (N, H, W) px.

        Images are RGB (N, 3, H, W), with sides that are multiples of 64. Every channel of the whole image has mean 0
        and variance 1.
        """
        features, features_right = self.feature(torch.cat((left, right))).chunk(2)
        volume = concatenate_shifts(self.conv_x(features), self.conv_y(features_right), self.max_disparity // 4 + 1)
        refined = F.interpolate(self.conv_refine(features), left.shape[2:], mode="bilinear", align_corners=False)
        weights = self.guidance(torch.cat((self.conv_start(left), self.bn_relu(refined)), 1))
        return self.cost_agg(volume, weights)


def concatenate_shifts(left: Tensor, right: Tensor, planes: int) -> Tensor:
    """Concatenate left features with the right features at every shift, (N, 2 C, planes, h, w); 0 outside the right
    image.
    """
    count, channels, height, width = left.shape
    volume = left.new_zeros(count, 2 * channels, planes, height, width)
    for shift in range(min(planes, width)):
        volume[:, :channels, shift, :, shift:] = left[..., shift:]
        volume[:, channels:, shift, :, shift:] = right[..., : width - shift]
    return volume
