"""One seed, many independent random streams.

Every random choice of a data set comes from its one seed. Each concern has its own child of the seed, so that adding a
rock does not move a hill, and rendering again does not change the ground.
"""

from __future__ import annotations

import numpy as np

#: The concerns, in an order that never changes: the position is the child's spawn key.
STREAMS = (
    "terrain",
    "rocks",
    "surface",
    "render",
    "sensor",
    "statistics",
    "stars",
    "plan",
    "stand_ins",
    "training",
    "bake",
    "pose",
    "lidar",
    "range_points",
)


def seed_stream(seed: int, concern: str, *index: int) -> np.random.SeedSequence:
    """Make the seed sequence of one concern, optionally of one element of it (a pair, an eye, a rock).

    It equals the sequence that ``SeedSequence(seed).spawn(len(STREAMS))`` gives at the concern's position, with
    ``index`` spawned from there.
    """
    return np.random.SeedSequence(seed, spawn_key=(STREAMS.index(concern), *index))


def make_generator(seed: int, concern: str, *index: int) -> np.random.Generator:
    """Make a numpy generator on ``seed_stream(seed, concern, *index)``."""
    return np.random.default_rng(seed_stream(seed, concern, *index))


def make_ground_generator(seed: int, variant: int, *index: int) -> np.random.Generator:
    """Make a numpy generator for the ground's relief, layers or landforms; ``variant`` is ``terrain.variant``.

    Variant 0 is the ground of versions without variants, so it adds nothing to the spawn key.
    """
    return make_generator(seed, "terrain", *index, *([variant] if variant else []))
