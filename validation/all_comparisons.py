"""The comparisons that are shipped, in the order of the page."""

from __future__ import annotations

from . import colours, moon_albedos, other_codes, polar_sandbox, second_renderer, snow_law, whole_disc
from .comparison import Comparison

COMPARISONS: tuple[Comparison, ...] = (
    moon_albedos.COMPARISON, colours.COMPARISON, other_codes.COMPARISON, whole_disc.COMPARISON,
    snow_law.COMPARISON, second_renderer.COMPARISON, polar_sandbox.COMPARISON)
