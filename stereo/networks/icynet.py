"""icynet: a small stereo network for icy ground, for any size and search range, with a confidence.

It computes features at 1/2 and 1/4 of the size, and correlates them by groups over the disparities. An hourglass of 2D
convolutions shifts its channels along the disparity, so that the search range is free. A refinement at 1/2 and convex
upsampling (Teed and Deng 2020, RAFT) follow. The shift along an axis replaces a 3D convolution, as in Lin et al. 2019
(TSM). New weights follow from the seed of PyTorch.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812, its usual name

from .icynet_file import count_levels

#: Width in px of the window in which brightness is normalized, and the least deviation in it.
_WINDOW_PX, _MIN_DEVIATION = 15, 0.01
#: Levels of 4 px on each side of the best level that are averaged.
_REACH_LEVELS = 2
#: Shifts at half size on each side that the refinement compares, px.
_REACH_HALF_PX = 3


def _conv(inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    """Make a convolution, a batch normalisation, which becomes part of the convolution at inference, and a
    leaky ReLU.
    """
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.LeakyReLU(0.1, inplace=True),
    )


class _Residual(nn.Module):
    """Two convolutions beside an identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first, self.second = _conv(channels, channels), nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        return F.leaky_relu(x + self.second(self.first(x)), 0.1)


class _Features(nn.Module):
    """Features of a grey image (N, 1, H, W): 16 channels at 1/2 and 48 at 1/4 of the size."""

    def __init__(self) -> None:
        super().__init__()
        self.at_half = nn.Sequential(_conv(1, 16, 5, 2), _conv(16, 16))
        self.at_quarter = nn.Sequential(_conv(16, 32, 3, 2), _Residual(32))
        self.at_eighth = nn.Sequential(_conv(32, 64, 3, 2), _Residual(64), _Residual(64))
        self.merge = nn.Conv2d(32 + 64, 48, 3, padding=1)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        half = self.at_half(image)
        quarter = self.at_quarter(half)
        wide = F.interpolate(self.at_eighth(quarter), scale_factor=2, mode="bilinear", align_corners=False)
        return half, self.merge(torch.cat([quarter, wide], 1))


