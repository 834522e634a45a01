"""The parts of IGEV-Stereo: convolutions, features, context, volume aggregation, recurrent update.

Attribute names come from the official code, gangweiX/IGEV (MIT), because they are the keys of its checkpoints; some
layers of a checkpoint served its training only.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812, its usual name

from .mobilenet import MobileNetTrunk

HIDDEN = 128  # channels of context and hidden state


class BasicConv(nn.Module):
    """Convolution, batch normalisation, leaky ReLU. A ``plain`` one only convolves, but keeps the norm's parameters."""

    def __init__(
        self,
        inputs: int,
        outputs: int,
        kernel: int,
        stride: int = 1,
        deconv: bool = False,
        volume: bool = False,
        plain: bool = False,
    ) -> None:
        super().__init__()
        kind: type[nn.Module] = {
            (False, False): nn.Conv2d,
            (True, False): nn.ConvTranspose2d,
            (False, True): nn.Conv3d,
            (True, True): nn.ConvTranspose3d,
        }[deconv, volume]
        padding = 1 if deconv else kernel // 2
        self.conv = kind(inputs, outputs, kernel, stride, padding, bias=False)
        self.bn = nn.BatchNorm3d(outputs) if volume else nn.BatchNorm2d(outputs)
        self.plain = plain

    def forward(self, x: Tensor) -> Tensor:
        x = self.conv(x)
        return x if self.plain else F.leaky_relu(self.bn(x))


