"""The options for the Blender and the graphics cards that render: ``--blender`` and ``--cards``."""

from __future__ import annotations

import argparse
import sys


def add_blender_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--blender``."""
    parser.add_argument("--blender", default=sys.executable, help="Blender, or a Python with bpy (this Python)")


def add_cards_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--cards``."""
    parser.add_argument(
        "--cards",
        default="",
        metavar="N,N",
        help="graphics cards for scenes with quality.device GPU, "
        "numbered as icymoon doctor lists them; each worker takes one (ICYMOON_CARDS, or all)",
    )
