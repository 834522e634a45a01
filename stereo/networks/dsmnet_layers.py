"""The parts of DSMNet: domain normalisation, features, guidance, volume aggregation.

Attribute names come from the official code, feihuzhang/DSMNet (MIT), because they are the keys of its checkpoints; some
layers of a checkpoint served its training only.
"""

from __future__ import annotations

from itertools import product

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812, its usual name

from .recursive_filters import aggregate_semi_global, filter_non_local


class DomainNorm(nn.Module):
    """Scales every pixel's channels to unit length, then every channel of the image to mean 0 and variance 1."""

    def __init__(self, channels: int, unit_length: bool = True) -> None:
        super().__init__()
        self.normalize = nn.InstanceNorm2d(channels, affine=True)
        self.unit_length = unit_length

    def forward(self, x: Tensor) -> Tensor:
        return self.normalize(F.normalize(x, dim=1) if self.unit_length else x)


class BasicConv(nn.Module):
    """Convolution, domain normalisation (batch normalisation in a ``volume``), ReLU."""

    def __init__(
        self,
        inputs: int,
        outputs: int,
        kernel: int = 3,
        stride: int = 1,
        deconv: bool = False,
        volume: bool = False,
        relu: bool = True,
        unit_length: bool = True,
    ) -> None:
        super().__init__()
        self.conv: nn.Module
        self.bn: nn.Module
        if volume:
            kind = nn.ConvTranspose3d if deconv else nn.Conv3d
            # A deconvolution makes 2 D - 1 planes from D planes: the first and the last one stay at the ends.
            self.conv = kind(inputs, outputs, (3, 4, 4) if deconv else 3, stride, 1, bias=False)
            self.bn = nn.BatchNorm3d(outputs)
        else:
            flat = nn.ConvTranspose2d if deconv else nn.Conv2d
            self.conv = flat(inputs, outputs, 4 if deconv else kernel, stride, 1, bias=False)
            self.bn = DomainNorm(outputs, unit_length)
        self.relu = relu

    def forward(self, x: Tensor) -> Tensor:
        x = self.bn(self.conv(x))
        return F.relu(x) if self.relu else x


class ResizeAndJoin(nn.Module):
    """Resizes features to half the size, or to twice the size with ``deconv``, and joins them with other features of
    that size.
    """

    def __init__(self, inputs: int, outputs: int, deconv: bool = False, volume: bool = False) -> None:
        super().__init__()
        self.conv1 = BasicConv(inputs, outputs, stride=2, deconv=deconv, volume=volume)
        self.conv2 = BasicConv(2 * outputs, outputs, volume=volume)

    def forward(self, x: Tensor, there: Tensor) -> Tensor:
        return self.conv2(torch.cat((self.conv1(x), there), 1))


