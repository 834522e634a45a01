"""MobileNetV2 (Sandler et al., CVPR 2018) as a pyramid of features, under the names of the timm library."""

from __future__ import annotations

from torch import Tensor, nn


class _Separable(nn.Module):
    """A depthwise 3 x 3 convolution, then a pointwise one."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv_dw = nn.Conv2d(inputs, inputs, 3, padding=1, groups=inputs, bias=False)
        self.bn1 = nn.BatchNorm2d(inputs)
        self.conv_pw = nn.Conv2d(inputs, outputs, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        x = nn.functional.relu6(self.bn1(self.conv_dw(x)))
        return self.bn2(self.conv_pw(x))


class _InvertedResidual(nn.Module):
    """Widens the channels sixfold, convolves them depthwise by 3 x 3, and narrows them; adds the input if the shapes
    allow.
    """

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        wide = 6 * inputs
        self.conv_pw = nn.Conv2d(inputs, wide, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(wide)
        self.conv_dw = nn.Conv2d(wide, wide, 3, stride, padding=1, groups=wide, bias=False)
        self.bn2 = nn.BatchNorm2d(wide)
        self.conv_pwl = nn.Conv2d(wide, outputs, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(outputs)
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        y = nn.functional.relu6(self.bn1(self.conv_pw(x)))
        y = nn.functional.relu6(self.bn2(self.conv_dw(y)))
        y = self.bn3(self.conv_pwl(y))
        return x + y if self.residual else y


def _make_stage(inputs: int, outputs: int, count: int, stride: int) -> nn.Sequential:
    return nn.Sequential(
        *(_InvertedResidual(outputs if place else inputs, outputs, 1 if place else stride) for place in range(count))
    )


class MobileNetTrunk(nn.Module):
    """Computes features of 24, 32, 96 and 160 channels at 1/4, 1/8, 1/16 and 1/32 of the size of images (N, 3,
    H, W).
    """

    def __init__(self) -> None:
        super().__init__()
        self.conv_stem = nn.Conv2d(3, 32, 3, 2, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(32)
        self.block0 = nn.Sequential(nn.Sequential(_Separable(32, 16)))
        self.block1 = nn.Sequential(_make_stage(16, 24, 2, stride=2))
        self.block2 = nn.Sequential(_make_stage(24, 32, 3, stride=2))
        self.block3 = nn.Sequential(_make_stage(32, 64, 4, stride=2), _make_stage(64, 96, 3, stride=1))
        self.block4 = nn.Sequential(_make_stage(96, 160, 3, stride=2))

    def pyramid(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return the features from fine to coarse."""
        quarter = self.block1(self.block0(nn.functional.relu6(self.bn1(self.conv_stem(image)))))
        eighth = self.block2(quarter)
        sixteenth = self.block3(eighth)
        return quarter, eighth, sixteenth, self.block4(sixteenth)
