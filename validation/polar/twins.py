"""A photograph beside its twin: masks of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import Twin


@dataclass(frozen=True)
class Masks:
    """Rock and shadow (H, W) of a photograph as labelled and as rendered, without what has no scan; and its twin.

    ``judged`` (H, W) is where the photograph shows the sandbox and what was scanned.
    """

    rock: np.ndarray
    shadow: np.ndarray
    our_rock: np.ndarray
    our_shadow: np.ndarray
    judged: np.ndarray
    twin: Twin