class NLFilter(nn.Module):
    """The non-local filter with weights from the filtered features."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.getweights = nn.Sequential(BasicConv(channels, channels, relu=False, unit_length=False))
        self.conv_refine = BasicConv(2 * channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        return self.conv_refine(torch.cat((filter_non_local(x, self.getweights(x)), x), 1))


class Pyramid(nn.Module):
    """Joins the features with their means over 2, 4, 8 and 16 px."""

    def __init__(self) -> None:
        super().__init__()
        self.conv0 = nn.Conv2d(32, 32, 3, padding=1, bias=False)
        self.conv1, self.conv2, self.conv3, self.conv4 = (
            nn.Sequential(nn.AvgPool2d(side), nn.Conv2d(32, 24, 3, padding=1, bias=False)) for side in (2, 4, 8, 16)
        )
        self.bn_relu = nn.Sequential(DomainNorm(128), nn.ReLU())
        self.conv_last = BasicConv(128, 32)

    def forward(self, x: Tensor) -> Tensor:
        x = self.conv0(x)
        means = [
            F.interpolate(branch(x), x.shape[2:], mode="bilinear", align_corners=False)
            for branch in (self.conv1, self.conv2, self.conv3, self.conv4)
        ]
        return self.conv_last(self.bn_relu(torch.cat((x, *means), 1)))


class Features(nn.Module):
    """Computes features (N, 32, H/4, W/4) of images (N, 3, H, W), through two hourglasses."""

    def __init__(self) -> None:
        super().__init__()
        self.conv_start = nn.Sequential(
            BasicConv(3, 32), BasicConv(32, 32, 5, stride=2), BasicConv(32, 32, stride=2), BasicConv(32, 32, relu=False)
        )
        self.conv1a, self.conv2a = BasicConv(32, 48, stride=2), BasicConv(48, 64, stride=2)
        self.conv3a, self.conv4a = BasicConv(64, 96, stride=2), BasicConv(96, 128, stride=2)
        self.deconv4a, self.deconv4b = ResizeAndJoin(128, 96, deconv=True), ResizeAndJoin(128, 96, deconv=True)
        self.deconv3a, self.deconv3b = ResizeAndJoin(96, 64, deconv=True), ResizeAndJoin(96, 64, deconv=True)
        self.deconv2a, self.deconv2b = ResizeAndJoin(64, 48, deconv=True), ResizeAndJoin(64, 48, deconv=True)
        self.deconv1a, self.deconv1b = ResizeAndJoin(48, 32, deconv=True), ResizeAndJoin(48, 32, deconv=True)
        self.conv1b, self.conv2b, self.conv3b, self.conv4b = (
            ResizeAndJoin(32, 48),
            ResizeAndJoin(48, 64),
            ResizeAndJoin(64, 96),
            ResizeAndJoin(96, 128),
        )
        self.nlf1, self.nlf2, self.nlf3 = NLFilter(32), NLFilter(32), NLFilter(32)
        self.nlf11, self.nlf12, self.nlf13, self.nlf14 = (NLFilter(48) for _ in range(4))
        self.pyramid1, self.pyramid2 = Pyramid(), Pyramid()

    def forward(self, image: Tensor) -> Tensor:
        x0 = self.nlf1(self.conv_start(image))
        x1 = self.nlf11(self.conv1a(x0))
        x2 = self.conv2a(x1)
        x3 = self.conv3a(x2)
        x4 = self.conv4a(x3)
        x3 = self.deconv4a(x4, x3)
        x2 = self.deconv3a(x3, x2)
        x1 = self.nlf12(self.deconv2a(x2, x1))
        x0 = self.pyramid1(self.nlf2(self.deconv1a(x1, x0)))
        x1 = self.nlf13(self.conv1b(x0, x1))
        x2 = self.conv2b(x1, x2)
        x3 = self.conv3b(x2, x3)
        x3 = self.deconv4b(self.conv4b(x3, x4), x3)
        x2 = self.deconv3b(x3, x2)
        x1 = self.nlf14(self.deconv2b(x2, x1))
        return self.pyramid2(self.nlf3(self.deconv1b(x1, x0)))


class _Similarities(nn.Module):
    """Computes the cosines between a pixel's channels and its 3 x 3 neighbours' channels, (N, 9, H, W), scaled to a sum
    of 1.
    """

    def forward(self, x: Tensor) -> Tensor:
        height, width = x.shape[2:]
        x = F.normalize(x, dim=1)
        padded = F.pad(x, (1, 1, 1, 1))
        cosines = [
            (x * padded[..., row : row + height, column : column + width]).sum(1)
            for row, column in product(range(3), repeat=2)
        ]
        return F.normalize(torch.stack(cosines, 1), p=1.0, dim=1)


class Guidance(nn.Module):
    """Computes the 20 weights of every aggregation, at 1/4 and 1/8 of the size, from features (N, 64, H, W)."""

    def __init__(self) -> None:
        super().__init__()
        self.conv0 = BasicConv(64, 32)
        self.conv1 = nn.Sequential(BasicConv(32, 32, 5, stride=2), BasicConv(32, 32, stride=2), BasicConv(32, 32))
        self.conv2, self.conv3 = BasicConv(32, 32), BasicConv(32, 32)
        self.conv11 = nn.Sequential(BasicConv(32, 48, stride=2), BasicConv(48, 48))
        self.conv12, self.conv13, self.conv14 = BasicConv(48, 48), BasicConv(48, 48), BasicConv(48, 48)
        self.weight_sg1, self.weight_sg2, self.weight_sg3 = (BasicConv(32, 32, relu=False) for _ in range(3))
        self.weight_sg11, self.weight_sg12, self.weight_sg13, self.weight_sg14 = (
            BasicConv(48, 48, relu=False) for _ in range(4)
        )
        self.getweights = nn.Sequential(_Similarities(), nn.Conv2d(9, 20, 1, bias=False))

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        x = self.conv0(x)
        weights = {}
        for step in ("1", "2", "3", "11", "12", "13", "14"):
            made = self.get_submodule("conv" + step)(x)
            x = made if step in ("1", "11") else made + x
            weights[step] = self.getweights(self.get_submodule("weight_sg" + step)(x))
        return weights


class SGABlock(nn.Module):
    """Semi-global aggregation and a convolution, added to the input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.bn_relu = nn.Sequential(nn.BatchNorm3d(channels), nn.ReLU())
        self.conv_refine = BasicConv(channels, channels, volume=True, relu=False)

    def forward(self, x: Tensor, weights: Tensor) -> Tensor:
        return F.relu(x + self.conv_refine(self.bn_relu(aggregate_semi_global(x, weights))))