class _Volume(nn.Module):
    """A convolution of volumes (N, D, C, H, W). A quarter of the channels comes from each neighbouring disparity."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.inputs, self.conv = inputs, _conv(inputs, outputs, 3, stride)

    def forward(self, x: Tensor) -> Tensor:
        part = self.inputs // 4
        nearer = F.pad(x[:, 1:, :part], (0, 0, 0, 0, 0, 0, 0, 1))
        farther = F.pad(x[:, :-1, part : 2 * part], (0, 0, 0, 0, 0, 0, 1, 0))
        moved = torch.cat([nearer, farther, x[:, :, 2 * part :]], 2)
        n, d = x.shape[:2]
        found = self.conv(moved.flatten(0, 1))
        return found.view(n, d, *found.shape[1:])


def _halve_levels(x: Tensor) -> Tensor:
    """Turn pairs of disparities of volumes (N, D, C, H, W) into channels, (N, D/2, 2 C, H, W)."""
    n, d, c, h, w = x.shape
    return x.reshape(n, d // 2, 2 * c, h, w)


def _double_size(x: Tensor) -> Tensor:
    """Double the disparities, rows and columns of volumes."""
    n, d, c, _, _ = x.shape
    wide = F.interpolate(x.flatten(0, 1), scale_factor=2, mode="nearest")
    wide = wide.view(n, d, 1, c, *wide.shape[-2:]).expand(-1, -1, 2, -1, -1, -1)
    return wide.reshape(n, 2 * d, c, *wide.shape[-2:])


class _Hourglass(nn.Module):
    """Computes costs (N, D, H, W), higher for better disparities, from correlations (N, D, groups, H, W)."""

    def __init__(self, groups: int) -> None:
        super().__init__()
        self.enter = _Volume(groups, 12)
        self.down = nn.ModuleList([_Volume(24, 24, 2), _Volume(48, 48, 2)])
        self.keep = nn.ModuleList([_Volume(24, 24), _Volume(48, 48)])
        # Volumes are narrowed before they are doubled, and then added: a convolution of both side by side costs three
        # times as much.
        self.narrow = nn.ModuleList([_Volume(48, 24), _Volume(24, 12)])
        self.up = nn.ModuleList([_Volume(24, 24), _Volume(12, 12)])
        self.leave = nn.Conv2d(12, 1, 3, padding=1)

    def forward(self, correlation: Tensor) -> Tensor:
        whole = self.enter(correlation)
        half = self.keep[0](self.down[0](_halve_levels(whole)))
        quarter = self.keep[1](self.down[1](_halve_levels(half)))
        half = self.up[0](_double_size(self.narrow[0](quarter)) + half)
        whole = self.up[1](_double_size(self.narrow[1](half)) + whole)
        return self.leave(whole.flatten(0, 1)).view(correlation.shape[0], -1, *correlation.shape[-2:])


class IcyNet(nn.Module):
    """The network. ``range_px`` is the greatest disparity that it can find. It may be changed at any time, because no
    weight depends on it.
    """

    groups = 8

    def __init__(self, range_px: int = 128) -> None:
        super().__init__()
        self.range_px = range_px
        self.features, self.hourglass = _Features(), _Hourglass(self.groups)
        self.raw_weight = nn.Parameter(torch.tensor(4.0))
        seen = 16 + 2 * _REACH_HALF_PX + 1 + 3
        self.refine = nn.Sequential(_conv(seen, 32), _Residual(32), _Residual(32))
        self.leave = nn.Conv2d(32, 2 + 4 * 9, 3, padding=1)

    def forward(self, left: Tensor, right: Tensor) -> tuple[Tensor, Tensor]:
        """Compute disparities (N, H, W) in px and confidences (N, H, W), logits, of grey images (N, 1, H, W) from 0 to
        1 with sides that are multiples of 16.
        """
        disparity, logit, _ = self.forward_with_costs(left, right)
        return disparity, logit

    def forward_with_costs(self, left: Tensor, right: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Compute the results of ``forward`` and, for the loss, the costs (N, D, H/4, W/4) by levels of 4 px."""
        (half, other_half), (quarter, other_quarter) = self._find_features(left, right)
        correlation = _correlate(quarter, other_quarter, count_levels(self.range_px), self.groups)
        return self._match(half, other_half, correlation)

    def forward_at_levels(self, left: Tensor, right: Tensor, levels: Tensor) -> tuple[Tensor, Tensor]:
        """Compute disparity (1, H, W) in px and confidence (1, H, W), a logit, of one pair; ``levels`` (D,) are 0 to D
        - 1.

        The numbers equal those from ``forward``, by operations whose sizes an exported network leaves free.
        """
        (half, other_half), (quarter, other_quarter) = self._find_features(left, right)
        correlation = _correlate_by_index(quarter, other_quarter, levels, self.groups)
        disparity, logit, _ = self._match(half, other_half, correlation)
        return disparity, logit

    def _find_features(self, left: Tensor, right: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
        """Compute the features of both eyes at 1/2 of the size, then at 1/4."""
        n = left.shape[0]
        half, quarter = self.features(_normalize_locally(torch.cat([left, right])))
        return (half[:n], half[n:]), (quarter[:n], quarter[n:])

    def _match(self, left: Tensor, right: Tensor, correlation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Compute disparities, confidences and costs from features at 1/2 and the correlation at 1/4 of the size."""
        costs = self.hourglass(correlation) + self.raw_weight * correlation.mean(2)
        level, peak = _find_best(costs)
        coarse = F.interpolate(
            torch.stack([2.0 * level, peak], 1), scale_factor=2, mode="bilinear", align_corners=False
        )
        fine = self._refine(left, right, coarse)
        return fine[0], fine[1], costs

    def _refine(self, left: Tensor, right: Tensor, coarse: Tensor) -> tuple[Tensor, Tensor]:
        """Compute disparity and confidence at full size from features at 1/2, and from ``coarse``: disparities in px of
        1/2, and peaks.
        """
        disparity = coarse[:, 0]
        near = [
            (left * _sample_along_rows(right, disparity + step)).mean(1)
            for step in range(-_REACH_HALF_PX, _REACH_HALF_PX + 1)
        ]
        off = (left - _sample_along_rows(right, disparity)).abs().mean(1)
        found = self.leave(
            self.refine(torch.cat([left, torch.stack([*near, off], 1), disparity[:, None] / 32, coarse[:, 1:]], 1))
        )
        better = F.relu(disparity + found[:, 0])
        both = torch.stack([2.0 * better, found[:, 1]], 1)
        full = _upsample_convex(both, found[:, 2:])
        return full[:, 0], full[:, 1]


def _normalize_locally(image: Tensor) -> Tensor:
    """Return tanh(d / 2), -1 to 1, where d is each pixel's difference from the mean around it, in standard
    deviations.
    """
    pad = _WINDOW_PX // 2
    padded = F.pad(image, (pad, pad, pad, pad), mode="reflect")
    mean, square = _average(padded), _average(padded * padded)
    spread = torch.sqrt(torch.clamp(square - mean * mean, min=_MIN_DEVIATION**2))
    return torch.tanh((image - mean) / (2.0 * spread))


def _average(image: Tensor) -> Tensor:
    """Average the window around each pixel: along the rows, then along the columns, which costs a fraction."""
    return F.avg_pool2d(F.avg_pool2d(image, (1, _WINDOW_PX), 1), (_WINDOW_PX, 1), 1)


def _correlate(left: Tensor, right: Tensor, levels: int, groups: int) -> Tensor:
    """Compute cosine similarities (N, levels, groups, H, W) of features with the other eye's features, 0 outside its
    image.
    """
    n, c, h, w = left.shape
    a, b = (F.normalize(each.view(n, groups, c // groups, h, w), dim=2) for each in (left, right))
    padded = F.pad(b, (levels - 1, 0))
    return torch.stack([(a * padded[..., levels - 1 - d : levels - 1 - d + w]).sum(2) for d in range(levels)], 1)


def _correlate_by_index(left: Tensor, right: Tensor, levels: Tensor, groups: int) -> Tensor:
    """Compute ``_correlate`` for one pair, with ``levels`` (D,) as a tensor."""
    a, b = (F.normalize(each.view(groups, -1, *each.shape[-2:]), dim=1) for each in (left[0], right[0]))
    column = torch.arange(left.shape[-1], device=left.device) - levels[:, None]
    moved = b[..., column.clamp(min=0)] * (column >= 0).to(b.dtype)
    return (a[..., None, :] * moved).sum(1).permute(2, 0, 1, 3)[None]


def _find_best(costs: Tensor) -> tuple[Tensor, Tensor]:
    """Find the mean level (N, H, W) around the best one, and the share of the probability there."""
    share = torch.softmax(costs, 1)
    best = costs.argmax(1, keepdim=True)
    steps = torch.arange(costs.shape[1], device=costs.device, dtype=costs.dtype)[None, :, None, None]
    near = share * ((steps - best.to(costs.dtype)).abs() <= _REACH_LEVELS + 0.5).to(costs.dtype)
    total = near.sum(1)
    return (near * steps).sum(1) / torch.clamp(total, min=1e-6), total


def _sample_along_rows(values: Tensor, disparity: Tensor) -> Tensor:
    """Sample values (N, C, H, W) at columns less ``disparity`` (N, H, W), linearly between columns; the border is
    repeated.
    """
    width = values.shape[-1]
    column = torch.arange(width, device=values.device, dtype=disparity.dtype) - disparity
    column = column.clamp(0.0, width - 1.0)
    first = column.detach().floor().clamp(0.0, width - 2.0)
    share = (column - first)[:, None]
    place = first.long().clamp(0, width - 2)[:, None].expand(-1, values.shape[1], -1, -1)
    return (1 - share) * values.gather(3, place) + share * values.gather(3, place + 1)


def _upsample_convex(values: Tensor, weights: Tensor) -> Tensor:
    """Upsample values to (N, C, 2 H, 2 W), as means of 3 x 3 neighbours. ``weights`` (N, 36, H, W) are nine for each of
    four pixels.
    """
    n, c, h, w = values.shape
    share = torch.softmax(weights.view(n, 1, 9, 4, h, w), 2)
    around = F.unfold(F.pad(values, (1, 1, 1, 1), mode="replicate"), 3).view(n, c, 9, 1, h, w)
    return F.pixel_shuffle((share * around).sum(2).reshape(n, 4 * c, h, w), 2)
