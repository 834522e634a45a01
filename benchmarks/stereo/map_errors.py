"""The stated standard deviations of heights, slopes and roughnesses, checked on other grounds, without renders.

    python benchmarks map_errors --grounds 40

Pairs are made by rays, see ``stereo.learning.made_pairs``, each with another camera, Sun and faults. A matcher's scales
are fitted on every second ground and checked on the others: the shares of errors within one and two standard
deviations, with 95 % intervals over grounds, beside the shares of normal errors. Grounds with hanging shapes are left
out, and so is a pair on which a matcher knows no cell.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from icymoon.stereo.decisions.cell_errors import fill_gaps, measure_sampling_variance, state_errors
from icymoon.stereo.decisions.dem import Dem, Grid, make_dem
from icymoon.stereo.decisions.footprints import average_under_footprint
from icymoon.stereo.decisions.height_errors import QUANTITIES, check_scale, count_errors, fit_scales, state_shape
from icymoon.stereo.decisions.rules import Rules, SiteRules, read_rules
from icymoon.stereo.decisions.safe_sites import SiteLayers, measure_layers
from icymoon.stereo.design.made_workspaces import find_top_heights
from icymoon.stereo.learning.grounds import Ground, build_ground, draw_recipe, make_split_generator, release_ground
from icymoon.stereo.learning.made_pairs import CROPS_PER_GROUND, MadePairs, draw_view
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.search_range import AUTO, find_true_range
from icymoon.support.arrays import Array

SIZE_PX = (320, 240)
#: Cells along a side, cells of a footprint, pixels of a cell at the middle of the near ground, and least disparity, px.
CELLS, FOOTPRINT_CELLS, CELL_PX, MIN_PX = 60, 8, 6, 2.0
#: Share of the ground, the nearest, around whose middle the cells are.
NEAR_SHARE = 0.6
RULES = read_rules()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--grounds", type=int, default=40, help="grounds, with hanging shapes or without")
    parser.add_argument("--pairs", type=int, default=2, help="pairs of each ground")
    parser.add_argument("--seed", type=int, default=0, help="seed of the grounds")
    parser.add_argument("--methods", default="bm,sgbm,jplv", help="matchers")


def place_cells(position: Array, depth: Array, focal_px: float) -> Grid:
    """Cells around the middle of the nearest points (n, 3) with depths (n,)."""
    near = depth < np.quantile(depth, NEAR_SHARE)
    side = CELL_PX * float(np.median(depth[near])) / focal_px
    east, north = np.median(position[near, :2], axis=0)
    half = CELLS * side / 2
    return Grid(side, CELLS, CELLS, float(east - half), float(north + half))


def scale_rules(cell_m: float) -> tuple[Rules, SiteRules]:
    """The shipped rules with a footprint of ``FOOTPRINT_CELLS`` cells, and gaps of one cell."""
    site = replace(RULES.site, disc_m=FOOTPRINT_CELLS * cell_m)
    return replace(RULES, site=site, cells=replace(RULES.cells, gap_m=cell_m)), site


def measure(dem: Dem, site: SiteRules, **errors: Any) -> SiteLayers:
    """The layers of an elevation model on lit ground in reach."""
    everywhere = np.ones(dem.height_m.shape)
    return measure_layers(dem, 90.0 * everywhere, everywhere, site, **errors)


def count_pair(position: Array, grid: Grid, true: Dem) -> dict[str, Any]:
    """The errors of the maps of points (n, 3), counted in units of their shape."""
    rules, site = scale_rules(grid.cell_m)
    dem = make_dem(position, grid, round(rules.cells.fewest_points))
    stated = state_errors(dem, measure_sampling_variance(position, grid, site.disc_m))
    dem, errors = fill_gaps(dem, stated, rules.cells.gap_m, site.disc_m, site.rock_height_m / 2)
    layers, exact = measure(dem, site, errors=errors, debias=rules.cells.debias), measure(true, site)
    shape = state_shape(dem, errors, layers.slope_deg, site.disc_m)
    everywhere = np.ones(dem.height_m.shape, bool)
    inside = average_under_footprint(everywhere, grid.cell_m, site.disc_m) > 1 - 1e-6
    return {
        "height": count_errors(dem.height_m - true.height_m, shape.height, everywhere),
        "slope": count_errors(layers.slope_deg - exact.slope_deg, shape.slope, inside),
        "roughness": count_errors(layers.roughness_m - exact.roughness_m, shape.roughness, inside),
    }


def decide(ground: Ground, number: int, methods: list[str]) -> dict[str, dict[str, Any]]:
    """The numbers of a pair of a ground by matcher."""
    split = ground.recipe.split
    made = MadePairs(split, ground.recipe.seed, SIZE_PX)
    sample = made.make_sample(ground, number)
    # The same random numbers as the sample's give its cameras.
    random = make_split_generator(made.seed, split, ground.recipe.number, 3, number)
    eye = draw_view(ground, split, SIZE_PX, random).left
    rays, scale = eye.directions(np.arange(SIZE_PX[0] * SIZE_PX[1])), sample["focal_px"] * sample["baseline_m"]

    def project(disparity: Array) -> tuple[Array, Array]:
        known = np.flatnonzero(np.isfinite(disparity) & (disparity > MIN_PX))
        depth = scale / disparity.ravel()[known].astype(np.float64)
        return eye.position + rays[known] * depth[:, None], depth

    exact = np.where(sample["valid"], sample["disparity_px"], np.nan).astype(np.float64)
    grid = place_cells(*project(exact), eye.focal_px)
    height = find_top_heights(ground, grid)
    true = Dem(grid, height, np.isfinite(height).astype(int))
    left, right = (np.rint(255 * np.clip(sample[name][0], 0, 1)).astype(np.uint8) for name in ("left", "right"))
    searched = find_true_range(exact)
    found = {}
    for method in methods:
        disparity, _, _ = match(method, left, right, ranges={AUTO: searched} if searched else {})
        found[method] = {"errors": count_pair(project(disparity)[0], grid, true)}
    return found


def decide_on_grounds(
    grounds: int, pairs: int, methods: list[str], seed: int = 0
) -> list[dict[str, list[dict[str, Any]]]]:
    """The numbers of the pairs of each ground by matcher."""
    found = []
    for number in range(grounds):
        recipe = draw_recipe(seed, "ground", number)
        if recipe.shapes:
            continue
        ground = build_ground(recipe)
        try:
            made = [decide(ground, number * CROPS_PER_GROUND + k, methods) for k in range(pairs)]
        finally:
            release_ground(ground)
        found.append({method: [each[method] for each in made] for method in methods})
    return found


def main(options: argparse.Namespace) -> None:
    """Make the pairs and print a table."""
    methods = options.methods.split(",")
    grounds = decide_on_grounds(options.grounds, options.pairs, methods, options.seed)
    print(f"{'matcher':<10}{'quantity':<12}{'scale':>8}{'grounds':>9}{'1 sigma (0.683)':>26}{'2 sigma (0.954)':>26}")
    for method in methods:
        own = [ground[method] for ground in grounds]
        scales = fit_scales(own[::2])
        for name in QUANTITIES:
            scale = scales[name]
            found = None if scale is None else check_scale(own[1::2], name, scale)
            if found is not None and scale is not None:
                shares = [
                    f"{share:.3f} ({low or 0:.3f} to {high or 1:.3f})"
                    for share, (low, high) in zip(found["within"], found["bounds"], strict=True)
                ]
                print(
                    f"{method:<10}{name:<12}{scale:8.2f}{found['grounds']:9}"
                    + "".join(f"{each:>26}" for each in shares)
                )
