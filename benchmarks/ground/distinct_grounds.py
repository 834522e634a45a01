"""Whether terrain presets are distinct grounds: correlations of their heights at one seed.

    python benchmarks distinct_grounds [SEED ...]        seed 1 by default

Heights on 129 x 129 points of the patch, less their mean plane. For each seed it prints the matrix, and then the
largest and the median absolute value: of the whole heights, and without waves of 4 m and longer, of which a patch of
20 m contains so few that chance alone correlates two grounds.
"""

from __future__ import annotations

import argparse

import numpy as np
from icymoon.physics.terrain.roughness.statistics import remove_plane
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings import description, preset_files
from icymoon.support.arrays import Array

#: Points per side of the grid, and the shortest wave that is left out of the heights without long waves.
POINTS, LONG_M = 129, 4.0
NAMES = preset_files.preset_names("terrains")


def correlate_presets(seed: int, points: int = POINTS, long_waves: bool = True) -> Array:
    """The correlations (n, n) of the heights of all terrain presets at one seed, with or without long waves."""
    fields = []
    for name in NAMES:
        settings = description.merged(description.defaults(), preset_files.load_preset(name))
        ground = make_terrain(settings, seed)
        axis = np.linspace(-ground.size_m / 2, ground.size_m / 2, points)
        x, y = axis[None, :], axis[:, None]
        heights = ground.heights(x, y, 2 * (axis[1] - axis[0]))
        fields.append(remove_plane(heights if long_waves else heights - ground.heights(x, y, LONG_M)).ravel())
    return np.corrcoef(fields)


def of_pairs(matrix: Array) -> Array:
    """The absolute correlation of each pair of presets."""
    return np.abs(matrix[np.triu_indices(len(matrix), 1)])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("seeds", nargs="*", type=int, default=[1], metavar="SEED")


def main(options: argparse.Namespace) -> None:
    """Print the matrix of each seed."""
    for seed in options.seeds:
        matrix = correlate_presets(seed)
        print(f"seed {seed:<20}" + "".join(f"{k + 1:>6}" for k in range(len(NAMES))))
        for k, (name, row) in enumerate(zip(NAMES, matrix, strict=True)):
            print(f"{k + 1:>2} {name.split('/')[1]:<22}" + "".join(f"{value:>6.2f}" for value in row))
        for what, found in (
            ("whole heights", of_pairs(matrix)),
            (f"waves under {LONG_M:g} m", of_pairs(correlate_presets(seed, long_waves=False))),
        ):
            print(
                f"{what}: largest {found.max():.2f}, median {np.median(found):.2f}, "
                f"{np.mean(found >= 0.3):.0%} of {len(found)} pairs of presets at 0.3 or above",
                flush=True,
            )
