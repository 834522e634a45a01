"""The printed numbers of the GUISS paper (its table of results, its table of run times, and its two kinds of pairs),
and the methods of the tables that are made again.

Bhaskara et al. 2024, tables 1 and 2. The rates are shares with an error above 10 cm; si-RMSE is the root, although the
paper's formula has none; the row *All* is the mean over 3060 reconstructed and 1960 synthetic pairs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

#: The groups of pairs in the table, with the paper's number of pairs.
PAIRS_BY_GROUP = {"All": 5020, "Reconstructed": 3060, "Synthetic": 1960}
#: The metrics of the table, by our keys.
PRINTED_METRICS = ("l1_m", "l1_rate_10", "si_rmse", "dod")


@dataclass(frozen=True)
class TableMethod:
    """A method of the tables: our matcher and its title."""

    matcher: str
    title: str


@dataclass(frozen=True)
class PrintedMethod(TableMethod):
    """A method of the paper, with its seconds for a pair of 640 x 480 px on a ``machine``. ``results`` are its
    PRINTED_METRICS by group, in our units: metres and shares.
    """

    seconds: float
    machine: str
    results: Mapping[str, tuple[float, float, float, float]]


PRINTED_METHODS = (
    PrintedMethod(
        "bm",
        "StereoBM",
        0.02,
        "i7",
        {
            "All": (1.13, 0.725, 0.30, 0.124),
            "Reconstructed": (0.73, 0.692, 0.11, 0.057),
            "Synthetic": (1.76, 0.776, 0.6, 0.229),
        },
    ),
    PrintedMethod(
        "jplv",
        "JPLV",
        0.15,
        "i7",
        {
            "All": (0.55, 0.739, 0.74, 0.131),
            "Reconstructed": (0.58, 0.745, 0.67, 0.072),
            "Synthetic": (0.48, 0.731, 0.86, 0.223),
        },
    ),
    PrintedMethod(
        "dsmnet",
        "DSMNet",
        0.45,
        "RTX 3080 laptop",
        {
            "All": (0.29, 0.661, 0.03, 0.026),
            "Reconstructed": (0.39, 0.717, 0.02, 0.023),
            "Synthetic": (0.14, 0.575, 0.04, 0.031),
        },
    ),
    PrintedMethod(
        "igev",
        "IGEV",
        0.34,
        "RTX 3080 laptop",
        {
            "All": (0.26, 0.644, 0.03, 0.023),
            "Reconstructed": (0.34, 0.702, 0.02, 0.019),
            "Synthetic": (0.14, 0.554, 0.04, 0.031),
        },
    ),
)
#: The methods of the tables. The last is not in the paper: a learned method that needs no download.
TABLE_METHODS: tuple[TableMethod, ...] = (*PRINTED_METHODS, TableMethod("icynet", "icynet"))
#: Seconds of rendering a pair and its depth, by group; on an i7 laptop.
RENDERING_S = {"Reconstructed": 3.0, "Synthetic": 60.0}
