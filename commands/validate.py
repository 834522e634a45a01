"""The verb ``validate``: Icy Moon beside independent measurements and other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..support.terminal import add_repeatable_option, as_path
from ..validation.all_comparisons import MODULES
from .renderer_options import add_blender_option


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``validate``."""
    names = ", ".join(MODULES)
    add_repeatable_option(parser, "--only", "NAME", f"one comparison; may repeat ({names}; all)")
    parser.add_argument("--quick", action="store_true", help="only what takes a minute, with fewer cases")
    add_repeatable_option(
        parser,
        "--own",
        "FILE.py",
        "Python file with a comparison of your own, which is run; may repeat",
        type=as_path,
        dest="own_files",
    )
    parser.add_argument(
        "--polar",
        type=as_path,
        metavar="FOLDER",
        help="labels and scanned rocks of POLAR-Sim, a real scene that is rendered again; see Validation in the manual",
    )
    parser.add_argument(
        "--frost",
        type=as_path,
        metavar="FOLDER",
        help="NASA's FROST scans of real ground as PLY or OBJ, compared with the terrain presets; see Validation",
    )
    parser.add_argument(
        "--out",
        type=as_path,
        default=Path("out/validation"),
        help="folder for renders, the tables validation.json and validation.md, and pictures (%(default)s)",
    )
    parser.add_argument(
        "--page", type=as_path, metavar="FILE.md", help="page whose sections of these comparisons are written anew"
    )
    add_blender_option(parser)
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    parser.set_defaults(run=_run_validate_verb)


def _run_validate_verb(options: argparse.Namespace) -> int:
    from .run_validation import run_validate  # whose comparisons every other verb would import too

    return run_validate(options)
