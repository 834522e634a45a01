"""The comparisons that are shipped."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .comparison import Comparison

#: The names of the comparisons and their modules here, in the order of the page. The command line needs only the names.
MODULES = {
    "albedos": "moon_albedos",
    "colours": "colours",
    "codes": "other_codes",
    "disc": "whole_disc",
    "snow": "snow_law",
    "mitsuba": "second_renderer",
    "ground": "ground_statistics",
    "polar": "polar_sandbox",
    "frost": "frost",
}


def load_comparisons() -> tuple[Comparison, ...]:
    """Load the comparisons, in the order of the page."""
    return tuple(import_module(f"{__package__}.{module}").COMPARISON for module in MODULES.values())
