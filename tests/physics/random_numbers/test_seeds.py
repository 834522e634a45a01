"""Random streams."""

from __future__ import annotations

import numpy as np
from icymoon.physics.random_numbers.seeds import STREAMS, make_generator, seed_stream


def test_streams_are_the_spawned_children_of_the_seed():
    children = np.random.SeedSequence(42).spawn(len(STREAMS))
    for name, child in zip(STREAMS, children, strict=True):
        assert np.array_equal(seed_stream(42, name).generate_state(4), child.generate_state(4))
    assert make_generator(42, "rocks").random() != make_generator(42, "terrain").random()
