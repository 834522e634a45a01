"""IGEV-Stereo: iterative geometry encoding volume (Xu, Wang, Ding, Yang, CVPR 2023).

Written from the paper and the behaviour of the official code, gangweiX/IGEV (MIT); its checkpoints load.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812, its usual name

from .igev_layers import (
    HIDDEN,
    BasicConv,
    Context,
    FeatureAtt,
    Features,
    Hourglass,
    InstanceConv,
    UpConv,
    UpdateBlock,
)

GROUPS = 8  # number of groups of channels, each correlated separately
LEVELS = 2  # number of scales of the volumes that are looked up
RADIUS = 4  # radius of the look-up, px of its level
SIZE_STEP = 32  # image sides are multiples of this
DISPARITY_STEP = 32  # max_disparity is a multiple of this


class IGEVStereo(nn.Module):
    """Disparity by a volume of costs, and by a recurrent refinement that looks up values in it.

    ``max_disparity`` px, a multiple of 32, is the reach of the volume; the refinement can leave it.
    """

    def __init__(self, max_disparity: int = 192) -> None:
        super().__init__()
        if max_disparity <= 0 or max_disparity % DISPARITY_STEP:
            raise ValueError(f"max_disparity is {max_disparity}, not a multiple of {DISPARITY_STEP}")
        self.max_disparity = max_disparity
        self.cnet = Context()
        self.update_block = UpdateBlock(LEVELS * (2 * RADIUS + 1) * (GROUPS + 1))
        self.context_zqr_convs = nn.ModuleList(nn.Conv2d(HIDDEN, 3 * HIDDEN, 3, padding=1) for _ in range(3))
        self.feature = Features()
        self.stem_2 = nn.Sequential(
            InstanceConv(3, 32, stride=2), nn.Conv2d(32, 32, 3, padding=1, bias=False), nn.InstanceNorm2d(32), nn.ReLU()
        )
        self.stem_4 = nn.Sequential(
            InstanceConv(32, 48, stride=2),
            nn.Conv2d(48, 48, 3, padding=1, bias=False),
            nn.InstanceNorm2d(48),
            nn.ReLU(),
        )
        self.spx_2_gru = UpConv(32, 32, batch_norm=True)
        self.spx_gru = nn.Sequential(nn.ConvTranspose2d(64, 9, 4, 2, padding=1))
        self.conv = InstanceConv(96, 96)
        self.desc = nn.Conv2d(96, 96, 1)
        self.corr_stem = BasicConv(GROUPS, GROUPS, 3, volume=True)
        self.corr_feature_att = FeatureAtt(GROUPS, 96)
        self.cost_agg = Hourglass()
        self.classifier = nn.Conv3d(GROUPS, 1, 3, padding=1, bias=False)
        # This layer upsampled the initial disparity for the training's loss; every checkpoint contains it.
        self.spx = nn.Sequential(nn.ConvTranspose2d(64, 9, 4, 2, padding=1))
        self.spx_2 = UpConv(24, 32)
        self.spx_4 = nn.Sequential(
            InstanceConv(96, 24), nn.Conv2d(24, 24, 3, padding=1, bias=False), nn.InstanceNorm2d(24), nn.ReLU()
        )

    def forward(self, left: Tensor, right: Tensor, iterations: int = 32) -> Tensor:
        """Compute the disparity of the left image, (N, 1, H, W) px, from RGB of 0 to 255, (N, 3, H, W), with sides that
        are multiples of 32.

        Each of the ``iterations`` takes the same time. Raises ValueError for fewer than one.
        """
        if iterations < 1:
            raise ValueError(f"iterations is {iterations}, not 1 or more")
        left, right = 2 * left / 255 - 1, 2 * right / 255 - 1
        features, stem_2, matched_left = self._extract_features(left)
        _, _, matched_right = self._extract_features(right)
        volume = correlate_groups(matched_left, matched_right, self.max_disparity // 4)
        volume = self.corr_feature_att(self.corr_stem(volume), features[0])
        volume = self.cost_agg(volume, features)
        chances = F.softmax(_to_single_precision(self.classifier(volume)), 2).squeeze(1)
        planes = torch.arange(chances.shape[1], dtype=chances.dtype, device=chances.device)[:, None, None]
        disparity = (planes * chances).sum(1, keepdim=True)

        hidden, context = [], []
        for (state, seen), layer in zip(self.cnet(left), self.context_zqr_convs, strict=True):
            hidden.append(torch.tanh(state))
            context.append(tuple(layer(F.relu(seen)).split(HIDDEN, 1)))
        look_up = VolumeLookUp(volume, matched_left, matched_right)
        mask_features = hidden[0]
        for _ in range(iterations):
            hidden, mask_features, change = self.update_block(hidden, context, look_up(disparity), disparity)
            disparity = disparity + _to_single_precision(change)
        return upsample_convex(4 * disparity, self.spx_gru(self.spx_2_gru(mask_features, stem_2)))

    def _extract_features(self, image: Tensor) -> tuple[list[Tensor], Tensor, Tensor]:
        """Extract features at four scales, features at half the size, and features for the matching."""
        features = self.feature(image)
        stem_2 = self.stem_2(image)
        features[0] = torch.cat((features[0], self.stem_4(stem_2)), 1)
        return features, stem_2, self.desc(self.conv(features[0]))


def correlate_groups(left: Tensor, right: Tensor, planes: int) -> Tensor:
    """Compute the mean product over each group of channels at every shift, (N, GROUPS, planes, h, w); 0 outside the
    image.
    """
    count, channels, height, width = left.shape
    left, right = (x.view(count, GROUPS, channels // GROUPS, height, width) for x in (left, right))
    volume = left.new_zeros(count, GROUPS, planes, height, width)
    for shift in range(min(planes, width)):
        volume[:, :, shift, :, shift:] = (left[..., shift:] * right[..., : width - shift]).mean(2)
    return volume


class VolumeLookUp:
    """Samples the geometry volume, and the correlation of all pixels of a row, around a disparity."""

    def __init__(self, volume: Tensor, left: Tensor, right: Tensor) -> None:
        count, groups, planes, height, width = volume.shape
        geometry = _to_single_precision(volume).permute(0, 3, 4, 1, 2).reshape(count * height * width, groups, planes)
        with torch.autocast(left.device.type, enabled=False):
            rows = torch.einsum("nchi,nchj->nhij", _to_single_precision(left), _to_single_precision(right))
        rows = rows.reshape(count * height * width, 1, width)
        self._pyramid = [(geometry, rows)]
        for _ in range(1, LEVELS):
            self._pyramid.append((F.avg_pool1d(self._pyramid[-1][0], 2), F.avg_pool1d(self._pyramid[-1][1], 2)))
        self._column = torch.arange(width, dtype=rows.dtype, device=rows.device)

    def __call__(self, disparity: Tensor) -> Tensor:
        """Sample around the disparity (N, 1, h, w); return (N, LEVELS (GROUPS + 1) (2 RADIUS + 1), h, w)."""
        count, _, height, width = disparity.shape
        matched = self._column - disparity
        found = []
        for level, (geometry, rows) in enumerate(self._pyramid):
            found += [
                _cut_windows(geometry, disparity.reshape(-1) / 2**level),
                _cut_windows(rows, matched.reshape(-1) / 2**level),
            ]
        return torch.cat(found, 1).view(count, height, width, -1).permute(0, 3, 1, 2)


def _cut_windows(lines: Tensor, centre: Tensor) -> Tensor:
    """Interpolate lines (P, C, L) at 2 RADIUS + 1 positions around a fractional ``centre``; return (P, C (2 RADIUS +
    1)), 0 outside.
    """
    length = lines.shape[2]
    before = torch.floor(centre)
    weight = (centre - before)[:, None, None]
    places = before.long()[:, None] + torch.arange(-RADIUS, RADIUS + 2, device=lines.device)
    inside = ((places >= 0) & (places < length))[:, None]
    values = lines.gather(2, places.clamp(0, length - 1)[:, None].expand(-1, lines.shape[1], -1)) * inside
    return torch.lerp(values[:, :, :-1], values[:, :, 1:], weight).flatten(1)


def upsample_convex(disparity: Tensor, logits: Tensor) -> Tensor:
    """Upsample a disparity to (N, 1, 4 h, 4 w), as a mean of the 3 x 3 neighbours, 0 outside, weighted by the softmax
    of ``logits`` (N, 9, 4 h, 4 w).
    """
    count, _, height, width = disparity.shape
    around = F.unfold(disparity, 3, padding=1).view(count, 9, height, width)
    around = F.interpolate(around, scale_factor=4, mode="nearest")
    return (F.softmax(_to_single_precision(logits), 1) * around).sum(1, keepdim=True)


def _to_single_precision(x: Tensor) -> Tensor:
    """Return the tensor in at least single precision.

    bfloat16, with 8 bits, is for features and costs; at a disparity of 64 px it has steps of half a pixel.
    """
    return x.float() if x.dtype == torch.bfloat16 else x