class InstanceConv(nn.Module):
    """Convolution, instance normalisation without parameters, leaky ReLU."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1, deconv: bool = False) -> None:
        super().__init__()
        kind = nn.ConvTranspose2d if deconv else nn.Conv2d
        self.conv = kind(inputs, outputs, kernel, stride, padding=1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        return F.leaky_relu(F.instance_norm(self.conv(x)))


class UpConv(nn.Module):
    """Doubles the size of features and joins them with finer features, with instance or batch normalisation."""

    def __init__(self, inputs: int, outputs: int, batch_norm: bool = False) -> None:
        super().__init__()
        layer = BasicConv if batch_norm else InstanceConv
        self.conv1 = layer(inputs, outputs, kernel=4, stride=2, deconv=True)
        self.conv2 = layer(2 * outputs, 2 * outputs, kernel=3)

    def forward(self, x: Tensor, finer: Tensor) -> Tensor:
        return self.conv2(torch.cat((self.conv1(x), finer), 1))


class Features(MobileNetTrunk):
    """Features of 48, 64, 192 and 160 channels at 1/4 to 1/32 of the size."""

    def __init__(self) -> None:
        super().__init__()
        self.deconv32_16 = UpConv(160, 96)
        self.deconv16_8 = UpConv(192, 32)
        self.deconv8_4 = UpConv(64, 24)
        self.conv4 = InstanceConv(48, 48)

    def forward(self, image: Tensor) -> list[Tensor]:
        x4, x8, x16, x32 = self.pyramid(image)
        x16 = self.deconv32_16(x32, x16)
        x8 = self.deconv16_8(x16, x8)
        return [self.conv4(self.deconv8_4(x8, x4)), x8, x16, x32]


class FeatureAtt(nn.Module):
    """Weighs the channels of a volume by the features of the left image at the same position."""

    def __init__(self, channels: int, features: int) -> None:
        super().__init__()
        self.feat_att = nn.Sequential(BasicConv(features, features // 2, 1), nn.Conv2d(features // 2, channels, 1))

    def forward(self, volume: Tensor, features: Tensor) -> Tensor:
        return torch.sigmoid(self.feat_att(features)).unsqueeze(2) * volume


class Hourglass(nn.Module):
    """Aggregates costs (N, 8, D, h, w) through three halvings and back."""

    def __init__(self) -> None:
        super().__init__()

        def down(inputs: int, outputs: int) -> nn.Sequential:
            return nn.Sequential(
                BasicConv(inputs, outputs, 3, 2, volume=True), BasicConv(outputs, outputs, 3, volume=True)
            )

        def up(inputs: int, outputs: int, plain: bool = False) -> BasicConv:
            return BasicConv(inputs, outputs, 4, 2, deconv=True, volume=True, plain=plain)

        def joined(channels: int) -> nn.Sequential:
            return nn.Sequential(
                BasicConv(2 * channels, channels, 1, volume=True),
                BasicConv(channels, channels, 3, volume=True),
                BasicConv(channels, channels, 3, volume=True),
            )

        self.conv1, self.conv2, self.conv3 = down(8, 16), down(16, 32), down(32, 48)
        self.conv3_up, self.conv2_up, self.conv1_up = up(48, 32), up(32, 16), up(16, 8, plain=True)
        self.agg_0, self.agg_1 = joined(32), joined(16)
        self.feature_att_8, self.feature_att_up_8 = FeatureAtt(16, 64), FeatureAtt(16, 64)
        self.feature_att_16, self.feature_att_up_16 = FeatureAtt(32, 192), FeatureAtt(32, 192)
        self.feature_att_32 = FeatureAtt(48, 160)

    def forward(self, volume: Tensor, features: list[Tensor]) -> Tensor:
        half = self.feature_att_8(self.conv1(volume), features[1])
        quarter = self.feature_att_16(self.conv2(half), features[2])
        eighth = self.feature_att_32(self.conv3(quarter), features[3])
        quarter = self.feature_att_up_16(self.agg_0(torch.cat((self.conv3_up(eighth), quarter), 1)), features[2])
        half = self.feature_att_up_8(self.agg_1(torch.cat((self.conv2_up(quarter), half), 1)), features[1])
        return self.conv1_up(half)


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions with batch normalisation, added to the input or its projection."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, padding=1)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1)
        self.norm1, self.norm2 = nn.BatchNorm2d(outputs), nn.BatchNorm2d(outputs)
        self.downsample = None
        if stride > 1 or inputs != outputs:
            self.norm3 = nn.BatchNorm2d(outputs)  # the same layer as downsample[1], under two names
            self.downsample = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride), self.norm3)

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu(self.norm1(self.conv1(x)))
        y = F.relu(self.norm2(self.conv2(y)))
        return F.relu((x if self.downsample is None else self.downsample(x)) + y)


class Context(nn.Module):
    """Computes (hidden state, context) of the left image, 128 channels each, at 1/4, 1/8 and 1/16; before tanh and
    ReLU.
    """

    def __init__(self) -> None:
        super().__init__()

        def layer(inputs: int, outputs: int, stride: int) -> nn.Sequential:
            return nn.Sequential(ResidualBlock(inputs, outputs, stride), ResidualBlock(outputs, outputs))

        def head() -> nn.Conv2d:
            return nn.Conv2d(HIDDEN, HIDDEN, 3, padding=1)

        self.conv1 = nn.Conv2d(3, 64, 7, padding=3)
        self.norm1 = nn.BatchNorm2d(64)
        self.layer1, self.layer2 = layer(64, 64, 1), layer(64, 96, 2)
        self.layer3, self.layer4, self.layer5 = (layer(inputs, HIDDEN, 2) for inputs in (96, HIDDEN, HIDDEN))
        self.outputs04, self.outputs08 = (
            nn.ModuleList(nn.Sequential(ResidualBlock(HIDDEN, HIDDEN), head()) for _ in range(2)) for _ in range(2)
        )
        self.outputs16 = nn.ModuleList(head() for _ in range(2))

    def forward(self, image: Tensor) -> list[list[Tensor]]:
        x = self.layer1(F.relu(self.norm1(self.conv1(image))))
        x04 = self.layer3(self.layer2(x))
        x08 = self.layer4(x04)
        x16 = self.layer5(x08)
        return [
            [head(x) for head in heads]
            for heads, x in ((self.outputs04, x04), (self.outputs08, x08), (self.outputs16, x16))
        ]


class _MotionEncoder(nn.Module):
    def __init__(self, looked_up: int) -> None:
        super().__init__()
        self.convc1 = nn.Conv2d(looked_up, 64, 1)
        self.convc2 = nn.Conv2d(64, 64, 3, padding=1)
        self.convd1 = nn.Conv2d(1, 64, 7, padding=3)
        self.convd2 = nn.Conv2d(64, 64, 3, padding=1)
        self.conv = nn.Conv2d(128, HIDDEN - 1, 3, padding=1)

    def forward(self, disparity: Tensor, looked_up: Tensor) -> Tensor:
        seen = F.relu(self.convc2(F.relu(self.convc1(looked_up))))
        moved = F.relu(self.convd2(F.relu(self.convd1(disparity))))
        return torch.cat((F.relu(self.conv(torch.cat((seen, moved), 1))), disparity), 1)


class _ConvGRU(nn.Module):
    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.convz, self.convr, self.convq = (nn.Conv2d(HIDDEN + inputs, HIDDEN, 3, padding=1) for _ in range(3))

    def forward(self, hidden: Tensor, context: tuple[Tensor, ...], *inputs: Tensor) -> Tensor:
        x = torch.cat(inputs, 1)
        both = torch.cat((hidden, x), 1)
        update = torch.sigmoid(self.convz(both) + context[0])
        reset = torch.sigmoid(self.convr(both) + context[1])
        new = torch.tanh(self.convq(torch.cat((reset * hidden, x), 1)) + context[2])
        return (1 - update) * hidden + update * new


class _DisparityHead(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(HIDDEN, 256, 3, padding=1)
        self.conv2 = nn.Conv2d(256, 1, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        return self.conv2(F.relu(self.conv1(x)))


class UpdateBlock(nn.Module):
    """One step of the three coupled GRUs: new hidden states, features for the upsampling, change of disparity."""

    def __init__(self, looked_up: int) -> None:
        super().__init__()
        self.encoder = _MotionEncoder(looked_up)
        self.gru04, self.gru08 = _ConvGRU(2 * HIDDEN), _ConvGRU(2 * HIDDEN)
        self.gru16 = _ConvGRU(HIDDEN)
        self.disp_head = _DisparityHead()
        self.mask_feat_4 = nn.Sequential(nn.Conv2d(HIDDEN, 32, 3, padding=1), nn.ReLU())

    def forward(
        self, hidden: list[Tensor], context: list[tuple[Tensor, ...]], looked_up: Tensor, disparity: Tensor
    ) -> tuple[list[Tensor], Tensor, Tensor]:
        net04, net08, net16 = hidden
        net16 = self.gru16(net16, context[2], _halve(net08))
        net08 = self.gru08(net08, context[1], _halve(net04), _enlarge(net16, net08))
        net04 = self.gru04(net04, context[0], self.encoder(disparity, looked_up), _enlarge(net08, net04))
        return [net04, net08, net16], self.mask_feat_4(net04), self.disp_head(net04)


def _halve(x: Tensor) -> Tensor:
    return F.avg_pool2d(x, 3, stride=2, padding=1)


def _enlarge(x: Tensor, to: Tensor) -> Tensor:
    return F.interpolate(x, to.shape[2:], mode="bilinear", align_corners=True)
