"""A photograph beside its twin: masks of both."""

from __future__ import annotations

from dataclasses import dataclass

from ...support.arrays import Array
from .scene import Twin


@dataclass(frozen=True)
class Masks:
    """Rock and shadow (H, W) of a photograph as labelled and as rendered, without what has no scan; and its twin.

    ``judged`` (H, W) is where the photograph shows the sandbox and what was scanned.
    """

    rock: Array
    shadow: Array
    our_rock: Array
    our_shadow: Array
    judged: Array
    twin: Twin
