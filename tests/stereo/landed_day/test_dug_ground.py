"""The ground by rays of a landed day: untouched as it was, and dug by the volume that the excavation states."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.rays.stereo_truth import list_squares
from icymoon.settings.description import merged
from icymoon.stereo.design.default_lander import GENTLE_TERRAINS, LANDER
from icymoon.stereo.design.made_workspaces import draw_recipes
from icymoon.stereo.landed_day.dug_ground import dig_ground, open_series
from icymoon.stereo.learning.grounds import Variety, build_ground, release_ground

LENGTH_M, WIDTH_M, BITE_M = 0.2, 0.08, 0.02


@pytest.fixture(scope="module")
def ground():
    (recipe,) = draw_recipes(0, "ground", 1, Variety(GENTLE_TERRAINS))
    made = build_ground(recipe)
    yield made
    release_ground(made)


@pytest.fixture(scope="module")
def series(ground):
    east, north = ground.recipe.place_m
    trench = {
        "path": "LINE",
        "start_x_m": east + 0.3,
        "start_y_m": north + 1.7,
        "length_m": LENGTH_M,
        "width_m": WIDTH_M,
        "bite_m": BITE_M,
        "states": 4,
    }
    return open_series(ground, merged(LANDER, {"excavation": trench}), 1)


def look_down(ground, grid):
    """Heights (rows, columns) of the middles of a grid's cells."""
    east, north = np.meshgrid(grid.east_m[:-1] + grid.cell_m / 2, grid.north_m[:-1] + grid.cell_m / 2)
    start = np.stack([east.ravel(), north.ravel(), np.full(east.size, 30.0)], axis=1)
    down = np.tile([0.0, 0.0, -1.0], (east.size, 1))
    found = np.concatenate(
        [ground.tracer.intersect(start[some], down[some], 0.0, 1e3).along for some in list_squares(*east.shape)]
    )
    order = np.concatenate(list(list_squares(*east.shape)))
    heights = np.empty(east.size)
    heights[order] = 30.0 - found
    return heights.reshape(east.shape)


def test_the_patch_of_untouched_ground_changes_nothing(ground, series):
    """Between vertices 2.5 mm apart, the patch is within the bend of the ground's own triangles of some 2 cm."""
    same = dig_ground(ground, series, 0)
    try:
        off = look_down(same, series.site.grid) - look_down(ground, series.site.grid)
    finally:
        release_ground(same)
    assert np.abs(off).max() < 5e-4
    assert np.abs(off).mean() < 3e-5


@pytest.mark.parametrize("bites", [1, 3])
def test_the_trench_in_the_rays_has_the_volume_of_the_excavation(ground, series, bites):
    """Rays through the middles of cells of two triangles measure their volume but for the noise of single precision."""
    series.at(bites)
    dug = dig_ground(ground, series, bites)
    grid = series.site.grid
    try:
        change = look_down(dug, grid) - look_down(ground, grid)
    finally:
        release_ground(dug)
    west, south, east, north = series.site.trench_m
    columns = (grid.east_m[:-1] > west) & (grid.east_m[1:] < east)
    rows = (grid.north_m[:-1] > south) & (grid.north_m[1:] < north)
    found = -change[np.ix_(rows, columns)].sum() * grid.cell_m**2
    stated = -series.facts(bites)["change_in_region_by_state_m3"][-1]
    assert found == pytest.approx(stated, rel=0.01)
    # The blade cuts a prism; chips of the rims add up to a tenth.
    assert 1.0 <= stated / (bites * BITE_M * LENGTH_M * WIDTH_M) < 1.1


def test_nothing_is_dug_at_the_border_of_the_patch(series):
    series.at(3)
    change = np.abs(series.at(3).layers.top - series.before_m)
    border = np.ones(change.shape, bool)
    width = round(0.05 / series.site.grid.cell_m)
    border[width:-width, width:-width] = False
    assert change.max() > 2 * BITE_M
    assert change[border].max() == 0
