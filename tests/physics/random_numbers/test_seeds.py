"""Random streams."""

from __future__ import annotations

import numpy as np
from icymoon.physics.random_numbers.seeds import STREAMS, generator, stream


def test_streams_are_the_spawned_children_of_the_seed():
    children = np.random.SeedSequence(42).spawn(len(STREAMS))
    for name, child in zip(STREAMS, children, strict=True):
        assert np.array_equal(stream(42, name).generate_state(4), child.generate_state(4))
    assert generator(42, "rocks").random() != generator(42, "terrain").random()
