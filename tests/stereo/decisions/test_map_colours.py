"""The colours of maps of decisions: those that the legend names, for as many cells as it counts."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.stereo.decisions.dem import Grid
from icymoon.stereo.decisions.map_colours import LEGEND_BY_MAP, colour_cells, count_cells
from icymoon.stereo.decisions.stored_maps import HEIGHT_ERROR, SLOPE, SUITABILITY, StoredMap

GREY = (150, 150, 150)


def stored(kind: str, *values: float) -> StoredMap:
    cells = np.array([values])
    return StoredMap(kind, Grid(0.1, 1, len(values), 0.0, 0.0), cells, np.zeros_like(cells), None, None, 0.3, 10.0)


@pytest.mark.parametrize(
    ("kind", "values", "counts"),
    [
        (SUITABILITY, (-np.inf, np.nan, -3.0, -1e-6, 0.0, 1.0), {"safe": 2, "unsafe": 2, "unknown": 2}),
        (SLOPE, (np.nan, 0.0, 10.0, 10.01, 20.0, 20.01, 90.0), {"gentle": 2, "steep": 2, "steeper": 2, "unknown": 1}),
        (HEIGHT_ERROR, (np.nan, 0.01, -0.01, 0.011, -0.2), {"high": 1, "low": 1, "right": 2, "unknown": 1}),
    ],
)
def test_each_cell_is_of_one_kind_and_grey_is_the_unknown(kind, values, counts):
    shown = stored(kind, *values)
    assert count_cells(shown) == counts
    assert count_cells(shown).keys() == LEGEND_BY_MAP[kind].keys()
    grey = (colour_cells(shown)[0] == GREY).all(axis=1)
    np.testing.assert_array_equal(grey, ~np.isfinite(values))


def test_the_colours_are_those_that_the_legend_names():
    red, green, blue = colour_cells(stored(SUITABILITY, -5.0, -1e-6, 0.0, 1.0))[0].astype(int).T
    assert (red[:2] > green[:2]).all()
    assert (green[2:] > red[2:]).all()
    red, green, blue = colour_cells(stored(SLOPE, 0.0, 9.9, 10.1, 19.9, 20.1, 90.0))[0].astype(int).T
    assert (green[:2] > red[:2]).all()
    assert ((np.minimum(red, green) > blue + 60) & (red - green < 60))[2:4].all()
    assert (red[4:] > green[4:] + 60).all()
    red, green, blue = colour_cells(stored(HEIGHT_ERROR, 0.05, -0.05, 0.0))[0].astype(int).T
    assert red[0] > blue[0] + 60
    assert blue[1] > red[1] + 60
    assert red[2] == green[2] == blue[2] > 240