class Disparity(nn.Module):
    """Computes the mean disparity under the softmin of the costs, (N, 4 h, 4 w) px, from a volume (N, 32, D, h, w)."""

    def __init__(self, max_disparity: int) -> None:
        super().__init__()
        self.conv3d_2d = nn.Conv3d(32, 1, 3, padding=1, bias=False)
        self.max_disparity = max_disparity

    def forward(self, volume: Tensor) -> Tensor:
        cost = self.conv3d_2d(volume)
        size = (self.max_disparity + 1, 4 * cost.shape[3], 4 * cost.shape[4])
        chances = F.softmin(F.interpolate(cost, size, mode="trilinear", align_corners=False).squeeze(1), 1)
        planes = torch.arange(size[0], dtype=chances.dtype, device=chances.device)[:, None, None]
        return (planes * chances).sum(1)


class CostAggregation(nn.Module):
    """Computes the disparity from a volume (N, 64, D, h, w), through two hourglasses."""

    def __init__(self, max_disparity: int) -> None:
        super().__init__()
        self.conv_start = BasicConv(64, 32, volume=True, relu=False)
        self.conv1a = BasicConv(32, 48, stride=2, volume=True)
        self.conv2a = BasicConv(48, 64, stride=2, volume=True)
        self.deconv1a, self.deconv1b = (ResizeAndJoin(48, 32, deconv=True, volume=True) for _ in range(2))
        self.deconv2a, self.deconv2b = (ResizeAndJoin(64, 48, deconv=True, volume=True) for _ in range(2))
        self.conv1b, self.conv2b = ResizeAndJoin(32, 48, volume=True), ResizeAndJoin(48, 64, volume=True)
        # The first two made disparities for the training's loss; they are in every checkpoint.
        self.disp0, self.disp1, self.disp2 = (Disparity(max_disparity) for _ in range(3))
        self.sga1, self.sga2, self.sga3 = SGABlock(32), SGABlock(32), SGABlock(32)
        self.sga11, self.sga12, self.sga13, self.sga14 = (SGABlock(48) for _ in range(4))

    def forward(self, volume: Tensor, weights: dict[str, Tensor]) -> Tensor:
        x0 = self.sga1(self.conv_start(volume), weights["1"])
        x1 = self.sga11(self.conv1a(x0), weights["11"])
        x2 = self.conv2a(x1)
        x1 = self.sga12(self.deconv2a(x2, x1), weights["12"])
        x0 = self.sga2(self.deconv1a(x1, x0), weights["2"])
        x1 = self.sga13(self.conv1b(x0, x1), weights["13"])
        x2 = self.conv2b(x1, x2)
        x1 = self.sga14(self.deconv2b(x2, x1), weights["14"])
        return self.disp2(self.sga3(self.deconv1b(x1, x0), weights["3"]))
