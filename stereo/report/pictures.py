"""The pictures in the report: of the shown pairs, and of a typical pair of each condition by each method."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...support.arrays import Array
from ..images.gallery import SCREEN_GAMMA
from ..images.image_files import encode_image, read_png
from .conditions import Condition
from .summary import ResultTable
from .table_columns import RANKING_METRIC

#: Most pictures in the file: as JPEG of 480 px they take about 25 kB each, and a third more as text.
MAX_PICTURES = 300
#: Most pictures in the matrix of conditions and methods.
MAX_IN_MATRIX = 96
_WIDTH_PX = 480
_JPEG_QUALITY = 80


def embed_picture(path: Path, height: int, linear: bool = False) -> str:
    """Embed a picture as a data URL, without the colour bar below its ``height`` rows, because HTML draws its own.

    The ``linear`` grey values of a sensor get the gamma of screens.
    """
    image = read_png(path)[:height]
    if linear:
        image = apply_screen_gamma(image)
    if image.shape[1] > _WIDTH_PX:
        size = (_WIDTH_PX, max(1, round(image.shape[0] * _WIDTH_PX / image.shape[1])))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    content = base64.b64encode(encode_image(image, ".jpg", _JPEG_QUALITY)).decode("ascii")
    return f"data:image/jpeg;base64,{content}"


def apply_screen_gamma(image: Array) -> Array:
    """Apply the gamma of screens to the linear grey values of a sensor, uint8."""
    return np.asarray((255 * (image / 255.0) ** SCREEN_GAMMA).astype(np.uint8))


def embed_left_image(facts: Mapping[str, Any], out: Path) -> str:
    """Embed the left image of a pair as a data URL."""
    return embed_picture(out / facts["images"]["left"], facts["height_px"], linear=facts.get("linear", True))


def find_typical_pair(table: ResultTable, among: Array) -> int | None:
    """Find the number of the typical pair where the boolean ``among`` is true; None if no such pair counts.

    Its share of wrong or missing pixels, averaged over the methods, is the median; of two pairs in the middle the
    better one is chosen. Pairs with failed methods are chosen only if there are no others.
    """
    errors = np.stack([table.column(k, RANKING_METRIC) for k in range(len(table.methods))])
    known = ~np.isnan(errors)
    methods = known.sum(axis=0) * among
    if not methods.any():
        return None
    candidates = np.flatnonzero(methods == methods.max())
    means = np.where(known, errors, 0.0).sum(axis=0)[candidates]
    return int(candidates[np.argsort(means, kind="stable")[(len(candidates) - 1) // 2]])


def choose_typical_pairs(table: ResultTable, conditions: Sequence[Condition]) -> list[tuple[Condition, int]]:
    """Choose the conditions of the matrix, each with its typical pair: as many as fit, or all pairs as one without
    conditions. [] for fewer than two pairs, because the report then shows the pair itself.
    """
    if len(table.pairs) < 2:
        return []
    found = [
        (condition, pair)
        for condition in conditions or [Condition("All pairs", np.ones(len(table.pairs), bool))]
        if (pair := find_typical_pair(table, condition.pairs & (table.scenes >= 0))) is not None
    ]
    return found[: max(1, MAX_IN_MATRIX // (1 + len(table.methods)))]


def make_picture_matrix(
    typical: Sequence[tuple[Condition, int]],
    table: ResultTable,
    facts: Mapping[str, Mapping[str, Any]],
    rows: Sequence[Mapping[str, Any]],
    out: Path,
) -> list[dict[str, Any]]:
    """Make a row for each condition: its ``name``, the name of its typical ``pair``, the ``left`` image and, for each
    method, the ``row`` and its ``error`` picture, "" if the method failed.

    ``facts`` are by pair; ``rows`` are of all pairs and methods.
    """
    count, found = len(table.methods), []
    for condition, number in typical:
        pair = table.pairs[number]
        own = rows[number * count : (number + 1) * count]
        found.append(
            {
                "name": condition.name,
                "pair": pair,
                "left": embed_left_image(facts[pair], out),
                "methods": [
                    {
                        "row": row,
                        "error": embed_picture(out / row["images"]["error"], facts[pair]["height_px"])
                        if "error" in row["images"]
                        else "",
                    }
                    for row in own
                ],
            }
        )
    return found
