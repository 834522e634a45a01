"""The two recursive filters of DSMNet, exact, in plain torch: they need no compiled extension.

NLF is the structure-preserving graph filter of Zhang et al., "Domain-invariant stereo matching networks", ECCV 2020.
SGA is the semi-global aggregation of Zhang et al., "GA-Net", CVPR 2019.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812, its usual name

#: Neighbours that are filtered before a pixel, as (rows, columns): above, above left, above right, left.
_NEIGHBOUR_OFFSETS = ((-1, 0), (-1, -1), (-1, 1), (0, -1))


def filter_non_local(x: Tensor, guide: Tensor) -> Tensor:
    """Filter features (N, C, H, W) in four scans, each of the previous result: down, up, to the right, to the left.

    A pixel becomes the mean of itself and of its already filtered neighbours, weighted by the softmax of the inner
    products of ``guide`` (N, G, H, W); a neighbour outside the image is the pixel itself.
    """
    for turned in _turns:
        x = turned(_scan_rows(turned(x), _scan_weights(turned(guide))))
    return x


def aggregate_semi_global(x: Tensor, weights: Tensor) -> Tensor:
    """Aggregate a volume (N, C, D, H, W): the largest of four scans, down, up, to the right and to the left.

    ``weights`` (N, 20, H, W) are five per scan, shared by channels and disparities. They weight the value itself, the
    previous value at its disparity, at one less and at one more, and the maximum of the previous values.
    """
    scans = [
        turned(_aggregate_scan(turned(x), F.normalize(turned(part), p=1.0, dim=1)))
        for turned, part in zip(_turns, weights.chunk(4, 1), strict=True)
    ]
    return torch.stack(scans).amax(0)


def _scan_down(x: Tensor) -> Tensor:
    return x


def _scan_up(x: Tensor) -> Tensor:
    return x.flip(-2, -1)


def _scan_right(x: Tensor) -> Tensor:
    return x.transpose(-2, -1)


def _scan_left(x: Tensor) -> Tensor:
    return x.transpose(-2, -1).flip(-2, -1)


_turns = (_scan_down, _scan_up, _scan_right, _scan_left)  # each turns its scan into one down the rows, and back


def _shift(x: Tensor, rows: int, columns: int) -> Tensor:
    """Return x[r + rows, c + columns] at each (r, c), 0 outside."""
    height, width = x.shape[-2:]
    return F.pad(x, (1, 1, 1, 1))[..., 1 + rows : 1 + rows + height, 1 + columns : 1 + columns + width]


def _scan_weights(guide: Tensor) -> Tensor:
    """Compute the weights (N, 5, H, W) of a pixel and its four neighbours in a scan. A neighbour outside the image
    gives its weight to the pixel.
    """
    products = [(guide * guide).sum(1), *((guide * _shift(guide, *place)).sum(1) for place in _NEIGHBOUR_OFFSETS)]
    weights = F.softmax(torch.stack(products, 1), 1)
    there = torch.stack([_shift(torch.ones_like(products[0]), *place) for place in _NEIGHBOUR_OFFSETS], 1)
    kept = weights[:, 1:] * there
    return torch.cat((weights[:, :1] + (weights[:, 1:] - kept).sum(1, keepdim=True), kept), 1)


def _scan_rows(x: Tensor, weights: Tensor) -> Tensor:
    """Compute o[r, c] = w · (x[r, c], o[r-1, c], o[r-1, c-1], o[r-1, c+1], o[r, c-1]), all rows side by side.

    In the order of t = c + 2 r, all inputs of a pixel come earlier: the left and the upper right pixel by 1, the upper
    pixel by 2, the upper left pixel by 3. So all pixels of one t are computed at once: one in each row, two columns
    apart from row to row.
    """
    count, channels, height, width = x.shape
    steps = width + 2 * (height - 1)
    row = torch.arange(height, device=x.device)
    column = torch.arange(steps, device=x.device)[:, None] - 2 * row
    inside = (column >= 0) & (column < width)
    place = (row * width + column.clamp(0, width - 1)).flatten()

    def skewed(values: Tensor) -> Tensor:  # (steps, N, C, H), 0 without a pixel
        picked = values.flatten(2)[:, :, place].view(count, -1, steps, height)
        return (picked * inside).permute(2, 0, 1, 3).contiguous()

    weight = skewed(weights).unsqueeze(3)
    own = skewed(x) * weight[:, :, 0]
    # Three steps of zeros before the first step, and a row of zeros above the first row.
    out = [x.new_zeros(count, channels, height + 1)] * 3
    for step in range(steps):
        third, second, last = out[-3:]
        w = weight[step]
        found = (
            own[step]
            + w[:, 1] * second[..., :-1]
            + w[:, 2] * third[..., :-1]
            + w[:, 3] * last[..., :-1]
            + w[:, 4] * last[..., 1:]
        )
        out.append(F.pad(found, (1, 0)))
    straight = torch.stack(out[3:], 3)[:, :, 1:]  # (N, C, H, steps)
    start = 2 * row[:, None] + torch.arange(width, device=x.device)
    return straight.gather(3, start.expand(count, channels, -1, -1))


def _aggregate_scan(x: Tensor, weights: Tensor) -> Tensor:
    """Aggregate one scan down the rows. The value itself replaces a missing disparity and all values above the first
    row.
    """
    rows = x.movedim(-2, 0).contiguous()  # (H, N, C, D, W)
    weight = weights.movedim(-2, 0)[:, :, :, None, None]  # (H, N, 5, 1, 1, W)
    if torch.is_grad_enabled() and (rows.requires_grad or weight.requires_grad):
        return torch.stack(_aggregate_rows(rows, weight)).movedim(0, -2)
    out = torch.empty_like(rows)
    out[0] = rows[0] * weight[0].sum(1)
    for row in range(1, len(rows)):
        value, last, target, w = rows[row], out[row - 1], out[row], weight[row]
        torch.mul(value, w[:, 0], out=target)
        target.addcmul_(last, w[:, 1]).addcmul_(last.amax(2, keepdim=True), w[:, 4])
        target[:, :, 1:].addcmul_(last[:, :, :-1], w[:, 2])
        target[:, :, :1].addcmul_(value[:, :, :1], w[:, 2])
        target[:, :, :-1].addcmul_(last[:, :, 1:], w[:, 3])
        target[:, :, -1:].addcmul_(value[:, :, -1:], w[:, 3])
    return out.movedim(0, -2)


def _aggregate_rows(rows: Tensor, weight: Tensor) -> list[Tensor]:
    """Aggregate the rows of one scan, each as a new tensor, because gradients need them."""
    done = [rows[0] * weight[0].sum(1)]
    for value, w in zip(rows[1:], weight[1:], strict=True):
        last = done[-1]
        nearer = torch.cat([value[:, :, :1], last[:, :, :-1]], 2)
        farther = torch.cat([last[:, :, 1:], value[:, :, -1:]], 2)
        best = last.amax(2, keepdim=True)
        done.append(value * w[:, 0] + last * w[:, 1] + best * w[:, 4] + nearer * w[:, 2] + farther * w[:, 3])
    return done
